"""What the tests share: small problems, a rough design, and quiet single-threaded NGSolve."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

# The tests share the processors by running side by side. Threads of a library that wait for work
# spin, and made a notebook beside other tests take ten times as long.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import ngsolve as ng
import numpy as np
import pytest
from hypothesis import settings
from support.designs import rough_coefficients

from ngspring.design.design import Design
from ngspring.fem import process
from ngspring.fem.process import available, parallel
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

# A busy machine must not fail a property test.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")


@pytest.hookimpl(optionalhook=True)  # known to pytest-xdist only
def pytest_xdist_auto_num_workers() -> int:
    """Processes for ``-n auto``: one a processor, no more than the longest file leaves work for."""
    return min(available(), 4)


@pytest.fixture(scope="session", autouse=True)
def heard_interrupts() -> None:
    """Ctrl-C reaches the processes that tests start.

    A shell starts what it puts into the background with SIGINT ignored, and children inherit that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def quiet_ngsolve() -> Iterator[None]:
    """No messages, and one thread wherever no number is given: the tests share the processors.

    NGSolve's idle workers spin. Where each of two processes had two of them, an analysis that
    takes its default took several times as long.
    """
    ng.ngsglobals.msg_level = 0
    with pytest.MonkeyPatch.context() as patch, parallel(1):
        patch.setattr(process, "available", lambda: 1)
        yield


@pytest.fixture
def all_processors(monkeypatch: pytest.MonkeyPatch) -> int:
    """The default number of threads is a user's again; how many there are."""
    monkeypatch.setattr(process, "available", available)
    return available()


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(20230916)


@pytest.fixture(params=["plane strain", "axisymmetric"])
def kinematics(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=["quarter", "full"])
def domain(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def coarse(kinematics: str, domain: str) -> SpringProblem:
    """8 x 8 elements, not square, every length and weight different from one."""
    return SpringProblem(
        (ControlPoint(9.0, 1.5),),
        kinematics=kinematics,
        domain=domain,
        elements=8,
        L=90.0,
        H=110.0,
        T=1.7,
    )


@pytest.fixture
def balanced(kinematics: str) -> SpringProblem:
    """Every term of C* counts: weights of similar effect, slopes above the limit, offsets eta.

    With Table 1's weights a wrong volume term (1e-8) would hide behind the mechanics.
    """
    unit = 1.0 if kinematics == "plane strain" else 40.0
    points = (
        ControlPoint(6.0, 1.0 * unit, weight=0.7 / unit**2),
        ControlPoint(-5.0, -1.4 * unit, weight=2.0 / unit**2, eta=-0.8),
        ControlPoint(6.0, 1.6 * unit, weight=0.3 / unit**2, eta=1.3),
    )
    return SpringProblem(
        points,
        kinematics=kinematics,
        elements=8,
        L=90.0,
        H=110.0,
        T=1.7,
        k_r=1e-3,
        k_rho=1e-4 / unit,
        k_i=0.5 / unit,
        k_H=0.1 / unit,
        l_i=30.0,
    )


@pytest.fixture
def rough(balanced: SpringProblem) -> Design:
    return Design(balanced, rough_coefficients(balanced))

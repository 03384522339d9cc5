"""What the tests share: small problems, a rough design, and quiet single-threaded NGSolve."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import ngsolve as ng
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import settings
from scipy.sparse.linalg import splu

from ngspring.design import Design
from ngspring.kkt import CoupledSystem, Residual, State
from ngspring.linear import symmetric
from ngspring.problem import KINEMATICS, ControlPoint, SpringProblem
from ngspring.spaces import stretched
from ngspring.splines import FloatArray
from ngspring.threads import available, parallel

# A busy machine must not fail a property test.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")


@pytest.hookimpl(optionalhook=True)  # known to pytest-xdist only
def pytest_xdist_auto_num_workers() -> int:
    """Processes for ``-n auto``: one a processor, no more than the longest file leaves work for."""
    return min(available(), 4)


@pytest.fixture(scope="session", autouse=True)
def quiet_ngsolve() -> Iterator[None]:
    """No messages, and one thread: the meshes are too small for more."""
    ng.ngsglobals.msg_level = 0
    with parallel(1):
        yield


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(20230916)


@pytest.fixture(params=KINEMATICS)
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


def rough_coefficients(problem: SpringProblem) -> FloatArray:
    """Solid (chi about 4) to void (about -7.5), with noise, on the coefficients of a problem."""
    column = Design.from_function(
        problem,
        lambda x, y: (
            6 * np.cos(2 * np.pi * (x / problem.L - 0.5))
            - 2
            + 3 * np.cos(2 * np.pi * y / problem.H) * np.cos(4 * np.pi * x / problem.L)
        ),
    )
    noise = np.random.default_rng(7).uniform(-0.4, 0.4, problem.coefficient_shape)
    return column.coefficients + noise


@pytest.fixture
def rough(balanced: SpringProblem) -> Design:
    return Design(balanced, rough_coefficients(balanced))


FIELDS = ("chi", "u", "lam")


class Flat:
    """The coupled system as functions of one vector (chi, u_1, u_2, ..., lam_1, lam_2, ...).

    Its state is rough in every field, far from equilibrium, with no element inverted.
    """

    dt = 3e3

    def __init__(self, design: Design, domain: str = "quarter", solver: str = "auto") -> None:
        self.problem = design.problem.replace(domain=domain)
        self.system = system = CoupledSystem(self.problem, solver)
        points, n = system.points, system.free
        self.shapes = ((system.coefficients,), (len(points), n), (len(points), n + 1))
        random = np.random.default_rng(5)
        unit = system.displacement.restrict(stretched(system.scalar))[:-1]
        u = [p.d * unit + 0.4 * random.uniform(-1, 1, n) for p in points]
        size = 0.3 * np.array([abs(p.q) * p.weight for p in points])[:, None]
        lam = size * random.uniform(-1, 1, self.shapes[2])
        self.x = self.vector(State(design.coefficients.ravel(), np.array(u), lam))
        self.chi_old = design.coefficients.ravel() + random.uniform(-1, 1, system.coefficients)

    @staticmethod
    def vector(of: State | Residual) -> FloatArray:
        return np.concatenate([of.chi, of.u.ravel(), of.lam.ravel()])

    def field(self, name: str) -> slice:
        """Where a field stands in the vector; "all" for all of them."""
        if name == "all":
            return slice(None)
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in self.shapes)])
        i = FIELDS.index(name)
        return slice(ends[i], ends[i + 1])

    def state(self, x: FloatArray) -> State:
        parts = (x[self.field(name)].copy() for name in FIELDS)
        return State(*(p.reshape(shape) for p, shape in zip(parts, self.shapes, strict=True)))

    def residual(self, x: FloatArray) -> FloatArray:
        return self.vector(self.system.residual(self.state(x), self.chi_old, self.dt))

    def as_residual(self, r: FloatArray) -> Residual:
        state = self.state(r)
        return Residual(state.chi, state.u, state.lam, {})

    def matrix(self, x: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Product with the Newton matrix, out of the transformed triangle that is factorised."""
        system = self.system
        system.assemble(self.state(x), self.dt)
        assert system._maps is not None
        packed = symmetric(system._maps.triangle)
        unit = np.eye(system.unknowns)
        columns = [sp.csc_matrix(self.vector(system._unpack(e))[:, None]) for e in unit]
        inverse = splu(sp.hstack(columns, format="csc"))
        return lambda d: inverse.solve(packed @ inverse.solve(d), "T")

    def direction(self, field: str, seed: int = 0) -> FloatArray:
        d = np.zeros_like(self.x)
        part = self.field(field)
        d[part] = np.random.default_rng(seed).uniform(-1, 1, d[part].shape)
        return d

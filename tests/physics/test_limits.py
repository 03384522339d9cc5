"""Strains stay in bounds: the terms that see a stretch or an energy density beyond its limit."""

from __future__ import annotations

import math
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh
from support.coupled import Flat, orders

import ngspring
from ngspring import ControlPoint, Design, ProblemError, SpringProblem
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.physics.chi import rho
from ngspring.physics.elasticity import strain_energy
from ngspring.physics.terms.base import Fields
from ngspring.physics.terms.energy_limit import EnergyLimit
from ngspring.physics.terms.stretch_limit import StretchLimit

LIMITS = {
    "stretch": {"stretch_limit": 1.01, "k_s": 1e5},
    "energy": {"energy_limit": 4e-4, "k_s": 0.1},
    "walls": {"wall": 30.0, "k_w": 1e-4},
    "gaps": {"gap": 30.0, "k_w": 1e-4},
}


def problem_with(kinematics: str, **changes: Any) -> SpringProblem:
    unit = 1.0 if kinematics == "plane strain" else 50.0
    points = (
        ControlPoint(5.0, 2.0 * unit, weight=1 / unit**2),
        ControlPoint(-5.0, -2.0 * unit, weight=1 / unit**2, eta=0.5),
    )
    values = {"elements": 8, "kinematics": kinematics, "l_i": 10.0, "k_s": 1.0, **changes}
    return SpringProblem(points, **values)


@pytest.fixture(params=LIMITS)
def term(request: pytest.FixtureRequest) -> str:
    """The name of a term that is not zero."""
    return str(request.param)


@pytest.fixture
def spring(kinematics: str, term: str) -> SpringProblem:
    return problem_with(kinematics, **LIMITS[term])


def density_of(
    term: StretchLimit | EnergyLimit,
    problem: SpringProblem,
    F: list[list[float]],
    chi: float = 40.0,
) -> float:
    """The term's density where u is linear, at the middle of the left half; in the solid."""
    x, y = problem.L / 4, problem.H / 2
    a = np.array(F) - np.eye(2)
    # On the axis nothing moves across it.
    x0 = problem.L / 2
    u = ng.CF((a[0, 0] * (ng.x - x0) + a[0, 1] * ng.y, a[1, 0] * ng.x + a[1, 1] * ng.y))
    grad = ng.CF(tuple(a.ravel()), dims=(2, 2))
    fields = Fields(ng.CF(chi), ng.CF((0, 0)), ng.CF((0, 0, 0, 0), dims=(2, 2)), u, grad)
    density = term.density(fields, problem)
    mesh = rectangle(problem)
    return float(density(mesh(x, y)))


def rectangle(problem: SpringProblem) -> Any:
    return MakeStructured2DMesh(nx=2, ny=2, mapping=lambda x, y: (problem.L * x, problem.H * y))


# -- what they are ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kinematics", ["plane strain", "axisymmetric"])
def test_the_largest_principal_stretch_counts_whatever_turns(kinematics: str) -> None:
    problem = problem_with(kinematics, stretch_limit=1.5, k_s=1.0)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    stretch = np.diag([0.9, 1.8])
    expected = (1.8 / 1.5 - 1) ** 6 / 6
    for F in (stretch, stretch @ turn):
        # u_r / r of a rotated one is no stretch around the axis: only the plane is looked at.
        if kinematics == "axisymmetric" and F is not stretch:
            continue
        found = density_of(StretchLimit(), problem, F.tolist())
        assert found == pytest.approx(expected, rel=1e-9)
    assert density_of(StretchLimit(), problem, [[1.0, 0.0], [0.0, 1.49]]) == 0.0


def test_the_stretch_around_the_axis_counts_too() -> None:
    problem = problem_with("axisymmetric", stretch_limit=1.5, k_s=1.0)
    # u_x is 0.8 times the distance from the axis: both stretches in the plane's x and around.
    found = density_of(StretchLimit(), problem, [[1.8, 0.0], [0.0, 1.0]])
    assert found == pytest.approx(2 * (1.8 / 1.5 - 1) ** 6 / 6, rel=1e-9)


def test_the_energy_density_is_that_of_the_law() -> None:
    problem = problem_with("plane strain", energy_limit=0.01, k_s=1.0)
    F = [[0.9, 0.1], [0.0, 1.4]]
    grad = ng.CF(tuple((np.array(F) - np.eye(2)).ravel()), dims=(2, 2))
    density = strain_energy(ng.CF((0, 0)), grad, problem)
    mesh = rectangle(problem)
    energy = float(density(mesh(10.0, 10.0)))
    found = density_of(EnergyLimit(), problem, F)
    assert found == pytest.approx((energy / 0.01 - 1) ** 6 / 6, rel=1e-9)


def test_grey_may_stretch_the_more_the_thinner_it_is() -> None:
    problem = problem_with("plane strain", stretch_limit=1.5, k_s=1.0)
    solid = density_of(StretchLimit(), problem, [[1.0, 0.0], [0.0, 1.6]])
    for chi in (0.0, -4.0):
        stretch = 1.5 + 0.1 / rho(chi)
        grey = density_of(StretchLimit(), problem, [[1.0, 0.0], [0.0, stretch]], chi)
        assert grey == pytest.approx(solid, rel=1e-9)


# -- their derivatives -----------------------------------------------------------------------------


def test_taylor_remainders_of_the_objective_along_equilibria_are_of_second_order(
    spring: SpringProblem, term: str, random: np.random.Generator
) -> None:
    system = CoupledSystem(spring, "sparsecholesky")
    chi = Design.column(spring).coefficients
    direction = random.uniform(-1, 1, chi.shape)
    state = initial_state(system, Design(spring, chi))
    terms = system.terms(state)
    assert terms[term] > 0.05 * terms["C"]
    slope = float(system.residual(state, state.chi, np.inf).chi @ direction.ravel())
    steps = np.array([1e-2, 5e-3, 2.5e-3])
    remainders = [
        system.terms(initial_state(system, Design(spring, chi + t * direction)))["C"]
        - terms["C"]
        - t * slope
        for t in steps
    ]
    np.testing.assert_allclose(orders(np.array(remainders), steps), 2.0, atol=0.1)


def test_taylor_remainders_of_the_residual_are_of_second_order(
    spring: SpringProblem, random: np.random.Generator
) -> None:
    system = CoupledSystem(spring, "sparsecholesky")
    state = initial_state(system, Design.column(spring))
    residual = system.residual(state, state.chi, 1e3)
    system.assemble(state, 1e3)
    update = system.solve(residual)
    size = float(np.abs(update.chi).max())
    # The update solves J du = -r, so that r + t J du = (1 - t) r.
    steps = np.array([4e-3, 2e-3, 1e-3]) / size
    remainders = []
    for t in steps:
        moved = State(
            *(a + t * b for a, b in zip(vars(state).values(), vars(update).values(), strict=True))
        )
        there = Flat.vector(system.residual(moved, state.chi, 1e3))
        remainders.append(np.linalg.norm(there - (1 - t) * Flat.vector(residual)))
    np.testing.assert_allclose(orders(np.array(remainders), steps), 2.0, atol=0.1)


def test_at_rest_nothing_is_beyond_a_limit_and_derivatives_are_finite(kinematics: str) -> None:
    spring = problem_with(kinematics, stretch_limit=1.02, energy_limit=4e-4)
    system = CoupledSystem(spring, "sparsecholesky")
    state = initial_state(system, Design.column(spring))
    rest = State(state.chi, 0.0 * state.u, 0.0 * state.lam)
    points = [ControlPoint(1e-9, 1.0), ControlPoint(-1e-9, -1.0, eta=0.5)]
    system.retarget(points)
    assert system.residual(rest, rest.chi, 1.0).finite
    assert system.terms(rest)["stretch"] == 0.0
    assert system.terms(rest)["energy"] == 0.0


# -- what they do ----------------------------------------------------------------------------------


def test_quarter_and_full_domain_have_the_same_objective(spring: SpringProblem) -> None:
    values = []
    for domain in ("quarter", "full"):
        system = CoupledSystem(spring.replace(domain=domain), "sparsecholesky")
        values.append(system.terms(initial_state(system, Design.column(system.problem))))
    assert values[0]["C"] == pytest.approx(values[1]["C"], rel=1e-9)


@pytest.mark.long
def test_with_a_limit_the_solid_stretches_less_at_the_same_targets() -> None:
    points = ControlPoint(10, 2), ControlPoint(-10, -2)
    plain = SpringProblem(points, elements=12, l_i=80 / 12)
    limited = plain.replace(stretch_limit=1.12)
    found, widths = [], []
    for problem in (plain, limited):
        result = ngspring.optimize(problem, threads=1)
        assert result.converged
        assert result.q == pytest.approx([2.0, -2.0], rel=1e-3)
        assert ngspring.optimality(result.design).residual < 1e-8
        body = ngspring.mesh_body(result.design)
        curve = ngspring.contact_load_displacement(body, [10.0, -10.0], threads=1, onset=math.inf)
        found.append(float(curve.stretch_measure.max()))
        widths.append(result.design.relative_width)
    assert found[0] > 1.19
    assert found[1] < 1.05 * 1.12
    # It costs material.
    assert widths[1] > widths[0]


# -- as a user gives them --------------------------------------------------------------------------


def test_one_line_switches_it_on() -> None:
    problem = ngspring.cases["C4"].replace(stretch_limit=1.5)
    assert problem.k_s == pytest.approx(1e11 * problem.k_rho)
    assert SpringProblem.from_toml(problem.to_toml()) == problem
    assert not StretchLimit().active(ngspring.cases["C4"])
    assert ngspring.cases["C4"].k_s == 0.0


def test_a_similar_spring_has_similar_limits() -> None:
    problem = ngspring.cases["C4"].replace(stretch_limit=1.5, energy_limit=0.1)
    similar = ngspring.scaled(problem, length=2.0, stress=3.0)
    assert similar.stretch_limit == 1.5
    assert similar.energy_limit == pytest.approx(0.3)
    assert similar.k_s == pytest.approx(problem.k_s / 8)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stretch_limit": 1.0}, "stretch_limit = 1.0"),
        ({"stretch_limit": 0.5}, "stretch_limit = 0.5"),
        ({"stretch_limit": -2.0}, "stretch_limit = -2.0"),
        ({"stretch_limit": 1e3}, "stretch_limit = 1000.0"),
        ({"stretch_limit": float("nan")}, "stretch_limit"),
        ({"energy_limit": -1.0}, "energy_limit = -1.0"),
        ({"stretch_limit": 1.5, "k_s": -1.0}, "k_s = -1.0"),
        ({"stretch_limit": 1.5, "k_rho": 0.0}, "k_s is needed"),
    ],
)
def test_a_limit_that_means_nothing_is_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        ngspring.cases["C4"].replace(**changes)

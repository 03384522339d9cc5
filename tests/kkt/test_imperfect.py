"""Control points with an imperfection: exact on half of the domain, weak where springs buckle."""

from __future__ import annotations

import numpy as np
import pytest
from support.coupled import Flat, orders

from ngspring import ControlPoint, Design, SpringProblem
from ngspring.analysis.mechanics import Mechanics
from ngspring.basics.arrays import FloatArray
from ngspring.kkt.start import initial_state, state_near
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.problem.imperfection import Offset
from ngspring.problem.material import bulk_and_shear_modulus

KINDS = [
    ("plane strain", "xy"),
    ("plane strain", "x"),
    ("plane strain", "y"),
    ("axisymmetric", "y"),
]


def spring(kinematics: str, odd_in: str, domain: str = "quarter") -> SpringProblem:
    """Two perfect control points, and one that is imperfect and dilated."""
    unit = 1.0 if kinematics == "plane strain" else 50.0
    w = 1 / unit**2
    points = (
        ControlPoint(6.0, 2.0 * unit, w),
        ControlPoint(-6.0, -2.0 * unit, w),
        ControlPoint(-6.0, -2.0 * unit, 0.3 * w, eta=0.5, eta_odd=1.5, odd_in=odd_in),
    )
    return SpringProblem(points, elements=8, l_i=10.0, kinematics=kinematics, domain=domain)


def started(problem: SpringProblem) -> tuple[CoupledSystem, State]:
    system = CoupledSystem(problem, "sparsecholesky")
    return system, initial_state(system, Design.column(problem))


# -- half = full -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kinematics", "odd_in", "nu"),
    [*((*kind, 0.4) for kind in KINDS), (*KINDS[0], 0.499), (*KINDS[3], 0.499)],
)
def test_two_copies_of_the_quarter_are_the_full_domain(
    kinematics: str, odd_in: str, nu: float
) -> None:
    forces, residuals, updates, terms = [], [], [], []
    for domain in ("quarter", "full"):
        K, G = bulk_and_shear_modulus(1.0, nu)
        problem = spring(kinematics, odd_in, domain).replace(K=K, G=G)
        problem = problem.replace(stretch_limit=1.01, k_s=1e3)
        system, state = started(problem)
        before = state.chi + np.sin(np.arange(len(state.chi)))
        residual = system.residual(state, before, 1e3)
        system.assemble(state, 1e3)
        forces.append(state.forces(problem))
        residuals.append(residual.chi)
        updates.append(system.solve(residual).chi)
        terms.append(system.terms(state)["C"])
    assert forces[0] == pytest.approx(forces[1], rel=1e-11)
    # What it is compared with is no copy of the perfect one.
    assert abs(forces[0][2] / forces[0][1] - 1) > 0.05
    assert terms[0] == pytest.approx(terms[1], rel=1e-9)
    for quarter, full in (residuals, updates):
        np.testing.assert_allclose(quarter, full, rtol=0, atol=1e-9 * np.abs(full).max())


def test_the_imperfect_state_breaks_the_symmetries() -> None:
    problem = spring("plane strain", "xy")
    system, state = started(problem)
    one, other = system.images[2].fields(np.append(state.u[2, : system.images[2].free], -6.0))
    assert np.abs(one - other).max() > 0.5
    # The others have no second copy, and nothing where they have no displacements.
    assert len(system.images[0].copies) == 1
    assert not state.u[0, system.images[0].free :].any()


# -- derivatives -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("kinematics", "odd_in"), KINDS)
def test_the_matrix_is_the_symmetric_derivative_of_the_residual(
    kinematics: str, odd_in: str
) -> None:
    problem = spring(kinematics, odd_in)
    points = tuple(
        ControlPoint(p.d, p.q, p.weight, 0.2, eta_odd=1.0, odd_in=odd_in)
        for p in problem.control_points[:2]
    )
    flat = Flat(Design.column(problem.replace(control_points=points)))
    matrix = flat.matrix(flat.x)
    v, w = flat.direction("all", 1), flat.direction("all", 2)
    expected = flat.derivative(v)
    product = matrix(v)
    for block in ("chi", "u", "lam"):
        part = flat.field(block)
        size = np.abs(expected[part]).max()
        assert np.abs(product[part] - expected[part]).max() <= 2e-7 * size, block
    assert w @ product == pytest.approx(v @ matrix(w), rel=1e-9)


@pytest.mark.parametrize(("kinematics", "odd_in"), [KINDS[0], KINDS[3]])
def test_taylor_remainders_are_of_second_and_third_order(
    kinematics: str, odd_in: str, random: np.random.Generator
) -> None:
    problem = spring(kinematics, odd_in)
    system, state = started(problem)
    direction = random.uniform(-1, 1, state.chi.shape)
    slope = float(system.residual(state, state.chi, np.inf).chi @ direction)
    here = system.terms(state)["C"]
    steps = np.array([8e-2, 4e-2, 2e-2])
    values = [
        [system.terms(shifted(system, state, s * t * direction))["C"] for s in (1, -1)]
        for t in steps
    ]
    first = np.array(
        [ahead - here - t * slope for (ahead, _), t in zip(values, steps, strict=True)]
    )
    np.testing.assert_allclose(orders(first, steps), 2.0, atol=0.1)
    # Odd in t: the second derivative, whatever it is, falls out of it.
    third = np.array([a - b - 2 * t * slope for (a, b), t in zip(values, steps, strict=True)])
    np.testing.assert_allclose(orders(third, steps), 3.0, atol=0.15)


def shifted(system: CoupledSystem, state: State, by: FloatArray) -> State:
    """Equilibria near by of a chi that has moved."""
    return state_near(system, State(state.chi + by, state.u, state.lam))


# -- what it sees ----------------------------------------------------------------------------------


def test_the_force_is_an_even_function_of_the_imperfection() -> None:
    forces = []
    for eta_odd in (-0.8, 0.8, 0.4, 0.2, 0.0):
        points = (ControlPoint(-4.0, -2.0, eta_odd=eta_odd),)
        problem = SpringProblem(points, elements=8, l_i=10.0)
        _, state = started(problem)
        forces.append(float(state.forces(problem)[0]))
    assert forces[0] == pytest.approx(forces[1], rel=1e-10)
    far = np.abs(np.array(forces[1:4]) - forces[4])
    np.testing.assert_allclose(orders(far, np.array([0.8, 0.4, 0.2])), 2.0, atol=0.1)


@pytest.mark.long
def test_a_slender_column_that_buckles_carries_less_with_an_imperfection() -> None:
    problem = SpringProblem((ControlPoint(-8.0, -1.0),), elements=20, l_i=4.0)
    column = Design.from_function(problem, lambda x, y: 2.0 * (4.0 - np.abs(x - 50.0)))
    system = CoupledSystem(problem, "sparsecholesky")
    chi = system.extraction_chi @ column.coefficients.ravel()
    perfect = Mechanics(system.scalar, chi, 0.0, "sparsecholesky")
    imperfect = Mechanics(system.scalar, chi, Offset(odd=0.5), "sparsecholesky")
    ratios = []
    for d in (-0.5, -8.0):
        forces = [
            body.advanced(body.at_rest(), d, abs(d))[0].q if d > -1 else walked(body, d)
            for body in (perfect, imperfect)
        ]
        ratios.append(forces[1] / forces[0])
    assert ratios[0] == pytest.approx(1.0, abs=0.02)
    assert ratios[1] < 0.7


def walked(body: Mechanics, d: float) -> float:
    point = body.at_rest()
    for here in np.linspace(0, d, 33)[1:]:
        point = body.equilibrium(here, point.u + (here - point.d) * point.tangent)
    return point.q

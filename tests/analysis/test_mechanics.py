"""Forward analysis: known numbers, exact solutions, convergence, contact, and ends of paths."""

from __future__ import annotations

import logging

import ngsolve as ng
import numpy as np
import pytest
from scipy.optimize import brentq
from support.designs import rough_coefficients

from ngspring import load_displacement
from ngspring.analysis.mechanics import Mechanics
from ngspring.analysis.path import follow
from ngspring.analysis.response import Response
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError, NgspringError, ProblemError
from ngspring.design.design import Design
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

POINT = (ControlPoint(10.0, 2.0),)


def make(kinematics: str = "plane strain", elements: int = 8, **changes: object) -> SpringProblem:
    return SpringProblem(POINT, kinematics=kinematics, elements=elements).replace(**changes)


def formula() -> ng.CoefficientFunction:
    """The field of the independent code: X, Y from the centre."""
    X, Y = ng.x - 50, ng.y - 50
    across, along = 2 * ng.pi * X / 100, 2 * ng.pi * Y / 100
    return 6 * ng.cos(across) - 2 + 3 * ng.cos(along) * ng.cos(2 * across)


INDEPENDENT = {
    "plane strain": {
        10: 2.18353448288,
        20: 3.96417577960,
        -5: -1.29334572374,
        -10: -2.75958999413,
        -20: -6.38694503604,
    },
    "axisymmetric": {
        10: 52.71218803753,
        20: 96.92241166989,
        -5: -30.51243030380,
        -10: -64.49748659688,
        -20: -145.82975102085,
    },
}


@pytest.mark.long
def test_reaction_forces_of_an_independent_code(kinematics: str) -> None:
    expected = INDEPENDENT[kinematics]
    problem = make(kinematics, elements=40)
    response = load_displacement(formula(), expected, problem=problem, threads=1)
    assert response.complete
    np.testing.assert_array_equal(response.d, list(expected))
    np.testing.assert_allclose(response.q, list(expected.values()), rtol=1e-10, atol=0)


def test_quarter_and_full_domain_have_the_same_forces(kinematics: str) -> None:
    problem = make(kinematics, elements=12, L=90.0, H=110.0, T=1.3)
    design = Design(problem, 0.8 * rough_coefficients(problem))
    d = [-12.0, -4.0, 9.0]
    quarter, full = (
        load_displacement(design, d, domain=part, threads=1) for part in ("quarter", "full")
    )
    assert quarter.complete
    assert full.complete
    np.testing.assert_allclose(full.q, quarter.q, rtol=1e-9)
    np.testing.assert_allclose(full.energy, quarter.energy, rtol=1e-9)
    np.testing.assert_allclose(full.stiffness, quarter.stiffness, rtol=1e-8)


# -- exact solutions -----------------------------------------------------------------------------


def piola(F: FloatArray, K: float, G: float) -> FloatArray:
    """Eq. 17 for a diagonal F, as a vector."""
    J = float(np.prod(F))
    deviator = F**2 - (F**2).sum() / 3
    return (K * np.log(J) + G * J ** (-2 / 3) * deviator) / F


def free_width(stretch: float, problem: SpringProblem) -> tuple[float, float]:
    """Lateral stretch without lateral stress, and the axial stress P_22 that goes with it."""

    def F(lateral: float) -> FloatArray:
        hoop = lateral if problem.motion.axis else 1.0
        return np.array([lateral, stretch, hoop])

    lateral = brentq(lambda a: piola(F(a), problem.K, problem.G)[0], 0.1, 10, xtol=1e-15)
    return float(lateral), float(piola(F(lateral), problem.K, problem.G)[1])


@pytest.mark.parametrize("d", [-40.0, -1.0, 55.0])
def test_a_solid_block_deforms_uniformly_with_free_width(
    d: float, kinematics: str, domain: str
) -> None:
    problem = make(kinematics, elements=4, domain=domain, L=80.0, H=120.0, T=2.5)
    response = load_displacement(ng.CF(60.0), [d], problem=problem, threads=1)
    lateral, stress = free_width(1 + d / problem.H, problem)
    area = np.pi * (problem.L / 2) ** 2 if problem.motion.axis else problem.L * problem.T
    assert response.q[0] == pytest.approx(area * stress, rel=1e-10)
    x, y = response.nodes_x
    u_x, u_y = response.nodes_u[0]
    expected = (lateral - 1) * (x - problem.L / 2)[:, None]
    np.testing.assert_allclose(u_x, np.broadcast_to(expected, u_x.shape), atol=1e-8)
    expected = (y * d / problem.H)[None, :]
    np.testing.assert_allclose(u_y, np.broadcast_to(expected, u_y.shape), atol=1e-8)


def test_upright_layers_share_the_stretch_and_carry_force_by_their_stiffness() -> None:
    # chi(x) in plane strain: every layer keeps the same free width, so q = T P_22 int E(chi) dx.
    problem = make(elements=8, L=80.0, H=120.0, T=2.5)
    chi = 8 * ng.cos(2 * ng.pi * (ng.x / 80 - 0.5)) - 1
    response = load_displacement(chi, [-25.0, 30.0], problem=problem, threads=1)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    x = (np.arange(8)[:, None] + (nodes + 1) / 2) * 10
    rho = 1 / (1 + np.exp(1 - 8 * np.cos(2 * np.pi * (x / 80 - 0.5))))
    stiffness = problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho))
    width = float((stiffness * weights / 2 * 10).sum())
    for d, q in zip(response.d, response.q, strict=True):
        _, stress = free_width(1 + d / problem.H, problem)
        assert q == pytest.approx(problem.T * width * stress, rel=1e-10)


def test_a_soft_block_is_softer_by_e_of_chi_and_eta_shifts_it(kinematics: str) -> None:
    problem = make(kinematics, elements=4)
    solid, half, shifted = (
        load_displacement(ng.CF(chi), [-8.0], problem=problem, eta=eta, threads=1).q[0]
        for chi, eta in ((60.0, 0.0), (0.5, 0.0), (-1.5, 2.0))
    )
    rho = 1 / (1 + np.exp(-0.5))
    factor = problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho))
    assert half == pytest.approx(factor * solid, rel=1e-9)
    assert shifted == pytest.approx(half, rel=1e-12)


def test_small_strains_have_the_stiffness_of_linear_elasticity() -> None:
    d = 1e-4
    plane = make(elements=4)
    K, G = plane.K, plane.G
    E, nu = 9 * K * G / (3 * K + G), (3 * K - 2 * G) / (2 * (3 * K + G))
    response = load_displacement(ng.CF(60.0), [d], problem=plane, threads=1)
    assert response.q[0] / d == pytest.approx(E / (1 - nu**2) * plane.T, rel=1e-5)
    round_ = make("axisymmetric", elements=4)
    response = load_displacement(ng.CF(60.0), [d], problem=round_, threads=1)
    assert response.q[0] / d == pytest.approx(E * np.pi * 50**2 / 100, rel=1e-5)


# -- consistency and convergence -----------------------------------------------------------------


def test_force_is_the_derivative_of_energy_and_stiffness_that_of_force(kinematics: str) -> None:
    problem = make(kinematics, elements=12)
    design = Design(problem, 0.8 * rough_coefficients(problem))
    h = 0.02
    for d in (-15.0, 12.0):
        path = np.array([d + k * h for k in (-2, -1, 0, 1, 2)])
        response = load_displacement(design, path, threads=1)
        assert response.complete
        for f, derivative in (
            (response.energy, response.q[2]),
            (response.q, response.stiffness[2]),
        ):
            difference = (8 * (f[3] - f[1]) - (f[4] - f[0])) / (12 * h)
            assert difference == pytest.approx(derivative, rel=1e-7)


def test_energy_is_the_work_of_the_force_along_the_path() -> None:
    problem = make(elements=8)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    d = np.append(10 + 10 * nodes, 20.0)
    response = load_displacement(Design.column(problem), d, threads=1)
    work = float(10 * weights @ response.q[:-1])
    assert response.energy[-1] == pytest.approx(work, rel=1e-9)


def test_forces_converge_with_the_fourth_power_of_the_element_size(kinematics: str) -> None:
    # Q2 displacements: second order in the gradient, and the energy squares it.
    X, Y = 2 * ng.pi * (ng.x / 100 - 0.5), 2 * ng.pi * (ng.y / 100 - 0.5)
    chi = 1 + ng.cos(X) + ng.cos(Y) * ng.cos(X)
    q = np.array(
        [
            load_displacement(chi, [-10.0], problem=make(kinematics, elements=n), threads=1).q[0]
            for n in (8, 16, 32)
        ]
    )
    order = np.log2(abs(q[1] - q[0]) / abs(q[2] - q[1]))
    assert order == pytest.approx(4, abs=0.35), q
    # A conforming space is too stiff.
    assert (np.diff(np.abs(q)) < 0).all()


# -- contact -------------------------------------------------------------------------------------


def slit(width: float = 10.0) -> ng.CoefficientFunction:
    """A solid block, cut through by a horizontal slit at half height."""
    return 20 * ng.IfPos(ng.sqrt((ng.y - 50) ** 2) - width / 2, 1.0, -1.0)


def test_a_slit_that_closes_carries_force_like_a_block_without_it(kinematics: str) -> None:
    problem = make(kinematics, elements=20)
    d = [-2.0, -5.0, -8.0, -12.0, -15.0, -20.0]
    response = load_displacement(slit(), d, problem=problem, threads=1)
    assert response.complete, response.message
    area = np.pi * 50**2 if problem.motion.axis else 100.0
    q = dict(zip(response.d, response.q / area, strict=True))
    # Open: next to nothing (the largest stress of the block is 0.15 MPa).
    assert -1e-4 < q[-8.0] < q[-5.0] < q[-2.0] < 0
    # Closed: the rest of the block, 90 mm high, is compressed by what exceeds the slit.
    for d_closed in (-12.0, -15.0, -20.0):
        _, stress = free_width((100 + d_closed) / 90, problem)
        assert q[d_closed] == pytest.approx(stress, rel=0.03)
    # The contact surfaces do not pass through each other.
    heights = response.nodes_x[1] + response.nodes_u[:, 1]
    assert (np.diff(heights, axis=-1) > 0).all()


def test_tension_opens_a_slit_without_force() -> None:
    response = load_displacement(slit(), [15.0], problem=make(elements=20), threads=1)
    assert response.complete
    assert 0 < response.q[0] < 1e-3


# -- paths that end, and arguments ---------------------------------------------------------------


@pytest.mark.long
def test_a_path_that_cannot_be_followed_returns_what_it_reached(
    caplog: pytest.LogCaptureFixture,
) -> None:
    problem = make(elements=8)
    design = Design(problem, rough_coefficients(problem))
    with caplog.at_level(logging.WARNING):
        response = load_displacement(design, [-95.0, -5.0, 5.0, 0.0], threads=1)
    assert not response.complete
    assert response.d.tolist() == [-5.0, 5.0, 0.0]
    assert response.q.shape == response.energy.shape == response.stiffness.shape == (3,)
    assert "the path ends at d = -" in response.message
    assert "-95 mm" in response.message
    assert response.message in caplog.text


def test_equilibrium_that_does_not_exist_is_an_error() -> None:
    problem = make(elements=4)
    scalar = ScalarSpace(Grid(problem))
    mechanics = Mechanics(scalar, ng.CF(60.0))
    with pytest.raises(ConvergenceError, match="inverts"):
        mechanics.equilibrium(-150.0, mechanics.uniform_stretch(-150.0))


def test_every_step_is_told_and_targets_are_met_exactly() -> None:
    problem = make(elements=8)
    scalar = ScalarSpace(Grid(problem))
    mechanics = Mechanics(scalar, formula())
    seen: list[float] = []
    points, message = follow(
        mechanics, np.array([-3.3, -17.0]), on_point=lambda point: seen.append(point.d)
    )
    assert message == ""
    assert [point.d for point in points] == [-3.3, -17.0]
    assert {-3.3, -17.0} < set(seen)
    assert (np.diff(seen) < 0).all()


def test_at_rest_nothing_is_stored_or_moved(kinematics: str) -> None:
    response = load_displacement(formula(), [0.0], problem=make(kinematics), threads=1)
    assert response.d.tolist() == [0.0]
    assert abs(response.q[0]) < 1e-12
    assert abs(response.energy[0]) < 1e-12
    assert np.abs(response.nodes_u).max() < 1e-12
    assert response.stiffness[0] > 0


def test_the_order_of_displacements_does_not_matter() -> None:
    def run(d: list[float]) -> Response:
        return load_displacement(formula(), d, problem=make(), threads=1)

    a, b = run([5.0, -3.0, 0.0, 5.0]), run([-3.0, 0.0, 5.0])
    assert a.d.tolist() == [5.0, -3.0, 0.0, 5.0]
    assert b.d.tolist() == [-3.0, 0.0, 5.0]
    a = a.by_displacement()
    np.testing.assert_array_equal(a.q, b.q)
    assert a.u.shape[:2] == (3, 2)
    nx, ny = a.grid.cells
    assert a.nodes_u.shape == (3, 2, 2 * nx + 1, 2 * ny + 1)


@pytest.mark.parametrize("d", [100.0, -100.0, float("nan"), float("inf"), -250.0])
def test_displacements_must_be_finite_and_smaller_than_the_height(d: float) -> None:
    with pytest.raises(ProblemError, match=r"displacement .* H = 100 mm"):
        load_displacement(Design.column(make()), [5.0, d])


@pytest.mark.parametrize("d", [["five"], [None], 5.0, None])
def test_displacements_must_be_numbers(d: object) -> None:
    with pytest.raises(ProblemError, match="displacements must be numbers"):
        load_displacement(Design.column(make()), d)  # type: ignore[arg-type]


def test_displacements_must_not_be_empty() -> None:
    with pytest.raises(ProblemError, match="no displacements"):
        load_displacement(Design.column(make()), [])


def test_a_formula_needs_a_problem() -> None:
    with pytest.raises(ProblemError, match="problem"):
        load_displacement(formula(), [5.0])


def test_a_design_must_be_a_design_or_a_formula() -> None:
    with pytest.raises(ProblemError, match="neither"):
        load_displacement("C7", [5.0])  # type: ignore[arg-type]


@pytest.mark.parametrize("eta", [float("nan"), float("inf")])
def test_the_offset_must_be_finite(eta: float) -> None:
    with pytest.raises(NgspringError, match="eta"):
        load_displacement(Design.column(make()), [5.0], eta=eta, threads=1)


@pytest.mark.parametrize("changes", [{"domain": "half"}, {"solver": "umfpack"}])
def test_other_arguments_are_checked(changes: dict[str, object]) -> None:
    with pytest.raises(NgspringError):
        load_displacement(Design.column(make()), [5.0], threads=1, **changes)  # type: ignore[arg-type]


def test_responses_come_in_the_order_in_which_they_were_asked_for(kinematics: str) -> None:
    problem = SpringProblem((ControlPoint(5.0, 1.0),), elements=8, kinematics=kinematics)
    design = Design.column(problem)
    asked = [3.0, -2.0, 0.0, 3.0, -4.0]
    response = load_displacement(design, asked, threads=1)
    assert response.d.tolist() == asked
    for k, d in enumerate(asked):
        alone = load_displacement(design, [d], threads=1)
        assert response.q[k] == pytest.approx(alone.q[0], rel=1e-9, abs=1e-9)
        np.testing.assert_allclose(response.nodes_u[k], alone.nodes_u[0], atol=1e-9)
    curve = response.by_displacement()
    assert curve.d.tolist() == [-4.0, -2.0, 0.0, 3.0]
    assert curve.q.tolist() == sorted(curve.q.tolist())

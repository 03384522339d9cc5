"""The solid of a spring without contact: constraints, forces, stresses, stretches."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from scipy.optimize import brentq
from support.contact_bodies import block_with_hole, body_of, rectangle, spring

from ngspring.basics.errors import ProblemError
from ngspring.fem.grid import Grid
from ngspring.problem.spring import SpringProblem
from ngspring.solid.contact.elasticity import Solid, section_force, spring_density
from ngspring.solid.contact.response import contact_load_displacement
from ngspring.solid.contact.supports import spring_supports
from ngspring.solid.mesh.body import Body


def solid_of(body: Body) -> Solid:
    supports = spring_supports(body)
    return Solid(body.mesh, spring_density(body), supports.extraction.matrix, supports.floating)


def uniaxial_stress(problem: SpringProblem, stretch: float) -> float:
    """Nominal stress of a block with free sides, from the energy density of Eq. 14."""

    def stresses(side: float) -> tuple[float, float]:
        if problem.motion.axis:
            f = np.array([side, stretch, side])
        else:
            f = np.array([side, stretch, 1.0])
        J = f.prod()
        isochoric = problem.G * J ** (-2 / 3)
        p = (problem.K * np.log(J) - isochoric * (f @ f) / 3) / f + isochoric * f
        return float(p[0]), float(p[1])

    side = brentq(lambda s: stresses(s)[0], 0.5, 2.0, xtol=1e-14)
    return stresses(side)[1]


def test_a_full_block_has_the_uniaxial_stress_of_its_material(kinematics: str, domain: str) -> None:
    problem = spring(kinematics=kinematics, domain=domain, L=60.0, H=80.0, T=1.5)
    width, height = Grid(problem).size
    if problem.motion.axis:
        free = body_of(rectangle(0.2 * width, 0, 0.8 * width, height), 15.0, problem)
        area = np.pi * (0.8 * width) ** 2
    else:
        free = body_of(rectangle(0.2 * width, 0, 0.6 * width, height), 15.0, problem)
        area = problem.T * 0.6 * problem.L
    response = contact_load_displacement(free, [-4.0, 8.0], threads=1)
    assert response.complete, response.message
    expected = [area * uniaxial_stress(problem, 1 + d / problem.H) for d in response.d]
    np.testing.assert_allclose(response.q, expected, rtol=1e-9)
    np.testing.assert_allclose(response.q_bottom, response.q, rtol=1e-10)
    np.testing.assert_allclose(response.q_stress, response.q, rtol=1e-10)
    np.testing.assert_allclose(response.largest_stretch[1], 1.1, rtol=1e-9)


def test_forces_and_tangent_are_derivatives_of_the_energy(
    kinematics: str, domain: str, random: np.random.Generator
) -> None:
    body = block_with_hole(25.0, kinematics=kinematics, domain=domain)
    solid = solid_of(body)
    v, direction = (random.normal(0, 0.05, solid.free + 1) for _ in range(2))
    h = 1e-5

    def at(step: float) -> np.ndarray:
        return solid.matrix @ (v + step * direction)

    slope = (solid.energy(at(h)) - solid.energy(at(-h))) / (2 * h)
    force = solid.transposed @ solid.forces(at(0.0))
    assert slope == pytest.approx(direction @ force, rel=1e-7)
    change = solid.transposed @ (solid.forces(at(h)) - solid.forces(at(-h))) / (2 * h)
    np.testing.assert_allclose(
        change, solid.tangent(at(0.0)) @ direction, atol=1e-6 * abs(change).max()
    )


def test_the_tangent_has_no_negative_eigenvalue_at_rest(kinematics: str, domain: str) -> None:
    solid = solid_of(block_with_hole(25.0, kinematics=kinematics, domain=domain))
    dense = solid.tangent(np.zeros(2 * solid.ndof)).toarray()[: solid.free, : solid.free]
    assert np.linalg.eigvalsh(dense)[0] > 0.0


def test_two_separate_columns_can_be_shifted_without_force() -> None:
    problem = spring(domain="full")
    columns = rectangle(10, 0, 10, 100) + rectangle(70, 0, 10, 100)
    solid = solid_of(body_of(columns, 10.0, problem))
    assert len(solid.floating) == 2
    dense = solid.tangent(np.zeros(2 * solid.ndof)).toarray()[: solid.free, : solid.free]
    values = np.linalg.eigvalsh(dense)
    assert np.sum(abs(values) < 1e-10 * values[-1]) == 2


def test_a_body_that_reaches_both_sides_does_not_float(domain: str) -> None:
    assert len(spring_supports(block_with_hole(25.0, domain=domain)).floating) == 0


def test_the_section_force_is_the_derivative_of_the_energy_by_d(kinematics: str) -> None:
    body = block_with_hole(12.0, kinematics=kinematics)
    response = contact_load_displacement(body, [-2.01, -2.0, -1.99], threads=1)
    slope = (response.energy[2] - response.energy[0]) / 0.02
    assert slope == pytest.approx(response.q[1], rel=1e-5)
    assert response.q_stress[1] == pytest.approx(response.q[1], rel=1e-9)
    solid = solid_of(body)
    assert section_force(body, solid, response.u[1]) == pytest.approx(response.q[1], rel=1e-9)


def test_the_largest_stretch_is_found_where_a_shear_has_it() -> None:
    body = body_of(rectangle(0, 0, 50, 50), 20.0, spring())
    solid = solid_of(body)
    field = ng.GridFunction(solid.space)
    field.Set(ng.CF((0.3 * ng.y, 0.05 * ng.x * ng.x / 50)))
    stretch, (x, _) = solid.largest_stretch(field.vec.FV().NumPy())
    expected = np.linalg.svd(np.array([[1.0, 0.3], [0.1, 1.0]]), compute_uv=False)[0]
    assert x == pytest.approx(50.0)
    assert stretch == pytest.approx(expected, rel=1e-9)


def test_a_thousandth_of_the_volume_may_stretch_more_than_the_measure_says() -> None:
    # The stretch rises from 1 at the bottom to 1.2 at the top; on a coarse mesh and on a fine one.
    for maxh in (20.0, 2.0):
        solid = solid_of(body_of(rectangle(0, 0, 50, 50), maxh, spring()))
        field = ng.GridFunction(solid.space)
        field.Set(ng.CF((0.0, 0.1 * ng.y * ng.y / 50)))
        dofs = field.vec.FV().NumPy()
        assert solid.largest_stretch(dofs)[0] == pytest.approx(1.2, rel=1e-9)
        error = solid.stretch_measure(dofs) - (1.2 - 1e-3 * 0.2)
        assert abs(error) < 0.001 * maxh


def test_a_solid_that_does_not_reach_the_top_is_refused() -> None:
    body = body_of(rectangle(0, 0, 50, 40), 20.0, spring())
    with pytest.raises(ProblemError, match="does not reach the top"):
        contact_load_displacement(body, [-1.0], threads=1)


def test_displacements_must_be_sensible() -> None:
    body = body_of(rectangle(0, 0, 50, 50), 20.0, spring())
    for wrong in ([], [np.nan], [-100.0], ["x"]):
        with pytest.raises(ProblemError):
            contact_load_displacement(body, wrong, threads=1)  # type: ignore[arg-type]

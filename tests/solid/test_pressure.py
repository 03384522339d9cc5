"""The pressure field of a nearly incompressible solid: exact, and without locking."""

from __future__ import annotations

import numpy as np
import pytest
from support.contact_bodies import block_with_hole, body_of, rectangle, spring
from support.cook import panel, tip

from ngspring.analysis.states import index_of
from ngspring.problem.laws.base import principal_stresses
from ngspring.problem.material import bulk_and_shear_modulus
from ngspring.problem.spring import SpringProblem
from ngspring.problem.targets.full_block import block_force
from ngspring.solid.contact.elasticity import Solid, numbered, spring_density
from ngspring.solid.contact.pressure import excess_of
from ngspring.solid.contact.response import contact_load_displacement
from ngspring.solid.contact.supports import spring_supports
from ngspring.solid.mesh.body import Body


def moduli(nu: float) -> dict[str, float]:
    return dict(zip("KG", bulk_and_shear_modulus(1.0, nu), strict=True))


def solid_of(body: Body) -> Solid:
    supports = spring_supports(body)
    excess = excess_of(body.problem)
    assert excess is not None
    return Solid(
        body.mesh,
        spring_density(body),
        supports.extraction.matrix,
        supports.floating,
        excess=excess,
    )


def block(**changes: object) -> Body:
    """A block of four fifths of the domain's width with free sides, on the quarter."""
    problem: SpringProblem = spring(**changes)
    return body_of(rectangle(10, 0, 40, 50), 20.0, problem)


def share(problem: SpringProblem) -> float:
    """Of the top side's area."""
    return 0.64 if problem.motion.axis else 0.8


def test_forces_and_tangent_are_derivatives_of_the_energy(
    kinematics: str, random: np.random.Generator
) -> None:
    solid = solid_of(block_with_hole(25.0, kinematics=kinematics, **moduli(0.49)))
    v, direction = (random.normal(0, 0.05, solid.free + 1) for _ in range(2))
    h = 1e-4

    def at(step: float) -> np.ndarray:
        return solid.matrix @ (v + step * direction)

    near = solid.energy(at(h)) - solid.energy(at(-h))
    slope = (8 * near - solid.energy(at(2 * h)) + solid.energy(at(-2 * h))) / (12 * h)
    assert slope == pytest.approx(direction @ solid.transposed @ solid.forces(at(0.0)), rel=1e-7)
    change = solid.transposed @ (solid.forces(at(h)) - solid.forces(at(-h))) / (2 * h)
    tangent = solid.tangent(at(0.0))
    np.testing.assert_allclose(change, tangent @ direction, atol=1e-5 * abs(change).max())
    assert abs(tangent - tangent.T).max() < 1e-12 * abs(tangent).max()


@pytest.mark.parametrize("nu", [0.49, 0.4999])
def test_a_block_with_free_sides_is_as_strong_as_its_law_says(nu: float, kinematics: str) -> None:
    body = block(kinematics=kinematics, **moduli(nu))
    response = contact_load_displacement(body, [-10.0, 20.0], threads=1)
    assert response.complete
    for d, q in zip(response.d, response.q, strict=True):
        expected = share(body.problem) * block_force(body.problem, d)
        assert q == pytest.approx(expected, rel=1e-8)
    # Stresses in the sections and on the side, with their pressure.
    np.testing.assert_allclose(response.q_stress, response.q, rtol=1e-8)
    np.testing.assert_allclose(response.q_side, response.q, rtol=1e-6)


def test_planar_tension_of_an_incompressible_block() -> None:
    # P = 2 C_10 (lambda - lambda^-3) with 2 C_10 = G, of which 1 / K is left: two K remove it.
    stretch, forces = 1.2, []
    for ratio in (1e4, 2e4):
        body = block(K=ratio, G=1.0)
        response = contact_load_displacement(body, [20.0], threads=1)
        forces.append(response.q[0] / (share(body.problem) * body.problem.top_area))
    assert 2 * forces[1] - forces[0] == pytest.approx(stretch - stretch**-3, rel=1e-8)


@pytest.mark.parametrize("nu", [0.49, 0.4999])
def test_a_confined_block_has_the_stresses_of_its_law(nu: float) -> None:
    body = block(**moduli(nu))
    supports = spring_supports(body)
    n = len(supports.extraction.weight) // 2
    # No displacement in x at all.
    weight = np.where(np.arange(2 * n) < n, 0.0, supports.extraction.weight)
    parent, top = np.arange(2 * n), supports.top[0]
    parent[supports.top] = top
    matrix = numbered(parent, weight, int(top))[0].matrix
    solid = Solid(body.mesh, spring_density(body), matrix, excess=excess_of(body.problem))
    d, problem = -2.0, body.problem
    height = np.array([v.point[1] for v in body.mesh.vertices])
    full = np.zeros(2 * n)
    full[n : n + len(height)] = d * height / problem.H
    force = solid.transposed @ solid.forces(full)
    axial = float(principal_stresses(problem.law, 1.0, 1 + d / problem.H, 1.0)[1])
    assert force[-1] == pytest.approx(axial * share(problem) * problem.top_area, rel=1e-8)
    assert np.abs(force[:-1]).max() < 1e-9 * abs(force[-1])


def test_quarter_and_full_domain_have_the_same_force() -> None:
    forces = []
    for domain in ("quarter", "full"):
        body = block_with_hole(8.0, a=20.0, b=12.0, domain=domain, **moduli(0.499))
        response = contact_load_displacement(body, [-4.0], threads=1)
        assert response.complete
        forces.append(response.q[index_of(response, -4.0)])
    # The meshes are not mirror images of each other.
    assert forces[1] == pytest.approx(forces[0], rel=3e-3)


# -- Cook's membrane -----------------------------------------------------------------------------
# References: quadratic to cubic pressure next to cubic and quartic displacements (an own
# computation with NGSolve), on meshes refined to 0.01 mm in the corner where stresses are infinite.
# Elmer's 6.147 for the first is that of a law without isochoric split: G/2 (I_1 - 3 - 2 ln J) and
# one of three usual volumetric energies give 6.146 to 6.148 (quartic elements of 1 mm).


@pytest.mark.parametrize(
    ("K", "G", "traction", "reference"),
    [
        (*bulk_and_shear_modulus(200.0, 0.35), 4.0, 6.179),
        (*bulk_and_shear_modulus(3.0, 0.4999), 0.05, 4.6995),
        (4.00942e5, 80.1938, 100 / 16, 6.9328),
    ],
)
def test_cooks_membrane_tends_to_its_reference(
    K: float, G: float, traction: float, reference: float
) -> None:
    coarse, fine = (tip(panel(K, G), traction, maxh) for maxh in (12.0, 6.0))
    assert coarse < fine < reference
    assert fine == pytest.approx(reference, rel=0.02)
    assert reference - fine < 0.5 * (reference - coarse)


def test_cooks_membrane_locks_without_a_pressure_field() -> None:
    locked, free = [], []
    for nu in (0.4999, 0.49999):
        problem = panel(*bulk_and_shear_modulus(3.0, nu))
        free.append(tip(problem, 0.05, 12.0))
        locked.append(tip(problem, 0.05, 12.0, locking=True))
    # Ten times the bulk modulus is the same solid ...
    assert free[1] == pytest.approx(free[0], rel=5e-4)
    # ... but not to elements that lock.
    assert locked[1] < 0.95 * locked[0] < 0.95 * free[0]

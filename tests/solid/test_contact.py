"""Contact between surfaces: forces, pressures, and what is known about them."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
import scipy.sparse as sp
from support.contact_bodies import (
    block_with_hole,
    constrained,
    half_cylinder,
    mechanics_of,
    meshed,
    nearest_vertex,
    rectangle,
    spring,
    two_blocks,
)

from ngspring.analysis.path import follow as follow_contact
from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ProblemError
from ngspring.solid.contact.contact import Contact, ContactLaw, lobatto
from ngspring.solid.contact.mechanics import ContactMechanics, ContactPoint
from ngspring.solid.contact.response import ContactSettings, contact_mechanics
from ngspring.solid.contact.supports import Plane, dof_places
from ngspring.solid.contact.surface import free_surface

STIFF = ContactLaw(2000.0, 1e-4)


def side(mesh: object, axis: int, place: float, component: int) -> IntArray:
    """Dofs of one component on the line ``x[axis] = place``."""
    places = dof_places(mesh)
    return np.flatnonzero(abs(places[:, axis] - place) < 1e-9) + component * len(places)


def shifted(mechanics: ContactMechanics, dx: float, dy: float, above: float) -> FloatArray:
    """Dofs of a rigid shift of all that lies above a height."""
    mesh, n = mechanics.solid.mesh, mechanics.solid.ndof
    points = np.array([v.point for v in mesh.vertices])
    moved = np.flatnonzero(points[:, 1] > above)
    full = np.zeros(2 * n)
    full[moved] = dx
    full[n + moved] = dy
    return full


def pressed_blocks(
    count: int = 6, law: ContactLaw = STIFF, sizes: tuple[float, float] = (1.3, 0.9)
) -> ContactMechanics:
    """Two blocks, the upper one pressed down on the lower one by u_y = d of its top."""
    mesh = two_blocks(sizes=sizes)
    n = mesh.nv + mesh.nedge
    fixed = np.concatenate([side(mesh, 1, 0.0, 1), side(mesh, 0, 0.0, 0)])
    matrix = flat_side(n, mesh.nv, fixed, side(mesh, 1, 10.05, 1))
    mechanics = mechanics_of(mesh, matrix, law, 10.0)
    surface = mechanics.contact.surface
    mechanics.contact = Contact(surface, (), law, lambda x: np.ones(len(x)), count)
    return mechanics


def flat_side(n: int, vertices: int, fixed: IntArray, top: IntArray) -> sp.csr_matrix:
    """Constraints of dofs that are zero and of a side that moves by d as a whole."""
    follow = top[top - n < vertices]
    # The bubbles of a constant are zero, its vertices follow the first one.
    fixed = np.concatenate([fixed, top[top - n >= vertices]])
    rows = constrained(n, fixed, _unit(2 * n, follow[0])).tolil()
    for vertex in follow[1:]:
        rows[vertex] = rows[follow[0]]
    matrix = rows.tocsr()
    used = np.flatnonzero(np.asarray(abs(matrix).sum(axis=0)).ravel() > 0)
    return sp.csr_matrix(matrix[:, used])


@pytest.fixture(scope="module")
def blocks() -> ContactMechanics:
    return pressed_blocks()


def _unit(size: int, k: int) -> FloatArray:
    vector = np.zeros(size)
    vector[k] = 1.0
    return vector


def test_lobatto_points_integrate_polynomials_and_have_the_ends() -> None:
    s, w = lobatto(6)
    assert s[0] == 0.0
    assert s[-1] == 1.0
    for power in range(10):
        assert w @ s**power == pytest.approx(1 / (power + 1), rel=1e-13)


def test_the_law_is_smooth_and_its_pressure_is_minus_the_slope_of_the_energy() -> None:
    law = ContactLaw(300.0, 0.01)
    gap = np.array([-0.1, -0.0100001, -0.0099999, -0.004, -1e-6, 0.0, 0.2])
    h = 1e-7
    slope = (law.energy(gap + h) - law.energy(gap - h)) / (2 * h)
    np.testing.assert_allclose(law.pressure(gap), -slope, atol=1e-6)
    curvature = -(law.pressure(gap + h) - law.pressure(gap - h)) / (2 * h)
    np.testing.assert_allclose(law.slope(gap), curvature, rtol=1e-3, atol=2e-3)


def test_the_surface_follows_the_displacement_field_exactly(random: np.random.Generator) -> None:
    body = block_with_hole(12.0)
    surface = free_surface(body.mesh, "surface")
    field = ng.GridFunction(ng.VectorH1(body.mesh, order=2))
    field.vec.FV().NumPy()[:] = random.normal(0, 1, len(field.vec))
    positions = surface.positions(field.vec.FV().NumPy())
    s = np.array([0.2, 0.5, 0.9])
    at_rest, moved = surface.at(surface.rest, s), surface.at(positions, s)
    rule = ng.IntegrationRule([(0.2,), (0.5,), (0.9,), (0.8,), (0.1,)], [1.0] * 5)
    points = body.mesh.MapToAllElements(rule, ng.BND)
    places = np.asarray(ng.CF((ng.x, ng.y))(points))
    values = np.asarray(field(points))
    for rest, now in zip(at_rest.reshape(-1, 2), moved.reshape(-1, 2), strict=True):
        k = np.argmin(np.hypot(*(places - rest).T))
        np.testing.assert_allclose(places[k], rest, atol=1e-10)
        np.testing.assert_allclose(now, places[k] + values[k], atol=1e-9)


def test_contact_forces_and_stiffness_are_derivatives_of_its_energy(
    blocks: ContactMechanics, random: np.random.Generator
) -> None:
    contact = Contact(
        blocks.contact.surface,
        (Plane("bottom", (0.0, 1.0), 0.2), Plane("right", (-1.0, 0.0), -9.9, 3)),
        ContactLaw(300.0, 0.02),
        lambda x: 1 + x[:, 0],
    )
    full = shifted(blocks, 0.13, -0.2, 5.02) + random.normal(0, 0.01, 2 * blocks.solid.ndof)
    direction = random.normal(0, 1.0, len(full))
    h = 1e-6
    plus, minus = (contact.state(full + step * direction) for step in (h, -h))
    state = contact.state(full)
    assert (state.pairs.gap < 0).sum() > 20
    assert (state.plane_gaps < 0).any(axis=1).all()
    slope = (contact.energy(plus) - contact.energy(minus)) / (2 * h)
    assert slope == pytest.approx(direction @ contact.forces(state), rel=1e-6)
    change = (contact.forces(plus) - contact.forces(minus)) / (2 * h)
    second = contact.second_derivative(state, sp.eye_array(len(full), format="csr"))
    np.testing.assert_allclose(change, second @ direction, atol=2e-5 * abs(change).max())
    np.testing.assert_allclose((second - second.T).toarray(), 0, atol=1e-9 * abs(second).max())


def test_contact_is_frictionless_and_balanced(blocks: ContactMechanics) -> None:
    """A flat block that slides on another feels no tangential force, and action is reaction."""
    full = shifted(blocks, 0.37, -0.06, 5.02)
    state = blocks.contact.state(full)
    forces = blocks.contact.forces(state)
    n, vertices = blocks.solid.ndof, blocks.solid.mesh.nv
    points = np.array([v.point for v in blocks.solid.mesh.vertices])
    upper = np.flatnonzero(points[:, 1] > 5.02)
    normal = forces[n:][upper].sum()
    assert normal < -0.1
    assert abs(forces[:n]).max() < 1e-12 * abs(normal)
    assert abs(forces[n : n + vertices].sum()) < 1e-12 * abs(normal)
    # Moments about the origin, bubbles included through the deformed nodes of the surface.
    turn = np.concatenate([-_deformed(blocks, full)[:, 1], _deformed(blocks, full)[:, 0]])
    assert abs(turn @ forces) < 1e-9 * abs(normal) * 10


def _deformed(mechanics: ContactMechanics, full: FloatArray) -> FloatArray:
    """Dofs (ndof, 2) of the deformed place."""
    n = mechanics.solid.ndof
    points = np.array([v.point for v in mechanics.solid.mesh.vertices])
    place = np.zeros((n, 2))
    place[: len(points)] = points
    return place + np.stack([full[:n], full[n:]], axis=1)


def patch_pressures(mechanics: ContactMechanics) -> tuple[FloatArray, FloatArray]:
    """Contact pressure over its mean, at the points and averaged over each edge."""
    points, message = follow_contact(mechanics, np.array([-0.05, -0.55]), mechanics.at_rest())
    assert not message
    end, contact = points[-1], mechanics.contact
    pressure, _ = contact.pressure(end.contact)
    inner = contact.rest[:, 0] < 10.0 - 1e-9
    on_faces = inner & (abs(abs(contact.rest[:, 1] - 5.025) - 0.025) < 1e-9)
    assert (pressure[on_faces] > 0).all()
    assert not (pressure[inner & ~on_faces] > 0).any()
    mean = -end.q / end.contact.positions[:, 0].max()
    means = []
    for edge in np.unique(contact.edge[on_faces]):
        length = np.where(contact.edge == edge, contact.length, 0.0)
        means.append(length @ pressure / length.sum())
    return pressure[on_faces] / mean, np.array(means) / mean


@pytest.mark.long
@pytest.mark.parametrize("sizes", [(1.3, 0.9), (2.0, 0.7), (0.7, 2.0), (1.0, 1.05), (2.5, 0.3)])
def test_patch_of_two_differently_meshed_blocks_has_uniform_pressure(
    sizes: tuple[float, float],
) -> None:
    """Within 0.5 % on every edge with the settings of a verification."""
    settings = ContactSettings()
    _, edges = patch_pressures(pressed_blocks(settings.points, settings.law(spring()), sizes))
    assert len(edges) > 10
    assert abs(edges - 1).max() < 0.005


@pytest.mark.long
def test_pressure_at_single_points_becomes_uniform_with_their_number() -> None:
    """It is as accurate as the points integrate across the other side's nodes."""
    deviations = [abs(patch_pressures(pressed_blocks(n))[0] - 1).max() for n in (6, 12, 48)]
    assert deviations[2] < deviations[1] / 4 < deviations[0] / 12
    assert deviations[2] < 0.005


def cylinder(radius: float, near: float, maxh: float) -> ContactMechanics:
    """Half of a half-cylinder above the plane y = 0, its flat top moved by u_y = d."""
    mesh = half_cylinder(radius, near, maxh)
    n = mesh.nv + mesh.nedge
    left = side(mesh, 0, 0.0, 0)
    matrix = flat_side(n, mesh.nv, left, side(mesh, 1, radius, 1))
    plane = Plane("bottom", (0.0, 1.0), 0.0)
    return mechanics_of(mesh, matrix, STIFF, radius, (plane,))


def test_a_half_cylinder_on_a_plane_has_hertz_pressure() -> None:
    """Half width and peak pressure of the line contact, a = 2 sqrt(P R / (pi E*))."""
    radius = 10.0
    mechanics = cylinder(radius, 0.8, 2.0)
    points, message = follow_contact(mechanics, np.array([-0.02]), mechanics.at_rest())
    assert not message
    (end,) = points
    problem = spring()
    K, G = problem.K, problem.G
    young, poisson = 9 * K * G / (3 * K + G), (3 * K - 2 * G) / (2 * (3 * K + G))
    modulus = young / (1 - poisson**2)
    load = 2 * mechanics.contact.plane_force(end.contact, "bottom")
    assert load == pytest.approx(-2 * end.q, rel=1e-9)
    half_width, peak = hertz_fit(mechanics, end)
    assert half_width / radius < 0.05
    assert half_width == pytest.approx(2 * np.sqrt(load * radius / (np.pi * modulus)), rel=0.03)
    assert peak == pytest.approx(2 * load / (np.pi * half_width), rel=0.03)
    assert peak == pytest.approx(modulus * half_width / (2 * radius), rel=0.03)


def hertz_fit(mechanics: ContactMechanics, point: ContactPoint) -> tuple[float, float]:
    """a and p0 of ``p^2 = p0^2 (1 - x^2 / a^2)``, by a straight line through p^2 over x^2."""
    pressure, _ = mechanics.contact.pressure(point.contact)
    x = mechanics.contact.points(point.contact.positions)[:, 0]
    touching = pressure > 0.1 * pressure.max()
    slope, peak_squared = np.polyfit(x[touching] ** 2, pressure[touching] ** 2, 1)
    return float(np.sqrt(-peak_squared / slope)), float(np.sqrt(peak_squared))


def test_no_step_carries_a_wall_through_another(blocks: ContactMechanics) -> None:
    begin = np.zeros(2 * blocks.solid.ndof)
    through = shifted(blocks, 0.0, -20.0, 5.02)
    share = blocks.skeleton.largest_step(begin, through)
    # Skeletons lie a seventh of an element inside either surface.
    assert 0.05 / 20 < share < 0.7 / 20
    assert blocks.skeleton.largest_step(begin, shifted(blocks, 3.0, 20.0, 5.02)) == 1.0


def test_a_wall_does_not_see_its_own_far_side() -> None:
    """A thin plate alone has no contact, however it is bent."""
    mesh = meshed(rectangle(0, 0, 10, 0.5), 0.4)
    for boundary in range(len(mesh.GetBoundaries())):
        mesh.ngmesh.SetBCName(boundary, "surface")
    surface = free_surface(mesh, "surface")
    contact = Contact(surface, (), STIFF, lambda x: np.ones(len(x)))
    n = surface.matrix.shape[1]
    full = np.zeros(2 * n)
    points = np.array([v.point for v in mesh.vertices])
    angle = points[:, 0] / 4
    full[: len(points)] = (4 - points[:, 1]) * np.sin(angle) - points[:, 0]
    full[n : n + len(points)] = 4 - (4 - points[:, 1]) * np.cos(angle) - points[:, 1]
    assert contact.energy(contact.state(full)) == 0.0


@pytest.mark.parametrize("wrong", [{"stiffness": -1.0}, {"smoothing": 0.0}, {"points": 2}])
def test_settings_are_checked(wrong: dict[str, float]) -> None:
    with pytest.raises(ProblemError, match=next(iter(wrong))):
        ContactSettings(**wrong)  # type: ignore[arg-type]


def test_weights_carry_the_radius_and_the_copies() -> None:
    body = block_with_hole(12.0, kinematics="axisymmetric")
    mechanics, _ = contact_mechanics(body, ContactSettings())
    contact = mechanics.contact
    # Two copies of the surface of revolution of a quarter ellipse with a point on the axis.
    area = contact.area.sum()
    x, y = contact.rest.T
    assert area == pytest.approx(2 * 2 * np.pi * (contact.length @ (50 - x)))
    a, b = 30.0, 4.0
    e = np.sqrt(1 - (b / a) ** 2)
    spheroid = 2 * np.pi * a**2 * (1 + (1 - e**2) / e * np.arctanh(e))
    assert area == pytest.approx(spheroid, rel=1e-3)
    assert nearest_vertex(body.mesh, 50.0, 46.0) >= 0
    assert y.min() == pytest.approx(46.0)

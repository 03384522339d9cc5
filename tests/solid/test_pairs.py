"""Which points of a surface are inside which part of it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from support.contact_bodies import two_blocks

from ngspring.basics.arrays import FloatArray
from ngspring.solid.contact.contact import Contact, ContactLaw, lobatto
from ngspring.solid.contact.pairs import PairSearch
from ngspring.solid.contact.surface import Surface, free_surface, outward, shapes, slopes

#: Nodes in micrometres of the tip of a flat hole that has folded on itself, as an analysis found
#: it: solid left of the line, the tip at (-101.8, 30.2), and the two flanks a micrometre inside
#: each other.
FOLD = np.array(
    [
        [112.69, -29.97],
        [84.19, -19.37],
        [56.09, -8.47],
        [30.29, -3.21],
        [4.5, -0.28],
        [-16.4, 2.57],
        [-36.42, 5.62],
        [-54.31, 8.87],
        [-69.64, 15.82],
        [-84.9, 23.17],
        [-101.85, 30.18],
        [-75.0, 17.21],
        [-53.96, 7.15],
        [-26.29, 3.5],
        [2.29, -0.68],
        [35.9, -1.97],
        [69.32, 0.55],
        [107.21, 10.04],
        [144.95, 19.69],
    ]
)


def fold() -> Surface:
    """The fold, and a long edge far from it, as there is in a mesh that is fine in the tip."""
    far = np.array([[5e3, 5e3], [3e3, 5e3], [1e3, 5e3]])
    nodes = 2 * np.arange(len(FOLD) // 2)[:, None] + np.arange(3)
    nodes = np.concatenate([nodes, [len(FOLD) + np.arange(3)]])
    rest = 1e-3 * np.concatenate([FOLD, far])
    return Surface(nodes, rest, sp.csr_matrix((len(rest),) * 2), np.zeros((len(nodes), 2), bool))


def feet(surface: Surface, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Gap of each point by looking at many places of every edge; 0 where it is inside of none."""
    gaps = np.zeros(len(points))
    s = np.linspace(0, 1, 20001)
    for nodes in surface.nodes:
        x, t = shapes(s) @ surface.rest[nodes], slopes(s) @ surface.rest[nodes]
        n = outward(t) / np.linalg.norm(t, axis=1)[:, None]
        for k, (point, normal) in enumerate(zip(points, normals, strict=True)):
            i = int(np.argmin(((point - x) ** 2).sum(1)))
            gap = (point - x[i]) @ n[i]
            inside = 0 < i < len(s) - 1 and gap < -1e-6 and n[i] @ normal < -0.5
            if inside and (gaps[k] == 0.0 or gap > gaps[k]):
                gaps[k] = gap
    return gaps


def test_no_point_inside_a_sharp_fold_is_lost() -> None:
    """The edges that are nearest to a point in a fold are not always the ones it is inside of."""
    surface = fold()
    s, _ = lobatto(6)
    points = surface.at(surface.rest, s).reshape(-1, 2)
    normals = outward(surface.slopes_at(surface.rest, s)).reshape(-1, 2)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    expected = feet(surface, points, normals)
    pairs = PairSearch(surface, s).find(surface.rest)
    found = np.zeros(len(points))
    found[pairs.point] = np.minimum(pairs.gap, 0.0)
    inside = expected < 0.0
    assert inside.sum() > 20
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-7)


def test_the_energy_does_not_jump_when_a_corner_slides_past_a_point() -> None:
    """The upper block, 2 micrometres inside the lower one, moves to the right by half an edge."""
    mesh = two_blocks()
    surface = free_surface(mesh, "surface")
    contact = Contact(surface, (), ContactLaw(300.0, 1e-4), lambda x: np.ones(len(x)))
    points = np.array([v.point for v in mesh.vertices])
    upper = np.flatnonzero(points[:, 1] > 5.02)
    n = surface.matrix.shape[1]

    def energy(shift: float) -> float:
        full = np.zeros(2 * n)
        full[upper], full[n + upper] = shift, -0.052
        return contact.energy(contact.state(full))

    low, high = -0.7, -0.1
    places = np.linspace(low, high, 121)
    energies = np.array([energy(place) for place in places])
    assert energies.min() > 0.0
    k = int(np.argmax(abs(np.diff(energies))))
    low, high = float(places[k]), float(places[k + 1])
    jump = abs(energies[k + 1] - energies[k])
    assert jump > 1e-3 * energies[k]
    while high - low > 1e-9:
        middle = (low + high) / 2
        parts = [abs(energy(middle) - energy(low)), abs(energy(high) - energy(middle))]
        low, high = (low, middle) if parts[0] > parts[1] else (middle, high)
        jump = max(parts)
    assert jump < 1e-5 * energies[k]


def _kinked(turn: float) -> Surface:
    """Solid above two edges of 1 mm that turn away from it, and a short edge of another one."""
    direction = np.array([np.cos(turn), -np.sin(turn)])
    ends = [[[-1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], direction], [[0.03, 0.0], [-0.03, 0.0]]]
    (a, b), (_, c), (d, e) = np.array(ends)
    rest = np.array([a, (a + b) / 2, b, (b + c) / 2, c, d, (d + e) / 2, e])
    nodes = np.array([[0, 1, 2], [2, 3, 4], [5, 6, 7]])
    return Surface(nodes, rest, sp.identity(len(rest), format="csr"), np.zeros((3, 2), bool))


def _moved(surface: Surface, place: FloatArray) -> FloatArray:
    """Displacements that carry the short edge there."""
    u = np.zeros((len(surface.rest), 2))
    u[5:] = place
    return u.T.ravel()


def _distance(point: FloatArray, begin: FloatArray, end: FloatArray) -> float:
    along = (point - begin) @ (end - begin) / ((end - begin) @ (end - begin))
    return float(np.linalg.norm(point - begin - np.clip(along, 0, 1) * (end - begin)))


def test_around_a_concave_kink_a_point_inside_is_as_deep_as_the_nearest_surface_is_far() -> None:
    """On either side of the kink the nearest place is on an edge, between them it is the kink."""
    surface = _kinked(np.radians(40))
    search = PairSearch(surface, lobatto(6)[0])
    at_the_kink = 0
    for angle in np.radians(np.linspace(40, 140, 41)):
        full = _moved(surface, 0.02 * np.array([np.cos(angle), np.sin(angle)]))
        positions = surface.positions(full)
        pairs = search.find(positions, ahead=False)
        pairs = pairs[pairs.point >= 12]
        assert list(pairs.point) == list(range(12, 18)), "no point of the short edge is lost"
        ends = positions[surface.nodes[:2][:, [0, 2]]]
        points = surface.at(positions, search.s)[2]
        expected = [-min(_distance(point, *edge) for edge in ends) for point in points]
        np.testing.assert_allclose(pairs.gap, expected, rtol=1e-9)
        at_the_kink += int(pairs.kink.sum())
    assert at_the_kink > 40


def test_forces_and_stiffness_at_a_concave_kink_are_derivatives_of_the_energy(
    random: np.random.Generator,
) -> None:
    surface = _kinked(np.radians(40))
    contact = Contact(surface, (), ContactLaw(300.0, 1e-3), lambda x: np.ones(len(x)))
    u, du = _moved(surface, np.array([0.003, 0.02])), random.normal(size=16)
    state = contact.state(u)
    assert state.pairs.kink.any()
    assert not state.pairs.kink[state.pairs.gap < 0.0].all()
    forces = contact.forces(state)
    stiffness = contact.second_derivative(state, sp.identity(16, format="csr"))
    h = 1e-6
    ahead, behind = contact.state(u + h * du), contact.state(u - h * du)
    slope = (contact.energy(ahead) - contact.energy(behind)) / (2 * h)
    np.testing.assert_allclose(slope, forces @ du, rtol=1e-6)
    change = (contact.forces(ahead) - contact.forces(behind)) / (2 * h)
    np.testing.assert_allclose(change, stiffness @ du, rtol=1e-6, atol=1e-6 * abs(change).max())


def test_edges_that_meet_no_other_see_each_other() -> None:
    """An edge of 2 mm, and one of 0.6 mm that lies 0.01 mm inside."""
    rest = np.array([[-1, 0], [0, 0], [1, 0], [0.3, 0.01], [0, 0.01], [-0.3, 0.01]], float)
    nodes, whole = np.arange(6).reshape(2, 3), sp.identity(6, format="csr")
    surface = Surface(nodes, rest, whole, np.ones((2, 2), bool))
    pairs = PairSearch(surface, lobatto(6)[0]).find(rest, ahead=False)
    assert set(pairs.point) >= set(range(6, 12))
    np.testing.assert_allclose(pairs.gap, -0.01, rtol=1e-12)


def test_what_energy_needs_is_found_without_looking_ahead() -> None:
    surface = fold()
    search = PairSearch(surface, lobatto(6)[0])
    pairs, inside = search.find(surface.rest), search.find(surface.rest, ahead=False)
    negative = pairs.gap < 0.0
    assert 20 < negative.sum() < len(pairs.gap)
    for name in ("point", "edge", "s", "gap", "normal", "kink"):
        found, expected = getattr(inside, name), getattr(pairs, name)[negative]
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)

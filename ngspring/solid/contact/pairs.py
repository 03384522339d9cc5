"""Which point of a surface faces which other point of it: closest-point projection."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.solid.contact.surface import Surface, outward

_SAMPLES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
_NEAREST = 4
#: Product of the normals of a point and of its foot from which on they face each other.
_OPPOSED = -0.5
#: The same for an edge's chord, to leave out what is not worth a projection.
_ROUGHLY_OPPOSED = 0.3
#: A point is inside by less than this part of the undeformed length of its own and of the opposite
#: edge: see `ngspring.solid.contact.tunnelling`, whose skeletons are nearer to either surface.
_DEEPEST = 0.25
#: Turn in rad of the surface between two edges from which on they are a convex corner.
_SHARP = 0.6
#: And from which on it is a fold.
_FOLDED = 2.6
#: An edge is prolonged by this part of its length where the surface ends on a side of the meshed
#: part, and its mirror image goes on; and everywhere by rounding, so that no point is lost between
#: two edges.
_OPEN_OVERHANG, _ROUNDING = 0.5, 1e-9


@dataclass(frozen=True, eq=False)
class Pairs:
    """Points of a surface and what they face.

    Attributes
    ----------
    point : int array (pairs,)
        Number of the point of contact (edge after edge).
    edge, s : arrays (pairs,)
        Foot of the perpendicular: edge and parameter.
    gap : array (pairs,)
        Signed distance in mm, negative inside the other solid.
    normal : array (pairs, 2)
        Outward normal at the foot.
    kink : bool array (pairs,)
        Whether the foot is a concave kink between two edges, at the end of this one: what is
        nearest to a point inside that is beyond the one and before the other.
    """

    point: IntArray
    edge: IntArray
    s: FloatArray
    gap: FloatArray
    normal: FloatArray
    kink: NDArray[np.bool_]

    def __getitem__(self, chosen: IntArray | NDArray[np.bool_]) -> Pairs:
        """Some of them."""
        return Pairs(*(getattr(self, part.name)[chosen] for part in fields(self)))

    def joined(self, others: Pairs) -> Pairs:
        """These, then others."""
        both = ((getattr(pairs, part.name) for pairs in (self, others)) for part in fields(self))
        return Pairs(*(np.concatenate(list(parts)) for parts in both))


class PairSearch:
    """Finds the pairs of a surface.

    A point sees only surface that faces it (normals more than 120 degrees apart), so not
    its own neighbourhood; and it is taken to be inside by less than half the length of the edges,
    so not the far side of the wall that it stands on itself: a body's mesh has several elements
    across each wall.
    """

    def __init__(self, surface: Surface, s: FloatArray) -> None:
        self.surface = surface
        self.s = s
        first, last = surface.nodes[:, 0], surface.nodes[:, 2]
        self.rest_lengths = np.linalg.norm(surface.rest[last] - surface.rest[first], axis=1)
        order = np.argsort(first)
        place = np.minimum(np.searchsorted(first[order], last), len(order) - 1)
        #: Pairs of edges that meet, the end of one and the beginning of the other.
        self._before = np.flatnonzero(first[order[place]] == last)
        self._after = order[place[self._before]]
        #: Which of them is at the beginning and at the end of an edge; -1 for none.
        self._kinks = np.full((surface.edges, 2), -1)
        self._kinks[self._after, 0] = self._kinks[self._before, 1] = np.arange(len(self._before))

    def find(self, positions: FloatArray, ahead: bool = True) -> Pairs:
        """All pairs closer than about twice the longest edge.

        Parameters
        ----------
        positions : array (nodes, 2)
        ahead : bool
            Without, only the pairs with a negative gap: all that energy and forces need, at a
            fraction of the work.
        """
        surface = self.surface
        points = surface.at(positions, self.s).reshape(-1, 2)
        normals = _unit(outward(surface.slopes_at(positions, self.s))).reshape(-1, 2)
        lengths = np.linalg.norm(np.diff(positions[surface.nodes[:, ::2]], axis=1)[:, 0], axis=1)
        reach = 2.0 * lengths.max()
        ends = surface.slopes_at(positions, np.array([0.0, 1.0]))
        turns = self._turns(ends)
        point, edge, s = self._inside(positions, points, normals, lengths)
        at_kinks = self._at_kinks(positions, points[point], point, edge, turns, ends)
        if ahead:
            near = self._ahead(positions, points, normals, reach)
            pairs = zip((point, edge, s), near, strict=True)
            point, edge, s = (np.concatenate(part) for part in pairs)
        s, gap, normal, converged = self._feet(positions, points[point], edge, s)
        limit = np.where(self.surface.open_ends, _OPEN_OVERHANG, _ROUNDING)[edge]
        on_edges = converged & (s >= -limit[:, 0]) & (s <= 1 + limit[:, 1])
        found = Pairs(point, edge, s, gap, normal, np.zeros(len(s), bool))[on_edges].joined(
            at_kinks
        )
        seen = (found.normal * normals[found.point]).sum(1) < _OPPOSED
        seen &= found.gap > -self._deepest(found.point, found.edge)
        seen &= found.gap < (reach if ahead else 0.0)
        return self._round_corners(positions, points, turns, self._nearest(found[seen], lengths))

    def _feet(
        self, positions: FloatArray, points: FloatArray, edge: IntArray, s: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
        """Parameters, gaps and normals at the feet of points on edges, and where they are found."""
        start, slope, curvature = _parabolas(positions[self.surface.nodes[edge]])
        offset = points - start
        s, converged = _project(offset, slope, curvature, s)
        normal = _unit(outward(slope + s[:, None] * curvature))
        foot = s[:, None] * (slope + (s / 2)[:, None] * curvature)
        return s, ((offset - foot) * normal).sum(1), normal, converged

    def _nearest(self, pairs: Pairs, lengths: FloatArray) -> Pairs:
        """The nearest of the pairs of each point."""
        beyond = np.maximum(np.maximum(-pairs.s, pairs.s - 1), 0.0) * lengths[pairs.edge]
        # Where a point is inside, another surface ahead of it must not hide that: the energy
        # would jump.
        order = np.lexsort([np.abs(pairs.gap) + 1e3 * beyond, pairs.gap >= 0.0, pairs.point])
        _, first = np.unique(pairs.point[order], return_index=True)
        return pairs[order[first]]

    def _at_kinks(
        self,
        positions: FloatArray,
        places: FloatArray,
        point: IntArray,
        edge: IntArray,
        turns: FloatArray,
        ends: FloatArray,
    ) -> Pairs:
        """Points beyond the one and before the other edge of a concave kink: they are inside it.

        There the surface is as far as the kink, in every direction: so the distance and its
        derivative do not jump when a point slides from one edge to the next.
        """
        kink = self._kinks[edge]
        # The last one is for ends that meet no other edge.
        pair, end = np.nonzero(np.append(turns < 0.0, False)[kink])
        kink = kink[pair, end]
        edge, after = self._before[kink], self._after[kink]
        away = places[pair] - positions[self.surface.nodes[edge, 2]]
        between = (away * ends[edge, 1]).sum(1) > 0.0
        between &= (away * ends[after, 0]).sum(1) < 0.0
        point, edge, away = point[pair[between]], edge[between], away[between]
        gap, one = -np.linalg.norm(away, axis=1), np.ones(len(point))
        return Pairs(point, edge, one, gap, -_unit(away), one.astype(bool))

    def _round_corners(
        self, positions: FloatArray, points: FloatArray, turns: FloatArray, pairs: Pairs
    ) -> Pairs:
        """Where a point inside a sharp corner is nearer to the corner's other side, that side.

        It need not face the point. Without it the energy would jump when the corner slides past
        the point; so the distance from both sides is zero there.
        """
        convex = np.full((self.surface.edges, 2), -1)
        sharp = turns > _SHARP
        convex[self._before[sharp], 1] = self._after[sharp]
        convex[self._after[sharp], 0] = self._before[sharp]
        neighbour = convex[pairs.edge, (pairs.s > 0.5).astype(int)]
        asked = np.flatnonzero((pairs.gap < 0.0) & (neighbour >= 0))
        edge, point = neighbour[asked], pairs.point[asked]
        begin = np.where(pairs.s[asked] > 0.5, 0.0, 1.0)
        s, gap, normal, converged = self._feet(positions, points[point], edge, begin)
        nearer = converged & (s >= 0.0) & (s <= 1.0) & (gap > pairs.gap[asked])
        others = Pairs(point, edge, s, gap, normal, np.zeros(len(s), bool))[nearer]
        number = np.arange(len(pairs.gap))
        number[asked[nearer]] = len(number) + np.arange(len(others.gap))
        return pairs.joined(others)[number]

    def _deepest(self, point: IntArray, edge: IntArray) -> FloatArray:
        """How far a point can be inside: skeletons of both sides do not cross."""
        own = self.rest_lengths[point // len(self.s)]
        return np.asarray(_DEEPEST * (own + self.rest_lengths[edge]))

    def _ahead(
        self, positions: FloatArray, points: FloatArray, normals: FloatArray, reach: float
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Points and edges that are near in place and opposite in direction, and parameters.

        Nearest in the product of both; of the surface behind it, only a part is found.
        """
        surface = self.surface
        samples = surface.at(positions, _SAMPLES).reshape(-1, 2)
        facing = _unit(outward(surface.slopes_at(positions, _SAMPLES))).reshape(-1, 2)
        tree = cKDTree(np.hstack([samples, reach * facing]))
        bound = 1.5 * reach
        distance, found = tree.query(
            np.hstack([points, -reach * normals]), k=_NEAREST, distance_upper_bound=bound
        )
        point, k = np.nonzero(np.isfinite(distance))
        sample = found[point, k]
        return point, sample // len(_SAMPLES), _SAMPLES[sample % len(_SAMPLES)]

    def _inside(
        self, positions: FloatArray, points: FloatArray, normals: FloatArray, lengths: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Every point with every edge that it may be inside of, and parameters to start with.

        All of them: in a sharp fold the nearest few can be the wrong ones, and a point that is
        lost takes its energy with it.
        """
        nodes = positions[self.surface.nodes]
        radius = np.linalg.norm(nodes - nodes[:, 1:2], axis=2).max(axis=1)
        radius = radius + _DEEPEST * (self.rest_lengths + self.rest_lengths.max())
        radius += np.where(self.surface.open_ends.any(1), _OPEN_OVERHANG, 0.0) * lengths
        found = cKDTree(points).query_ball_point(nodes[:, 1], radius)
        edge = np.repeat(np.arange(len(nodes)), [len(k) for k in found])
        point = np.fromiter(itertools.chain.from_iterable(found), np.int64, len(edge))
        chord = nodes[:, 2] - nodes[:, 0]
        direction = _unit(outward(chord))
        apart = (direction[edge] * normals[point]).sum(1) < _ROUGHLY_OPPOSED
        point, edge = point[apart], edge[apart]
        along = ((points[point] - nodes[edge, 0]) * chord[edge]).sum(1)
        s = along / np.maximum((chord[edge] ** 2).sum(1), 1e-300)
        return point, edge, np.clip(s, 0.0, 1.0)

    def _turns(self, ends: FloatArray) -> FloatArray:
        """Angle in rad by which the surface turns where two edges meet, positive if convex.

        Nearly a half turn is a fold that has closed on itself, not a needle. ``ends`` are the
        edges' slopes at their two ends.
        """
        t, after = ends[self._before, 1], ends[self._after, 0]
        cross = t[:, 0] * after[:, 1] - t[:, 1] * after[:, 0]
        angle = np.arctan2(cross, (t * after).sum(1))
        return np.asarray(np.where(angle > _FOLDED, angle - 2 * np.pi, angle))


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-300))


def _parabolas(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place, first and second derivative at s = 0 of the parabolas through (n, 3, 2) nodes."""
    first, middle, last = x[:, 0], x[:, 1], x[:, 2]
    return first, 4 * middle - 3 * first - last, 4 * (first + last) - 8 * middle


def _project(
    offset: FloatArray, slope: FloatArray, curvature: FloatArray, s: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Closest points of parabolas: Newton's method for ``(p - x(s)) . x'(s) = 0``, a cubic in s.

    Parameters
    ----------
    offset : array (n, 2)
        Points, from the parabolas' beginnings.
    slope, curvature : arrays (n, 2)
        See `_parabolas`.
    s : array (n,)
        Where to start.

    Returns
    -------
    s : array (n,)
    found : bool array (n,)
        Where the method has converged to a closest point, not to one that is furthest away.
    """

    def products(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1])

    # f(s) = f_0 - s (f_1 + s (f_2 + s f_3))
    factors = np.stack(
        [
            products(offset, slope),
            products(slope, slope) - products(offset, curvature),
            1.5 * products(slope, curvature),
            0.5 * products(curvature, curvature),
        ]
    )
    s, update = s.copy(), np.zeros_like(s)
    moving = np.arange(len(s))
    for _ in range(20):
        f_0, f_1, f_2, f_3 = factors[:, moving]
        here = s[moving]
        falls = f_1 + here * (2 * f_2 + here * 3 * f_3)
        value = f_0 - here * (f_1 + here * (f_2 + here * f_3))
        change = np.clip(value / np.where(falls > 0.0, falls, np.inf), -0.5, 0.5)
        update[moving] = change
        s[moving] = np.clip(here + change, -1.0, 2.0)
        moving = moving[np.abs(change) >= 1e-14]
        if not len(moving):
            break
    _, f_1, f_2, f_3 = factors
    return s, (np.abs(update) < 1e-10) & (f_1 + s * (2 * f_2 + s * 3 * f_3) > 0.0)

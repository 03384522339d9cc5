"""Which point of a surface faces which other point of it: closest-point projection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.solid.contact.surface import CURVATURES, Surface, outward, shapes, slopes

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
#: An edge is prolonged by this part of its length at a concave kink between two edges, so that a
#: point inside the other solid is not lost between them (at a convex one it is not inside); and by
#: this much where the surface ends on a side of the meshed part, and its mirror image goes on.
_OVERHANG, _OPEN_OVERHANG = 0.02, 0.5


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
    """

    point: IntArray
    edge: IntArray
    s: FloatArray
    gap: FloatArray
    normal: FloatArray


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

    def find(self, positions: FloatArray) -> Pairs:
        """All pairs closer than about twice the longest edge."""
        surface = self.surface
        points = surface.at(positions, self.s).reshape(-1, 2)
        normals = _unit(outward(surface.slopes_at(positions, self.s))).reshape(-1, 2)
        chord = positions[surface.nodes[:, 2]] - positions[surface.nodes[:, 0]]
        lengths = np.linalg.norm(chord, axis=1)
        reach = 2.0 * lengths.max()
        ahead = self._ahead(positions, points, normals, reach)
        inside = self._inside(positions, points, normals, chord)
        point, edge, s = (np.concatenate(part) for part in zip(ahead, inside, strict=True))
        x = positions[surface.nodes[edge]]
        s, converged = _project(points[point], x, s)
        t = np.einsum("pi,pic->pc", slopes(s), x)
        normal = _unit(outward(t))
        gap = ((points[point] - np.einsum("pi,pic->pc", shapes(s), x)) * normal).sum(1)
        limit = self._overhang(positions)[edge]
        opposed = (normal * normals[point]).sum(1) < _OPPOSED
        seen = converged & opposed & (s >= -limit[:, 0]) & (s <= 1 + limit[:, 1])
        seen &= (gap > -self._deepest(point, edge)) & (gap < reach)
        beyond = np.maximum(np.maximum(-s, s - 1), 0.0) * lengths[edge]
        # Where a point is inside, another surface ahead of it must not hide that: the energy
        # would jump.
        order = np.lexsort([np.abs(gap) + 1e3 * beyond, gap >= 0.0, point, ~seen])
        order = order[: int(seen.sum())]
        _, first = np.unique(point[order], return_index=True)
        best = order[first]
        found = Pairs(point[best], edge[best], s[best], gap[best], normal[best])
        return self._round_corners(positions, points, found)

    def _round_corners(self, positions: FloatArray, points: FloatArray, pairs: Pairs) -> Pairs:
        """Where a point inside a sharp corner is nearer to the corner's other side, that side.

        It need not face the point. Without it the energy would jump when the corner slides past
        the point; so the distance from both sides is zero there.
        """
        convex = np.full((self.surface.edges, 2), -1)
        turns = self._turns(positions) > _SHARP
        convex[self._before[turns], 1] = self._after[turns]
        convex[self._after[turns], 0] = self._before[turns]
        neighbour = convex[pairs.edge, (pairs.s > 0.5).astype(int)]
        asked = np.flatnonzero((pairs.gap < 0.0) & (neighbour >= 0))
        edge, point = neighbour[asked], pairs.point[asked]
        x = positions[self.surface.nodes[edge]]
        s, converged = _project(points[point], x, np.where(pairs.s[asked] > 0.5, 0.0, 1.0))
        normal = _unit(outward(np.einsum("pi,pic->pc", slopes(s), x)))
        gap = ((points[point] - np.einsum("pi,pic->pc", shapes(s), x)) * normal).sum(1)
        nearer = converged & (s >= 0.0) & (s <= 1.0) & (gap > pairs.gap[asked])
        changed = asked[nearer]
        edges, parameters, gaps, normals = (
            part.copy() for part in (pairs.edge, pairs.s, pairs.gap, pairs.normal)
        )
        edges[changed], parameters[changed] = edge[nearer], s[nearer]
        gaps[changed], normals[changed] = gap[nearer], normal[nearer]
        return Pairs(pairs.point, edges, parameters, gaps, normals)

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
        self, positions: FloatArray, points: FloatArray, normals: FloatArray, chord: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Every point with every edge that it may be inside of, and parameters to start with.

        All of them: in a sharp fold the nearest few can be the wrong ones, and a point that is
        lost takes its energy with it.
        """
        nodes = positions[self.surface.nodes]
        radius = np.linalg.norm(nodes - nodes[:, 1:2], axis=2).max(axis=1)
        radius = radius + _DEEPEST * (self.rest_lengths + self.rest_lengths.max())
        found = cKDTree(points).query_ball_point(nodes[:, 1], radius)
        edge = np.repeat(np.arange(len(nodes)), [len(k) for k in found])
        point = np.concatenate([np.asarray(k, np.int64) for k in found])
        direction = _unit(outward(chord))
        apart = (direction[edge] * normals[point]).sum(1) < _ROUGHLY_OPPOSED
        point, edge = point[apart], edge[apart]
        along = ((points[point] - nodes[edge, 0]) * chord[edge]).sum(1)
        s = along / np.maximum((chord[edge] ** 2).sum(1), 1e-300)
        return point, edge, np.clip(s, 0.0, 1.0)

    def _turns(self, positions: FloatArray) -> FloatArray:
        """Angle in rad by which the surface turns where two edges meet, positive if convex.

        Nearly a half turn is a fold that has closed on itself, not a needle.
        """
        ends = self.surface.slopes_at(positions, np.array([0.0, 1.0]))
        t, after = ends[self._before, 1], ends[self._after, 0]
        cross = t[:, 0] * after[:, 1] - t[:, 1] * after[:, 0]
        angle = np.arctan2(cross, (t * after).sum(1))
        return np.asarray(np.where(angle > _FOLDED, angle - 2 * np.pi, angle))

    def _overhang(self, positions: FloatArray) -> FloatArray:
        """By which part of its length each edge is prolonged at its two ends."""
        concave = self._turns(positions) < 0.0
        limit = np.where(self.surface.open_ends, _OPEN_OVERHANG, 0.0)
        limit[self._before[concave], 1] = _OVERHANG
        limit[self._after[concave], 0] = _OVERHANG
        return limit


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-300))


def _project(
    points: FloatArray, x: FloatArray, s: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Closest points of parabolas: Newton's method for ``(p - x(s)) . x'(s) = 0``."""
    c = np.einsum("i,pic->pc", CURVATURES, x)
    update = np.zeros_like(s)
    for _ in range(20):
        offset = points - np.einsum("pi,pic->pc", shapes(s), x)
        t = np.einsum("pi,pic->pc", slopes(s), x)
        curvature = (t * t).sum(1) - (offset * c).sum(1)
        safe = np.where(curvature > 0.0, curvature, np.inf)
        update = np.clip((offset * t).sum(1) / safe, -0.5, 0.5)
        s = np.clip(s + update, -1.0, 2.0)
        if np.abs(update).max(initial=0.0) < 1e-14:
            break
    t = np.einsum("pi,pic->pc", slopes(s), x)
    offset = points - np.einsum("pi,pic->pc", shapes(s), x)
    curvature = (t * t).sum(1) - (offset * c).sum(1)
    return s, (np.abs(update) < 1e-10) & (curvature > 0.0)

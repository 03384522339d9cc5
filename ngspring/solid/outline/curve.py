"""Curves with corners, and points along them spaced by their curvature."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.solid.outline.levelset import LevelSet

#: Directions that differ by more than this across no distance make a corner, in rad; no distance
#: is this many units of the level set.
_CORNER_ANGLE = 0.35
_CORNER_SIZE = 1e-4


@dataclass(frozen=True, eq=False)
class Curve:
    """One contour, with the solid on its left.

    Attributes
    ----------
    points : array (n, 2)
        On the contour to 1e-12 of the domain. A closed curve does not repeat its first point.
    closed : bool
        Open curves begin and end on a side of the domain.
    corners : int array
        Points at which the direction jumps, never the ends of an open curve. Empty for splines.
    """

    points: FloatArray
    closed: bool
    corners: IntArray

    @property
    def length(self) -> float:
        """Length of the polygon in mm."""
        return float(np.linalg.norm(np.diff(self.loop, axis=0), axis=1).sum())

    @property
    def loop(self) -> FloatArray:
        """The points, with the first one repeated at the end of a closed curve."""
        return np.vstack([self.points, self.points[:1]]) if self.closed else self.points


def resampled(
    level_set: LevelSet, points: FloatArray, closed: bool, spacing: float, angle: float
) -> Curve:
    """The curve with points spaced by its curvature, and its corners.

    Parameters
    ----------
    level_set : LevelSet
    points : array (n, 2)
        Vertices on the contour, dense enough to be a start of Newton's method in between, with
        the solid on the left.
    closed : bool
    spacing, angle
        See `ngspring.solid.outline.contour.trace`.
    """
    dense = np.vstack([points, points[:1]]) if closed else points
    if level_set.exact:
        split = np.empty(0, np.int64)
    else:
        dense, split = _with_corners(level_set, dense)
        if closed and split.size:
            # A closed curve with corners begins at one of them.
            dense = np.vstack([dense[split[0] : -1], dense[: split[0] + 1]])
            split = (split - split[0])[1:]
    bounds = [0, *split.tolist(), len(dense) - 1]
    arcs = [_respaced(level_set, dense[a : b + 1], spacing, angle) for a, b in pairwise(bounds)]
    corners = np.cumsum([len(arc) - 1 for arc in arcs])[:-1]
    if closed and split.size:
        corners = np.concatenate([[0], corners])
    joined = np.vstack([arcs[0], *(arc[1:] for arc in arcs[1:])])
    return Curve(joined[:-1] if closed else joined, closed, corners.astype(np.int64))


def _turns(normals: FloatArray) -> FloatArray:
    """Angles between successive unit vectors in rad."""
    a, b = normals[:-1], normals[1:]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.asarray(np.abs(np.arctan2(cross, (a * b).sum(axis=1))))


def _with_corners(level_set: LevelSet, dense: FloatArray) -> tuple[FloatArray, IntArray]:
    """Points added where the direction jumps, and the numbers of those that are corners."""
    size = _CORNER_SIZE * level_set.unit
    for _ in range(60):
        gap = np.linalg.norm(np.diff(dense, axis=0), axis=1)
        jump = (_turns(level_set.normals(dense)) > _CORNER_ANGLE) & (gap > size)
        where = np.flatnonzero(jump)
        if not where.size:
            break
        middle = (dense[where] + dense[where + 1]) / 2
        dense = np.insert(dense, where + 1, level_set.project(middle), axis=0)
    jumps = np.flatnonzero(_turns(level_set.normals(dense)) > _CORNER_ANGLE) + 1
    jumps = jumps[(jumps > 1) & (jumps < len(dense) - 1)]
    # The few points that mark one corner count once.
    place = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    apart = np.diff(place[jumps], prepend=-np.inf) > 10 * size
    return dense, jumps[apart].astype(np.int64)


def _respaced(level_set: LevelSet, dense: FloatArray, spacing: float, angle: float) -> FloatArray:
    """Points on a smooth arc whose distance follows the curvature; both ends are kept."""
    gap = np.linalg.norm(np.diff(dense, axis=0), axis=1)
    turn = _turns(level_set.normals(dense))
    if not level_set.exact:
        # At a corner the normal belongs to either side.
        turn = np.where(gap > 2 * _CORNER_SIZE * level_set.unit, turn, 0.0)
        turn[0], turn[-1] = min(turn[:2]), min(turn[-2:])
    needed = np.maximum(gap / spacing, turn / angle)
    place = np.concatenate([[0.0], np.cumsum(needed)])
    count = max(int(np.ceil(place[-1])), 3)
    wanted = np.linspace(0, place[-1], count + 1)[1:-1]
    inner = np.column_stack([np.interp(wanted, place, dense[:, k]) for k in (0, 1)])
    after = np.clip(np.searchsorted(place, wanted), 1, len(place) - 1)
    moved, reached = level_set.approach(inner, reach=gap[after - 1])
    # Near a saddle at the level Newton's method may leave the curve; its vertices do not.
    vertex = np.where(wanted - place[after - 1] < place[after] - wanted, after - 1, after)
    points = np.where(reached[:, None], moved, dense[vertex])
    keep = reached | ((vertex > 0) & (vertex < len(dense) - 1) & _first_of(vertex, ~reached))
    return np.vstack([dense[:1], points[keep], dense[-1:]])


def _first_of(values: IntArray, which: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the marked entries are the first of their value among the marked ones."""
    result = np.zeros(len(values), bool)
    marked = np.flatnonzero(which)
    result[marked[np.unique(values[marked], return_index=True)[1]]] = True
    return result

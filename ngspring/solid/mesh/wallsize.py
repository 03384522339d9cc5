"""Element sizes along the boundary of a solid, from local thickness and curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.solid.outline.levelset import LevelSet
from ngspring.solid.outline.outline import Outline, Piece
from ngspring.solid.sides import SURFACE

#: Surfaces are the two faces of a wall if their normals differ by more than 120 degrees.
_OPPOSITE = -0.5
#: Cosine of the turn between neighbouring points that makes the first of them a corner.
_SMOOTH = 0.94
#: A wedge is not a wall: from face to face along the boundary it must be this much further than
#: across, which leaves rounded ends of walls (1.6) and wedges of more than 28 degrees out.
_AROUND = 4.0
#: Largest distance between a chord and its arc as a share of the gap in front of it.
_SAGITTA = 0.2
#: A wall divided by this many times the wanted number is the element size to begin with.
_LAYERS = 1.05


@dataclass(frozen=True, eq=False)
class Boundary:
    """Points along the boundary of the solid, dense against its features.

    Attributes
    ----------
    pieces : list of Piece
        The pieces in the order of the outline's loops.
    piece : int array (n,)
        Which piece each point belongs to; neighbours share their common end point.
    points, normals : arrays (n, 2)
        Places in mm and unit vectors into the solid.
    curvature : array (n,)
        1 / radius in 1/mm.
    thickness : array (n,)
        Diameter in mm of the largest disc in the solid that touches the boundary at the point
        and an opposite surface; infinite where there is none.
    gap : array (n,)
        The same for the void in front of the point; infinite where it is larger than the domain.
    opposite : int array (n,)
        The point that the disc touches, among the points and their mirror images
        (image ``k`` of point ``i`` is ``k n + i``); -1 where there is none.
    """

    pieces: list[Piece]
    piece: IntArray
    points: FloatArray
    normals: FloatArray
    curvature: FloatArray
    thickness: FloatArray
    gap: FloatArray
    opposite: IntArray


def survey(outline: Outline) -> Boundary:
    """Thickness and curvature along the boundary of the solid."""
    ls = outline.level_set
    spacing = min(ls.problem.L, ls.problem.H) / 300
    pieces = [piece for loop in outline.loops for piece in loop.pieces]
    places, normals, curvature = [], [], []
    for piece in pieces:
        if piece.name == SURFACE:
            p, n = piece.points, ls.normals(piece.points)
            _one_sided(ls, piece, n)
            k = _curvature(p, n)
        else:
            a, b = piece.points
            count = max(2, int(np.ceil(np.linalg.norm(b - a) / spacing)) + 1)
            p = a + np.linspace(0, 1, count)[:, None] * (b - a)
            tangent = (b - a) / np.linalg.norm(b - a)
            n = np.tile([-tangent[1], tangent[0]], (count, 1))
            k = np.zeros(count)
        places.append(p)
        normals.append(n)
        curvature.append(k)
    number = np.repeat(np.arange(len(pieces)), [len(p) for p in places])
    points, into = np.vstack(places), np.vstack(normals)
    inner = np.isin(number, [k for k, piece in enumerate(pieces) if piece.name in ls.mirrors])
    loop_of_piece = np.repeat(
        np.arange(len(outline.loops)), [len(loop.pieces) for loop in outline.loops]
    )
    way = _Way(loop_of_piece[number], *_places(points, loop_of_piece[number]))
    thickness, opposite = _thickness(ls, points, into, inner, way)
    gap, _ = _thickness(ls, points, -into, inner, way)
    # A disc that leaves the domain lies in front of a hollow, not between two surfaces.
    gap[gap > max(ls.problem.L, ls.problem.H)] = np.inf
    return Boundary(
        pieces, number, points, into, np.concatenate(curvature), thickness, gap, opposite
    )


@dataclass(frozen=True, eq=False)
class _Way:
    """Where each point lies along its loop, and the length of the loop."""

    loop: IntArray
    place: FloatArray
    around: FloatArray

    def between(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Distances along the boundary; infinite between loops."""
        a = np.abs(self.place[rows, None] - self.place[columns])
        same = self.loop[rows, None] == self.loop[columns]
        return np.asarray(np.where(same, np.minimum(a, self.around[rows, None] - a), np.inf))


def _places(points: FloatArray, loop: IntArray) -> tuple[FloatArray, FloatArray]:
    step = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    step[np.diff(loop, prepend=loop[:1]) != 0] = 0.0
    place = np.cumsum(step)
    first = np.array([place[loop == k].min() for k in range(loop.max() + 1)])
    last = np.array([place[loop == k].max() for k in range(loop.max() + 1)])
    return place - first[loop], (last - first)[loop]


def _one_sided(ls: LevelSet, piece: Piece, normals: FloatArray) -> None:
    """At the corners of a function's contour, take the normal of the neighbour on this piece."""
    if not ls.exact and not piece.periodic and len(normals) > 2:
        for end, inside in ((0, 1), (-1, -2)):
            if normals[end] @ normals[inside] < _SMOOTH:
                normals[end] = normals[inside]


def _curvature(points: FloatArray, normals: FloatArray) -> FloatArray:
    gap = np.linalg.norm(np.diff(points, axis=0), axis=1)
    a, b = normals[:-1], normals[1:]
    turn = np.abs(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)))
    between = np.divide(turn, gap, out=np.zeros_like(turn), where=gap > 0)
    return np.asarray(
        np.maximum(np.append(between, between[-1]), np.insert(between, 0, between[0]))
    )


def _thickness(
    ls: LevelSet,
    points: FloatArray,
    normals: FloatArray,
    inner: NDArray[np.bool_],
    way: _Way,
) -> tuple[FloatArray, IntArray]:
    """Diameter of the maximal inscribed disc at each point; ``inner`` ones are not on a surface."""
    n = len(points)
    images = ls.problem.sector.images()
    all_points = np.vstack([offset + sign * points for sign, offset in images])
    all_normals = np.vstack([sign * normals for sign, _ in images])
    surface = np.flatnonzero(np.tile(~inner, len(images)))
    thickness, opposite = np.full(n, np.inf), np.full(n, -1)
    q, m = all_points[surface], all_normals[surface]
    for block in np.array_split(np.flatnonzero(~inner), max(1, n * len(q) // 2_000_000 + 1)):
        apart = q[None] - points[block, None]
        height = (apart * normals[block, None]).sum(axis=2)
        facing = (normals[block] @ m.T < _OPPOSITE) & (height > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            diameter = np.where(facing, (apart**2).sum(axis=2) / height, np.inf)
        own = np.flatnonzero(surface < n)
        near = way.between(block, surface[own]) < _AROUND * diameter[:, own]
        diameter[:, own] = np.where(near, np.inf, diameter[:, own])
        best = diameter.argmin(axis=1)
        thickness[block] = diameter[np.arange(len(block)), best]
        found = np.isfinite(thickness[block])
        opposite[block] = np.where(found, surface[best], -1)
    return thickness, opposite


@dataclass(frozen=True)
class Sizes:
    """What decides the size of the elements.

    Attributes
    ----------
    across : float
        Elements across every wall.
    angle : float
        Largest turn of the surface within an element in rad.
    smallest, largest : float
        Bounds of the element size in mm.
    grading : float
        Largest growth of the size per distance.
    """

    across: float
    angle: float
    smallest: float
    largest: float
    grading: float = 0.3

    def along(self, boundary: Boundary, refine: FloatArray) -> FloatArray:
        """Element size at each point of the boundary; ``refine`` scales the walls' share."""
        with np.errstate(divide="ignore"):
            bend = self.angle / boundary.curvature
            # Chords on the two faces of a curved slit must not cross.
            bend = np.minimum(bend, np.sqrt(8 * _SAGITTA * boundary.gap / boundary.curvature))
        size = np.minimum(self.inside(boundary, refine), np.maximum(bend, self.smallest))
        return np.asarray(size)

    def inside(self, boundary: Boundary, refine: FloatArray) -> FloatArray:
        """Element size inside the wall that begins at each point of the boundary."""
        wall = boundary.thickness / (_LAYERS * self.across) * refine
        return np.asarray(np.clip(wall, self.smallest, self.largest))


def graded(points: FloatArray, size: FloatArray, grading: float) -> FloatArray:
    """Sizes reduced so that they grow by at most ``grading`` times the distance between points."""
    result: FloatArray = size.copy()
    order = np.argsort(size)
    # Small sizes reach out first; a point already below its limit cannot lower others further.
    for k in order.tolist():
        limit = result[k] + grading * np.hypot(*(points - points[k]).T)
        np.minimum(result, limit, out=result)
    return result

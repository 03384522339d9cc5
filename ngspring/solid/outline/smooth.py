"""Outlines as cubic splines within a tolerance, for drawings and CAD."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import OutlineError
from ngspring.solid.outline.levelset import LevelSet
from ngspring.solid.outline.outline import Loop, Outline, Piece
from ngspring.solid.sides import SURFACE

_REFINEMENTS = 12
_CHECKED = np.array([0.2, 0.5, 0.8])


@dataclass(frozen=True, eq=False)
class SmoothPiece:
    """A straight or cubic piece of an outline.

    Attributes
    ----------
    points : array (n, 2)
        On the contour of chi; the two ends of a straight piece.
    parameters : array (n,)
        Parameter of the spline at each point: the length of the polygon up to it.
    spline : BSpline, optional
        Clamped C2 cubic through the points, with the contour's tangents at the ends. None for
        straight pieces.
    """

    points: FloatArray
    parameters: FloatArray
    spline: BSpline | None = None

    def beziers(self) -> FloatArray:
        """Control points (n - 1, 4, 2) of the cubic Bezier curves; a line is one of them."""
        if self.spline is None:
            a, b = self.points
            return np.array([[a, a + (b - a) / 3, a + 2 * (b - a) / 3, b]])
        # With free ends the outermost points are not knots, and spans may be split: harmless.
        ends, slopes = self.spline(self.parameters), self.spline(self.parameters, 1)
        third = np.diff(self.parameters)[:, None] / 3
        first, last = ends[:-1], ends[1:]
        return np.stack(
            [first, first + third * slopes[:-1], last - third * slopes[1:], last], axis=1
        )


def smooth_loops(
    outline: Outline, tolerance: float, degree: int = 3
) -> list[list[list[SmoothPiece]]]:
    """Parts -> loops -> pieces, each within the tolerance (mm) of the contour.

    Of degree 1 the curves are polygons through their points.

    Raises
    ------
    OutlineError
        If a contour is not smooth enough.
    """
    return [
        [_smooth_loop(outline.level_set, loop, tolerance, degree) for loop in part.loops]
        for part in outline.parts
    ]


def _smooth_loop(ls: LevelSet, loop: Loop, tolerance: float, degree: int) -> list[SmoothPiece]:
    return [
        fit(ls, piece, tolerance, degree) if piece.name == SURFACE else _straight(piece)
        for piece in loop.pieces
    ]


def _straight(piece: Piece) -> SmoothPiece:
    a, b = piece.points
    return SmoothPiece(piece.points, np.array([0.0, float(np.linalg.norm(b - a))]))


def fit(ls: LevelSet, piece: Piece, tolerance: float, degree: int = 3) -> SmoothPiece:
    """A spline through points of a piece, refined until it is within the tolerance (mm)."""
    points = piece.points
    for _ in range(_REFINEMENTS):
        spline, knots = _interpolant(ls, points, piece.periodic, degree)
        u = knots[:-1, None] + np.diff(knots)[:, None] * _CHECKED
        place = np.clip(spline(u.ravel()), 0, ls.size)
        off = np.abs(ls.distance(place)).reshape(-1, len(_CHECKED)).max(axis=1)
        poor = np.flatnonzero(off > tolerance)
        if not poor.size:
            return SmoothPiece(points, knots, spline)
        middle = ls.project(np.clip(spline((knots[poor] + knots[poor + 1]) / 2), 0, ls.size))
        points = np.insert(points, poor + 1, middle, axis=0)
    raise OutlineError(
        f"a curve within {tolerance:g} mm of the contour near"
        f" ({points[0, 0]:.4g}, {points[0, 1]:.4g}) mm was not found: use a larger tolerance"
    )


def _interpolant(
    ls: LevelSet, points: FloatArray, periodic: bool, degree: int
) -> tuple[BSpline, FloatArray]:
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    normals = ls.normals(points[[0, -1]])
    if degree == 1 or (not ls.exact and not periodic):
        # At a corner the gradient belongs to either side: leave the ends free.
        return make_interp_spline(knots, points, k=degree if len(points) > 3 else 1), knots
    tangents = np.column_stack([normals[:, 1], -normals[:, 0]])
    ends = ([(1, tangents[0])], [(1, tangents[1])])
    return make_interp_spline(knots, points, k=3, bc_type=ends), knots


def enclosed(parts: list[list[list[SmoothPiece]]], axis: float | None = None) -> float:
    """Area in mm^2 inside the curves, or the volume in mm^3 they sweep about the line x = axis.

    Green's theorem with enough Gauss points to be exact for cubic Beziers.
    """
    nodes, weights = np.polynomial.legendre.leggauss(5)
    total = 0.0
    for piece in (piece for part in parts for loop in part for piece in loop):
        b = piece.beziers()
        for t, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
            s = 1 - t
            x = b[:, :, 0] @ np.array([s**3, 3 * s * s * t, 3 * s * t * t, t**3])
            dy = np.diff(b[:, :, 1], axis=1) @ np.array([3 * s * s, 6 * s * t, 3 * t * t])
            swept = x if axis is None else -np.pi * (axis - x) ** 2
            total += float(weight * (swept * dy).sum())
    return total

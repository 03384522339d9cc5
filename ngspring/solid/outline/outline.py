"""The boundary of the solid: contours and pieces of the domain's sides, joined to closed loops.

Small islands and voids are dropped; parts that nothing holds, and solids that do not join the two
loaded sides, are found here.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.design.design import Design
from ngspring.problem.spring import SpringProblem
from ngspring.solid.outline.contour import solid_area, trace
from ngspring.solid.outline.curve import Curve
from ngspring.solid.outline.levelset import ChiFunction, LevelSet, level_set
from ngspring.solid.sides import SURFACE

logger = logging.getLogger(__name__)

#: Largest area with a density between 0.05 and 0.95, as a multiple of what the interfaces of a
#: design at the steepest slope of chi take (Eq. 11); finished designs have 1.3 to 2.
CLEAR = 5.0
#: Voids of a smaller share of L H are filled.
_VOID = 1e-7
#: Stops along the sides are the same up to this distance, in units of the level set.
_SAME = 1e-9
#: |chi| at the densities 0.05 and 0.95.
_GREY_CHI = float(np.log(19.0))


@dataclass(frozen=True, eq=False)
class Piece:
    """A smooth piece of a loop with the solid on its left.

    Attributes
    ----------
    points : array (n, 2)
        In mm; the first one is repeated at the end if the piece is a whole smooth loop. Of a
        straight piece the two ends.
    name : str
        `ngspring.solid.sides.SURFACE`, or the side of the domain on which the piece lies.
    periodic : bool
        Whether the piece is a whole smooth loop.
    """

    points: FloatArray
    name: str = SURFACE
    periodic: bool = False


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed sequence of pieces, each beginning where the one before ends."""

    pieces: tuple[Piece, ...]

    @property
    def polygon(self) -> FloatArray:
        """The vertices (n, 2), the first one not repeated."""
        return np.vstack([piece.points[:-1] for piece in self.pieces])

    @property
    def area(self) -> float:
        """Signed area of the polygon in mm^2; negative for the edge of a void."""
        polygon = self.polygon
        if len(polygon) < 3:
            # There and back along a side; shapely makes no ring of two points.
            return 0.0
        ring = shapely.LinearRing(polygon)
        area = float(shapely.Polygon(ring).area)
        return area if ring.is_ccw else -area

    @property
    def sides(self) -> frozenset[str]:
        """Sides of the domain that the loop reaches."""
        return frozenset(piece.name for piece in self.pieces) - {SURFACE}


def area_inside(ls: LevelSet, loop: Loop) -> float:
    """Signed area of a loop in mm^2 with parabolas through the contour as its edges."""
    area = loop.area
    for piece in loop.pieces:
        if piece.name == SURFACE:
            chord = np.diff(piece.points, axis=0)
            middle = (piece.points[1:] + piece.points[:-1]) / 2
            moved, reached = ls.approach(middle, reach=np.linalg.norm(chord, axis=1) / 2)
            bow = np.where(reached[:, None], moved - middle, 0.0)
            area += float((bow[:, 0] * chord[:, 1] - bow[:, 1] * chord[:, 0]).sum() * 2 / 3)
    return area


@dataclass(frozen=True, eq=False)
class Part:
    """A connected piece of the solid: its outer edge and the edges of the voids inside it."""

    outer: Loop
    voids: tuple[Loop, ...] = ()

    @property
    def loops(self) -> tuple[Loop, ...]:
        """The outer edge, then those of the voids."""
        return (self.outer, *self.voids)

    @property
    def area(self) -> float:
        """Area of the polygon in mm^2."""
        return sum(loop.area for loop in self.loops)


@dataclass(frozen=True, eq=False)
class Outline:
    """The solid on the meshed part of the domain.

    Attributes
    ----------
    level_set : LevelSet
    parts : tuple of Part
        What is kept, the largest part first. At least one joins the two loaded sides.
    dropped : tuple of Part
        Islands below the given area, and parts that touch neither loaded side.
    filled : tuple of Loop
        Voids below the given area, which count as solid.
    loose : tuple of Part
        Those of `parts` that touch only one of the loaded sides.
    """

    level_set: LevelSet
    parts: tuple[Part, ...]
    dropped: tuple[Part, ...] = ()
    filled: tuple[Loop, ...] = ()
    loose: tuple[Part, ...] = field(default=())

    @property
    def area(self) -> float:
        """Area of the solid in mm^2 by quadrature of chi, without what was dropped or filled."""
        ls = self.level_set
        without = [loop for part in self.dropped for loop in part.loops] + list(self.filled)
        return solid_area(ls) - sum(area_inside(ls, loop) for loop in without)

    @property
    def loops(self) -> tuple[Loop, ...]:
        """All loops of all parts."""
        return tuple(loop for part in self.parts for loop in part.loops)


def outline(
    design: Design | ChiFunction,
    problem: SpringProblem | None = None,
    *,
    level: float = 0.0,
    domain: str | None = None,
    smallest_island: float | None = None,
    smallest_void: float | None = None,
    spacing: float | None = None,
    angle: float = 0.1,
) -> Outline:
    """The boundary of {chi > level} on the meshed part of the domain.

    Parameters
    ----------
    design, problem, level, domain
        See `ngspring.solid.outline.levelset.level_set`.
    smallest_island : float, optional
        Separate solid parts whose area in the full domain is below this (mm^2) are dropped with a
        warning; by default l_i^2, a single interface width.
    smallest_void : float, optional
        Voids whose area in the full domain is below this (mm^2) are filled with a warning; by
        default 1e-7 of L H.
    spacing, angle
        See `ngspring.solid.outline.contour.trace`.

    Raises
    ------
    OutlineError
        If the design is empty, full, grey or not joined to both loaded sides.
    """
    ls = level_set(design, problem, level=level, domain=domain)
    if smallest_island is None:
        smallest_island = ls.problem.l_i**2
    if smallest_void is None:
        smallest_void = _VOID * ls.problem.L * ls.problem.H
    for name, value in (("smallest_island", smallest_island), ("smallest_void", smallest_void)):
        if not (np.isfinite(value) and value >= 0):
            raise ProblemError(f"{name} = {shown(value)} must be an area in mm^2, at least 0")
    curves = trace(ls, spacing, angle)
    if isinstance(design, Design):
        _require_clear(design, ls, sum(curve.length for curve in curves))
    parts, filled = _parts(ls, curves, smallest_void)
    kept, dropped, loose = [], [], []
    for part in sorted(parts, key=lambda part: -part.area):
        touched = {"bottom", "top"} & part.outer.sides
        if _full_area(part.outer, part.area, ls) < smallest_island or not touched:
            dropped.append(part)
        else:
            kept.append(part)
            if len(touched) == 1:
                loose.append(part)
    _report(ls, dropped, loose, filled)
    if len(kept) == len(loose):
        raise OutlineError(
            f"the solid chi > {ls.level:g} is not connected: no part of it joins the bottom and"
            " the top of the domain"
        )
    return Outline(ls, tuple(kept), tuple(dropped), tuple(filled), tuple(loose))


def _report(ls: LevelSet, dropped: list[Part], loose: list[Part], filled: list[Loop]) -> None:
    for part in dropped:
        logger.warning("dropped %s: it joins no loaded side", _described(part.outer, part.area, ls))
    for part in loose:
        side = next(iter({"bottom", "top"} & part.outer.sides))
        logger.warning(
            "%s touches only the %s of the meshed part", _described(part.outer, part.area, ls), side
        )
    for loop in filled:
        logger.warning("filled %s", _described(loop, -loop.area, ls, "a void"))


def _described(loop: Loop, area: float, ls: LevelSet, kind: str = "a solid part") -> str:
    x, y = loop.polygon.mean(axis=0)
    return f"{kind} of {_full_area(loop, area, ls):.3g} mm^2 near ({x:.4g}, {y:.4g}) mm"


def _full_area(loop: Loop, area: float, ls: LevelSet) -> float:
    """Area of a part together with the mirror images it is joined to."""
    return float(area * 2 ** len(loop.sides & set(ls.mirrors)))


def _require_clear(design: Design, ls: LevelSet, length: float) -> None:
    """Refuse a design that is grey beyond its interfaces."""
    width, height = ls.size
    nx, ny = (8 * cells for cells in ls.cells)
    x, y = (np.arange(nx) + 0.5) * width / nx, (np.arange(ny) + 0.5) * height / ny
    grey = float((np.abs(design.chi(x[:, None], y[None, :])) < _GREY_CHI).mean()) * width * height
    band = 2 * _GREY_CHI * ls.problem.l_i / 8
    if grey > CLEAR * band * max(length, min(width, height)):
        raise OutlineError(
            f"the design is grey: {grey / (width * height):.0%} of its area has a density between"
            f" 0.05 and 0.95, but {length:.4g} mm of interface take"
            f" {band * length / (width * height):.1%}; it has no clear outline"
        )


# -- loops -----------------------------------------------------------------------------------------


def _parts(
    ls: LevelSet, curves: list[Curve], smallest_void: float
) -> tuple[list[Part], list[Loop]]:
    loops = [Loop(_pieces(curve)) for curve in curves if curve.closed]
    open_curves, filled = [], []
    for curve in curves:
        if not curve.closed:
            notch = _void_at_mirror(ls, curve)
            if notch is not None and _full_area(notch, -area_inside(ls, notch), ls) < smallest_void:
                filled.append(notch)
            else:
                open_curves.append(curve)
    loops += _side_loops(ls, open_curves)
    outer = [loop for loop in loops if loop.area > 0]
    if not outer:
        raise OutlineError(f"the design is empty: chi > {ls.level:g} nowhere")
    if len(loops) == 1 and not curves:
        raise OutlineError(f"the design is full: chi > {ls.level:g} in the whole domain")
    inner: list[Loop] = []
    for loop in loops:
        if loop.area <= 0:
            small = _full_area(loop, -area_inside(ls, loop), ls) < smallest_void
            (filled if small else inner).append(loop)
    polygons = [shapely.Polygon(loop.polygon) for loop in outer]
    voids: dict[int, list[Loop]] = {k: [] for k in range(len(outer))}
    for loop in inner:
        around = np.flatnonzero(shapely.contains_xy(polygons, *loop.polygon[0]))
        if around.size:
            voids[min(around.tolist(), key=lambda k: outer[k].area)].append(loop)
    return [Part(loop, tuple(voids[k])) for k, loop in enumerate(outer)], filled


def _void_at_mirror(ls: LevelSet, curve: Curve) -> Loop | None:
    """The part of a void that mirror lines cut off, if the curve is its edge."""
    sides = [
        next((side for side in ls.mirrors if _lies_on(point, side, ls.size)), None)
        for point in curve.points[[0, -1]]
    ]
    if None in sides:
        return None
    first, last = curve.points[[0, -1]]
    stops = [last, first] if sides[0] == sides[1] else [last, np.array(ls.size), first]
    straight = [
        Piece(np.array(pair), str(side))
        for pair, side in zip(pairwise(stops), (sides[1], sides[0]), strict=False)
    ]
    loop = Loop((*_pieces(curve), *straight))
    return loop if loop.area < 0 else None


def _lies_on(point: FloatArray, side: str, size: tuple[float, float]) -> bool:
    axis = 0 if side == "right" else 1
    return bool(point[axis] == size[axis])


def _pieces(curve: Curve) -> tuple[Piece, ...]:
    points = curve.loop
    if curve.closed and not curve.corners.size:
        return (Piece(points, periodic=True),)
    bounds = [*curve.corners.tolist(), len(points) - 1]
    if not curve.closed:
        bounds = [0, *bounds]
    return tuple(Piece(points[a : b + 1]) for a, b in pairwise(bounds) if b > a)


def _place_on_sides(point: FloatArray, size: tuple[float, float]) -> float:
    """Counter-clockwise distance along the rectangle from its lower left corner."""
    (x, y), (width, height) = point, size
    away = [y, width - x, height - y, x]
    side = int(np.argmin(away))
    return float([x, width + y, 2 * width + height - x, 2 * (width + height) - y][side])


def _side_loops(ls: LevelSet, curves: list[Curve]) -> list[Loop]:
    """Open curves joined by the solid pieces of the sides, counter-clockwise."""
    width, height = ls.size
    if not curves:
        middle = np.array([0.0, width / 2, width]), np.array([0.0, height / 2, height])
        inside = ls.value(middle[0][[0, 2, 0, 2, 1]], middle[1][[0, 0, 2, 2, 0]])
        if np.median(inside) <= 0:
            return []
        corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
        sides = ("bottom", "right", "top", "left")
        pairs = zip(corners, np.roll(corners, -1, axis=0), sides, strict=True)
        return [Loop(tuple(Piece(np.array([a, b]), side) for a, b, side in pairs))]
    begin = np.array([_place_on_sides(curve.points[0], ls.size) for curve in curves])
    loops, used = [], np.zeros(len(curves), bool)
    around = 2 * (width + height)
    for first in range(len(curves)):
        if used[first]:
            continue
        pieces: list[Piece] = []
        here = first
        while True:
            used[here] = True
            pieces += _pieces(curves[here])
            end = curves[here].points[-1]
            ahead = (begin - _place_on_sides(end, ls.size)) % around
            following = int(np.argmin(ahead))
            pieces += _along_sides(end, curves[following].points[0], float(ahead[following]), ls)
            here = following
            if here == first:
                break
            if used[here]:
                raise OutlineError("the contour and the sides of the domain do not fit together")
        loops.append(Loop(tuple(pieces)))
    return loops


def _along_sides(a: FloatArray, b: FloatArray, distance: float, ls: LevelSet) -> list[Piece]:
    """Straight pieces from a counter-clockwise along the sides to b."""
    width, height = ls.size
    start = _place_on_sides(a, ls.size)
    tiny = _SAME * ls.unit
    places = np.cumsum([0.0, width, height, width, height, width, height, width, height])
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    sides = ("bottom", "right", "top", "left")
    between = [k for k, s in enumerate(places) if start + tiny < s < start + distance - tiny]
    stops = [a, *(corners[k % 4] for k in between), b]
    first = int(np.searchsorted(places, start + tiny)) - 1
    return [
        Piece(np.array([stops[k], stops[k + 1]]), sides[(first + k) % 4])
        for k in range(len(stops) - 1)
    ]

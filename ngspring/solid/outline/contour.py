"""The contours chi = level, traced on the spline itself.

On a cell of its grid chi is biquadratic. In Bernstein form its nine coefficients bound it, so a
cell without a contour is recognised with certainty, and so is one where chi is monotone in x or in
y and every contour therefore a graph. The cells are halved until each is of one of these kinds
(after Plantinga and Vegter 2004): thin slits and necks are found however thin they are. Along a
cell's edge chi is a quadratic with known roots; they are the vertices of the traced curves.

References
----------
S. Plantinga, G. Vegter, Isotopic approximation of implicit curves and surfaces, SGP 2004.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import OutlineError
from ngspring.solid.outline.curve import Curve, resampled
from ngspring.solid.outline.levelset import FUNCTION_CELLS, LevelSet

#: Fine cells per element with which the search starts on a spline.
_SPLINE_CELLS = 4
_HALVINGS = 5
_DOUBLINGS = 3
_STRIP = 64
_AREA_HALVINGS = 5
#: The traced level differs from the wanted one by this share of the largest |chi|, so that no grid
#: point lies exactly on the contour. Vertices are moved onto the wanted contour afterwards.
_SHIFT = 1.23456789e-13
#: Points of a contour are the same up to this distance, in units of the level set.
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class _Cells:
    """Cells with the Bernstein coefficients of chi, ``[k, a, b]`` for order a in x, b in y."""

    i: IntArray
    j: IntArray
    per_side: tuple[int, int]
    coefficients: FloatArray

    def select(self, which: NDArray[np.bool_]) -> _Cells:
        return _Cells(self.i[which], self.j[which], self.per_side, self.coefficients[which])

    def halved(self) -> _Cells:
        """Four for each, by de Casteljau: a shared edge gets bitwise the same coefficients."""
        parts, i, j = [], [], []
        for a, in_x in enumerate(_split(self.coefficients, 1)):
            for b, both in enumerate(_split(in_x, 2)):
                parts.append(both)
                i.append(2 * self.i + a)
                j.append(2 * self.j + b)
        nx, ny = self.per_side
        return _Cells(np.concatenate(i), np.concatenate(j), (2 * nx, 2 * ny), np.concatenate(parts))


def _split(c: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    first, middle, last = (np.take(c, k, axis=axis) for k in range(3))
    left, right = (first + middle) / 2, (middle + last) / 2
    centre = (left + right) / 2
    return np.stack([first, left, centre], axis), np.stack([centre, right, last], axis)


def trace(level_set: LevelSet, spacing: float | None = None, angle: float = 0.1) -> list[Curve]:
    """All closed and open contours of a level set.

    Parameters
    ----------
    level_set : LevelSet
    spacing : float, optional
        Largest distance between neighbouring points in mm; by default 1/300 of the domain.
    angle : float
        Largest turn of the curve between neighbouring points in rad.

    Raises
    ------
    OutlineError
        If chi is not smooth enough to be traced.
    """
    if spacing is None:
        spacing = min(level_set.problem.L, level_set.problem.H) / 300
    places, chains = _resolved(level_set)
    curves = []
    for chain, closed in chains:
        points = _on_contour(level_set, places[chain], closed)
        if closed and len(points) < 3:
            continue
        curves.append(resampled(level_set, points, closed, spacing, angle))
    return curves


def _resolved(level_set: LevelSet) -> tuple[FloatArray, list[tuple[IntArray, bool]]]:
    """Vertices and the chains of them; of a function at a resolution that finds all it has."""
    if level_set.exact:
        return _chained(level_set, _SPLINE_CELLS)
    before: list[bool] | None = None
    for doubling in range(_DOUBLINGS + 1):
        places, chains = _chained(level_set, FUNCTION_CELLS * 2**doubling)
        found = sorted(closed for _, closed in chains)
        if found == before:
            return places, chains
        before = found
    raise OutlineError(
        "chi(x, y) has details that its samples, 1/128 of an element apart, do not resolve:"
        " give a problem with more elements"
    )


def _chained(level_set: LevelSet, factor: int) -> tuple[FloatArray, list[tuple[IntArray, bool]]]:
    cells = _cells_with_contours(level_set, factor)
    if not cells.i.size:
        return np.empty((0, 2)), []
    places, pairs = _segments(cells, level_set.size)
    return places, _chains(len(places), pairs)


def solid_area(level_set: LevelSet) -> float:
    """Area of {chi > level} on the meshed part in mm^2, by quadrature of the spline.

    Independent of the traced curves: whole cells count by the sign of chi; on the small cells that
    hold a contour the length of the solid along each Gauss line is known exactly. The relative
    error of a design's area is about 1e-8.
    """
    width, height = level_set.size
    factor = _SPLINE_CELLS if level_set.exact else 2 * FUNCTION_CELLS
    cells, total = _initial_cells(level_set, factor)
    for _ in range(_AREA_HALVINGS):
        cells = cells.halved()
        if not level_set.exact:
            cells = _sampled(level_set, cells)
        cut = _may_contain(cells)
        nx, ny = cells.per_side
        whole = ~cut & (cells.coefficients.max(axis=(1, 2)) > 0)
        total += float(whole.sum()) * width / nx * height / ny
        cells = cells.select(cut)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    nx, ny = cells.per_side
    # Lines along the direction in which chi changes most.
    across = np.abs(np.diff(cells.coefficients, axis=1)).sum(axis=(1, 2))
    upwards = np.abs(np.diff(cells.coefficients, axis=2)).sum(axis=(1, 2))
    turned = np.swapaxes(cells.coefficients, 1, 2)
    c = np.where((across > upwards)[:, None, None], cells.coefficients, turned)
    for t, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
        line = c @ np.array([(1 - t) ** 2, 2 * t * (1 - t), t * t])
        roots = np.sort(np.nan_to_num(_edge_roots(line), nan=1.0), axis=1)
        first, last = line[:, 0] > 0, line[:, 2] > 0
        # Without roots both are 1, so the length between them is 0.
        inner = np.where(first == last, roots[:, 1] - roots[:, 0], roots[:, 0])
        solid = np.where(last, 1 - inner, inner)
        total += float(weight * solid.sum()) * width / nx * height / ny
    return total


def _bernstein(nodal: FloatArray, axis: int) -> FloatArray:
    first, middle, last = (np.take(nodal, k, axis=axis) for k in range(3))
    return np.stack([first, 2 * middle - (first + last) / 2, last], axis)


def _initial_cells(level_set: LevelSet, factor: int) -> tuple[_Cells, float]:
    """The cells that may hold a contour, and the area of those that are solid."""
    width, height = level_set.size
    nx, ny = (factor * cells for cells in level_set.cells)
    y = np.linspace(0, height, 2 * ny + 1)
    corners = level_set.value(*np.meshgrid(np.linspace(0, width, nx + 1), y[::2], indexing="ij"))
    shift = _SHIFT * float(np.abs(corners).max())
    kept, solid = [], 0
    # In strips of columns, so that fine samples of the whole domain need not be kept.
    for start in range(0, nx, _STRIP):
        columns = min(_STRIP, nx - start)
        x = np.linspace(0, width, 2 * nx + 1)[2 * start : 2 * (start + columns) + 1]
        chi = level_set.value(x[:, None], y[None, :]) - shift
        i, j = (index.ravel() for index in np.indices((columns, ny)))
        nodal = np.stack(
            [np.stack([chi[2 * i + a, 2 * j + b] for b in range(3)], -1) for a in range(3)], 1
        )
        cells = _Cells(i + start, j, (nx, ny), _bernstein(_bernstein(nodal, 1), 2))
        cut = _may_contain(cells)
        solid += int((~cut & (cells.coefficients.max(axis=(1, 2)) > 0)).sum())
        kept.append(cells.select(cut))
    cells = _Cells(
        np.concatenate([c.i for c in kept]),
        np.concatenate([c.j for c in kept]),
        (nx, ny),
        np.concatenate([c.coefficients for c in kept]),
    )
    return cells, solid * (width / nx) * (height / ny)


def _sampled(level_set: LevelSet, cells: _Cells) -> _Cells:
    """The same cells with chi of a function taken anew at their nodes."""
    nx, ny = cells.per_side
    width, height = level_set.size
    half = np.arange(3)
    x = (2 * cells.i[:, None, None] + half[:, None]) * (width / (2 * nx))
    y = (2 * cells.j[:, None, None] + half) * (height / (2 * ny))
    chi = level_set.value(*np.broadcast_arrays(x, y))
    return _Cells(cells.i, cells.j, cells.per_side, _bernstein(_bernstein(chi, 1), 2))


def _cells_with_contours(level_set: LevelSet, factor: int) -> _Cells:
    cells, _ = _initial_cells(level_set, factor)
    for _ in range(_HALVINGS):
        cells = cells.select(_may_contain(cells))
        if not (~np.logical_or(*_monotone(cells))).any():
            break
        cells = cells.halved()
    return cells.select(_may_contain(cells))


def _may_contain(cells: _Cells) -> NDArray[np.bool_]:
    flat = cells.coefficients.reshape(len(cells.i), 9)
    return np.asarray((flat.min(axis=1) < 0) & (flat.max(axis=1) > 0))


def _monotone(cells: _Cells) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether chi is certainly monotone in x, and in y, on each cell."""
    result: list[NDArray[np.bool_]] = []
    for axis in (1, 2):
        slope = np.diff(cells.coefficients, axis=axis).reshape(len(cells.i), 6)
        result.append(np.asarray((slope > 0).all(axis=1) | (slope < 0).all(axis=1)))
    return result[0], result[1]


def _edge_roots(c: FloatArray) -> FloatArray:
    """Roots in (0, 1) of quadratics in Bernstein form (n, 3): shape (n, 2), filled with NaN.

    Exactly one if the ends differ in sign, else none or two, whatever the rounding.
    """
    a, b = c[:, 0] - 2 * c[:, 1] + c[:, 2], c[:, 1] - c[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        disc = b * b - a * c[:, 0]
        w = -(b + np.where(b >= 0, 1, -1) * np.sqrt(np.maximum(disc, 0)))
        roots = np.sort(np.column_stack([w / a, c[:, 0] / w]), axis=1)
        inside = (roots > 0) & (roots < 1)
    change = (c[:, 0] > 0) != (c[:, 2] > 0)
    # The one root of a change of sign, should rounding put both on the same side of an end.
    middle = np.where(inside[:, 0], roots[:, 0], np.where(inside[:, 1], roots[:, 1], 0.5))
    two = ~change & (disc > 0) & inside.all(axis=1) & (roots[:, 0] < roots[:, 1])
    result = np.where(two[:, None], roots, np.nan)
    result[change, 0] = middle[change]
    return result


def _segments(cells: _Cells, size: tuple[float, float]) -> tuple[FloatArray, IntArray]:
    """Roots on the cells' edges and pairs of them joined by a contour in a cell."""
    nx, ny = cells.per_side
    h = np.array(size) / [nx, ny]
    c, n = cells.coefficients, len(cells.i)
    root_id, cell, place = [], [], []
    # Edges are numbered by their lower left grid point, horizontal ones even, vertical ones odd.
    for vertical, shift, edge in (
        (0, 0, c[:, :, 0]),
        (0, 1, c[:, :, 2]),
        (1, 0, c[:, 0, :]),
        (1, 1, c[:, 2, :]),
    ):
        i = cells.i + (shift if vertical else 0)
        j = cells.j + (0 if vertical else shift)
        roots = _edge_roots(edge)
        for k in (0, 1):
            found = np.flatnonzero(~np.isnan(roots[:, k]))
            t = roots[found, k]
            root_id.append((2 * (i * (ny + 1) + j) + vertical)[found] * 2 + k)
            cell.append(found)
            along = (i[found], j[found] + t) if vertical else (i[found] + t, j[found])
            place.append(np.column_stack(along) * h)
    all_ids, all_cells = np.concatenate(root_id), np.concatenate(cell)
    all_places = np.concatenate(place)
    _, first, number = np.unique(all_ids, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    # A contour that is a graph over y (chi monotone in x) meets its cell's edges in the order of y.
    by_y = _monotone(cells)[0][all_cells]
    order = np.lexsort((np.where(by_y, all_places[:, 1], all_places[:, 0]), all_cells))
    count = np.bincount(all_cells, minlength=n)
    if (count % 2).any():
        raise OutlineError("chi has values that are not consistent: its contour cannot be traced")
    unclear = (count > 2) & ~np.logical_or(*_monotone(cells))
    for k in np.flatnonzero(unclear).tolist():
        start = int(count[:k].sum())
        mine = order[start : start + count[k]]
        order[start : start + count[k]] = mine[_round_pairs(cells, k, all_places[mine], h)]
    return all_places[first], number[order].reshape(-1, 2).astype(np.int64)


def _round_pairs(cells: _Cells, k: int, places: FloatArray, h: FloatArray) -> IntArray:
    """Order that pairs the roots of a cell with a saddle at the level by chi at its centre."""
    corner = np.array([cells.i[k], cells.j[k]]) * h
    offset = places - corner - h / 2
    order = np.argsort(np.arctan2(offset[:, 1] / h[1], offset[:, 0] / h[0]))
    weights = np.array([0.25, 0.5, 0.25])
    centre = weights @ cells.coefficients[k] @ weights
    between = np.arctan2(*(offset[order[:2]] / h).sum(axis=0)[::-1])
    s = np.clip(
        0.5
        + 0.5
        * np.array([np.cos(between), np.sin(between)])
        / max(abs(np.cos(between)), abs(np.sin(between))),
        0,
        1,
    )
    b_x, b_y = (np.array([(1 - t) ** 2, 2 * t * (1 - t), t * t]) for t in s)
    value = b_x @ cells.coefficients[k] @ b_y
    # If the centre belongs to the region between the first two roots, they are not joined.
    return np.roll(order, -1) if (centre > 0) == (value > 0) else order


def _chains(n: int, pairs: IntArray) -> list[tuple[IntArray, bool]]:
    neighbours: list[list[int]] = [[] for _ in range(n)]
    for a, b in pairs.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    seen = np.zeros(n, bool)
    chains = []
    ends = [k for k in range(n) if len(neighbours[k]) == 1]
    for start in [*ends, *range(n)]:
        if seen[start] or not neighbours[start]:
            continue
        chain, previous, here = [start], -1, start
        seen[start] = True
        while True:
            ahead = [k for k in neighbours[here] if k != previous and not seen[k]]
            if not ahead:
                break
            previous, here = here, ahead[0]
            seen[here] = True
            chain.append(here)
        chains.append((np.array(chain), len(neighbours[start]) == 2))
    return chains


def _on_contour(level_set: LevelSet, points: FloatArray, closed: bool) -> FloatArray:
    """Traced vertices moved onto the contour, the ends along their side; solid on the left."""
    width = level_set.size[0]
    # Of a spline the roots are exact but for the shift of the level; where chi hardly changes, at
    # a saddle, Newton's method could only leave them.
    moved, reached = level_set.approach(points)
    result = np.where(reached[:, None], moved, points)
    if not closed:
        ends = points[[0, -1]]
        on_vertical = (ends[:, 0] == 0) | (ends[:, 0] == width)
        along = np.where(on_vertical[:, None], [[0.0, 1.0]], [[1.0, 0.0]])
        moved, reached = level_set.approach(ends, along)
        result[[0, -1]] = np.where(reached[:, None], moved, ends)
    chord = np.diff(result, axis=0)
    normal = level_set.normals((result[1:] + result[:-1]) / 2)
    if (chord[:, 0] * normal[:, 1] - chord[:, 1] * normal[:, 0]).sum() < 0:
        result = result[::-1].copy()
    tiny = _SAME * level_set.unit
    keep = np.linalg.norm(np.diff(result, axis=0, prepend=result[-1:]), axis=1) > tiny
    if not closed:
        keep[[0, -1]] = True
        if np.linalg.norm(result[-1] - result[-2]) <= tiny and len(result) > 2:
            keep[-2] = False
    return np.asarray(result[keep])

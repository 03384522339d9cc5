"""Control points from a measured or drawn curve.

A curve is a list of (d, q); strains and nominal stresses become displacements and forces with the
spring's size, ``d = strain H`` and ``q = stress L T`` (axisymmetric: ``stress pi L^2 / 4``). A
curve of many points is reduced to the few that represent it: each control point costs as much as
the first one.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import finite_number, shown
from ngspring.basics.errors import ProblemError
from ngspring.basics.files import PathLike, naming, read_text
from ngspring.problem.curves.branches import single_valued
from ngspring.problem.curves.drawing import parse_drawing
from ngspring.problem.curves.table import parse_columns
from ngspring.problem.point import ControlPoint

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

#: A curve of at most this many points is taken as it is; more control points are never chosen.
MOST_POINTS = 6
#: The curve through the chosen points stays this close to the given one, relative to its range.
CLOSE = 0.02
#: A force closer to d = 0 than this part of the range is one at the origin.
_NEAR_ZERO = 1 / 200


@dataclass(frozen=True, eq=False)
class TargetCurve:
    """A curve to be matched.

    Attributes
    ----------
    d, q : arrays (points,)
        Displacements in mm, increasing, each once, and forces in N. As given: with or without the
        origin.
    remarks : tuple of str
        What was assumed or averaged while it was read.
    """

    d: FloatArray
    q: FloatArray
    remarks: tuple[str, ...] = ()

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest displacement in mm, zero included."""
        return min(0.0, float(self.d[0])), max(0.0, float(self.d[-1]))

    def force(self, d: FloatArray | float) -> FloatArray:
        """Force in N at displacements in mm, by monotone piecewise cubic interpolation.

        The undeformed state, d = 0 with q = 0, belongs to the curve.

        Raises
        ------
        ProblemError
            If a displacement lies outside the curve.
        """
        low, high = self.range
        values = np.asarray(d, float)
        slack = 1e-9 * (high - low)
        outside = values[(values < low - slack) | (values > high + slack)]
        if outside.size:
            raise ProblemError(
                f"d = {outside.flat[0]:g} mm lies outside the curve, which goes from {low:g} to"
                f" {high:g} mm"
            )
        return np.asarray(_through(self.d, self.q)(np.clip(values, low, high)))

    def control_points(
        self, points: int | None = None, at: Iterable[float] | None = None, weight: float = 1.0
    ) -> tuple[ControlPoint, ...]:
        """A few control points that represent the curve, in order of d or of ``at``.

        Parameters
        ----------
        points : int, optional
            How many. By default a curve of up to six points is taken as it is; of a longer one the
            ends and the middle of either side are taken, and up to six in all until the curve
            through them stays within 2 % of the largest force.
        at : iterable of float, optional
            Their displacements in mm, instead.
        weight : float
            Weight w_q of each, in N^-2.

        Raises
        ------
        ProblemError
            If there are not so many, or a displacement is zero or outside the curve.
        """
        if points is not None and at is not None:
            raise ProblemError("give either the number of control points or their displacements")
        chosen = (
            sorted(self._chosen(points)) if at is None else [finite_number("at", d) for d in at]
        )
        return tuple(
            ControlPoint(d, float(q), weight=weight)
            for d, q in zip(chosen, self._rounded(chosen), strict=True)
        )

    def _rounded(self, d: list[float]) -> FloatArray:
        """Forces at given displacements: as given where they are, else to four digits."""
        q = self.force(np.array(d))
        digits = [float(f"{value:.4g}") for value in q]
        exact = dict(zip(self.d.tolist(), self.q.tolist(), strict=True))
        return np.array([exact.get(a, b) for a, b in zip(d, digits, strict=True)])

    def _chosen(self, points: int | None) -> list[float]:
        given = [d for d in self.d.tolist() if d != 0.0]
        if points is not None and points < 1:
            raise ProblemError(f"points = {points} must be at least 1")
        if len(given) <= MOST_POINTS if points is None else len(given) == points:
            return given
        if points is not None and len(given) < points:
            raise ProblemError(f"the curve has {len(given)} points, fewer than {points}")
        low, high = self.range
        # A side of a few percent is noise around zero.
        ends = [end for end in (low, high) if abs(end) > 0.05 * (high - low)]
        candidates = [_neat(d) for d in np.linspace(low, high, 201) if low < _neat(d) < high]
        candidates = [
            d for d in candidates if d and (d > 0 or low in ends) and (d < 0 or high in ends)
        ]
        chosen = [*ends, *(_neat(end / 2) for end in ends)][:points]
        while len(chosen) < (points or MOST_POINTS):
            where, size = self._worst(chosen, candidates)
            if points is None and size <= CLOSE:
                break
            if where in chosen:
                break
            chosen.append(where)
        return chosen

    def _worst(self, chosen: list[float], candidates: list[float]) -> tuple[float, float]:
        """Where the curve through the chosen points is farthest off, and how far."""
        d = np.array(candidates)
        ends = np.array(sorted(chosen))
        inside = d[(d >= min(0.0, ends[0])) & (d <= max(0.0, ends[-1]))]
        exact = self.force(inside)
        error = np.abs(_through(ends, self.force(ends))(inside) - exact)
        k = int(error.argmax())
        return float(inside[k]), float(error[k] / np.abs(self.q).max(initial=1e-300))

    def notes(self, points: Iterable[ControlPoint]) -> tuple[str, ...]:
        """The remarks, and how well fewer control points stand for the curve.

        Parameters
        ----------
        points : iterable of ControlPoint
            Those of the design itself; ones with an eta are left out.
        """
        chosen = [point for point in points if point.own]
        if len(chosen) >= len(self.d):
            return self.remarks
        return (
            *self.remarks,
            f"{len(chosen)} control points stand for {len(self.d)} points: a smooth curve through"
            f" them is within {100 * self.deviation(chosen):.2g} % of the largest force",
        )

    def deviation(self, points: Iterable[ControlPoint]) -> float:
        """Largest distance of the curve through control points from this one, relative to max |q|.

        Only between the outermost control points (and zero).
        """
        pairs = sorted((p.d, p.q) for p in points)
        d, q = (np.array(values) for values in zip(*pairs, strict=True))
        inside = np.linspace(min(0.0, d[0]), max(0.0, d[-1]), 401)
        error = np.abs(_through(d, q)(inside) - self.force(inside)).max()
        return float(error / max(float(np.abs(self.q).max()), 1e-300))


def _through(d: FloatArray, q: FloatArray) -> PchipInterpolator:
    """Monotone interpolation through points and the origin."""
    keep = d != 0.0
    places, values = np.append(d[keep], 0.0), np.append(q[keep], 0.0)
    order = np.argsort(places)
    # Needed only here, and a fifth of a second to import: every problem comes by this module.
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(places[order], values[order])


def _neat(value: float) -> float:
    """To three significant digits, as one would choose it by hand."""
    return float(f"{value:.3g}")


def parse_curve(
    text: str,
    height: float,
    area: float,
    compression: bool = False,
    branch: str | None = None,
    specimen: int | None = None,
    quantities: str | None = None,
) -> TargetCurve:
    """A target curve from CSV text.

    Parameters
    ----------
    text : str
        See `ngspring.problem.curves.table`.
    height, area : float
        Height of the spring in mm and area of its loaded side in mm^2, which turn strains and
        stresses into displacements and forces.
    compression : bool
        Whether the text counts compression as positive, as test machines do: both signs are
        turned. A column whose name says so, such as ``compression [mm]``, turns them as well.
    branch : {"loading", "unloading", "mean"}, optional
        Of a test with loops, see `ngspring.problem.curves.branches`; loading by default.
    specimen : int, optional
        Which one, from 1, if there are several.
    quantities : {"force", "stress"}, optional
        Which to take of a file that has both; displacement and force by default.

    Raises
    ------
    ProblemError
        If the text cannot be read, has no point but the origin, or a displacement of H or more.
    """
    columns = parse_columns(text, specimen, quantities)
    d, q = columns.x, columns.y
    if columns.stress:
        d, q = d * height, q * area
    remarks = list(columns.remarks)
    if compression or columns.compression:
        d, q = _turned(d, q, remarks, "" if compression else columns.compression)
    elif not columns.tension and _is_positive(d) and _is_positive(q):
        remarks.append(
            "all points are taken as tension; if this was a compression test, give --compression"
        )
    return _curve(d, q, height, remarks, branch, columns.stress)


def _is_positive(values: FloatArray) -> bool:
    """Whether values are positive but for a few percent, which are noise around zero."""
    return bool(values.max() > 0.0 and values.min() >= -0.05 * values.max())


def _turned(
    d: FloatArray, q: FloatArray, remarks: list[str], column: str = ""
) -> tuple[FloatArray, FloatArray]:
    """A curve that counts compression as positive, with the signs of this package.

    Parameters
    ----------
    d, q : arrays
    remarks : list of str
        What was done is added.
    column : str
        The column whose name is the reason; empty if it was asked for.

    Raises
    ------
    ProblemError
        If it was asked for, but the curve is one of compression as it is.
    """
    if _is_positive(-d):
        if not column:
            raise ProblemError(
                "compression turns the signs of a curve that counts it as positive, but here d is"
                " negative, which is compression already: leave it out"
            )
        remarks.append(
            f"column {shown(column)} names compression, but d is negative, which is compression"
            " already: the signs stay as they are"
        )
        return d, q
    reason = f"column {shown(column)} counts compression as positive" if column else "--compression"
    remarks.append(
        f"{reason}: both signs are turned, and a row with negative numbers in the file is tension"
    )
    return -d, -q


def _curve(
    d: FloatArray,
    q: FloatArray,
    height: float,
    remarks: list[str],
    branch: str | None,
    stress: bool = False,
) -> TargetCurve:
    d = _without_rounding(d, height, "d")
    q = _without_rounding(q, float(np.abs(q).max()), "q")
    if not (d != 0.0).any():
        raise ProblemError("the curve has no point with d different from zero")
    far = np.abs(d).max()
    if far >= height:
        hint = ""
        if 10 * height < far < 600 * height:
            hint = " (are the displacements in µm? name their column d [um])"
        if stress:
            hint = " (is it in %, or a stretch? name its column strain [%] or stretch)"
        raise ProblemError(
            f"the curve goes to d = {far:g} mm, but the spring is only H = {height:g} mm high{hint}"
        )
    d, q = single_valued(d, q, branch, remarks)
    scale = float(np.abs(q).max())
    near = np.abs(d) <= _NEAR_ZERO * (d[-1] - d[0]) if len(d) > MOST_POINTS else d == 0.0
    if near.any() and (preload := float(np.abs(q[near]).max())) > 0.05 * scale:
        remarks.append(
            f"the curve does not pass through the origin (q = {preload:.3g} N near d = 0): a spring"
            " has no force at d = 0, so the curve is bent to it there; shift the zero of d"
        )
    return TargetCurve(d, q, tuple(remarks))


def _without_rounding(values: FloatArray, unit: float, name: str) -> FloatArray:
    """Numbers, with zeros in place of what is nothing but rounding beside a unit.

    Raises
    ------
    ProblemError
        If one is too large, or all are too small, to compute with.
    """
    size = np.abs(values)
    largest = float(size.max())
    if not (largest == 0.0 or 1e-30 < largest < 1e30):
        raise ProblemError(f"the curve goes to {name} = {largest:g}: this cannot be computed with")
    return np.where(size > 1e-12 * unit, values, 0.0)


def read_curve(
    path: PathLike,
    height: float,
    area: float,
    axes: tuple[tuple[float, float], tuple[float, float]] | None = None,
    compression: bool = False,
    branch: str | None = None,
    specimen: int | None = None,
    quantities: str | None = None,
) -> TargetCurve:
    """A target curve from a CSV file, or from an SVG drawing.

    Parameters
    ----------
    path : path
        See `parse_curve`; a name that ends with ``.svg`` is a drawing, see
        `ngspring.problem.curves.drawing`.
    height, area : float
        Of the spring, in mm and mm^2, see `parse_curve`. A problem has both: ``problem.H``,
        ``problem.top_area``.
    axes : pair of pairs of float, optional
        Ranges of d in mm and of q in N of a drawing.
    compression : bool
        Whether the file counts compression as positive: both signs are turned.
    branch, specimen, quantities : optional
        What to take of a file that holds more than one curve, see `parse_curve`.

    Raises
    ------
    ProblemError
        With the name of the file.
    """
    name = os.fsdecode(path)
    drawn = name.lower().endswith(".svg")
    with naming(name):
        if drawn and axes is None:
            raise ProblemError("a drawing needs the ranges of d and q that its axes stand for")
        text = read_text(name, foreign=not drawn)
        if axes is not None and drawn:
            d, q = parse_drawing(text, *axes, specimen)
            remarks: list[str] = []
            if compression:
                d, q = _turned(d, q, remarks)
            return _curve(d, q, height, remarks, branch)
        return parse_curve(text, height, area, compression, branch, specimen, quantities)

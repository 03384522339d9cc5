"""The solid {chi > level} of a design, or of any function, on the part of the domain to be meshed.

The rest of the post-evaluation sees chi only through this: its values, its gradient, and points
moved onto the contour by Newton's method along the gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.design.design import Design
from ngspring.fem.grid import Grid
from ngspring.problem.scaling import length_unit
from ngspring.problem.sector import DOMAINS
from ngspring.problem.spring import SpringProblem

#: A vectorised function chi(x, y); x and y in mm from the lower left corner of the full domain.
ChiFunction: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]

#: Points of the contour satisfy |chi - level| / |grad chi| below this, in units of `LevelSet.unit`.
ON_CONTOUR = 1e-10
#: Fine cells per element on which chi of a function is taken as biquadratic to find its contours.
FUNCTION_CELLS = 8
_SAMPLES = 4096
_SYMMETRIC = 1e-9


@dataclass(frozen=True, eq=False)
class LevelSet:
    """chi - level and its gradient on the rectangle ``[0, width] x [0, height]``.

    Attributes
    ----------
    problem : SpringProblem
        Its ``domain`` says which part the rectangle is, as in `ngspring.fem.grid.Grid`.
    value : callable
        chi(x, y) - level, vectorised.
    gradient : callable
        (d chi/dx, d chi/dy), vectorised.
    level : float
    cells : pair of int
        A grid that resolves chi: for a design chi is biquadratic on each cell.
    exact : bool
        Whether chi is a spline, biquadratic on each cell and C1 everywhere, so its contours have
        no corners.
    """

    problem: SpringProblem
    value: ChiFunction
    gradient: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
    level: float
    cells: tuple[int, int]
    exact: bool

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the rectangle in mm."""
        return Grid(self.problem).size

    @property
    def unit(self) -> float:
        """The length in mm that what is tiny is measured with: 1 for the paper's springs."""
        return length_unit(self.problem)

    @property
    def mirrors(self) -> tuple[str, ...]:
        """Sides of the rectangle on which the solid continues as its mirror image."""
        return tuple(mirror.side for mirror in self.problem.sector.mirrors)

    def normals(self, points: FloatArray) -> FloatArray:
        """Unit vectors into the solid (along grad chi), shape (n, 2)."""
        gradient = np.column_stack(self.gradient(points[:, 0], points[:, 1]))
        length = np.linalg.norm(gradient, axis=1, keepdims=True)
        return np.asarray(gradient / np.where(length > 0, length, 1.0))

    def distance(self, points: FloatArray) -> FloatArray:
        """First-order distance (chi - level) / |grad chi| to the contour in mm, signed."""
        slope = np.hypot(*self.gradient(points[:, 0], points[:, 1]))
        chi = self.value(points[:, 0], points[:, 1])
        return np.asarray(chi / np.where(slope > 0, slope, np.inf))

    def project(self, points: FloatArray, along: FloatArray | None = None) -> FloatArray:
        """Points moved onto the contour along grad chi, or along given directions; see `approach`.

        Raises
        ------
        OutlineError
            If a point does not reach the contour to 1e-12 of the domain.
        """
        result, reached = self.approach(points, along)
        if not reached.all():
            x, y = np.asarray(points)[~reached][0]
            raise OutlineError(
                f"no point of the contour chi = {self.level:g} was found near"
                f" ({x:.6g}, {y:.6g}) mm: chi is not smooth there"
            )
        return result

    def approach(
        self,
        points: FloatArray,
        along: FloatArray | None = None,
        reach: FloatArray | None = None,
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Points moved onto the contour by Newton's method, as far as it is near.

        Parameters
        ----------
        points : array (n, 2)
            Near the contour, in mm.
        along : array (n, 2), optional
            Directions in which the points may move; by default along grad chi.
        reach : array (n,), optional
            How far a point may move in mm; by default an element.

        Returns
        -------
        points : array (n, 2)
        reached : bool array (n,)
            Whether each point is on the contour to 1e-12 of the domain and within reach.
        """
        size = np.array(self.size)
        element = float((size / self.cells).min())
        near = ON_CONTOUR * self.unit
        start = np.array(points, float)
        result = start.copy()
        active = np.arange(len(result))
        for _ in range(60):
            here = result[active]
            chi = self.value(here[:, 0], here[:, 1])
            gradient = np.column_stack(self.gradient(here[:, 0], here[:, 1]))
            direction = gradient.copy() if along is None else along[active]
            if along is None:
                # At a side of the domain a point that would leave it moves along the side.
                outwards = -np.sign(chi)[:, None] * gradient
                direction[(here <= 0) & (outwards < 0) | (here >= size) & (outwards > 0)] = 0.0
            slope = (gradient * direction).sum(axis=1)
            step = -chi / np.where(slope != 0, slope, np.inf)
            length = np.abs(step) * np.linalg.norm(direction, axis=1)
            step *= np.minimum(1.0, element / np.maximum(length, 1e-300))
            result[active] = np.clip(here + step[:, None] * direction, 0.0, size)
            active = active[length > 0.1 * near]
            if not active.size:
                break
        allowed = np.full(len(start), element) if reach is None else reach
        moved = np.linalg.norm(result - start, axis=1)
        return result, (np.abs(self.distance(result)) <= near) & (moved <= allowed)


def level_set(
    design: Design | ChiFunction,
    problem: SpringProblem | None = None,
    *,
    level: float = 0.0,
    domain: str | None = None,
) -> LevelSet:
    """The level set of a design, or of a function chi(x, y).

    Parameters
    ----------
    design : Design or callable
        A function takes arrays x, y in mm from the lower left corner of the full domain.
    problem : SpringProblem, optional
        Size, kinematics, material; needed for a function.
    level : float
        The solid is ``{chi > level}``. At an established interface chi changes by ``8 / l_i`` per
        mm, so ``level = -8 o / l_i`` moves the surface outwards by o mm (2.6).
    domain : {"quarter", "full"}, optional
        Part of the domain. By default the quarter if chi is symmetric, else the full domain.

    Raises
    ------
    ProblemError
        If the problem of a function is missing or an argument has the wrong type.
    OutlineError
        If chi is not finite, or a quarter is wanted of a function without its symmetries.
    """
    problem = owner(design, problem)
    if not np.isfinite(level):
        raise ProblemError(f"level = {shown(level)} must be a finite number")
    if domain is not None and domain not in DOMAINS:
        raise ProblemError(f"domain = {shown(domain)} must be 'quarter' or 'full'")
    level = float(level)
    if isinstance(design, Design):
        return _of_design(design, problem.replace(domain=domain or "quarter"), level)
    if domain != "full":
        symmetric = is_symmetric(design, problem)
        if domain == "quarter" and not symmetric:
            raise OutlineError("chi is not symmetric about both axes: use domain='full'")
        domain = "quarter" if symmetric else "full"
    return _of_function(design, problem.replace(domain=domain), level)


def owner(design: Design | ChiFunction, problem: SpringProblem | None) -> SpringProblem:
    """The given problem, or that of a design.

    Raises
    ------
    ProblemError
        If the problem of a function is missing, or it is neither a design nor a function.
    """
    if problem is None:
        if not isinstance(design, Design):
            raise ProblemError("a function chi(x, y) needs a problem that says how large it is")
        return design.problem
    if not callable(design) and not isinstance(design, Design):
        raise ProblemError(f"{shown(design)} is neither a Design nor a function chi(x, y)")
    return problem


def _of_design(design: Design, problem: SpringProblem, level: float) -> LevelSet:
    if (problem.L, problem.H, problem.elements) != (
        design.problem.L,
        design.problem.H,
        design.problem.elements,
    ):
        raise ProblemError("the design belongs to a problem of another size or mesh")

    def value(x: FloatArray, y: FloatArray) -> FloatArray:
        return design.chi(x, y) - level

    def gradient(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        return design.chi(x, y, (1, 0)), design.chi(x, y, (0, 1))

    return LevelSet(problem, value, gradient, level, Grid(problem).cells, exact=True)


def _of_function(chi: ChiFunction, problem: SpringProblem, level: float) -> LevelSet:
    width, height = Grid(problem).size

    def value(x: FloatArray, y: FloatArray) -> FloatArray:
        values = _evaluate(chi, x, y)
        if not np.isfinite(values).all():
            raise OutlineError("the function chi(x, y) has values that are not finite numbers")
        return np.asarray(values - level)

    def slope(x: FloatArray, y: FloatArray, axis: int) -> FloatArray:
        step, end = 1e-7 * min(width, height), (width, height)[axis]
        place = (x, y)[axis]
        low, high = np.maximum(place - step, 0.0), np.minimum(place + step, end)
        upper = value(high, y) if axis == 0 else value(x, high)
        lower = value(low, y) if axis == 0 else value(x, low)
        return np.asarray((upper - lower) / (high - low))

    def gradient(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y = np.asarray(x, float), np.asarray(y, float)
        return slope(x, y, 0), slope(x, y, 1)

    return LevelSet(problem, value, gradient, level, Grid(problem).cells, exact=False)


def _evaluate(chi: ChiFunction, x: FloatArray, y: FloatArray) -> FloatArray:
    values = np.asarray(chi(x, y), dtype=float)
    return np.array(np.broadcast_to(values, np.broadcast_shapes(np.shape(x), np.shape(y))))


def is_symmetric(chi: ChiFunction, problem: SpringProblem) -> bool:
    """Whether a function is symmetric about x = L/2 and y = H/2, judged at 4096 points.

    Of an axisymmetric spring only the half left of the axis exists.
    """
    random = np.random.default_rng(0)
    x, y = random.uniform(size=(2, _SAMPLES)) * [[problem.L], [problem.H]]
    sector = problem.replace(domain="quarter").sector
    if sector.rotation:
        x = x / 2
    here = _evaluate(chi, x, y)
    scale = _SYMMETRIC * max(float(np.abs(here).max()), 1e-300)
    places = np.column_stack([x, y])
    images = [mirror.places(places) for mirror in sector.mirrors if not mirror.rotation]
    return all(bool(np.abs(_evaluate(chi, *image.T) - here).max() <= scale) for image in images)

"""Displacement fields of the whole spring, mirrored from the part that was analysed.

A doubly symmetric design whose deformation stays symmetric satisfies
``u_x(L - x, y) = -u_x(x, y)`` and ``u_y(x, H - y) = d - u_y(x, y)``, which is what the quarter
stands for. An axisymmetric spring is shown as its cross-section, mirrored at the axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from ngspring.analysis.response import Response
from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem


class Curve(Protocol):
    """What every load-displacement curve has, however it was computed."""

    @property
    def d(self) -> FloatArray:
        """Displacements in mm."""

    @property
    def q(self) -> FloatArray:
        """Forces in N."""


class Ended(Protocol):
    """Something that may have ended early."""

    @property
    def message(self) -> str:
        """Where and why, if it did."""


class Fields(Protocol):
    """Displacement fields by the place of their point in a curve."""

    def __getitem__(self, index: int, /) -> Any:
        """u_x and u_y in mm at the vertices, edge middles and centres of the analysed mesh."""


class States(Curve, Protocol):
    """A curve with the displacement fields of some of its points, as pictures need them."""

    @property
    def problem(self) -> SpringProblem:
        """With the domain that was analysed."""

    @property
    def nodes_u(self) -> Fields:
        """Those of the control points at least."""

    @property
    def grey(self) -> FloatArray:
        """Share of the strain energy where the density is between 0.1 and 0.9."""

    @property
    def complete(self) -> bool:
        """Whether every displacement that was asked for was reached."""

    @property
    def message(self) -> str:
        """Where and why the path ended, if it did."""


#: States of the design, or by the offset eta of chi.
Responses = States | Mapping[float, States]


def by_offset(responses: Responses) -> Mapping[float, States]:
    """Responses by the offset eta of chi they belong to; a single one belongs to eta = 0."""
    return responses if isinstance(responses, Mapping) else {0.0: responses}


def curve_displacements(
    design: Design, low: float | None = None, high: float | None = None, points: int = 41
) -> FloatArray:
    """Evenly spaced displacements in mm, from zero to the outermost control points by default."""
    targets = [point.d for point in design.problem.control_points]
    first = min(0.0, *targets) if low is None else low
    last = max(0.0, *targets) if high is None else high
    # Rounded to 1e-9 mm if H = 100 mm; and 0 and the control points are hit exactly.
    decimals = 11 - math.floor(math.log10(design.problem.H))
    values = np.round(np.linspace(first, last, points), decimals)
    exact = np.array([0.0, *targets])
    nearest = exact[np.abs(values[:, None] - exact).argmin(axis=1)]
    same = np.abs(values - nearest) <= 1e-11 * design.problem.H
    return np.asarray(np.where(same, nearest, values))


def path_displacements(design: Design, points: int) -> tuple[float, ...]:
    """Evenly spaced displacements in mm with the control points and zero, in increasing order."""
    controls = [point.d for point in design.problem.control_points]
    return tuple(sorted({0.0, *controls, *map(float, curve_displacements(design, points=points))}))


def index_of(curve: Curve, d: float) -> int | None:
    """Place of a displacement in a curve; None if it was not reached."""
    largest = float(np.abs(curve.d).max(initial=0.0))
    near = np.flatnonzero(np.isclose(curve.d, d, rtol=1e-12, atol=1e-12 * largest))
    return int(near[0]) if len(near) else None


def force_at(curve: Curve, d: float) -> float:
    """Force in N at a displacement; NaN if it was not reached."""
    index = index_of(curve, d)
    return float("nan") if index is None else float(curve.q[index])


def common_path(first: Curve, second: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Displacements of a curve that another one reached, too, and the forces of both there."""
    d = np.array([x for x in first.d if index_of(second, x) is not None])
    q, other = (np.array([force_at(curve, x) for x in d]) for curve in (first, second))
    return d, q, other


def endings(named: Mapping[str, Ended]) -> str:
    """Where and why paths ended, by their names; empty if none did."""
    return "; ".join(f"{name}: {curve.message}" for name, curve in named.items() if curve.message)


def control_places(curve: Curve, problem: SpringProblem, eta: float) -> list[int]:
    """Places in a curve of the control points with this offset, as far as they were reached."""
    points = [p for p in problem.control_points if p.eta == eta and p.on_curves]
    found = [index_of(curve, point.d) for point in points]
    return [place for place in found if place is not None]


def at_control_points(
    responses: Mapping[float, Response], problem: SpringProblem
) -> dict[float, Response]:
    """The same with nothing but the states at control points."""
    return {
        eta: response.selected(control_places(response, problem, eta))
        for eta, response in responses.items()
    }


def reached(responses: Responses, point: ControlPoint) -> float | None:
    """Reaction force in N at a control point; None if it was not reached, or is on no curve."""
    response = by_offset(responses).get(point.eta) if point.on_curves else None
    index = None if response is None else index_of(response, point.d)
    return None if response is None or index is None else float(response.q[index])


def full_displacement(response: States, index: int) -> FloatArray:
    """Displacements in mm on the half-cell grid of the whole spring.

    Returns
    -------
    array (2, 2 N + 1, 2 N + 1)
        u_x and u_y at the vertices, edge middles and centres of the N x N mesh.
    """
    sector = response.problem.sector
    return sector.whole(response.nodes_u[index], float(response.d[index]))


def interpolation(cells: int, t: FloatArray) -> FloatArray:
    """Quadratic interpolation along a line of cells from its half-cell nodes.

    Parameters
    ----------
    cells : int
        The nodes lie at 0, 1/2, 1, ..., cells.
    t : array
        Places within [0, cells].
    """
    cell = np.clip(np.floor(t).astype(np.int64), 0, cells - 1)
    s = t - cell
    weights = np.stack([(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)], axis=1)
    columns = 2 * cell[:, None] + np.arange(3)
    rows = np.repeat(np.arange(len(t)), 3)
    matrix = np.zeros((len(t), 2 * cells + 1))
    matrix[rows, columns.ravel()] = weights.ravel()
    return matrix

"""Displacement fields of the whole spring, mirrored from the part that was analysed.

A doubly symmetric design whose deformation stays symmetric satisfies
``u_x(L - x, y) = -u_x(x, y)`` and ``u_y(x, H - y) = d - u_y(x, y)``, which is what the quarter
stands for. An axisymmetric spring is shown as its cross-section, mirrored at the axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ngspring.analysis.response import Response, load_displacement
from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

Responses = Response | Mapping[float, Response]


def by_offset(responses: Responses) -> Mapping[float, Response]:
    """Responses by the offset eta of chi they belong to; a single one belongs to eta = 0."""
    return {0.0: responses} if isinstance(responses, Response) else responses


def control_point_responses(
    design: Design,
    further: Iterable[float] = (),
    *,
    domain: str | None = None,
    threads: int | None = None,
) -> dict[float, Response]:
    """Responses at the control points by their offset eta.

    Parameters
    ----------
    design : Design
    further : iterable of float
        More displacements in mm for eta = 0, to draw a curve.
    domain : {"quarter", "full"}, optional
        Overrides the problem's.
    threads : int, optional
        See `ngspring.optimize`.
    """
    wanted: dict[float, set[float]] = {0.0: {0.0, *further}}
    for point in design.problem.control_points:
        wanted.setdefault(point.eta, set()).add(point.d)
    return {
        eta: load_displacement(design, sorted(targets), domain, eta=eta, threads=threads)
        for eta, targets in wanted.items()
    }


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


class Curve(Protocol):
    """What every load-displacement curve has, however it was computed."""

    @property
    def d(self) -> FloatArray:
        """Displacements in mm."""

    @property
    def q(self) -> FloatArray:
        """Forces in N."""


def index_of(curve: Curve, d: float) -> int | None:
    """Place of a displacement in a curve; None if it was not reached."""
    largest = float(np.abs(curve.d).max(initial=0.0))
    near = np.flatnonzero(np.isclose(curve.d, d, rtol=1e-12, atol=1e-12 * largest))
    return int(near[0]) if len(near) else None


def force_at(curve: Curve, d: float) -> float:
    """Force in N at a displacement; NaN if it was not reached."""
    index = index_of(curve, d)
    return float("nan") if index is None else float(curve.q[index])


def at_control_points(responses: Responses, problem: SpringProblem) -> dict[float, Response]:
    """The same with nothing but the states at control points."""
    kept: dict[float, Response] = {}
    for eta, response in by_offset(responses).items():
        places = [index_of(response, p.d) for p in problem.control_points if p.eta == eta]
        kept[eta] = response.selected([place for place in places if place is not None])
    return kept


def reached(responses: Responses, point: ControlPoint) -> float | None:
    """Reaction force in N at a control point; None if it was not reached."""
    response = by_offset(responses).get(point.eta)
    index = None if response is None else index_of(response, point.d)
    return None if response is None or index is None else float(response.q[index])


def full_displacement(response: Response, index: int) -> FloatArray:
    """Displacements in mm on the half-cell grid of the whole spring.

    Returns
    -------
    array (2, 2 N + 1, 2 N + 1)
        u_x and u_y at the vertices, edge middles and centres of the N x N mesh.
    """
    sector = response.problem.sector
    return sector.whole(response.nodes_u[index], float(response.d[index]))


def interpolation(cells: int, t: FloatArray) -> sp.csr_matrix:
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
    entries = weights.ravel(), (rows, columns.ravel())
    return sp.csr_matrix(entries, shape=(len(t), 2 * cells + 1))

"""Picture of a spring's stability: critical modes, and the lowest eigenvalue along the path."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ngspring.analysis.stability import Critical, Stability
from ngspring.basics.arrays import FloatArray
from ngspring.basics.text import significant
from ngspring.design.design import Design
from ngspring.view.design import draw_design, moved_grid
from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import picture_name

_MODE = "#c03030"
_COLOURS = {"solid": "black", "grey": "0.6", "void": "white"}
_CELLS = 160


def stability_figure(design: Design, outcome: Stability) -> Figure:
    """The critical states with their modes, and the lowest eigenvalue against d.

    The state at the loss of stability is grey, the outline (chi = 0) of the same state plus the
    critical mode is red. Eigenvalues are marked by where their mode lives: solid, grey or void.

    Parameters
    ----------
    design : Design
    outcome : Stability
        Of this design.
    """
    count = len(outcome.critical)
    figure = new_figure(3.4 * count + 4.4, 3.6)
    axes = figure.subplots(1, count + 1, width_ratios=[3.4] * count + [4.4], squeeze=False)[0]
    for panel, critical in zip(axes, outcome.critical, strict=False):
        _draw_critical(panel, design, critical, outcome.eta)
    _draw_eigenvalues(axes[-1], outcome)
    figure.suptitle(picture_name(design.problem), fontsize=10)
    return figure


def _draw_critical(axes: Axes, design: Design, critical: Critical, eta: float) -> None:
    problem, mode = design.problem, critical.mode
    state, shape = critical.point.u, mode.nodes
    # Of a body of revolution only the half left of its axis was analysed.
    sector = problem.replace(domain="full").sector
    state, shape = sector.whole(state, critical.d), sector.whole(shape, 0.0)
    left, right = draw_design(axes, design, state, eta)
    shifted = state + 0.06 * problem.H * shape
    _outline(axes, design, state, eta, "0.3")
    _outline(axes, design, shifted, eta, _MODE)
    axes.set_xlim(min(0.0, left) - 0.08 * problem.L, max(problem.L, right) + 0.08 * problem.L)
    axes.set_ylim(-0.04 * problem.H, problem.H * 1.04 + max(0.0, critical.d))
    for side in (0.0, problem.H + critical.d):
        axes.axhline(side, color="0.3", linewidth=0.8)
    axes.set_title(
        f"critical: d = {significant(critical.d, 3)} mm, q = {significant(critical.q, 3)} N\n"
        f"{mode.symmetry_text}; {100 * mode.shares[0]:.0f} % in solid",
        fontsize=SMALL + 1,
    )
    axes.set_xlabel("mm", fontsize=SMALL)
    axes.tick_params(labelsize=SMALL - 1)


def _outline(axes: Axes, design: Design, displacement: FloatArray, eta: float, colour: str) -> None:
    problem = design.problem
    cells = max(1, math.ceil(_CELLS / problem.elements)) * problem.elements
    x, y, place_x, place_y = moved_grid(problem, cells, displacement)
    chi = design.chi(x[:, None], y[None, :]) + eta
    if chi.min() < 0 < chi.max():
        axes.contour(place_x, place_y, chi, [0.0], colors=colour, linewidths=1.1)


def _draw_eigenvalues(axes: Axes, outcome: Stability) -> None:
    points = [*outcome.points, *(critical.point for critical in outcome.critical)]
    points.sort(key=lambda point: point.d)
    d = [point.d for point in points]
    values = [point.lowest / outcome.rest for point in points]
    kinds = [point.modes[0].kind for point in points]
    axes.axhline(0, color="0.5", linewidth=0.8)
    axes.plot(d, values, color="0.5", linewidth=1, zorder=1)
    for x, y, kind in zip(d, values, kinds, strict=True):
        axes.plot(x, y, "o", markersize=5, color=_COLOURS[kind], markeredgecolor="black")
    for critical in outcome.critical:
        axes.axvline(critical.d, color=_MODE, linewidth=1)
    handles = [
        Line2D([], [], linestyle="none", marker="o", color=_COLOURS[kind], markeredgecolor="black")
        for kind in _COLOURS
    ]
    axes.legend(handles, [f"mode in {kind}" for kind in _COLOURS], fontsize=SMALL)
    axes.set_xlabel("d [mm]")
    axes.set_ylabel("lowest eigenvalue, relative to rest")
    axes.grid(color="0.92")

"""Pictures of a run: forces against their targets, and how it converged (Fig. 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ngspring.analysis.states import Curve
from ngspring.basics.arrays import FloatArray
from ngspring.design.corrections import Correction
from ngspring.design.history import History, stages
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.view.curves import draw_curve
from ngspring.view.figure import LINES, SMALL, SOLID_STYLE, new_figure
from ngspring.view.text import picture_name, point_label, width_symbol


def reached_figure(
    problem: SpringProblem,
    forces: list[float] | None = None,
    curve: Curve | None = None,
    history: History | None = None,
    solid: Sequence[float] | None = None,
) -> Figure:
    """Targets and reached forces in the load-displacement diagram, with the curve if it is known.

    Parameters
    ----------
    problem : SpringProblem
    forces : list of float, optional
        Forces in N at the control points.
    curve : Curve, optional
    history : History, optional
        Forces of earlier design updates become faint dots.
    solid : sequence of float, optional
        Forces in N of the solid at the control points.
    """
    figure = new_figure(5.4, 4.3)
    axes = figure.subplots()
    draw_curve(axes, {} if curve is None else {"curve": curve}, problem)
    points = problem.control_points
    targets = [point.q for point in points]
    now = [*targets, *(forces or ()), *filter(math.isfinite, solid or ())]
    low, high = min(0.0, *now), max(0.0, *now)
    if curve is not None:
        low, high = min(low, float(curve.q.min())), max(high, float(curve.q.max()))
    margin = 0.12 * (high - low)
    if history is not None:
        _draw_earlier(axes, problem, history)
    if forces is not None:
        axes.plot(
            [point.d for point in points],
            forces,
            "x",
            color="black",
            markersize=9,
            markeredgewidth=1.8,
            label="reached" if solid is None else "third medium",
            zorder=4,
        )
    if solid is not None:
        axes.plot([point.d for point in points], solid, **SOLID_STYLE, label="solid")
    # The first designs are often far off: what counts is what is near the targets.
    axes.set_ylim(low - margin, high + margin)
    axes.legend(fontsize=SMALL, loc="upper left")
    axes.set_title(f"{picture_name(problem)}: force against displacement", fontsize=10)
    return figure


def _draw_earlier(axes: Axes, problem: SpringProblem, history: History) -> None:
    shades = np.linspace(0.85, 0.45, len(history))
    name: str | None = "earlier updates"
    for j, point in enumerate(problem.control_points[: len(history.last().q)]):
        places = np.full(len(history), point.d)
        colors = np.repeat(shades[:, None], 3, axis=1)
        axes.scatter(places, history.q(j), s=9, c=colors, zorder=3, label=name)
        name = None


def forces_figure(
    history: History, problem: SpringProblem, corrections: Sequence[Correction] = ()
) -> Figure:
    """Reached forces over the design updates, with the targets as thin lines.

    Where targets were corrected, diamonds are what the solids carry.
    """
    figure = new_figure(5.4, 4.3)
    axes = figure.subplots()
    update = history["update"]
    values = [point.q for point in problem.control_points]
    for j, point in enumerate(problem.control_points):
        if f"q{j + 1}" not in history.columns:
            continue
        q = history.q(j)
        values.append(float(q[-1]))
        axes.axhline(point.q, color="0.6", linewidth=0.8)
        axes.plot(
            update,
            q,
            **_style(j, point, len(update)),
            markersize=3.5,
            linewidth=1.2,
        )
    for k, one in enumerate(corrections):
        name = None if k else "solid"
        axes.plot([one.update] * len(one.solid), one.solid, **SOLID_STYLE, label=name)
        values += filter(math.isfinite, one.solid)
    low, high = min(0.0, *values), max(0.0, *values)
    # The first designs may be off by an order of magnitude. At the top there is the legend.
    size = high - low
    axes.set_ylim(low - 0.15 * size, high + 0.3 * size)
    axes.set_xlim(0, max(1.0, float(update[-1])) * 1.02)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("design update")
    axes.set_ylabel("q [N]")
    axes.set_title("forces at the control points; thin lines: targets", fontsize=10)
    axes.grid(color="0.92")
    axes.legend(fontsize=SMALL, loc="upper right", ncols=min(3, len(problem.control_points)))
    return figure


def convergence_figure(history: History, problem: SpringProblem) -> Figure:
    """dt, C, each C_q and the equivalent width against design updates (Fig. 3)."""
    figure = new_figure(6.4, 7.6, constrained=False)
    axes: Sequence[Axes] = figure.subplots(4, 1, sharex=True)
    # Margins that matplotlib would find in twice the time: nothing in the picture changes them.
    figure.subplots_adjust(0.14, 0.07, 0.97, 0.94, hspace=0.12)
    update, dt = history["update"], history["dt"]
    _draw_log(axes[0], update, dt, "dt", color="black", marker=".")
    if np.isinf(dt).any():
        last = float(update[np.isinf(dt)][-1])
        axes[0].axvline(last, color="0.4", linestyle=":", linewidth=1)
        axes[0].annotate(
            "dt = ∞",
            (last, 0.08),
            xycoords=("data", "axes fraction"),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            fontsize=SMALL,
        )
    _draw_log(axes[1], update, history["C"], "C", color="black", marker=".")
    for j, point in enumerate(problem.control_points):
        _draw_log(
            axes[2],
            update,
            history.C_q(j),
            "C$_q$",
            **_style(j, point, len(update)),
        )
    axes[2].legend(fontsize=SMALL, loc="upper right")
    axes[3].plot(update, history["width"], color="black", marker=".", markersize=3, linewidth=1)
    axes[3].set_ylabel(f"V as {width_symbol(problem)}")
    axes[3].set_xlabel("design update")
    axes[3].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[3].set_xlim(0, max(1.0, float(update[-1])) * 1.02)
    for ax in axes:
        ax.grid(color="0.9")
    _mark_meshes(axes, history)
    figure.align_ylabels(list(axes))
    last_width = history.last().width
    figure.suptitle(
        f"{picture_name(problem)}: {len(history) - 1} design updates,"
        f" {history.newton_iterations} Newton iterations,"
        f" {width_symbol(problem)} = {last_width:.4f}",
        fontsize=10,
    )
    return figure


def _mark_meshes(axes: Sequence[Axes], history: History) -> None:
    """Dashed lines where a finer mesh or corrected targets took over, named at the first's foot."""
    parts = stages(history.rows())
    for part in parts if len(parts) > 1 else ():
        first = part[0]
        for ax in axes if first.update else ():
            ax.axvline(first.update, color="0.5", linestyle="--", linewidth=0.8)
        corrected = "correction 1" if first.correction == 1 else str(first.correction)
        axes[0].annotate(
            corrected if first.correction else f"{first.elements} × {first.elements}",
            # Above each other where stages are short.
            (first.update, 0.9 if first.correction else 0.05),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=SMALL,
        )


def _style(j: int, point: ControlPoint, updates: int) -> dict[str, Any]:
    """How the line of a control point looks over the design updates."""
    return {
        "color": str(0.15 * (j % 5)),
        "linestyle": LINES[j % 4],
        "marker": "osv^D"[j % 5],
        "markevery": max(1, updates // 25),
        "label": point_label(point),
    }


def _draw_log(axes: Axes, x: FloatArray, y: FloatArray, name: str, **style: Any) -> None:
    shown = np.where(np.isfinite(y) & (y > 0), y, np.nan)
    axes.plot(x, shown, linewidth=1, markersize=3, **style)
    if np.isfinite(shown).any():
        axes.set_yscale("log")
    axes.set_ylabel(name)

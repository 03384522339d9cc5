"""Load-displacement curves with their targets."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ngspring.analysis.response import Response
from ngspring.analysis.states import Curve
from ngspring.design.design import Design
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.view.figure import LINES, SMALL, SOLID_STYLE, new_figure
from ngspring.view.text import picture_name, picture_text


def response_figure(response: Response, problem: SpringProblem) -> Figure:
    """Load-displacement curve with the targets of a problem; says so where it ends early."""
    figure = new_figure(5.0, 3.8)
    axes = figure.subplots()
    draw_curve(axes, response, problem)
    title = "\n".join([picture_name(problem), *textwrap.wrap(response.message, 70)])
    axes.set_title(title, fontsize=10 if response.complete else SMALL)
    return figure


def draw_frame(axes: Axes) -> None:
    """What every diagram of q over d has: lines through zero, and names."""
    axes.axhline(0, color="0.7", linewidth=0.8)
    axes.axvline(0, color="0.7", linewidth=0.8)
    axes.set_xlabel("d [mm]")
    axes.set_ylabel("q [N]")


def draw_line(axes: Axes, curve: Curve, **style: Any) -> None:
    """Draw q over d as a line, whatever the order of its points, dotted where it jumps."""
    d, q = np.asarray(curve.d), np.asarray(curve.q)
    order = np.argsort(d)
    d, q = d[order], q[order]
    for jump in getattr(curve, "jumps", ()):
        ends = [jump.q_before, jump.q_after][:: 1 if jump.d > 0 else -1]
        place = np.searchsorted(d, jump.d)
        d = np.insert(d, place, [jump.d] * 3)
        q = np.insert(q, place, [ends[0], np.nan, ends[1]])
        axes.plot([jump.d] * 2, ends, color=style.get("color"), linestyle=":", linewidth=0.9)
    axes.plot(d, q, **style)


def draw_curve(
    axes: Axes,
    response: Curve | Mapping[str, Curve],
    problem: SpringProblem,
    solid: Sequence[float] | None = None,
) -> None:
    """Draw q(d) and the target points; several curves come by their names.

    ``solid`` are the forces in N of a part's solid at the control points.
    """
    curves = response if isinstance(response, Mapping) else {"response": response}
    draw_frame(axes)
    for k, (name, curve) in enumerate(curves.items()):
        draw_line(axes, curve, color="black", linewidth=1.3, linestyle=LINES[k % 4], label=name)
    plain, offset = control_points_by_kind(problem)
    for points, fill, name in ((plain, "0.6", "target"), (offset, "none", "target, offset chi")):
        if points:
            axes.plot(
                [point.d for point in points],
                [point.q for point in points],
                linestyle="none",
                marker="o" if fill != "none" else "s",
                markersize=6 if fill != "none" else 9,
                markerfacecolor=fill,
                markeredgecolor="black",
                label=name,
            )
    if solid is not None:
        places = [point.d for point in problem.control_points]
        axes.plot(places, solid, **SOLID_STYLE, label="solid")
    axes.grid(color="0.92")
    axes.margins(0.06)
    axes.legend(fontsize=SMALL, loc="upper left")


def draw_named_points(axes: Axes, name: str, points: Sequence[ControlPoint]) -> None:
    """Mark target points; the name of their design stands beside the outermost one."""
    places = [point.d for point in points], [point.q for point in points]
    axes.plot(*places, "o", markerfacecolor="0.8", markeredgecolor="black", markersize=5.5)
    last = max(points, key=lambda point: abs(point.d))
    axes.annotate(
        picture_text(name),
        (last.d, last.q),
        xytext=(math.copysign(7, last.d), 0),
        textcoords="offset points",
        ha="left" if last.d > 0 else "right",
        va="center",
        fontsize=SMALL + 1,
    )


def control_points_by_kind(problem: SpringProblem) -> tuple[list[ControlPoint], list[ControlPoint]]:
    """Control points of the blueprint design, and those with an offset of chi."""
    plain = [point for point in problem.control_points if point.own]
    return plain, [point for point in problem.control_points if point.eta and point.on_curves]


def curves_figure(designs: Mapping[str, Design | None], responses: Mapping[str, Curve]) -> Figure:
    """Curves of many designs with their target points in one diagram (Figs. 4 and 6).

    Parameters
    ----------
    designs : mapping from name to Design
        None for one that is missing; it is named in the diagram.
    responses : mapping from name to Response
        Of the designs that are there.
    """
    figure = new_figure(5.6, 4.8)
    axes = figure.subplots()
    draw_frame(axes)
    for k, (name, design) in enumerate(designs.items()):
        if design is None:
            continue
        response = responses[name]
        grey = str(0.45 * (k % 2))
        draw_line(axes, response, color=grey, linestyle=LINES[k % 4], linewidth=1.3)
        points = control_points_by_kind(design.problem)[0]
        draw_named_points(axes, name, points)
    missing = [name for name, design in designs.items() if design is None]
    if missing:
        axes.set_title(f"not in the gallery: {', '.join(missing)}", fontsize=SMALL)
    axes.grid(color="0.92")
    axes.margins(0.11, 0.06)
    return figure

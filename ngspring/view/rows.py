"""Rows of designs with their deformed states and curves (Figs. 5, 7-11, 14, 16)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ngspring.analysis.states import Responses, States, by_offset, full_displacement, index_of
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import NgspringError
from ngspring.design.design import Design
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.view.curves import control_points_by_kind, draw_curve
from ngspring.view.design import draw_design, draw_guides, ratio_text
from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import picture_text, point_label


@dataclass(frozen=True, eq=False)
class Panel:
    """One state of a design in a row of pictures.

    Attributes
    ----------
    title : str
        One or two lines.
    design : Design, optional
        Nothing is drawn without it.
    d : float
        Displacement of the top side in mm.
    displacement : array, optional
        See `draw_design`.
    eta : float
        Offset of chi.
    note : str
        What to write in place of a picture.
    """

    title: str
    design: Design | None = None
    d: float = 0.0
    displacement: FloatArray | None = None
    eta: float = 0.0
    note: str = ""


@dataclass(frozen=True, eq=False)
class Row:
    """A row of states, and curves by name at its end (none: no diagram).

    Attributes
    ----------
    panels : sequence of Panel
    problem : SpringProblem, optional
        Its targets are marked in the diagram.
    curves : mapping from name to Response or StoredResponse
    solid : sequence of float, optional
        Forces in N of a part's solid at the control points.
    """

    panels: Sequence[Panel]
    problem: SpringProblem | None
    curves: Mapping[str, States]
    solid: Sequence[float] | None = None


def design_figure(design: Design, responses: Responses, curve: States) -> Figure:
    """Undeformed design, deformed states at all control points, and the curve.

    Parameters
    ----------
    design : Design
    responses : Response, or mapping from eta to Response
        Holds the states at the control points.
    curve : Response
        Points of the load-displacement curve.
    """
    problem = design.problem
    name = problem.name or "spring"
    panels = _state_panels(name, design, responses, problem.control_points)
    # A part's curve would otherwise seem to miss its targets.
    name = "response" if design.solid is None else "third medium"
    return rows_figure([Row(panels, problem, {name: curve}, design.solid)], height=2.2)


def gallery_figure(designs: Mapping[str, Design | None], responses: Mapping[str, States]) -> Figure:
    """One row per design, as in Figs. 5 and 7-11.

    Undeformed, deformed at the control points of the blueprint design, and the curve.

    Parameters
    ----------
    designs : mapping from name to Design
        None for one that is missing; its row is empty and says so.
    responses : mapping from name to Response
        Curves of the designs that are there, with the states at the control points.
    """
    rows = []
    for name, design in designs.items():
        if design is None:
            rows.append(Row([Panel(name, note="not in\nthe gallery")], None, {}))
            continue
        plain = control_points_by_kind(design.problem)[0]
        panels = _state_panels(name, design, responses[name], plain)
        problem = design.problem.replace(control_points=plain)
        rows.append(Row(panels, problem, {"response": responses[name]}))
    return rows_figure(rows)


def robust_figure(
    designs: Mapping[str, tuple[Design | None, Design | None]],
    responses: Mapping[str, tuple[States | None, States | None]],
) -> Figure:
    """Robust design, states of the one that is not, and the curves of both (Fig. 14).

    Parameters
    ----------
    designs : mapping from name to (robust, not robust)
        None for one that is missing.
    responses : mapping from name to (robust, not robust)
        Their curves for eta = 0, with the states at the control points.
    """
    rows = []
    for name, (robust, plain) in designs.items():
        curves = {}
        panels = []
        problem = None
        for design, response, kind in zip(
            (robust, plain), responses[name], ("robust", "not robust"), strict=True
        ):
            title = f"{name}, {kind}"
            if design is None or response is None:
                panels.append(Panel(title, note="not in\nthe gallery"))
                continue
            points = control_points_by_kind(design.problem)[0]
            problem = design.problem.replace(control_points=points)
            curves[kind] = response
            shown = points if kind == "not robust" else []
            panels += _state_panels(title, design, response, shown)
        rows.append(Row(panels, problem, curves))
    return rows_figure(rows)


def snapshots_figure(
    runs: Mapping[str, Mapping[int, Design]], updates: Sequence[int] | None = None
) -> Figure:
    """Designs on the way of several evolutions, one row each (Fig. 16).

    Parameters
    ----------
    runs : mapping from name to designs by design update
        An empty one leaves a row that says so.
    updates : sequence of int, optional
        Which of them to show, besides the last of each run; all by default.
    """
    rows = []
    for name, designs in runs.items():
        panels = [
            Panel(f"{picture_text(name)}, update {update}\n{ratio_text(design)}", design)
            for update, design in designs.items()
            if updates is None or update in updates or update == max(designs)
        ]
        rows.append(Row(panels or [Panel(name, note="no\nsnapshots")], None, {}))
    return rows_figure(rows)


def _solid_texts(design: Design, points: Sequence[ControlPoint]) -> list[str]:
    """What the solid of a part carries at each of these points; empty if that is not known."""
    known = dict(zip(design.problem.control_points, design.solid or (), strict=False))
    forces = [known.get(point, math.nan) for point in points]
    return [f"solid {force:.4g} N" if math.isfinite(force) else "" for force in forces]


def _state_panels(
    name: str, design: Design, responses: Responses, points: Sequence[ControlPoint]
) -> list[Panel]:
    """The undeformed design, then its states at some control points."""
    panels = [Panel(f"{picture_text(name)}\n{ratio_text(design)}", design)]
    points = [point for point in points if point.on_curves]
    for point, in_solid in zip(points, _solid_texts(design, points), strict=True):
        response = by_offset(responses).get(point.eta)
        index = None if response is None else index_of(response, point.d)
        label = point_label(point)
        if response is None or index is None:
            panels.append(Panel(f"{label}\nnot reached", None, point.d))
            continue
        title = f"{label}\n{in_solid or f'q = {response.q[index]:.4g} N'} (target {point.q:g})"
        u = full_displacement(response, index)
        panels.append(Panel(title, design, point.d, u, point.eta))
    return panels


def rows_figure(rows: Sequence[Row], height: float = 1.75) -> Figure:
    """Rows of states and curves, all states on one scale so that they can be compared.

    Parameters
    ----------
    rows : sequence of Row
    height : float
        Height of a state in inches, less where it would be wider than 4 inches.

    Raises
    ------
    NgspringError
        If there is no state to draw.
    """
    panels = [panel for row in rows for panel in row.panels]
    drawn = [panel.design.problem for panel in panels if panel.design is not None]
    if not drawn:
        raise NgspringError("there is no design to draw")
    L, H = max(problem.L for problem in drawn), max(problem.H for problem in drawn)
    figure = new_figure(10.0, 3.2, constrained=False)

    def new_axes() -> Axes:
        return figure.add_axes((0.0, 0.0, 1.0, 1.0), label=str(len(figure.axes)))

    states, diagrams = [], []
    left, right = -0.03 * L, 1.03 * L
    for row in rows:
        states.append([new_axes() for _ in row.panels])
        for axes, panel in zip(states[-1], row.panels, strict=True):
            axes.set_title(panel.title, fontsize=SMALL + 1)
            if panel.design is not None:
                extent = draw_design(axes, panel.design, panel.displacement, panel.eta)
                left, right = min(left, extent[0]), max(right, extent[1])
        diagrams.append(new_axes() if row.curves else None)
    low, high = -0.03 * H, H + max(0.0, *(panel.d for panel in panels)) + 0.03 * H
    scale = min(height / (high - low), 4.0 / (right - left))
    panel_width, panel_height = scale * (right - left), scale * (high - low)

    # All lengths in inches from here on.
    first, gap, curve_width, below, above = 0.55, 0.12, 1.32 * height, 0.5, 0.5
    columns = max(len(row.panels) for row in rows)
    gap = max(gap, 1.75 - panel_width)  # a title is up to 1.65 inches wide
    after = first + columns * (panel_width + gap) + 0.6
    width = after + curve_width + 0.15 if any(diagrams) else after - 0.6 + 0.15
    row_height = height + above
    total = below + len(rows) * row_height
    figure.set_size_inches(width, total)
    lowest = max(i for i, row in enumerate(rows) if any(panel.design for panel in row.panels))
    for i, (row, row_states, diagram) in enumerate(zip(rows, states, diagrams, strict=True)):
        bottom = below + (len(rows) - 1 - i) * row_height
        for k, (axes, panel) in enumerate(zip(row_states, row.panels, strict=True)):
            x, y = first + k * (panel_width + gap), bottom + (height - panel_height) / 2
            axes.set_position((x / width, y / total, panel_width / width, panel_height / total))
            axes.set_xlim(left, right)
            axes.set_ylim(low, high)
            problem = drawn[0] if row.problem is None else row.problem
            _finish_panel(axes, panel, problem, leftmost=k == 0, lowest=i == lowest)
        if diagram is not None and row.problem is not None:
            place = after / width, bottom / total, curve_width / width, height / total
            diagram.set_position(place)
            draw_curve(diagram, row.curves, row.problem, row.solid)
            if len(rows) > 1:
                diagram.tick_params(labelsize=SMALL)
            if i != lowest:
                diagram.set_xlabel("")
            if not all(curve.complete for curve in row.curves.values()):
                diagram.set_title("the path ends early", fontsize=SMALL)
    return figure


def _finish_panel(
    axes: Axes, panel: Panel, problem: SpringProblem, leftmost: bool, lowest: bool
) -> None:
    axes.set_aspect("equal")
    for side in axes.spines.values():
        side.set_visible(False)
    if panel.note:
        axes.set_xticks([])
        axes.set_yticks([])
        frame = {"boxstyle": "square,pad=1", "facecolor": "none", "edgecolor": "0.6"}
        place = axes.transAxes
        axes.text(0.5, 0.5, panel.note, transform=place, ha="center", va="center", bbox=frame)
        return
    draw_guides(axes, problem, panel.d)
    axes.set_xticks([0, problem.L / 2, problem.L])
    axes.set_yticks([0, problem.H / 2, problem.H])
    axes.tick_params(labelsize=SMALL - 1, labelleft=leftmost, labelbottom=lowest)
    if lowest:
        axes.set_xlabel("mm", fontsize=SMALL)
    if leftmost:
        axes.set_ylabel("mm", fontsize=SMALL)

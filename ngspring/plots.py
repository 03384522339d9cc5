"""Pictures of runs, designs and curves, arranged as in the paper.

Figures are plain matplotlib objects on the Agg canvas; no graphical backend is selected.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.special import expit

from ngspring.design import Design
from ngspring.errors import NgspringError
from ngspring.files import PathLike, replacing
from ngspring.history import History
from ngspring.labels import point_label, width_symbol
from ngspring.problem import ControlPoint, SpringProblem
from ngspring.response import Response
from ngspring.splines import FloatArray
from ngspring.states import Curve, Responses, by_offset, full_displacement, index_of, interpolation

_CELLS = 320
_VOID = 0.02
_SMALL = 8
_LINES = ("-", "--", "-.", ":")


def new_figure(width: float, height: float, constrained: bool = True) -> Figure:
    """An empty figure (inches) with its own canvas."""
    figure = Figure(figsize=(width, height), layout="constrained" if constrained else None)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: PathLike, dpi: int = 160) -> None:
    """Write a figure atomically; the suffix of the path decides the format.

    Raises
    ------
    RunFolderError
        If the file cannot be written.
    NgspringError
        If matplotlib does not know the suffix.
    """
    suffix = str(path).rpartition(".")[2].lower()
    known = sorted(figure.canvas.get_supported_filetypes())
    if suffix not in known:
        raise NgspringError(f"{path}: the suffix of a picture must be one of {', '.join(known)}")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=suffix)


# -- convergence (Fig. 3) --------------------------------------------------------------------------


def convergence_figure(history: History, problem: SpringProblem) -> Figure:
    """dt, C, each C_q and the equivalent width against design updates (Fig. 3)."""
    figure = new_figure(6.4, 7.6)
    axes: Sequence[Axes] = figure.subplots(4, 1, sharex=True)
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
            fontsize=_SMALL,
        )
    _draw_log(axes[1], update, history["C"], "C", color="black", marker=".")
    for j, point in enumerate(problem.control_points):
        _draw_log(
            axes[2],
            update,
            history[f"C_q{j + 1}"],
            "C$_q$",
            color=str(0.15 * (j % 5)),
            linestyle=_LINES[j % 4],
            marker="osv^D"[j % 5],
            markersize=3,
            markevery=max(1, len(update) // 25),
            label=point_label(point),
        )
    axes[2].legend(fontsize=_SMALL, loc="upper right")
    axes[3].plot(update, history["width"], color="black", marker=".", markersize=3, linewidth=1)
    axes[3].set_ylabel(f"V as {width_symbol(problem)}")
    axes[3].set_xlabel("design update")
    axes[3].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[3].set_xlim(0, max(1.0, float(update[-1])) * 1.02)
    for ax in axes:
        ax.grid(color="0.9")
    figure.align_ylabels(list(axes))
    last_width = history.last()["width"]
    figure.suptitle(
        f"{problem.name or 'spring'}: {len(history) - 1} design updates,"
        f" {history.newton_iterations} Newton iterations,"
        f" {width_symbol(problem)} = {last_width:.4f}",
        fontsize=10,
    )
    return figure


def _draw_log(axes: Axes, x: FloatArray, y: FloatArray, name: str, **style: object) -> None:
    shown = np.where(np.isfinite(y) & (y > 0), y, np.nan)
    look = {"linewidth": 1, "markersize": 3, **style}
    axes.plot(x, shown, **look)  # type: ignore[arg-type]
    if np.isfinite(shown).any():
        axes.set_yscale("log")
    axes.set_ylabel(name)


# -- load-displacement curve -----------------------------------------------------------------------


def response_figure(response: Response, problem: SpringProblem) -> Figure:
    """Load-displacement curve with the targets of a problem; says so where it ends early."""
    figure = new_figure(5.0, 3.8)
    axes = figure.subplots()
    draw_curve(axes, response, problem)
    title = "\n".join([problem.name or "spring", *textwrap.wrap(response.message, 70)])
    axes.set_title(title, fontsize=10 if response.complete else _SMALL)
    return figure


def draw_curve(axes: Axes, response: Curve | Mapping[str, Curve], problem: SpringProblem) -> None:
    """Draw q(d) and the target points; several curves come by their names."""
    curves = response if isinstance(response, Mapping) else {"response": response}
    axes.axhline(0, color="0.7", linewidth=0.8)
    axes.axvline(0, color="0.7", linewidth=0.8)
    for k, (name, curve) in enumerate(curves.items()):
        axes.plot(
            curve.d, curve.q, color="black", linewidth=1.3, linestyle=_LINES[k % 4], label=name
        )
    plain, offset = _by_kind(problem)
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
    axes.set_xlabel("d [mm]")
    axes.set_ylabel("q [N]")
    axes.grid(color="0.92")
    axes.margins(0.06)
    axes.legend(fontsize=_SMALL, loc="upper left")


def _by_kind(problem: SpringProblem) -> tuple[list[ControlPoint], list[ControlPoint]]:
    """Control points of the blueprint design, and those with an offset of chi."""
    plain = [point for point in problem.control_points if not point.eta]
    return plain, [point for point in problem.control_points if point.eta]


def curves_figure(
    designs: Mapping[str, Design | None], responses: Mapping[str, Response]
) -> Figure:
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
    axes.axhline(0, color="0.7", linewidth=0.8)
    axes.axvline(0, color="0.7", linewidth=0.8)
    for k, (name, design) in enumerate(designs.items()):
        if design is None:
            continue
        response = responses[name]
        grey = str(0.45 * (k % 2))
        axes.plot(response.d, response.q, color=grey, linestyle=_LINES[k % 4], linewidth=1.3)
        points = _by_kind(design.problem)[0]
        places = [point.d for point in points], [point.q for point in points]
        axes.plot(*places, "o", markerfacecolor="0.8", markeredgecolor="black", markersize=5.5)
        last = max(points, key=lambda point: abs(point.d))
        axes.annotate(
            name,
            (last.d, last.q),
            xytext=(math.copysign(7, last.d), 0),
            textcoords="offset points",
            ha="left" if last.d > 0 else "right",
            va="center",
            fontsize=_SMALL + 1,
        )
    missing = [name for name, design in designs.items() if design is None]
    if missing:
        axes.set_title(f"not in the gallery: {', '.join(missing)}", fontsize=_SMALL)
    axes.set_xlabel("d [mm]")
    axes.set_ylabel("q [N]")
    axes.grid(color="0.92")
    axes.margins(0.11, 0.06)
    return figure


# -- design (Fig. 5) -------------------------------------------------------------------------------


def draw_design(
    axes: Axes, design: Design, displacement: FloatArray | None = None, eta: float = 0.0
) -> tuple[float, float]:
    """Draw rho in grey on the deformed body; void (rho < 0.02) is left out.

    Parameters
    ----------
    axes : Axes
    design : Design
    displacement : array (2, 2 N + 1, 2 N + 1), optional
        From `ngspring.states.full_displacement`; undeformed without it.
    eta : float
        Offset of chi.

    Returns
    -------
    left, right : float
        Extent of the solid in x, in mm.
    """
    problem = design.problem
    cells = max(2, math.ceil(_CELLS / problem.elements)) * problem.elements
    x, y = np.linspace(0, problem.L, cells + 1), np.linspace(0, problem.H, cells + 1)
    place_x, place_y = np.meshgrid(x, y, indexing="ij")
    if displacement is not None:
        mesh = (displacement.shape[1] - 1) // 2
        fine = interpolation(mesh, np.linspace(0, mesh, cells + 1))
        place_x = place_x + fine @ displacement[0] @ fine.T
        place_y = place_y + fine @ displacement[1] @ fine.T
    middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
    chi = design.chi(middle_x[:, None], middle_y[None, :]) + eta
    rho = 1 / (1 + np.exp(-np.clip(chi, -100, 100)))
    axes.pcolormesh(
        place_x,
        place_y,
        np.ma.masked_less(rho, _VOID),
        cmap="Greys",
        vmin=0,
        vmax=1.15,
        edgecolors="none",
        antialiased=False,
        rasterized=True,
    )
    axes.set_aspect("equal")
    solid = place_x[:-1, :-1][rho > 0.5]
    return (float(solid.min()), float(solid.max())) if len(solid) else (0.0, problem.L)


def density_figure(design: Design) -> Figure:
    """The density rho of a design with its scale and the symmetry axes (Fig. 2)."""
    problem = design.problem
    figure = new_figure(4.6, 4.0)
    axes = figure.subplots()
    x, y = (np.linspace(0, size, _CELLS + 1) for size in (problem.L, problem.H))
    rho = design.density((x[1:] + x[:-1])[:, None] / 2, (y[1:] + y[:-1])[None, :] / 2)
    image = axes.pcolormesh(x, y, rho.T, cmap="Greys", vmin=0, vmax=1, rasterized=True)
    figure.colorbar(image, ax=axes, label="density ρ", shrink=0.8, ticks=[0, 0.25, 0.5, 0.75, 1])
    axes.axvline(problem.L / 2, color="0.5", linewidth=0.8, linestyle="-.")
    axes.axhline(problem.H / 2, color="0.5", linewidth=0.8, linestyle="-.")
    axes.set_aspect("equal")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.set_title(_ratio(design), fontsize=10)
    return figure


# -- rows of designs (Figs. 5, 7-11, 14, 16) -------------------------------------------------------


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
    curves : mapping from name to Response
    """

    panels: Sequence[Panel]
    problem: SpringProblem | None
    curves: Mapping[str, Response]


def design_figure(design: Design, responses: Responses, curve: Response) -> Figure:
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
    name = problem.name or "design"
    panels = _state_panels(name, design, responses, problem.control_points)
    return rows_figure([Row(panels, problem, {"response": curve})], height=2.2)


def gallery_figure(
    designs: Mapping[str, Design | None], responses: Mapping[str, Response]
) -> Figure:
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
        plain = _by_kind(design.problem)[0]
        panels = _state_panels(name, design, responses[name], plain)
        problem = design.problem.replace(control_points=plain)
        rows.append(Row(panels, problem, {"response": responses[name]}))
    return rows_figure(rows)


def robust_figure(
    designs: Mapping[str, tuple[Design | None, Design | None]],
    responses: Mapping[str, tuple[Response | None, Response | None]],
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
            points = _by_kind(design.problem)[0]
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
            Panel(f"{name}, update {update}\n{_ratio(design)}", design)
            for update, design in designs.items()
            if updates is None or update in updates or update == max(designs)
        ]
        rows.append(Row(panels or [Panel(name, note="no\nsnapshots")], None, {}))
    return rows_figure(rows)


def _ratio(design: Design) -> str:
    problem = design.problem
    return f"{width_symbol(problem)} = {design.equivalent_width / problem.H:.4f}"


def _state_panels(
    name: str, design: Design, responses: Responses, points: Sequence[ControlPoint]
) -> list[Panel]:
    """The undeformed design, then its states at some control points."""
    panels = [Panel(f"{name}\n{_ratio(design)}", design)]
    for point in points:
        response = by_offset(responses).get(point.eta)
        index = None if response is None else index_of(response, point.d)
        label = point_label(point)
        if response is None or index is None:
            panels.append(Panel(f"{label}\nnot reached", None, point.d))
            continue
        title = f"{label}\nq = {response.q[index]:.4g} N (target {point.q:g})"
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
            axes.set_title(panel.title, fontsize=_SMALL + 1)
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
            draw_curve(diagram, row.curves, row.problem)
            if len(rows) > 1:
                diagram.tick_params(labelsize=_SMALL)
            if i != lowest:
                diagram.set_xlabel("")
            if not all(curve.complete for curve in row.curves.values()):
                diagram.set_title("the path ends early", fontsize=_SMALL)
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
    for y in (0.0, problem.H + panel.d):
        axes.axhline(y, color="0.3", linewidth=0.8)
    if panel.d:
        axes.axhline(problem.H, color="0.5", linewidth=0.7, linestyle=":")
    if problem.axisymmetric:
        axes.axvline(problem.L / 2, color="0.5", linewidth=0.7, linestyle="-.")
    axes.set_xticks([0, problem.L / 2, problem.L])
    axes.set_yticks([0, problem.H / 2, problem.H])
    axes.tick_params(labelsize=_SMALL - 1, labelleft=leftmost, labelbottom=lowest)
    if lowest:
        axes.set_xlabel("mm", fontsize=_SMALL)
    if leftmost:
        axes.set_ylabel("mm", fontsize=_SMALL)


# -- erosion and dilation (Fig. 15) ----------------------------------------------------------------


def offsets_figure(
    x: FloatArray, chi: FloatArray, problem: SpringProblem, offsets: Sequence[float]
) -> Figure:
    """chi and rho along a line, and the stiffness E of chi + eta for some offsets (Fig. 15)."""
    figure = new_figure(5.6, 6.2)
    above, middle, below = axes = figure.subplots(3, 1, sharex=True)
    above.plot(x, chi, color="black", linewidth=1.3)
    above.axhline(0, color="0.7", linewidth=0.8)
    above.set_ylabel("χ")
    middle.plot(x, expit(chi), color="black", linewidth=1.3)
    middle.set_ylabel("ρ(χ)")
    for eta in offsets:
        kind, line = ("dilated", "-.") if eta > 0 else ("eroded", "--")
        if not eta:
            kind, line = "blueprint", "-"
        below.plot(
            x,
            ramp(chi + eta, problem),
            color="0.35" if eta else "black",
            linewidth=1.3,
            linestyle=line,
            label=f"η = {eta:g} ({kind})",
        )
    below.set_ylabel("E(χ + η)")
    below.set_xlabel("x [mm]")
    below.legend(fontsize=_SMALL)
    for ax in axes:
        ax.grid(color="0.92")
    figure.align_ylabels(list(axes))
    return figure


def ramp(chi: FloatArray, problem: SpringProblem) -> FloatArray:
    """E(chi) of Eq. 3 for plain arrays; `ngspring.energies.stiffness` is for NGSolve."""
    rho = expit(chi)
    return np.asarray(problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho)))

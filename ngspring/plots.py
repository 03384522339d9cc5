"""Pictures of a run and of a design, after Figs. 3 and 5 of the paper.

Figures are plain matplotlib objects on the Agg canvas; no graphical backend is selected.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ngspring.design import Design
from ngspring.errors import NgspringError
from ngspring.files import PathLike, replacing
from ngspring.history import History
from ngspring.labels import point_label, width_symbol
from ngspring.problem import SpringProblem
from ngspring.response import Response
from ngspring.splines import FloatArray
from ngspring.states import Responses, by_offset, full_displacement, index_of, interpolation

_CELLS = 320
_VOID = 0.02
_SMALL = 8


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
    styles = ("-", "--", "-.", ":")
    for j, point in enumerate(problem.control_points):
        _draw_log(
            axes[2],
            update,
            history[f"C_q{j + 1}"],
            "C$_q$",
            color=str(0.15 * (j % 5)),
            linestyle=styles[j % 4],
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


def draw_curve(axes: Axes, response: Response, problem: SpringProblem) -> None:
    """Draw q(d) and the target points."""
    axes.axhline(0, color="0.7", linewidth=0.8)
    axes.axvline(0, color="0.7", linewidth=0.8)
    axes.plot(response.d, response.q, color="black", linewidth=1.3, label="response")
    plain = [point for point in problem.control_points if not point.eta]
    offset = [point for point in problem.control_points if point.eta]
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


def design_figure(design: Design, responses: Responses, curve: Response) -> Figure:
    """Undeformed design, deformed states at the control points, and the curve: a row of Fig. 5.

    Parameters
    ----------
    design : Design
    responses : Response, or mapping from eta to Response
        Holds the states at the control points.
    curve : Response
        Points of the load-displacement curve.
    """
    problem = design.problem
    points = problem.control_points
    highest = problem.H + max(0.0, *(point.d for point in points))
    low, high = -0.03 * problem.H, highest + 0.03 * problem.H
    figure = new_figure(10.0, 3.2, constrained=False)
    all_axes = [figure.add_axes((0.0, 0.0, 1.0, 1.0), label=str(k)) for k in range(len(points) + 2)]
    *all_axes, last = all_axes
    extents = [draw_design(all_axes[0], design)]
    symbol = width_symbol(problem)
    ratio = design.equivalent_width / problem.H
    name = problem.name or "design"
    all_axes[0].set_title(f"{name}\n{symbol} = {ratio:.4f}", fontsize=_SMALL + 1)
    for axes, point in zip(all_axes[1:], points, strict=True):
        response = by_offset(responses).get(point.eta)
        index = None if response is None else index_of(response, point.d)
        title = f"{point_label(point)}\n"
        if response is None or index is None:
            title += "not reached"
            axes.set_aspect("equal")
        else:
            extents.append(draw_design(axes, design, full_displacement(response, index), point.eta))
            title += f"q = {response.q[index]:.4g} N (target {point.q:g})"
        axes.set_title(title, fontsize=_SMALL + 1)
    left = min(-0.03 * problem.L, *(extent[0] for extent in extents))
    right = max(1.03 * problem.L, *(extent[1] for extent in extents))
    # One scale for all panels, so that the states can be compared.
    scale = min(2.2 / (high - low), 4.0 / (right - left))
    panel, panel_height = scale * (right - left), scale * (high - low)
    first, gap, curve_width = 0.55, 0.12, 2.9
    after = first + len(all_axes) * (panel + gap) + 0.6
    width, height = after + curve_width + 0.15, 3.2
    figure.set_size_inches(width, height)
    above = 0.5 + (2.2 - panel_height) / 2
    for k, axes in enumerate(all_axes):
        place = (first + k * (panel + gap)) / width
        axes.set_position((place, above / height, panel / width, panel_height / height))
    last.set_position((after / width, 0.5 / height, curve_width / width, 2.2 / height))
    for axes, d in zip(all_axes, [0.0, *(point.d for point in points)], strict=True):
        axes.set_xlim(left, right)
        axes.set_ylim(low, high)
        for y in (0.0, problem.H + d):
            axes.axhline(y, color="0.3", linewidth=0.8)
        if d:
            axes.axhline(problem.H, color="0.5", linewidth=0.7, linestyle=":")
        if problem.axisymmetric:
            axes.axvline(problem.L / 2, color="0.5", linewidth=0.7, linestyle="-.")
        axes.set_xticks([0, problem.L / 2, problem.L])
        axes.set_yticks([0, problem.H / 2, problem.H])
        axes.tick_params(labelsize=_SMALL - 1, labelleft=axes is all_axes[0])
        for side in axes.spines.values():
            side.set_visible(False)
        axes.set_xlabel("mm", fontsize=_SMALL)
    all_axes[0].set_ylabel("mm", fontsize=_SMALL)
    draw_curve(last, curve, problem)
    return figure

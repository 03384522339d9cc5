"""Pictures of runs, designs and curves, arranged as in the paper.

Figures are plain matplotlib objects on the Agg canvas; no graphical backend is selected.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence

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
from ngspring.states import Curve, interpolation

_CELLS = 320
_VOID = 0.02
#: Font size of small print.
SMALL = 8
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
            fontsize=SMALL,
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
    axes[2].legend(fontsize=SMALL, loc="upper right")
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
    axes.set_title(title, fontsize=10 if response.complete else SMALL)
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
    axes.set_xlabel("d [mm]")
    axes.set_ylabel("q [N]")
    axes.grid(color="0.92")
    axes.margins(0.06)
    axes.legend(fontsize=SMALL, loc="upper left")


def control_points_by_kind(problem: SpringProblem) -> tuple[list[ControlPoint], list[ControlPoint]]:
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
        points = control_points_by_kind(design.problem)[0]
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
            fontsize=SMALL + 1,
        )
    missing = [name for name, design in designs.items() if design is None]
    if missing:
        axes.set_title(f"not in the gallery: {', '.join(missing)}", fontsize=SMALL)
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


def ratio_text(design: Design) -> str:
    """Equivalent width (diameter) over height, for a title."""
    problem = design.problem
    return f"{width_symbol(problem)} = {design.equivalent_width / problem.H:.4f}"


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
    axes.set_title(ratio_text(design), fontsize=10)
    return figure


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
    below.legend(fontsize=SMALL)
    for ax in axes:
        ax.grid(color="0.92")
    figure.align_ylabels(list(axes))
    return figure


def ramp(chi: FloatArray, problem: SpringProblem) -> FloatArray:
    """E(chi) of Eq. 3 for plain arrays; `ngspring.energies.stiffness` is for NGSolve."""
    rho = expit(chi)
    return np.asarray(problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho)))

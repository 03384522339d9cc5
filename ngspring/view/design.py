"""The density of a design, at rest and deformed, and what an offset of chi does to it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ngspring.analysis.states import interpolation
from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.physics.chi import rho, stiffness
from ngspring.problem.spring import SpringProblem
from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import width_symbol

#: Cells of a picture across the domain, about.
CELLS = 320
_VOID = 0.02


def draw_design(
    axes: Axes, design: Design, displacement: FloatArray | None = None, eta: float = 0.0
) -> tuple[float, float]:
    """Draw rho in grey on the deformed body; void (rho < 0.02) is left out.

    Parameters
    ----------
    axes : Axes
    design : Design
    displacement : array (2, 2 N + 1, 2 N + 1), optional
        From `ngspring.analysis.states.full_displacement`; undeformed without it.
    eta : float
        Offset of chi.

    Returns
    -------
    left, right : float
        Extent of the solid in x, in mm.
    """
    problem = design.problem
    cells = max(2, math.ceil(CELLS / problem.elements)) * problem.elements
    x, y, place_x, place_y = moved_grid(problem, cells, displacement)
    middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
    chi = design.chi(middle_x[:, None], middle_y[None, :]) + eta
    density = rho(chi)
    i, j = (_extent((density >= _VOID).any(axis=axis)) for axis in (1, 0))
    corners = slice(i.start, i.stop + 1), slice(j.start, j.stop + 1)
    mesh = axes.pcolormesh(
        place_x[corners],
        place_y[corners],
        np.ma.masked_less(density[i, j], _VOID),
        cmap="Greys",
        vmin=0,
        vmax=1.15,
        edgecolors="none",
        antialiased=False,
        rasterized=True,
    )
    # The void belongs to the body as well.
    whole = [(float(place.min()), float(place.max())) for place in (place_x, place_y)]
    mesh.sticky_edges.x[:], mesh.sticky_edges.y[:] = whole
    axes.update_datalim(np.transpose(whole))
    axes.set_aspect("equal")
    solid = place_x[:-1, :-1][density > 0.5]
    return (float(solid.min()), float(solid.max())) if len(solid) else (0.0, problem.L)


def _extent(there: NDArray[np.bool_]) -> slice:
    """From the first to the last cell where there is something: void takes as long to draw."""
    places = np.flatnonzero(there)
    return slice(places[0], places[-1] + 1) if len(places) else slice(0, len(there))


def moved_grid(
    problem: SpringProblem, cells: int, displacement: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Lines x and y of a grid of cells x cells over the body, and where its points move to."""
    x, y = np.linspace(0, problem.L, cells + 1), np.linspace(0, problem.H, cells + 1)
    place_x, place_y = np.meshgrid(x, y, indexing="ij")
    if displacement is not None:
        mesh = (displacement.shape[1] - 1) // 2
        fine = interpolation(mesh, np.linspace(0, mesh, cells + 1))
        place_x = place_x + fine @ displacement[0] @ fine.T
        place_y = place_y + fine @ displacement[1] @ fine.T
    return x, y, place_x, place_y


def draw_guides(axes: Axes, problem: SpringProblem, d: float) -> None:
    """The sides that are held, the top at rest, and the axis of a body of revolution."""
    for y in (0.0, problem.H + d):
        axes.axhline(y, color="0.3", linewidth=0.8)
    if d:
        axes.axhline(problem.H, color="0.5", linewidth=0.7, linestyle=":")
    for mirror in problem.sector.mirrors:
        if mirror.rotation:
            axes.axvline(mirror.size / 2, color="0.5", linewidth=0.7, linestyle="-.")


def ratio_text(design: Design) -> str:
    """Equivalent width (diameter) over height, for a title."""
    problem = design.problem
    return f"{width_symbol(problem)} = {design.relative_width:.4f}"


def density_figure(design: Design) -> Figure:
    """The density rho of a design with its scale and the symmetry axes (Fig. 2)."""
    problem = design.problem
    figure = new_figure(4.6, 4.0)
    axes = figure.subplots()
    x, y = (np.linspace(0, size, CELLS + 1) for size in (problem.L, problem.H))
    density = design.density((x[1:] + x[:-1])[:, None] / 2, (y[1:] + y[:-1])[None, :] / 2)
    image = axes.pcolormesh(x, y, density.T, cmap="Greys", vmin=0, vmax=1, rasterized=True)
    figure.colorbar(image, ax=axes, label="density ρ", shrink=0.8, ticks=[0, 0.25, 0.5, 0.75, 1])
    axes.axvline(problem.L / 2, color="0.5", linewidth=0.8, linestyle="-.")
    axes.axhline(problem.H / 2, color="0.5", linewidth=0.8, linestyle="-.")
    axes.set_aspect("equal")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.set_title(ratio_text(design), fontsize=10)
    return figure


def offsets_figure(
    x: FloatArray, chi: FloatArray, problem: SpringProblem, offsets: Sequence[float]
) -> Figure:
    """chi and rho along a line, and the stiffness E of chi + eta for some offsets (Fig. 15)."""
    figure = new_figure(5.6, 6.2)
    above, middle, below = axes = figure.subplots(3, 1, sharex=True)
    above.plot(x, chi, color="black", linewidth=1.3)
    above.axhline(0, color="0.7", linewidth=0.8)
    above.set_ylabel("χ")
    middle.plot(x, rho(chi), color="black", linewidth=1.3)
    middle.set_ylabel("ρ(χ)")
    for eta in offsets:
        kind, line = ("dilated", "-.") if eta > 0 else ("eroded", "--")
        if not eta:
            kind, line = "blueprint", "-"
        below.plot(
            x,
            stiffness(chi + eta, problem),
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

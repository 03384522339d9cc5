"""Picture of a family of springs: how much material each target costs, and what it looks like."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ngspring.evolution.family import Family
from ngspring.view.design import draw_design, draw_guides
from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import picture_name, width_symbol

#: Designs that are drawn, at most.
_DRAWN = 6


def family_figure(family: Family) -> Figure:
    """W/H over the target that changes most, above designs along the way.

    Filled marks: followed from the design before; open ones: by the evolution, because the branch
    of stationary points had ended.
    """
    designs = family.designs
    first, last = designs[0].problem, designs[-1].problem
    places = np.unique(np.linspace(0, len(designs) - 1, min(_DRAWN, len(designs))).round())
    drawn = [int(k) for k in places]
    figure = new_figure(1.7 * max(len(drawn), 3), 5.0)
    grid = figure.add_gridspec(2, len(drawn), height_ratios=(1.5, 1.0))
    axes = figure.add_subplot(grid[0, :])
    j = family.varied
    targets = np.array([design.problem.control_points[j].q for design in designs])
    evolved = np.array([member.evolved for member in family.members])
    axes.plot(targets, family.widths, color="black", linewidth=1)
    axes.plot(targets[~evolved], family.widths[~evolved], "o", color="black", label="followed")
    if evolved.any():
        axes.plot(
            targets[evolved],
            family.widths[evolved],
            "o",
            markerfacecolor="white",
            markeredgecolor="black",
            label="by the evolution",
        )
    if targets[-1] < targets[0]:
        # In the order of the designs below.
        axes.invert_xaxis()
    axes.set_xlabel(f"target q [N] at d = {last.control_points[j].d:g} mm")
    axes.set_ylabel(width_symbol(first))
    axes.grid(color="0.92")
    axes.legend(fontsize=SMALL)
    axes.set_title(f"from {picture_name(first)} to {picture_name(last)}", fontsize=10)
    for column, k in enumerate(drawn):
        below = figure.add_subplot(grid[1, column])
        draw_design(below, designs[k])
        draw_guides(below, designs[k].problem, 0.0)
        below.set_axis_off()
        below.set_title(f"{targets[k]:.4g} N\n{family.widths[k]:.4f}", fontsize=SMALL)
    return figure

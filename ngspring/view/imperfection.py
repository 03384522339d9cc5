"""Picture of what an imperfection does to the curve of a solid."""

from __future__ import annotations

import textwrap

from matplotlib.figure import Figure

from ngspring.analysis.states import force_at
from ngspring.solid.imperfection import STABLE, Imperfection
from ngspring.view.curves import draw_frame, draw_line
from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import picture_name


def imperfection_figure(outcome: Imperfection) -> Figure:
    """Curves of the perfect and the imperfect solid, and where the second leaves the first."""
    figure = new_figure(5.2, 4.2)
    axes = figure.subplots()
    draw_frame(axes)
    draw_line(axes, outcome.perfect, color="0.6", linewidth=2.6, label="perfect")
    label = f"surfaces moved by up to {outcome.size:g} mm"
    draw_line(axes, outcome.imperfect, color="black", linewidth=1.2, linestyle="--", label=label)
    for k, d in enumerate(outcome.leaves):
        axes.plot(
            [d],
            [force_at(outcome.imperfect, d)],
            "o",
            markerfacecolor="white",
            markeredgecolor="black",
            label=None if k else f"off by more than {100 * STABLE:g} %",
        )
    lines = textwrap.wrap(outcome.verdict, 70)
    axes.set_title("\n".join([picture_name(outcome.design.problem), *lines]), fontsize=SMALL + 1)
    axes.legend(fontsize=SMALL, loc="upper left")
    axes.margins(0.05)
    return figure

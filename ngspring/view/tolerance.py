"""Picture of what moved surfaces do to a curve."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ngspring.solid.tolerance import Tolerance
from ngspring.view.curves import draw_frame, draw_line
from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import picture_name


def tolerance_figure(outcome: Tolerance) -> Figure:
    """The curve with a band for each size of offset, and the target points."""
    figure = new_figure(5.2, 4.2)
    axes = figure.subplots()
    draw_frame(axes)
    sizes = outcome.sizes
    d = outcome.displacements
    shades = np.linspace(0.62, 0.9, len(sizes))
    for size, shade in reversed(list(zip(sizes, shades, strict=True))):
        low, high = outcome.band(size)
        axes.fill_between(
            d, low, high, color=str(shade), linewidth=0, label=f"surfaces moved by ±{size:g} mm"
        )
    for curve in outcome.curves:
        if curve.contact is None:
            continue
        nominal = curve.offset == 0.0
        style = "-" if nominal else "--" if curve.offset < 0 else "-."
        draw_line(
            axes,
            curve.contact,
            color="black" if nominal else "0.35",
            linewidth=1.5 if nominal else 0.7,
            linestyle=style,
            label="as designed" if nominal else None,
        )
    axes.plot(
        [point.d for point in outcome.points],
        [point.q for point in outcome.points],
        "o",
        markerfacecolor="white",
        markeredgecolor="black",
        label="target",
    )
    axes.set_title(
        f"{picture_name(outcome.design.problem)}: dashed thinner, dash-dotted thicker",
        fontsize=10,
    )
    axes.legend(fontsize=SMALL, loc="upper left")
    axes.margins(0.05)
    return figure

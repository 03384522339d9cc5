"""Parts beside what was asked for: targets, third medium and solid in one small diagram each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import picture_text

_COLUMNS = 4


@dataclass(frozen=True)
class PartCurves:
    """The curves of a part.

    Attributes
    ----------
    name : str
    targets : sequence of pairs
        d in mm and q in N of the control points.
    d : sequence of float
        Displacements in mm at which forces are known.
    third_medium, solid : sequence of float
        Forces in N of the third medium, which was asked for other targets, and of the solid with
        real contact.
    """

    name: str
    targets: Sequence[tuple[float, float]]
    d: Sequence[float]
    third_medium: Sequence[float]
    solid: Sequence[float]


def parts_figure(parts: Sequence[PartCurves]) -> Figure:
    """One diagram a part: circles are targets, lines the solid, dashes the third medium."""
    columns = min(_COLUMNS, len(parts))
    rows = -(-len(parts) // columns)
    figure = new_figure(2.7 * columns, 2.5 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, part in zip(panels, parts, strict=False):
        axes.axhline(0, color="0.8", linewidth=0.7)
        axes.axvline(0, color="0.8", linewidth=0.7)
        axes.plot(part.d, part.third_medium, "--", color="0.45", lw=1.2, label="third medium")
        axes.plot(part.d, part.solid, "-", color="black", lw=1.4, label="solid, real contact")
        axes.plot(
            *zip(*part.targets, strict=True),
            "o",
            color="tab:red",
            mfc="none",
            label="targets",
        )
        axes.set_title(picture_text(part.name), fontsize=SMALL + 1)
        axes.tick_params(labelsize=SMALL - 1)
    for axes in panels[len(parts) :]:
        axes.set_axis_off()
    for axes in panels[max(0, len(parts) - columns) : len(parts)]:
        axes.set_xlabel("d [mm]", fontsize=SMALL)
    for axes in panels[::columns]:
        axes.set_ylabel("q [N]", fontsize=SMALL)
    panels[0].legend(fontsize=SMALL - 1, loc="upper left")
    return figure

"""What a limit of strains costs in material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ngspring.view.figure import LINES, SMALL, new_figure
from ngspring.view.text import picture_text

_MARKS = "osD^v"


@dataclass(frozen=True)
class LimitedDesign:
    """A design with or without a limit of its stretch.

    Attributes
    ----------
    limit : float or None
        Largest principal stretch that was asked for; None without a limit.
    measure : float
        The principal stretch that a thousandth of the solid's volume exceeds.
    width : float
        W/H or D/H.
    """

    limit: float | None
    measure: float
    width: float


def limits_figure(cases: Mapping[str, Sequence[LimitedDesign]]) -> Figure:
    """W/H over the limit, relative to W/H without: a line for each case, which ends at none.

    Parameters
    ----------
    cases : mapping
        Designs by the name of their case, one of them without a limit. Filled marks stand at the
        limit, hollow ones at the solid's own stretch. The design without a limit has a hollow mark
        only, where the line ends.
    """
    figure = new_figure(5.8, 4.4)
    axes = figure.subplots()
    for k, (name, designs) in enumerate(cases.items()):
        shade = str(0.55 * k / max(1, len(cases) - 1))
        _draw_case(axes, name, designs, shade, _MARKS[k % len(_MARKS)], LINES[k % len(LINES)])
    axes.set_xlabel(
        "principal stretch [-]\nfilled: limit, hollow: exceeded by a thousandth of the solid"
    )
    axes.set_ylabel("W/H relative to that without a limit [-]")
    axes.tick_params(labelsize=SMALL)
    axes.grid(color="0.92")
    if cases:
        axes.legend(fontsize=SMALL, title="W/H", title_fontsize=SMALL)
    return figure


def _draw_case(
    axes: Axes, name: str, designs: Sequence[LimitedDesign], shade: str, mark: str, line: str
) -> None:
    plain = next(d.width for d in designs if d.limit is None)
    placed = sorted((d.limit or d.measure, d.width / plain, d.limit is not None) for d in designs)
    places = [place[:2] for place in placed]
    filled = [k for k, (*_, limited) in enumerate(placed) if limited]
    label = f"{picture_text(name)}, {plain:.4f} without"
    axes.plot(*zip(*places, strict=True), line + mark, color=shade, markevery=filled, label=label)
    own = [(d.measure, d.width / plain) for d in designs]
    axes.plot(*zip(*own, strict=True), mark, linestyle="none", color=shade, mfc="white")
    for design in designs:
        if design.limit is not None:
            ends, height = [design.limit, design.measure], design.width / plain
            axes.plot(ends, [height, height], color=shade, linewidth=0.6, zorder=1)

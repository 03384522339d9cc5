"""What a limit of strains costs in material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import picture_text

_MARKS = "osD^vPX*"


def limits_figure(cases: Mapping[str, Sequence[tuple[float | None, float, float]]]) -> Figure:
    """W/H over the limit, and over what the solid has.

    Parameters
    ----------
    cases : mapping
        By name: limit (None without one), W/H, and the solid's own measure. A design without a
        limit stands at its measure, and is drawn hollow.
    """
    figure = new_figure(5.6, 4.2)
    axes = figure.subplots()
    for k, (name, points) in enumerate(cases.items()):
        mark = _MARKS[k % len(_MARKS)]
        measures, widths = [p[2] for p in points], [p[1] for p in points]
        shade = str(0.15 + 0.5 * k / max(1, len(cases)))
        axes.plot(measures, widths, color=shade, linewidth=1.1, zorder=1)
        for limit, width, measure in points:
            axes.plot(
                measure,
                width,
                mark,
                color=shade,
                mfc="white" if limit is None else shade,
                label=picture_text(name) if limit == points[-1][0] else None,
            )
            if limit is not None:
                axes.plot([limit, measure], [width, width], ":", color=shade, linewidth=1)
                axes.plot(limit, width, "|", color=shade, markersize=9)
    axes.set_xlabel("stretch that a thousandth of the solid exceeds (bars: limit)", fontsize=9)
    axes.set_ylabel("W/H", fontsize=9)
    axes.tick_params(labelsize=SMALL)
    axes.grid(color="0.92")
    axes.legend(fontsize=SMALL, title="filled: with a limit", title_fontsize=SMALL)
    return figure

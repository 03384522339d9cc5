"""Picture of tests of a material and of the laws that were fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ngspring.problem.fit.fitting import Fit
from ngspring.problem.laws.modes import MODES
from ngspring.view.figure import LINES, SMALL, new_figure

_MARKERS = ("o", "s", "^", "D", "v")
_SHADES = ("black", "0.45")


def fit_figure(fits: Sequence[Fit]) -> Figure:
    """Nominal stress over stretch, a panel for each kind of test; dotted where not stable.

    Parameters
    ----------
    fits : sequence of Fit
        Of the same tests, the best first.
    """
    kinds = [kind for kind in MODES if any(test.test == kind for test in fits[0].tests)]
    figure = new_figure(4.6 * len(kinds), 3.9)
    for axes, kind in zip(np.ravel(figure.subplots(1, len(kinds))), kinds, strict=True):
        _draw_kind(axes, kind, fits)
    return figure


def _draw_kind(axes: Axes, kind: str, fits: Sequence[Fit]) -> None:
    tests = [test for test in fits[0].tests if test.test == kind]
    axes.axhline(0, color="0.7", linewidth=0.8)
    axes.axvline(1, color="0.7", linewidth=0.8)
    for k, test in enumerate(tests):
        axes.plot(
            test.stretch,
            test.stress,
            _MARKERS[k % len(_MARKERS)],
            markerfacecolor="white",
            markeredgecolor="black",
            markersize=5,
            label=test.name or "measured",
        )
    ends = [float(end) for test in tests for end in (test.stretch.min(), test.stretch.max())]
    stretch = np.linspace(min(1.0, *ends), max(1.0, *ends), 401)
    for k, each in enumerate(fits):
        stress = MODES[kind].nominal_stress(each.law, stretch)
        low, high = each.stable.ranges[kind]
        style: dict[str, Any] = {"color": _SHADES[k // len(LINES) % 2], "linewidth": 1.2}
        stable = (stretch >= low) & (stretch <= high)
        label = f"{each.candidate}, {100 * each.mean_error:.2g} %"
        axes.plot(
            stretch,
            np.where(stable, stress, np.nan),
            linestyle=LINES[k % len(LINES)],
            label=label,
            **style,
        )
        axes.plot(stretch, np.where(stable, np.nan, stress), linestyle=":", **style)
    measured = np.concatenate([test.stress for test in tests])
    room = 0.15 * float(np.ptp(np.append(measured, 0.0)))
    # A law may go far beyond the tests between their points, and must not hide them.
    axes.set_ylim(measured.min(initial=0.0) - room, measured.max(initial=0.0) + room)
    axes.set_xlabel("stretch")
    axes.set_ylabel("nominal stress [MPa]")
    axes.set_title(kind, fontsize=10)
    axes.legend(fontsize=SMALL)

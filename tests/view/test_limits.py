"""W/H over the limit of the stretch: what stands where, and that it can be read in grey."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ngspring.view.limits import LimitedDesign, limits_figure

C4 = [
    LimitedDesign(1.35, 1.4, 0.29),
    LimitedDesign(None, 1.6, 0.23),
    LimitedDesign(1.5, 1.475, 0.27),
]
T3 = [LimitedDesign(None, 1.32, 0.27), LimitedDesign(1.2, 1.21, 0.31)]
LABELS = "C4, 0.2300 without", "T3, 0.2700 without"


@pytest.fixture(scope="module")
def figure() -> Figure:
    return limits_figure({"C4": C4, "T3": T3})


def curves(figure: Figure) -> dict[str, Line2D]:
    lines = figure.axes[0].get_lines()
    return {str(line.get_label()): line for line in lines if line.get_label()[0] != "_"}


def test_axes_and_legend_say_what_is_drawn(figure: Figure) -> None:
    axes = figure.axes[0]
    assert (
        axes.get_xlabel()
        == "principal stretch [-]\nfilled: limit, hollow: exceeded by a thousandth of the solid"
    )
    assert axes.get_ylabel() == "W/H relative to that without a limit [-]"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(LABELS)


def test_a_curve_goes_from_the_tightest_limit_to_the_design_without(figure: Figure) -> None:
    curve = curves(figure)[LABELS[0]]
    expected = [(1.35, 0.29 / 0.23), (1.5, 0.27 / 0.23), (1.6, 1.0)]
    np.testing.assert_allclose(curve.get_xydata(), expected)
    # Only limits are filled.
    assert curve.get_markevery() == [0, 1]


def test_every_solid_has_a_hollow_mark_at_its_own_stretch(figure: Figure) -> None:
    hollow = [line for line in figure.axes[0].get_lines() if line.get_markerfacecolor() == "white"]
    for line, designs, plain in zip(hollow, (C4, T3), (0.23, 0.27), strict=True):
        expected = [(d.measure, d.width / plain) for d in designs]
        np.testing.assert_allclose(line.get_xydata(), expected)


def test_cases_differ_in_grey(figure: Figure) -> None:
    lines = list(curves(figure).values())
    assert len({line.get_marker() for line in lines}) == len(lines)
    assert len({line.get_linestyle() for line in lines}) == len(lines)
    for red, green, blue in (to_rgb(line.get_color()) for line in lines):
        assert red == green == blue < 0.6


def test_nothing_is_cut_off(figure: Figure) -> None:
    figure.canvas.draw()
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert box.x0 >= 0
    assert box.y0 >= 0
    assert box.x1 <= width
    assert box.y1 <= height


def test_a_case_without_limits_has_hollow_marks_only() -> None:
    line, hollow = limits_figure({"C4": [LimitedDesign(None, 1.6, 0.23)]}).axes[0].get_lines()
    assert line.get_markevery() == []
    assert hollow.get_markerfacecolor() == "white"

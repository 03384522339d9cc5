"""Notes of corrected targets: what they say, and what they may not be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ngspring import ControlPoint, Design, ProblemError, SpringProblem
from ngspring.design.corrections import (
    CORRECTIONS,
    MISSED,
    Correction,
    best_of,
    corrections_of,
    solid_deviations,
)
from ngspring.design.soundness import flaw

PROBLEM = SpringProblem((ControlPoint(10, 2, aim=1.9), ControlPoint(-10, -2)), elements=8)
FIRST = Correction(4, (2.0, -2.0), (2.2, float("nan")))
SECOND = Correction(9, (1.9, -2.0), (2.02, -1.9))


def design(**notes: Any) -> Design:
    info = {"converged": True, CORRECTIONS: [FIRST.to_note(), SECOND.to_note()], **notes}
    return Design(PROBLEM, Design.column(PROBLEM).coefficients + 9.0, None, info)


def test_they_survive_a_file(tmp_path: Path) -> None:
    design().save(tmp_path / "part.npz")
    found = corrections_of(Design.load(tmp_path / "part.npz").info)
    assert found[1] == SECOND
    assert found[0].update == 4
    np.testing.assert_array_equal(found[0].solid, FIRST.solid)


def test_a_deviation_is_positive_where_the_solid_is_stiffer_in_compression_too() -> None:
    far = solid_deviations(PROBLEM.control_points, SECOND.solid)
    np.testing.assert_allclose(far, [0.01, -0.05])
    assert SECOND.worst(PROBLEM.control_points) == pytest.approx(-0.05)


def test_the_solid_of_a_design_is_that_of_its_own_aims() -> None:
    assert design().solid == SECOND.solid
    assert Design(PROBLEM, design().coefficients).solid is None
    on_the_way = PROBLEM.replace(
        control_points=(ControlPoint(10, 2, aim=1.8), ControlPoint(-10, -2))
    )
    assert Design(on_the_way, design().coefficients, None, design().info).solid is None


def test_the_best_one_reached_every_control_point() -> None:
    points = PROBLEM.control_points
    assert best_of([FIRST, SECOND], points) == 1
    assert best_of([FIRST], points) is None
    worse = Correction(12, (1.8, -2.0), (2.0, -1.7))
    assert best_of([FIRST, SECOND, worse], points) == 1


def test_what_a_part_misses_is_its_flaw_and_grey_is_none() -> None:
    assert flaw(design(grey=[0.9, 0.9])) == ""
    assert flaw(design(**{MISSED: "too stiff"})) == "too stiff"


@pytest.mark.parametrize(
    "wrong",
    [
        5,
        [5],
        [{"update": 1, "aims": [1.0, 2.0]}],
        [{**SECOND.to_note(), "more": 1}],
        [{**SECOND.to_note(), "update": -1}],
        [{**SECOND.to_note(), "update": 1.5}],
        [{**SECOND.to_note(), "update": True}],
        [{**SECOND.to_note(), "aims": [1.0]}],
        [{**SECOND.to_note(), "aims": [1.0, None]}],
        [{**SECOND.to_note(), "solid": [1.0, float("inf")]}],
        [{**SECOND.to_note(), "solid": ["1", 2.0]}],
    ],
)
def test_a_note_that_is_something_else_is_refused(wrong: object) -> None:
    with pytest.raises(ProblemError, match="corrections"):
        design(**{CORRECTIONS: wrong})

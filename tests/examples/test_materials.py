"""The keyboard's dome: its targets are measured points, its stored numbers those of its design."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ngspring import Design, SpringProblem, load_displacement, read_curve

MATERIALS = Path(__file__).parents[2] / "examples" / "materials"
STORED = MATERIALS / "results" / "dome.npz"
pytestmark = pytest.mark.skipif(not STORED.is_file(), reason="the examples are not installed")


@pytest.fixture(scope="module")
def problem() -> SpringProblem:
    return SpringProblem.from_toml(MATERIALS / "dome.toml")


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.load(STORED)


def test_the_targets_are_measured_points(problem: SpringProblem) -> None:
    curve = read_curve(MATERIALS / "dome.csv", problem.H, problem.top_area)
    measured = dict(zip(curve.d, curve.q, strict=True))
    assert measured[-4.1] == -0.94
    assert [measured[point.d] for point in problem.control_points] == [
        point.q for point in problem.control_points
    ]


def test_the_stored_design_is_what_the_file_asks_for(
    problem: SpringProblem, design: Design
) -> None:
    assert design.problem.equals_but_for_name(problem)


def test_the_stored_forces_fall_where_those_of_a_dome_do(problem: SpringProblem) -> None:
    told = json.loads((MATERIALS / "results" / "dome.json").read_text())
    force = {d: -q for d, q in zip(told["d"], told["third_medium"], strict=True)}
    assert force[-1.0] > force[-2.0] > force[-3.0] < force[-3.9] < force[-4.1]
    for point in problem.control_points:
        assert -force[point.d] == pytest.approx(point.q, rel=1e-3)


@pytest.mark.long
def test_the_stored_curve_is_that_of_the_stored_design(design: Design) -> None:
    told = json.loads((MATERIALS / "results" / "dome.json").read_text())
    stored = dict(zip(told["d"], told["third_medium"], strict=True))
    found = load_displacement(design, [-1.0], threads=1)
    assert np.asarray(found.q) == pytest.approx([stored[-1.0]], rel=1e-6)

"""What a run leaves behind says so if the optimiser ended beyond a bifurcation."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ngspring import Result, SpringProblem, cases, load_displacement, optimize
from ngspring.output import other_branches
from ngspring.states import Responses, control_point_responses

PROBLEM: SpringProblem = cases["C4"].replace(elements=8, l_i=10.0)


@pytest.fixture(scope="module")
def begun() -> Result:
    return optimize(PROBLEM, max_updates=2, threads=1)


@pytest.fixture(scope="module")
def paths(begun: Result) -> Responses:
    return control_point_responses(begun.design, [-20, -15, -10, -5, 5, 10], threads=1)


def test_states_on_the_path_from_rest_are_not_remarked_upon(
    begun: Result, paths: Responses
) -> None:
    assert other_branches(begun, paths) == []


def test_a_force_that_the_path_from_rest_does_not_lead_to_is_said(
    begun: Result, paths: Responses
) -> None:
    elsewhere = begun.q + np.array([0.0, 0.0, 0.05])
    (line,) = other_branches(dataclasses.replace(begun, q=elsewhere), paths)
    assert f"carries {begun.q[2]:.4g} N at d = -20 mm, not {elsewhere[2]:.4g} N" in line


def test_a_control_point_that_the_path_did_not_reach_is_not_judged(begun: Result) -> None:
    short = load_displacement(begun.design, [-10, 10], threads=1)
    far = dataclasses.replace(begun, q=begun.q + np.array([0.0, 0.0, 1.0]))
    assert other_branches(far, short) == []

"""Eroded and dilated control points, from one line of a problem's file."""

from __future__ import annotations

import pytest

from ngspring import ControlPoint, ProblemError, SpringProblem
from ngspring.problem.offsets import SHARE_ROBUST, with_offsets

POINTS = (ControlPoint(10, 2, 3.0), ControlPoint(-10, -2, 3.0), ControlPoint(-20, -4, 3.0))


def etas(points: tuple[ControlPoint, ...]) -> list[tuple[float, float]]:
    return [(point.d, point.eta) for point in points]


def test_robust_adds_both_twins_of_every_target() -> None:
    found = with_offsets(POINTS, 1.0, robust=0.2)
    assert found[:3] == POINTS
    assert etas(found[3:]) == [(d, e) for e in (-1.6, 1.6) for d in (10.0, -10.0, -20.0)]
    assert {point.weight for point in found[3:]} == {3.0 * SHARE_ROBUST}
    assert [point.q for point in found[3:]] == [2.0, -2.0, -4.0] * 2


def test_one_line_of_a_file_does_it_with_its_own_interface() -> None:
    text = SpringProblem(POINTS, l_i=2.0).to_toml()
    read = SpringProblem.from_toml("robust = 0.2\nimperfection = 0.1\n" + text)
    assert read.control_points == with_offsets(POINTS, 2.0, robust=0.2, imperfection=0.1)
    # What is written holds the points themselves.
    assert SpringProblem.from_toml(read.to_toml()) == read


def test_without_them_nothing_is_added() -> None:
    assert with_offsets(POINTS, 1.0) == POINTS


@pytest.mark.parametrize("key", ["robust", "imperfection"])
@pytest.mark.parametrize("value", ["0", "-1.0", "nan", '"thick"', "true"])
def test_a_length_that_is_none_is_refused(key: str, value: str) -> None:
    with pytest.raises(ProblemError, match=key):
        SpringProblem.from_toml(f"{key} = {value}\n" + SpringProblem(POINTS).to_toml())


def test_a_twin_that_is_there_already_is_refused() -> None:
    points = (*POINTS, ControlPoint(10, 2, eta=1.6))
    with pytest.raises(ProblemError, match="leave one of them out"):
        with_offsets(points, 1.0, robust=0.2)


# -- imperfections ---------------------------------------------------------------------------------


def test_an_imperfection_is_a_control_point_at_the_outermost_compression() -> None:
    points = ControlPoint(10, 2), ControlPoint(-10, -2), ControlPoint(-20, -4, aim=-3.8)
    *targets, imperfect = with_offsets(points, 2.0, imperfection=0.2)
    assert tuple(targets) == points
    assert (imperfect.d, imperfect.q, imperfect.aim) == (-20, -4, -3.8)
    # Surfaces lie 0.2 mm further out where chi is larger by 8 / l_i times that.
    assert imperfect.eta_odd == pytest.approx(0.8)
    assert (imperfect.eta, imperfect.odd_in) == (0.0, "xy")
    assert 0 < imperfect.weight < 1
    assert not imperfect.own


def test_without_compression_the_outermost_tension_is_imperfect() -> None:
    points = ControlPoint(10, 2), ControlPoint(20, 4)
    assert with_offsets(points, 1.0, imperfection=0.1, odd_in="x")[-1].d == 20


def test_an_imperfection_in_a_file_fits_the_kinematics() -> None:
    text = 'imperfection = 0.2\nkinematics = "{}"\n[[control_points]]\nd = -10\nq = -2\n'
    plane = SpringProblem.from_toml(text.format("plane strain"))
    round_one = SpringProblem.from_toml(text.format("axisymmetric"))
    assert plane.control_points[-1].odd_in == "xy"
    assert round_one.control_points[-1].odd_in == "y"
    for problem in (plane, round_one):
        assert SpringProblem.from_toml(problem.to_toml()) == problem


def test_what_turns_about_an_axis_cannot_be_odd_across_it() -> None:
    with pytest.raises(ProblemError, match=r"odd_in = 'xy' is not valid.*body of revolution"):
        SpringProblem((ControlPoint(-10, -2, eta_odd=1.0),), kinematics="axisymmetric")


def test_a_kind_of_imperfection_needs_its_size() -> None:
    with pytest.raises(ProblemError, match="without imperfection"):
        SpringProblem.from_toml('imperfection_odd_in = "y"\n[[control_points]]\nd = -10\nq = -2\n')


def test_a_problem_without_imperfections_is_written_as_before() -> None:
    text = SpringProblem((ControlPoint(-10, -2),)).to_toml()
    assert "odd" not in text

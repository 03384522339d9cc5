"""A finished design leads to its neighbours; where its branch ends, the evolution goes on."""

from __future__ import annotations

import csv
import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import ngspring
from ngspring import ControlPoint, Design, NgspringError, ProblemError, SpringProblem
from ngspring.cli.main import cli
from ngspring.evolution.continuation import FollowSteps, moved_points
from ngspring.evolution.family import family_members
from ngspring.view.family import family_figure

SMALL = ngspring.cases["C4"].replace(elements=8, l_i=10.0)


def with_targets(factor: float, problem: SpringProblem = SMALL) -> SpringProblem:
    points = [ControlPoint(p.d, factor * p.q, p.weight) for p in problem.control_points]
    return problem.replace(control_points=points, name=f"{factor:g} times")


@pytest.fixture(scope="module")
def design() -> Design:
    result = ngspring.optimize(SMALL, threads=1)
    assert result.converged
    return result.design


# -- one neighbour ---------------------------------------------------------------------------------


def test_where_nothing_moves_the_design_stays(design: Design) -> None:
    result = ngspring.follow(design, SMALL, threads=1)
    assert result.converged
    np.testing.assert_allclose(result.design.coefficients, design.coefficients, atol=1e-7)


def test_a_neighbour_is_an_exact_stationary_point_of_its_own_problem(design: Design) -> None:
    goal = with_targets(1.02)
    result = ngspring.follow(design, goal, threads=1)
    assert result.converged
    assert result.message == ""
    assert result.design.problem == goal
    assert ngspring.optimality(result.design).residual < 1e-8
    np.testing.assert_allclose(result.q, [p.q for p in goal.control_points], rtol=1e-3)
    # All of it was followed: every row is a stationary point.
    assert np.isinf(result.history["dt"]).all()


def test_it_is_the_design_that_the_evolution_finds_from_there(design: Design) -> None:
    goal = with_targets(1.02)
    followed = ngspring.follow(design, goal, threads=1)
    evolved = ngspring.optimize(goal, design, 1e6, threads=1)
    assert followed.history.newton_iterations < evolved.history.newton_iterations
    np.testing.assert_allclose(followed.design.coefficients, evolved.design.coefficients, atol=1e-6)


@pytest.mark.long
def test_where_the_branch_ends_the_evolution_goes_on(design: Design) -> None:
    # A step that is never small enough is a branch that ends at once.
    ends = FollowSteps(first=1.0, largest=1.0, smallest=1.0, many=1)
    goal = with_targets(1.05)
    with pytest.raises(ProblemError, match="no stationary point"):
        ngspring.follow(with_another_chi(design), goal, threads=1)
    result = ngspring.follow(design, goal, steps=ends, threads=1)
    assert result.converged
    steps = result.history["dt"]
    assert (steps == 0.0).sum() == 1
    assert np.isfinite(steps).sum() > 3
    assert ngspring.optimality(result.design).residual < 1e-8


def with_another_chi(design: Design) -> Design:
    return Design(design.problem, design.coefficients + 0.2, design.history)


def test_control_points_move_in_straight_lines() -> None:
    goal = with_targets(2.0)
    middle = moved_points(SMALL, goal, 0.25)
    for here, there, point in zip(SMALL.control_points, goal.control_points, middle, strict=True):
        assert point.q == pytest.approx(0.75 * here.q + 0.25 * there.q)
        assert point.d == here.d
    assert moved_points(SMALL, goal, 0.0) == SMALL.control_points
    assert moved_points(SMALL, goal, 1.0) == goal.control_points


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"k_rho": 2e-8}, "k_rho = 2e-08 instead of 1e-08"),
        ({"elements": 10}, "elements = 10 instead of 8"),
        ({"control_points": SMALL.control_points[:2]}, "3 control points cannot become 2"),
        (
            {"control_points": [ControlPoint(-p.d, -p.q) for p in SMALL.control_points]},
            "through 0",
        ),
    ],
)
def test_only_control_points_move(design: Design, changes: dict[str, object], match: str) -> None:
    with pytest.raises(ProblemError, match=match):
        ngspring.follow(design, SMALL.replace(**changes), threads=1)


# -- families --------------------------------------------------------------------------------------


def test_a_family_leads_from_the_design_to_the_goal(design: Design) -> None:
    goal = with_targets(1.02)
    family = ngspring.family(design, goal, 3, threads=1)
    assert [member.share for member in family.members] == [0.0, 0.5, 1.0]
    first, middle, last = family.designs
    np.testing.assert_allclose(first.coefficients, design.coefficients, atol=1e-7)
    assert [p.q for p in middle.problem.control_points] == pytest.approx(
        [1.01 * p.q for p in SMALL.control_points]
    )
    assert last.problem == goal
    assert all(ngspring.optimality(member).residual < 1e-8 for member in family.designs)
    # Stiffer springs need more material.
    assert (np.diff(family.widths) > 0).all()
    rows = list(csv.DictReader(io.StringIO(family.to_csv())))
    assert [float(row["width"]) for row in rows] == family.widths.tolist()
    assert float(rows[-1]["target3"]) == goal.control_points[2].q
    texts = [text.get_text() for ax in family_figure(family).axes for text in ax.texts]
    assert all("nan" not in text for text in texts)


@pytest.mark.parametrize("members", [1, 0, True, 2.0, 10**6])
def test_a_family_has_at_least_two_members(design: Design, members: int) -> None:
    with pytest.raises(NgspringError, match="members"):
        next(family_members(design, SMALL, members))


def test_the_command_writes_its_members_and_a_picture(
    design: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    design.save("small.npz")
    Path("goal.toml").write_text(with_targets(1.01).to_toml())
    words = ["family", "small.npz", "--to", "goal.toml", "--members", "2", "--threads", "1"]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 0, outcome.output
    folder = tmp_path / "runs" / "family-small-goal"
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["family.csv", "family.png", "member-00.npz", "member-01.npz"]
    assert Design.load(folder / "member-01.npz").problem.control_points == (
        with_targets(1.01).control_points
    )
    assert "100%" in outcome.output


def test_a_design_with_a_limit_keeps_it_on_its_way_to_a_goal_without(
    design: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    problem = design.problem.replace(wall=0.1)
    dataclasses.replace(design, problem=problem).save("small.npz")
    Path("goal.toml").write_text(with_targets(1.01).to_toml())
    words = ["family", "small.npz", "--to", "goal.toml", "--members", "2", "--threads", "1"]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 0, outcome.output
    last = Design.load("runs/family-small-goal/member-01.npz").problem
    assert last == problem.replace(control_points=with_targets(1.01).control_points, name=last.name)

"""Coarse meshes come first; the end is a stationary point of the problem that was asked for."""

from __future__ import annotations

import dataclasses
import logging
from pathlib import Path

import numpy as np
import pytest

import ngspring
from ngspring import (
    NO_LADDER,
    ControlPoint,
    Design,
    Ladder,
    ProblemError,
    Result,
    Snapshots,
    SpringProblem,
)
from ngspring.cli.progress import plain_line
from ngspring.design.history import History, Row, stages
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.runstate import read_run
from ngspring.evolution.updates import Update
from ngspring.problem.scaling import time_unit
from ngspring.view.report import report_page

# One control point: each of them multiplies what a run costs, and the meshes do not know of them.
PROBLEM = SpringProblem((ControlPoint(10, 2),), name="one", elements=16, l_i=5.0)
LADDER = Ladder(smallest=8)


def elements(ladder: Ladder, problem: ngspring.SpringProblem, start: object = None) -> list[int]:
    return [rung.elements for rung in ladder.rungs(problem, start)]  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, list[Update], Path]:
    """An uninterrupted run, what was told of it, and its folder."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    told: list[Update] = []
    result = ngspring.optimize(
        PROBLEM, out=folder, observers=[told.append], threads=1, ladder=LADDER
    )
    return result, told, folder


# -- which meshes ----------------------------------------------------------------------------------


def test_the_meshes_are_halves_with_interfaces_as_many_elements_wide() -> None:
    rungs = Ladder().rungs(ngspring.cases["C7"])
    assert [rung.elements for rung in rungs] == [20, 40, 80]
    assert [rung.l_i for rung in rungs] == [4.0, 2.0, 1.0]
    assert rungs[-1] is ngspring.cases["C7"]


@pytest.mark.parametrize(
    ("count", "expected"), [(8, [8]), (36, [36]), (50, [24, 50]), (90, [22, 44, 90])]
)
def test_every_mesh_has_an_even_number_of_elements_and_is_not_too_coarse(
    count: int, expected: list[int]
) -> None:
    assert elements(Ladder(), PROBLEM.replace(elements=count)) == expected


def test_a_finished_design_keeps_its_details() -> None:
    problem = ngspring.cases["C7"]
    assert elements(Ladder(), problem, ngspring.gallery["C4"]) == [80]
    assert elements(Ladder(halvings=3), problem.replace(elements=160), ngspring.gallery["C4"]) == [
        160
    ]
    # What was only drawn has none yet.
    assert elements(Ladder(), problem, Design.random(problem)) == [20, 40, 80]


def test_a_ladder_that_is_none_is_refused() -> None:
    for changes in ({"halvings": -1}, {"leave": 0.0}, {"dt": float("nan")}, {"smallest": 0}):
        with pytest.raises(ProblemError, match="is no ladder"):
            dataclasses.replace(LADDER, **changes)


# -- a run -----------------------------------------------------------------------------------------


def test_it_ends_at_an_exact_stationary_point_of_what_was_asked_for(
    whole: tuple[Result, list[Update], Path],
) -> None:
    result = whole[0]
    assert result.converged
    assert result.design.problem == PROBLEM
    assert ngspring.optimality(result.design).residual < 1e-8
    np.testing.assert_allclose(result.q, [point.q for point in PROBLEM.control_points], rtol=1e-3)


@pytest.mark.long
def test_it_ends_no_higher_than_without_coarse_meshes(
    whole: tuple[Result, list[Update], Path],
) -> None:
    plain = ngspring.optimize(PROBLEM, threads=1, ladder=NO_LADDER)
    assert plain.converged
    assert len(stages(plain.history.rows())) == 1
    assert whole[0].history.last().C <= plain.history.last().C * (1 + 1e-3)


def test_each_coarse_mesh_is_left_once_dt_has_come_far(
    whole: tuple[Result, list[Update], Path],
) -> None:
    coarse, fine = stages(whole[0].history.rows())
    leave = LADDER.leave * time_unit(PROBLEM)
    assert [coarse[0].elements, fine[0].elements] == [8, 16]
    assert all(row.dt < leave for row in coarse[:-1])
    assert leave <= coarse[-1].dt < np.inf
    assert fine[0].dt == 0.0
    assert fine[-1].is_end
    rows = whole[0].history.rows()
    assert [row.update for row in rows] == list(range(len(rows)))


def test_the_next_mesh_starts_from_the_design_of_the_one_before(
    whole: tuple[Result, list[Update], Path],
) -> None:
    told = [update for update in whole[1] if update.accepted]
    (first,) = (u for u in told if u.row.elements == 16 and u.row.dt == 0.0)
    before = told[first.row.update - 1].design
    np.testing.assert_array_equal(
        first.design.coefficients, before.with_problem(PROBLEM).coefficients
    )
    # Loaded from rest on its own mesh.
    here = ngspring.load_displacement(first.design, [p.d for p in PROBLEM.control_points])
    np.testing.assert_allclose(first.row.q, here.q, rtol=1e-6)


def test_snapshots_are_all_on_the_last_mesh(whole: tuple[Result, list[Update], Path]) -> None:
    snapshots = Snapshots.load(whole[2] / "snapshots.npz")
    assert snapshots.problem == PROBLEM
    assert len(snapshots.updates) == len(whole[0].history)


def test_progress_and_report_tell_the_mesh(whole: tuple[Result, list[Update], Path]) -> None:
    coarse = plain_line(whole[1][0], PROBLEM)
    assert "on 8 elements" in coarse
    assert "elements" not in plain_line(whole[1][-1], PROBLEM)
    text = report_page(read_run(whole[2]))
    assert "Meshes on the way" in text
    assert "8 × 8" in text


# -- stopping and going on -------------------------------------------------------------------------


def boundary(result: Result) -> int:
    """Last update on the coarse mesh."""
    return stages(result.history.rows())[0][-1].update


@pytest.mark.long
@pytest.mark.parametrize("after", [0, 1])
def test_a_run_that_is_stopped_on_any_mesh_goes_on_to_the_same_design(
    whole: tuple[Result, list[Update], Path], tmp_path: Path, after: int
) -> None:
    result = whole[0]
    stop = boundary(result) + after
    options = {"out": tmp_path / "run", "threads": 1, "ladder": LADDER}
    halfway = ngspring.optimize(PROBLEM, max_updates=stop, **options)  # type: ignore[arg-type]
    assert not halfway.converged
    assert halfway.design.problem.elements == (8 if after <= 0 else 16)
    state = read_run(tmp_path / "run")
    assert state.asked == PROBLEM
    assert "16 × 16 elements" in report_page(state)
    again = ngspring.optimize(PROBLEM, resume=True, **options)  # type: ignore[arg-type]
    assert again.converged
    np.testing.assert_allclose(again.design.coefficients, result.design.coefficients, atol=1e-9)
    columns = [k for k, name in enumerate(result.history.columns) if name != "seconds"]
    np.testing.assert_allclose(
        again.history.values[:, columns], result.history.values[:, columns], rtol=1e-9, atol=1e-12
    )


def test_the_checkpoint_of_a_coarse_mesh_belongs_to_the_problem_asked_for(
    whole: tuple[Result, list[Update], Path], tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    ngspring.optimize(PROBLEM, max_updates=2, out=folder, threads=1, ladder=LADDER)
    checkpoint = Checkpoint.load(folder / "checkpoint.npz")
    assert checkpoint.problem.elements == 8
    assert checkpoint.goal == PROBLEM
    with pytest.raises(ngspring.RunFolderError, match="another problem"):
        ngspring.optimize(checkpoint.problem, out=folder, resume=True, threads=1)
    corrected = PROBLEM.replace(name="corrected")
    ngspring.optimize(corrected, max_updates=3, out=folder, resume=True, threads=1, ladder=LADDER)
    assert Checkpoint.load(folder / "checkpoint.npz").goal.name == "corrected"


# -- where a coarse mesh leads astray --------------------------------------------------------------


def test_a_design_that_is_nothing_on_the_next_mesh_gives_way_to_the_start(
    whole: tuple[Result, list[Update], Path], caplog: pytest.LogCaptureFixture
) -> None:
    told = [update for update in whole[1] if update.accepted]
    left = told[boundary(whole[0])].checkpoint
    assert left is not None
    void = dataclasses.replace(left.state, chi=np.full_like(left.state.chi, -5.0))
    evolution = ngspring.evolve(
        PROBLEM,
        resume_from=dataclasses.replace(left, state=void),
        threads=1,
        ladder=LADDER,
    )
    updates = iter(evolution)
    next(updates)
    with caplog.at_level(logging.WARNING):
        first = next(updates)
    assert "led astray" in caplog.text
    assert first.row.elements == 16
    np.testing.assert_array_equal(first.design.coefficients, Design.column(PROBLEM).coefficients)


def test_a_coarse_mesh_that_fails_hands_its_design_on(caplog: pytest.LogCaptureFixture) -> None:
    rule = ngspring.StepRule(smallest=1e6)
    hard = ngspring.cases["C4"].replace(elements=16, l_i=5.0)
    evolution = ngspring.evolve(hard, dt_initial=1e6, rule=rule, threads=1, ladder=LADDER)
    with caplog.at_level(logging.WARNING):
        for update in evolution:
            if update.row.elements == 16:
                break
    assert "given up on 8 elements" in caplog.text
    assert update.row.elements == 16
    assert not evolution.over


# -- walls and gaps --------------------------------------------------------------------------------


def test_a_finished_start_keeps_its_walls_on_every_mesh() -> None:
    problem = PROBLEM.replace(elements=80, l_i=1.0, wall=2.0, gap=0.8)
    finished = dataclasses.replace(Design.column(PROBLEM), history=one_row())
    for start, walls in ((None, [0.0, 0.0, 2.0]), (finished, [2.0, 2.0, 2.0])):
        assert [rung.wall for rung in Ladder().rungs(problem, start)] == walls


def one_row() -> History:
    return History.from_rows([Row(update=0, C_q=(0.0,), q=(2.0,))])


def test_walls_come_into_the_history_with_the_last_mesh(tmp_path: Path) -> None:
    problem = PROBLEM.replace(gap=20.0)
    options = {"out": tmp_path / "run", "threads": 1, "ladder": LADDER}
    coarse = ngspring.optimize(problem, max_updates=1, **options)  # type: ignore[arg-type]
    assert coarse.design.problem.gap == 0.0
    assert read_run(tmp_path / "run").asked == problem
    done = ngspring.optimize(problem, resume=True, **options)  # type: ignore[arg-type]
    assert done.converged
    assert done.design.problem == problem
    first, last = stages(done.history.rows())
    assert {row.terms["gaps"] for row in first} == {0.0}
    assert last[0].terms["gaps"] > 0.0
    for row in (first[-1], last[-1]):
        parts = sum(row.terms.values()) + sum(row.C_q)
        assert parts == pytest.approx(row.C, rel=1e-12)

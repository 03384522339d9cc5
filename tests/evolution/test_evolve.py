"""The loop of the evolution belongs to the caller."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import ngspring
from ngspring import ControlPoint, SpringProblem, StepRule
from ngspring.basics.errors import ProblemError
from ngspring.design.history import History, Row, stages
from ngspring.evolution.steprule import PAPER_RULE
from ngspring.kkt.newton import EXACT, relative_residuals
from ngspring.kkt.system import CoupledSystem

SMALL = SpringProblem((ControlPoint(8.0, 2.0), ControlPoint(-8.0, -2.0)), elements=8, l_i=10.0)


def test_a_loop_may_be_left_and_taken_up_again_by_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = ngspring.optimize(SMALL, max_updates=8, threads=1)
    first = ngspring.evolve(SMALL, threads=1)
    seen = []
    for update in first:
        seen.append(update)
        if update.row.update == 3:
            break
    assert not first.over
    second = ngspring.evolve(SMALL, resume_from=seen[-1].checkpoint, threads=1)
    for update in second:
        assert update.resumed == (update.row.update == 3)
        if update.row.update == 8:
            break
    # Of no importance to whoever goes on: seconds.
    columns = [k for k, name in enumerate(whole.history.columns) if name != "seconds"]
    np.testing.assert_allclose(
        second.history.values[:, columns], whole.history.values[:, columns], rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(
        second.result.design.coefficients, whole.design.coefficients, atol=1e-9
    )
    assert not list(tmp_path.iterdir())  # nothing is written


def test_the_same_evolution_goes_on_where_its_loop_was_left() -> None:
    evolution = ngspring.evolve(SMALL, threads=1)
    numbers = []
    for stop in (2, 5):
        for update in evolution:
            numbers.append(update.row.update)
            if update.row.update == stop:
                break
    assert numbers == [0, 1, 2, 3, 4, 5]


@pytest.mark.long
def test_it_ends_by_itself_at_the_stationary_point() -> None:
    evolution = ngspring.evolve(SMALL, threads=1, rule=StepRule())
    *_, last = evolution
    assert evolution.over
    assert last.row.is_end
    assert evolution.result.converged
    assert evolution.result.design.info["converged"] is True
    assert list(evolution) == []


def test_it_goes_on_from_the_last_accepted_update_even_after_a_rejected_one() -> None:
    first = ngspring.evolve(SMALL, dt_initial=1e6, threads=1, rule=StepRule())
    updates = []
    for update in first:
        updates.append(update)
        if not update.accepted:
            break
    assert not updates[-1].accepted
    assert first.checkpoint is updates[-1].checkpoint is updates[-2].checkpoint
    again = iter(ngspring.evolve(SMALL, resume_from=first.checkpoint, threads=1, rule=StepRule()))
    assert next(again).resumed
    assert next(again).dt == updates[-1].dt


def test_after_the_end_was_tried_in_vain_updates_are_iterated_as_far_as_the_end() -> None:
    """Where a stationary point has just vanished, what is stopped early goes nowhere."""
    system = CoupledSystem(SMALL, "sparsecholesky", 1)
    before: list[float] = []
    after: list[float] = []
    tried, chi = False, None
    # A rule that tries the end long before its time.
    for update in ngspring.evolve(SMALL, threads=1, rule=StepRule(rest=1e3, still=10)):
        tried = tried or (not update.accepted and np.isinf(update.dt))
        if not update.accepted:
            continue
        state = update.checkpoint.state
        if chi is not None:
            residual = system.residual(state, chi, update.dt)
            (after if tried else before).append(relative_residuals(system, residual).max())
        chi = state.chi
        if len(after) == 6:
            break
    assert tried
    assert max(before) > 1e-4
    assert max(after) < EXACT.residual_tolerance


@pytest.mark.parametrize(("search", "falls"), [(True, [4, 16, 64]), (False, [4, 4, 4])])
def test_where_the_end_has_failed_dt_falls_faster_and_faster(
    search: bool, falls: list[float]
) -> None:
    """The paper's rule falls by four each time."""
    rule = StepRule(growth=1e4, easy_growth=1e4, easy=9, few=10, end=1e9, search=search)
    tried: list[float] = []
    failed = False
    for update in ngspring.evolve(SMALL, threads=1, rule=rule):
        if failed and update.accepted:
            break
        failed = failed or np.isinf(update.dt)
        tried += [update.dt] if failed else []
    assert np.isinf(tried[0])
    assert not update.row.is_end
    tried = [rule.end, *tried[1:], update.dt]
    assert [before / after for before, after in pairwise(tried)][:3] == falls
    assert not PAPER_RULE.search


def test_arguments_are_checked_before_anything_is_computed() -> None:
    for dt in (-1.0, 0.0, float("nan"), "1"):
        with pytest.raises(ProblemError, match="dt_initial"):
            ngspring.evolve(SMALL, dt_initial=dt)  # type: ignore[arg-type]
    first = next(iter(ngspring.evolve(SMALL, threads=1)))
    with pytest.raises(ProblemError, match="another problem"):
        ngspring.evolve(SMALL.replace(l_i=12.0), resume_from=first.checkpoint)


@pytest.mark.long
def test_a_pause_is_no_end() -> None:
    evolution = ngspring.evolve(SMALL, threads=1, rule=StepRule())
    next(iter(evolution))
    evolution.stop("a pause")
    *_, last = evolution
    assert last.row.is_end
    assert evolution.message == ""
    assert "stopped" not in evolution.result.design.info


def test_why_a_loop_was_left_is_a_note_of_the_design() -> None:
    evolution = ngspring.evolve(SMALL, threads=1)
    next(iter(evolution))
    evolution.stop("enough")
    assert evolution.result.message == "enough"
    assert evolution.design.info["stopped"] == "enough"


# -- rows of the history ---------------------------------------------------------------------------


def test_a_row_goes_into_the_table_and_back() -> None:
    row = Row(
        3, 10.0, 4, 1, 7, -2.5, 0.1, {"volume": 0.05}, (0.01, 0.04), (2.0, -2.0), 99.0, 0.2, 1.5, 40
    )
    history = History.from_rows([row])
    assert history.columns == (
        "update",
        "elements",
        "correction",
        "dt",
        "newton_iterations",
        "rejected",
        "rejected_iterations",
        "leap",
        "C",
        "volume",
        "C_q1",
        "C_q2",
        "q1",
        "q2",
        "V",
        "width",
        "seconds",
    )
    assert history.last() == row
    assert history.rows() == [row]
    assert history.q(1).tolist() == [-2.0]
    assert history.C_q(0).tolist() == [0.01]
    assert row["q2"] == -2.0


def test_a_history_of_an_older_version_has_neither_leaps_nor_meshes() -> None:
    history = History(("update", "dt", "seconds"), np.array([[0.0, 1.0, 0.5], [1.0, np.inf, 0.7]]))
    start, end = history.rows()
    assert start.leap == 0.0
    assert [len(mesh) for mesh in stages(history.rows())] == [2]
    assert end.is_end
    assert not start.is_end
    assert end.seconds == 0.7


def test_what_a_row_means() -> None:
    assert Row(1, dt=1.0, leap=-3.0, rejected=2).failed == 1
    assert Row(1, dt=1.0, leap=3.0, rejected=2).failed == 2
    assert Row(1, dt=1.0, leap=3.0).leapt
    assert Row(1, dt=1.0, newton_iterations=4, rejected_iterations=6).iterations == 10

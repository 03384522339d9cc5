"""Leaps along the flow of the design between converged updates."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import ngspring
from ngspring import ControlPoint, Design, LeapRule, SpringProblem, StepRule
from ngspring.design.history import Row
from ngspring.evolution.leaps import Leaping
from ngspring.evolution.stepping import BackwardEuler, Past
from ngspring.kkt.newton import EXACT
from ngspring.kkt.start import initial_state
from ngspring.kkt.system import CoupledSystem

SMALL = ngspring.cases["C4"].replace(elements=8, l_i=10.0)
ONE = SpringProblem((ControlPoint(10, 2),), elements=8, l_i=10.0)
DT = 50.0


def rows_of(
    steps: list[float],
    leaps: dict[int, float] | None = None,
    rejected: dict[int, int] | None = None,
) -> list[Row]:
    """A history with these dt, leaps (in multiples of dt) and rejected attempts.

    A leap that failed, which is stored as a negative one, is a rejected attempt unless told.
    """
    rows = []
    for k, dt in enumerate(steps):
        factor = (leaps or {}).get(k, 0.0)
        count = (rejected or {}).get(k, int(factor < 0.0))
        rows.append(Row(k, dt, leap=factor * dt, rejected=count))
    return rows


def test_there_is_no_leap_as_long_as_dt_grows() -> None:
    rule = LeapRule(patience=3)
    growing = rows_of([0.0, 1.0, 2.0, 4.0])
    assert rule.factor(growing) == 0.0
    assert rule.factor(rows_of([0.0, 1.0, 4.0, 2.0, 4.0])) == 0.0
    # The first of the largest counts: the one after is no progress.
    assert rule.factor(rows_of([0.0, 1.0, 4.0, 2.0, 4.0, 4.0])) == rule.first


def test_leaps_alternate_with_updates_that_show_the_drift() -> None:
    rule = LeapRule(patience=2)
    steps = [0.0, 4.0, 1.0, 1.0, 1.0]
    assert rule.factor(rows_of(steps, {4: 3.0})) == 0.0
    assert rule.factor(rows_of(steps, {4: -3.0})) == 0.0
    assert rule.factor(rows_of(steps, {3: 3.0})) == pytest.approx(3.0 * rule.growth)
    assert rule.factor(rows_of(steps, {3: -3.0})) == pytest.approx(1.5)
    assert rule.factor(rows_of(steps, {3: 9.0})) == rule.largest
    # A leap of 3 of the dt that failed after it, too, was one of 3, not of 12.
    assert rule.factor(rows_of(steps, {3: -12.0}, {3: 2})) == pytest.approx(1.5)
    # Given up after a short one that failed, and tried again later.
    assert rule.factor(rows_of(steps, {3: -0.8})) == 0.0
    assert rule.factor(rows_of([*steps, 1.0], {3: -0.8})) == rule.first


def test_a_dt_that_failed_lately_is_not_tried_again() -> None:
    rule = LeapRule(patience=2, memory=4)
    steps = [0.0, 9.0, 1.0, 2.0, 2.0]
    # One attempt with 4 dt was rejected at row 2.
    assert rule.held(rows_of(steps, rejected={2: 1}), 2.0, 3.9) == 3.9
    assert rule.held(rows_of(steps, rejected={2: 1}), 2.0, 4.0) == 2.0
    assert rule.held(rows_of([*steps, 2.0, 2.0], rejected={2: 1}), 2.0, 4.0) == 4.0
    # A leap that failed says nothing of dt.
    assert rule.held(rows_of(steps, {2: -3.0}, {2: 1}), 2.0, 4.0) == 4.0
    assert rule.held(rows_of(steps, {2: -3.0}, {2: 2}), 2.0, 4.0) == 2.0
    # As long as dt grows nothing is held back.
    assert rule.held(rows_of([0.0, 1.0, 2.0], rejected={1: 1}), 2.0, 4.0) == 4.0


@pytest.fixture(scope="module")
def system() -> CoupledSystem:
    return CoupledSystem(SMALL, "sparsecholesky", 1)


@pytest.fixture(scope="module")
def drifting(system: CoupledSystem) -> Past:
    """Two converged updates after the start, and a history that asks for a leap."""
    euler = BackwardEuler(system, EXACT, StepRule())
    state = initial_state(system, Design.column(SMALL))
    for dt in (10.0, 100.0, 500.0, DT, DT):
        outcome = euler.solved(state, dt, EXACT)
        assert outcome.converged
        previous, state = state, outcome.state
    rows = rows_of([0.0, 1e9, *[DT] * 12])
    rows[-1] = dataclasses.replace(rows[-1], C=system.terms(state)["C"])
    return Past(state, previous, rows)


def test_a_leap_takes_the_design_as_far_as_several_updates_would(
    system: CoupledSystem, drifting: Past
) -> None:
    leaping = Leaping(system, EXACT, LeapRule(first=2.0))
    outcome = leaping.update(drifting, DT)
    assert outcome.converged
    assert outcome.leap == 2 * DT
    euler = BackwardEuler(system, EXACT, StepRule())
    state = drifting.state
    for _ in range(3):
        state = euler.solved(state, DT, EXACT).state
    moved = np.linalg.norm(state.chi - drifting.state.chi)
    assert np.linalg.norm(outcome.state.chi - state.chi) < 0.25 * moved
    before, after, there = (system.terms(s)["C"] for s in (drifting.state, outcome.state, state))
    assert after < before
    assert before - after == pytest.approx(before - there, rel=0.25)
    # It ends with a converged update: equilibrium holds as well as after any other.
    residual = system.residual(outcome.state, outcome.state.chi, np.inf)
    assert np.abs(residual.lam).max() < 1e-5


def test_the_drift_is_measured_per_pseudo_time(system: CoupledSystem, drifting: Past) -> None:
    """After a change of dt the leap is a multiple of the new one."""
    leaping = Leaping(system, EXACT, LeapRule(first=4.0))
    outcome = leaping.update(drifting, DT / 2)
    same = Leaping(system, EXACT, LeapRule(first=2.0)).update(drifting, DT)
    assert outcome.leap == same.leap == 2 * DT
    difference = np.linalg.norm(outcome.state.chi - same.state.chi)
    assert difference < 0.2 * np.linalg.norm(same.state.chi - drifting.state.chi)


def test_a_leap_too_far_is_given_up_for_an_update_over_the_same_dt(
    system: CoupledSystem, drifting: Past
) -> None:
    leaping = Leaping(system, EXACT, LeapRule(first=1e4, largest=1e5))
    failed = leaping.update(drifting, DT)
    assert not failed.converged
    assert failed.reason.startswith("a leap too far")
    once = dataclasses.replace(drifting, rejected=1)
    assert leaping.shrunk(once, DT) == DT
    outcome = leaping.update(once, DT)
    plain = BackwardEuler(system, EXACT, StepRule()).update(drifting, DT)
    assert outcome.converged
    np.testing.assert_allclose(outcome.state.chi, plain.state.chi, rtol=0, atol=1e-7)
    assert outcome.leap == -DT * 1e4
    assert leaping.shrunk(dataclasses.replace(drifting, rejected=2), DT) == DT / 4


@pytest.mark.long
def test_a_run_with_leaps_ends_in_the_same_stationary_point() -> None:
    eager = LeapRule(patience=1, converged=StepRule(growth=1.3, easy=0))
    leapt = ngspring.optimize(ONE, rule=eager, newton=EXACT, threads=1)
    plain = ngspring.optimize(ONE, rule=StepRule(), threads=1)
    assert leapt.converged
    assert plain.converged
    assert (leapt.history["leap"] > 0).sum() >= 3
    assert not plain.history["leap"].any()
    assert leapt.history["C"][-1] == pytest.approx(plain.history["C"][-1], rel=1e-8)
    np.testing.assert_allclose(leapt.design.coefficients, plain.design.coefficients, atol=1e-4)
    # C is lower after every leap that was kept.
    kept = leapt.history["leap"] > 0
    assert (np.diff(leapt.history["C"])[kept[1:]] < 0).all()

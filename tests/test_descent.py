"""Design updates of a single iteration, and how they take turns with converged ones."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import ngspring
from ngspring import Design, Update
from ngspring.backward_euler import BackwardEuler, Past
from ngspring.descent import Descent
from ngspring.kkt import CoupledSystem, State
from ngspring.newton import NewtonResult, NewtonSettings
from ngspring.start import initial_state
from ngspring.stepping import Mixed, make_stepper
from ngspring.steprule import MixedRule, StepRule

SMALL = ngspring.cases["C4"].replace(elements=12, l_i=7.0)


@pytest.fixture(scope="module")
def system() -> CoupledSystem:
    return CoupledSystem(SMALL, "sparsecholesky", 1)


@pytest.fixture(scope="module")
def start(system: CoupledSystem) -> State:
    return initial_state(system, Design.column(SMALL))


def reduced_objective(system: CoupledSystem, state: State, chi: np.ndarray) -> float:
    """C(chi) from equilibria found by following the spring's path, not by `Descent`."""
    moved = initial_state(system, Design(SMALL, chi.reshape(SMALL.coefficient_shape)))
    return system.terms(moved)["C"]


def test_the_expected_decrease_is_that_of_the_objective_in_equilibrium(
    system: CoupledSystem, start: State
) -> None:
    before = system.terms(start)["C"]
    errors = []
    for dt in (1.0, 0.25):
        step = Descent(system).step(start, dt)
        assert step.accepted
        errors.append(abs(step.ratio - 1))
        after = reduced_objective(system, start, step.state.chi)
        assert after < before
        assert system.terms(step.state)["C"] == pytest.approx(after, rel=1e-5)
    # The model is quadratic, the objective is not: the error falls at least with dt.
    assert errors[1] < errors[0] / 2
    assert errors[1] < 0.02


def test_a_step_ends_in_equilibrium_with_the_multipliers_of_its_forces(
    system: CoupledSystem, start: State
) -> None:
    state = Descent(system).step(start, 20.0).state
    residual = system.residual(state, state.chi, np.inf)
    forces = np.array([abs(point.q) for point in SMALL.control_points])
    assert (np.linalg.norm(residual.lam[:, :-1], axis=1) < 1e-3 * forces).all()
    # What is out of balance belongs to q, so the last row is balanced together with it.
    weighted = np.einsum("ji,ji->j", state.lam, residual.lam) / state.lam[:, -1]
    assert (abs(weighted) < 1e-9 * forces).all()


def test_multipliers_that_the_iteration_got_wrong_are_found_again(
    system: CoupledSystem, start: State
) -> None:
    """A multiplier near zero that should not be hides a deviation of q from C."""
    wrong = State(start.chi, start.u, 1e-9 * start.lam)
    assert system.terms(wrong)["C"] < 0.9 * system.terms(start)["C"]
    right = Descent(system)._evaluated(wrong)
    np.testing.assert_allclose(right.state.lam, start.lam, rtol=1e-5, atol=1e-9)
    assert pytest.approx(system.terms(start)["C"], rel=1e-7) == right.C


def test_a_step_that_makes_c_larger_is_rejected_and_leaves_the_state(
    system: CoupledSystem, start: State
) -> None:
    step = Descent(system).step(start, 1e6)
    assert not step.accepted
    assert step.reason
    assert step.state is start


@pytest.mark.parametrize(
    ("dt", "before", "expected"),
    [
        (1.0, 4, ["all", "one"] * 3),
        (1.0, 1, ["one", "all"] * 3),
        (1e12, 4, ["one", "one", "all"] * 2),
        (1e12, 1, ["one", "one", "all"] * 2),
    ],
)
def test_attempts_take_turns(
    system: CoupledSystem,
    start: State,
    monkeypatch: pytest.MonkeyPatch,
    dt: float,
    before: int,
    expected: list[str],
) -> None:
    """Below ``follow`` converged updates come first, unless the last one was a single iteration."""
    calls: list[str] = []
    failed = NewtonResult(start, False, 3, "no", None, np.inf)

    def euler(*args: object) -> NewtonResult:
        calls.append("all")
        return failed

    class Single:
        def __init__(self, system: object) -> None: ...

        def step(self, state: State, dt: float, least: float) -> object:
            assert least == (0.8 if dt <= 1e10 else 0.2)
            calls.append("one")
            return dataclasses.make_dataclass(
                "Step", ["state", "accepted", "ratio", "optimality", "reason"]
            )(state, False, 0.0, np.inf, "no")

    monkeypatch.setattr("ngspring.backward_euler.solve_update", euler)
    monkeypatch.setattr("ngspring.stepping.Descent", Single)
    stepper = Mixed(system, NewtonSettings(), MixedRule())
    tried = []
    rows = [{"newton_iterations": float(before)}]
    for rejected in range(6):
        stepper.update(Past(start, start, rows, rejected), dt)
        tried.append(dt)
        dt = stepper.shrunk(Past(start, start, rows, rejected + 1), dt)
    assert calls == expected
    steps = [0, 0, 1, 1, 2, 2] if tried[0] == 1.0 else [0, 1, 1, 2, 3, 3]
    assert tried == [tried[0] / 4**k for k in steps]


def test_above_follow_single_iterations_come_first_in_units_of_the_domain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = SMALL.replace(L=200.0, H=200.0, elements=6, l_i=28.0)
    system = CoupledSystem(problem, "sparsecholesky", 1)
    state = initial_state(system, Design.column(problem))
    stepper = make_stepper(system, NewtonSettings(), MixedRule(follow=10.0))
    assert isinstance(stepper, Mixed)
    for dt, beyond in ((39.0, False), (41.0, True)):
        stepper.update(Past(state, state, [{"newton_iterations": 4.0}]), dt)
        assert stepper._beyond is beyond
    assert isinstance(make_stepper(system, NewtonSettings(), StepRule()), BackwardEuler)


def test_the_rule_makes_dt_grow_with_the_quality_of_the_model() -> None:
    rule = MixedRule()
    assert [rule.grown(1.0, 1.0, 1.0, calm) for calm in range(5)] == [1.0, 1.5, 2.0, 5.0, 5.0]
    assert rule.grown(1.0, 0.6, 1.0, 4) == 1.0
    assert rule.grown(1.0, 0.3, 1.0, 4) == 0.5
    assert rule.grown(1.0, 1.0, 1e-6, 1) == np.inf
    # Not right after a rejected attempt, nor where the model is bad.
    assert rule.grown(1.0, 1.0, 1e-6, 0) == 1.0
    assert rule.grown(1.0, 0.6, 1e-6, 3) == 1.0


def test_a_final_update_tried_too_early_goes_on_from_the_last_dt() -> None:
    """With single iterations from the start, and the end in sight at once."""
    updates: list[Update] = []
    eager = MixedRule(follow=1e-3, settled=10.0)
    problem = ngspring.cases["C4"].replace(elements=4, l_i=20.0)
    result = ngspring.optimize(problem, rule=eager, threads=1, observers=[updates.append])
    early = [k for k, update in enumerate(updates) if np.isinf(update.dt) and not update.accepted]
    assert early
    last = [update for update in updates[: early[0]] if update.accepted][-1]
    assert updates[early[0] + 1].dt == 2 * last.dt
    assert result.converged


def test_single_iterations_reach_a_stationary_minimum_with_the_targets_met() -> None:
    problem = ngspring.cases["C4"].replace(elements=8, l_i=10.0)
    mixed = ngspring.optimize(problem, rule=MixedRule(follow=1e-3), threads=1)
    assert mixed.converged
    targets = [point.q for point in problem.control_points]
    np.testing.assert_allclose(mixed.q, targets, rtol=1e-3)
    single = mixed.history["newton_iterations"][1:-1] == 1
    assert single.mean() > 0.8
    # C falls from update to update, but for what equilibrium is left inexact.
    assert (np.diff(mixed.history["C"]) <= 1e-4 * mixed.history["C"][:-1]).all()
    converged = ngspring.optimize(problem, rule=StepRule(), threads=1)
    assert mixed.history.last()["C"] == pytest.approx(converged.history.last()["C"], rel=0.02)

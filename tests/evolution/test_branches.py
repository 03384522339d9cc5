"""A design counts as converged only if its states lie on the path from rest."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring import ControlPoint, Design, SpringProblem, optimize
from ngspring.evolution.branches import on_another_branch, path_from_rest
from ngspring.evolution.evolve import RETURNS
from ngspring.fem.process import parallel
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem

PROBLEM = SpringProblem((ControlPoint(-10.0, -2.0),), name="small", elements=8, l_i=10.0)


def elsewhere(state: State) -> State:
    """As if the spring carried 5 % of its target more: lam_Ty is w (q - q_*)."""
    lam = state.lam.copy()
    lam[:, -1] += 0.1
    return State(state.chi, state.u, lam)


def test_states_on_the_path_from_rest_stay_and_others_are_replaced() -> None:
    with parallel(1) as threads:
        system = CoupledSystem(PROBLEM, threads=threads)
        state = initial_state(system, Design.column(PROBLEM))
        assert path_from_rest(system, state) is None
        rest = path_from_rest(system, elsewhere(state))
    assert rest is not None
    np.testing.assert_allclose(rest.forces(PROBLEM), state.forces(PROBLEM), rtol=1e-9)
    np.testing.assert_array_equal(rest.chi, state.chi)


def test_equal_forces_do_not_hide_a_path_on_which_the_design_is_not_stationary(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with parallel(1) as threads:
        system = CoupledSystem(PROBLEM, threads=threads)
        state = initial_state(system, Design.column(PROBLEM))
        residuals = {id(state): 1e-9}
        monkeypatch.setattr(
            "ngspring.evolution.branches.relative_optimality",
            lambda _, s: residuals.get(id(s), 0.3),
        )
        assert path_from_rest(system, state) is not None
        residuals = {id(state): 0.3}
        assert path_from_rest(system, state) is None  # no worse than what the run has found


def test_forces_are_compared_on_the_scale_of_the_largest_target() -> None:
    problem = PROBLEM.replace(control_points=(ControlPoint(-10, 0.0), ControlPoint(10, 4.0)))
    q = np.array([0.0, 4.0])
    assert not on_another_branch(problem, q, np.add(q, [0.003, -0.003]))
    assert on_another_branch(problem, q, np.add(q, [0.005, 0.0]))


def test_a_run_that_ends_on_another_branch_goes_on_from_the_path_from_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[State] = []

    def once(system: CoupledSystem, state: State) -> State | None:
        asked.append(state)
        return elsewhere(state) if len(asked) == 1 else path_from_rest(system, state)

    plain = optimize(PROBLEM, threads=1)
    monkeypatch.setattr("ngspring.evolution.evolve.path_from_rest", once)
    result = optimize(PROBLEM, threads=1)
    assert result.converged
    assert len(asked) == 2
    dt = result.history["dt"]
    (back,) = np.flatnonzero(dt[1:] == 0.0) + 1
    assert back == len(plain.history) - 1  # in the place of the row that would have been the last
    assert result.history["q1"][back] == pytest.approx(plain.q[0] + 0.1, rel=1e-6)
    assert dt[-1] == np.inf
    assert result.q == pytest.approx(plain.q, rel=1e-6)


def test_a_run_that_leaves_the_path_again_and_again_is_not_called_converged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "ngspring.evolution.evolve.path_from_rest", lambda system, state: elsewhere(state)
    )
    result = optimize(PROBLEM, threads=1)
    assert not result.converged
    assert result.design.info["converged"] is False
    assert (result.history["dt"][1:] == 0.0).sum() == RETURNS
    assert f"after each of {RETURNS} returns" in result.message
    assert "after each" in str(result.design.info["failed"])

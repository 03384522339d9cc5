"""Newton's method with steps that are cut short: what it takes for a failure."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring.analysis.newton import NewtonError, Step, downhill, newton
from ngspring.basics.arrays import FloatArray


def solve(longest: float, calls: list[FloatArray], acceptable: bool = True) -> FloatArray:
    """The root of u - 1 by steps of which at most a part is free."""

    def evaluate(u: FloatArray) -> FloatArray:
        calls.append(u)
        return u - 1.0

    u, _, _ = newton(
        np.zeros(1),
        np.array([-1.0]),
        evaluate=evaluate,
        direction=lambda u, state: -state,
        acceptable=lambda step: acceptable,
        converged=lambda step: bool(abs(step.after[0]) < 1e-6),
        max_iterations=60,
        smallest=1e-8,
        longest=lambda u, update: longest,
        stuck="no step is any good",
        blocked="no way is free",
    )
    return u


def test_shortened_steps_get_there() -> None:
    np.testing.assert_allclose(solve(0.5, []), [1.0], atol=1e-6)


def test_a_step_that_is_cut_to_nothing_fails_at_once_and_costs_nothing() -> None:
    calls: list[FloatArray] = []
    with pytest.raises(NewtonError, match="no way is free"):
        solve(1e-13, calls)
    assert calls == []


def test_a_step_that_is_free_and_no_good_is_said_to_be_so() -> None:
    with pytest.raises(NewtonError, match="no step is any good"):
        solve(1.0, [], acceptable=False)


def rest_in_a_kink(forces_are_asked: bool) -> float:
    """Where x rests that a spring pulls to 3e-6 out of a kink with slopes of +-1e-5.

    The kink is 1e-8 wide, and what the energy changes in there is rounding beside 35.
    """
    pull, kink, width, rounding = 3e-6, 1e-5, 1e-8, 1e-12 * 35.0

    def evaluate(u: FloatArray) -> tuple[float, float]:
        x = float(u[0])
        bend = x**2 / (2 * width) if abs(x) < width else abs(x) - width / 2
        force = x - pull + kink * float(np.clip(x / width, -1.0, 1.0))
        return 35.0 + (x - pull) ** 2 / 2 + kink * bend, force

    def direction(u: FloatArray, state: tuple[float, float]) -> FloatArray:
        inside = abs(float(u[0])) < width
        return np.array([-state[1] / (1.0 + kink / width * inside)])

    def acceptable(step: Step[tuple[float, float]]) -> bool:
        slopes = [float(step.update[0]) * state[1] for state in (step.before, step.after)]
        energies = step.before[0], step.after[0]
        return downhill(step.length, energies, slopes, rounding, not forces_are_asked)

    begin = np.array([-2e-6])
    u, _, _ = newton(
        begin,
        evaluate(begin),
        evaluate=evaluate,
        direction=direction,
        acceptable=acceptable,
        converged=lambda step: abs(step.after[1]) < 1e-12,
        max_iterations=60,
        smallest=1e-8,
    )
    return float(u[0])


def test_a_minimum_in_a_kink_is_found_where_energies_differ_by_rounding() -> None:
    with pytest.raises(NewtonError, match="no convergence in 60"):
        rest_in_a_kink(forces_are_asked=False)
    assert rest_in_a_kink(forces_are_asked=True) == pytest.approx(3e-9, rel=2e-3)


def test_a_step_that_gains_nothing_of_what_it_promises_is_none() -> None:
    assert downhill(1.0, (1.0, 0.5), (-1.0, 0.1), 0.0)
    assert not downhill(1.0, (1.0, 1.0), (-1.0, -0.9), 0.0)
    assert not downhill(1.0, (1.0, 1.0 + 1e-15), (-1.0, 0.9), 1e-14)
    assert downhill(1.0, (1.0, 1.0 + 1e-15), (-1e-16, 1e-16), 1e-14, balanced=True)

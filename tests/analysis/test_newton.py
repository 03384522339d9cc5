"""Newton's method with steps that are cut short: what it takes for a failure."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring.analysis.newton import NewtonError, newton
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

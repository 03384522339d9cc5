"""A path is the same whatever is asked for, and where it jumps is told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from ngspring.analysis.path import Jump, Steps, departure, follow, stepped
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError

#: Where the branch u^3 - u = d that begins at u = -1 ends.
FOLD = 2 / np.sqrt(27)


@dataclass(frozen=True)
class State:
    d: float
    q: float
    u: FloatArray
    tangent: FloatArray
    stiffness: float
    iterations: int


class Snapping:
    """One unknown with u^3 - u = d, and q = u: stable from u = -1 on until the fold."""

    steps = Steps(
        first=0.1,
        smallest=1e-5,
        largest=0.5,
        resolved=1e-3,
        smooth=0.1,
        lands=False,
        easy=4,
        hard=10,
        growth=2.0,
        remembered=True,
    )
    size = 1.0

    def at_rest(self) -> State:
        return self._state(0.0, -1.0, 0)

    def _state(self, d: float, u: float, iterations: int) -> State:
        slope = 1 / (3 * u**2 - 1)
        return State(d, u, np.array([u]), np.array([slope]), slope, iterations)

    def _newton(self, d: float, u: float) -> State:
        for iteration in range(1, 30):
            change = (u**3 - u - d) / (3 * u**2 - 1)
            u -= change
            if abs(change) < 1e-12:
                return self._state(d, u, iteration)
        raise ConvergenceError("no convergence")

    def advanced(self, here: State, target: float, tried: float) -> tuple[State, float]:
        d = stepped(here.d, target, tried)
        return self._newton(d, float(here.u[0] + (d - here.d) * here.tangent[0])), tried

    def settled(self, here: State, target: float, tried: float) -> State:
        # Downhill from the fold there is only the other branch.
        return self._newton(stepped(here.d, target, tried), 1.5)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 40])
def test_the_path_does_not_depend_on_what_is_asked_for(count: int) -> None:
    targets = np.linspace(0, 0.8, count + 1)[1:]
    jumps: list[Jump] = []
    points, message = follow(Snapping(), targets, on_jump=jumps.append)
    assert message == ""
    assert [point.d for point in points] == targets.tolist()
    for point in points:
        roots = np.roots([1, 0, -1, -point.d])
        real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
        expected = real[0] if point.d < FOLD else real[-1]
        assert point.q == pytest.approx(expected, abs=1e-9)
    (jump,) = jumps
    assert jump.d == pytest.approx(FOLD, abs=2e-3)
    assert jump.q_before == pytest.approx(-1 / np.sqrt(3), abs=0.05)
    assert jump.q_after == pytest.approx(2 / np.sqrt(3), abs=0.01)
    assert str(jump).startswith("snap-through at d = 0.38")


def test_a_kink_is_no_jump_and_a_jump_is_one_however_small_the_step() -> None:
    def at(d: float, q: float, slope: float) -> State:
        return State(d, q, np.array([q]), np.array([slope]), slope, 1)

    for step in (1.0, 1e-3, 1e-6):
        # From slope 1 to slope 10 somewhere in between.
        for part in (0.0, 0.3, 1.0):
            kink = at(step, step * (part + 10 * (1 - part)), 10.0)
            assert departure(at(0.0, 0.0, 1.0), kink) < 0.5
        assert departure(at(0.0, 0.0, 1.0), at(step, step + 5.0, 1.0)) > 1.0


def test_two_displacements_that_differ_by_rounding_are_one_place() -> None:
    def at(d: float, error: float) -> State:
        return State(d, d, np.array([d + error]), np.ones(1), 1.0, 3)

    assert departure(at(-3.9, 0.0), at(-3.9000000000000004, 1e-13)) < Snapping.steps.smooth
    assert departure(at(-3.9, 0.0), at(-3.9000000000000004, 1e-3)) > 1.0

"""Newton's method with steps that are halved until they are acceptable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError

State = TypeVar("State")


#: Of the decrease of the energy that a step promises, the least that it has to keep.
_KEPT = 1e-4
#: Part of the slope before a step from which on the energy rises too steeply behind it.
_UPHILL = 0.5


class NewtonError(ConvergenceError):
    """No step was acceptable, or there were too many."""


class Step(Generic[State]):
    """One Newton step.

    Attributes
    ----------
    update : array
        The full step.
    length : float
        The part of it that is made.
    before, after : State
        What was evaluated at its ends.
    """

    def __init__(self, update: FloatArray, length: float, before: State, after: State) -> None:
        self.update, self.length, self.before, self.after = update, length, before, after

    @property
    def size(self) -> float:
        """Largest change of an unknown."""
        return float(np.abs(self.length * self.update).max(initial=0.0))


def newton(
    u: FloatArray,
    state: State,
    *,
    evaluate: Callable[[FloatArray], State],
    direction: Callable[[FloatArray, State], FloatArray],
    acceptable: Callable[[Step[State]], bool],
    converged: Callable[[Step[State]], bool],
    max_iterations: int,
    smallest: float = 1e-3,
    longest: Callable[[FloatArray, FloatArray], float] | None = None,
    stuck: str = "every Newton step inverts an element",
    blocked: str = "no part of a Newton step may be made",
) -> tuple[FloatArray, State, int]:
    """Unknowns, their state and the iterations it took.

    Parameters
    ----------
    u : array
        The guess.
    state : State
        What `evaluate` gives for it.
    evaluate : callable
        State (forces, energy) of given unknowns.
    direction : callable
        Newton's update for unknowns and their state.
    acceptable : callable
        Whether a step may be made; otherwise it is halved.
    converged : callable
        Whether the step made was the last one; may raise `ConvergenceError`.
    max_iterations : int
    smallest : float
        Steps shorter than this are a failure.
    longest : callable, optional
        The part of an update that is tried first; 1 by default.
    stuck, blocked : str
        What it means that no step is acceptable, and that ``longest`` leaves nothing of one.

    Raises
    ------
    NewtonError
        If no step is acceptable, or there are too many.
    """
    for iteration in range(1, max_iterations + 1):
        update = direction(u, state)
        length = 1.0 if longest is None else longest(u, update)
        if length < smallest:
            raise NewtonError(blocked)
        while True:
            step = Step(update, length, state, evaluate(u + length * update))
            if acceptable(step):
                break
            length /= 2
            if length < smallest:
                raise NewtonError(stuck)
        u, state = u + length * update, step.after
        if converged(step):
            return u, state, iteration
    raise NewtonError(f"no convergence in {max_iterations} Newton iterations")


def downhill(
    length: float,
    energies: Sequence[float],
    slopes: Sequence[float],
    rounding: float,
    balanced: bool = False,
) -> bool:
    """Whether a step of a minimisation leads down.

    Energies that differ by rounding do not tell a step that goes too far from one that does not;
    forces do. Without asking them a point that rests in a flat kink of the energy, as a concave one
    of a surface that it presses on, would be thrown from one side to the other for ever.

    Parameters
    ----------
    length : float
        The part of the update that the step makes.
    energies, slopes : sequences of two floats
        Before and behind the step; slopes along the whole update.
    rounding : float
        Of the energy.
    balanced : bool
        Whether forces behind the step are rounding.
    """
    (before, after), (fall, rise) = energies, slopes
    if after > before + _KEPT * length * fall + rounding:
        return False
    return balanced or after < before - rounding or rise <= _UPHILL * abs(fall)

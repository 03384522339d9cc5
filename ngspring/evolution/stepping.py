"""Design updates: what they have to do, and the paper's, a converged backward Euler step (2.7)."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ngspring.evolution.steprule import Rows, StepRule
from ngspring.kkt.elimination import Elimination
from ngspring.kkt.newton import EXACT, NewtonResult, NewtonSettings, solve_update
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem

#: Newton settings that are never satisfied: `NewtonSettings.max_iterations` decides.
POLISHING = NewtonSettings(0.0, 0.0, 0.0, max_iterations=2)


@dataclass(frozen=True, eq=False)
class Past:
    """Where an evolution stands.

    Attributes
    ----------
    state : State
        The last accepted one.
    previous : State
        The one before.
    rows : Rows
        The history so far.
    rejected : int
        Attempts that were made from ``state`` without success.
    exact : bool
        Whether updates have to be iterated as far as the last one, as that was tried in vain: next
        to where a stationary point has just vanished, Newton's method wanders, and an update that
        is stopped early passes for one without going anywhere.
    searches : int
        How many attempts with a smaller dt have been due since the end failed; 0 if it has not.
    """

    state: State
    previous: State
    rows: Rows
    rejected: int = 0
    exact: bool = False
    searches: int = 0

    def newton(self, settings: NewtonSettings) -> NewtonSettings:
        """How far updates on the way are iterated, if it is so far otherwise."""
        return settings.at_most(EXACT) if self.exact else settings


def polished(system: CoupledSystem, outcome: NewtonResult) -> NewtonResult:
    """The exact stationary point to rounding: two more Newton iterations, if they help."""
    again = solve_update(system, outcome.state, outcome.state.chi, np.inf, POLISHING)
    better = again if again.optimality < outcome.optimality else outcome
    iterations = outcome.iterations + again.iterations
    return dataclasses.replace(better, converged=True, reason="", iterations=iterations)


class Stepper(ABC):
    """A kind of step.

    Attributes
    ----------
    rule : StepRule
        When the transient term is removed (``end``) and when a run is given up (``smallest``).
    """

    rule: StepRule

    @abstractmethod
    def update(self, past: Past, dt: float) -> NewtonResult:
        """A design update over dt (infinite: the final one)."""

    @abstractmethod
    def grown(self, past: Past, dt: float, outcome: NewtonResult) -> float:
        """Next dt after an accepted update, of which ``past`` holds the row already.

        ``past.rejected`` attempts were made before it.
        """

    @abstractmethod
    def shrunk(self, past: Past, dt: float) -> float:
        """Next dt after ``past.rejected`` attempts, the last one with dt."""


class BackwardEuler(Stepper):
    """The paper's updates: each one iterated to convergence (2.7)."""

    def __init__(self, system: CoupledSystem, newton: NewtonSettings, rule: StepRule) -> None:
        self.system = system
        self.newton = newton
        self.rule = rule
        self.elimination = Elimination(system)

    def update(self, past: Past, dt: float) -> NewtonResult:
        """See `Stepper`."""
        return self.solved(past.state, dt, past.newton(self.newton))

    def solved(self, state: State, dt: float, newton: NewtonSettings) -> NewtonResult:
        """A backward Euler step over dt from a state; without transient term to the exact end."""
        last = np.isinf(dt)
        settings = newton.at_most(EXACT) if last else newton
        outcome = solve_update(self.system, state, state.chi, dt, settings, self.elimination)
        return polished(self.system, outcome) if outcome.converged and last else outcome

    def grown(self, past: Past, dt: float, outcome: NewtonResult) -> float:
        """See `Stepper`."""
        return self.rule.grown(dt, outcome.iterations, past.rejected)

    def shrunk(self, past: Past, dt: float) -> float:
        """See `Stepper`."""
        return self.rule.shrunk(dt, past.searches)

"""One design update of the evolution: a converged backward Euler step, or a single iteration."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod

import numpy as np

from ngspring.descent import Descent
from ngspring.elimination import Elimination
from ngspring.kkt import CoupledSystem, State
from ngspring.newton import NewtonResult, NewtonSettings, solve_update
from ngspring.steprule import MixedRule, StepRule, time_unit

#: Newton settings that are never satisfied: `NewtonSettings.max_iterations` decides.
POLISHING = NewtonSettings(0.0, 0.0, 0.0, max_iterations=2)


class Stepper(ABC):
    """A kind of step.

    Attributes
    ----------
    rule : StepRule
        When the transient term is removed (``end``) and when a run is given up (``smallest``).
    """

    rule: StepRule

    @abstractmethod
    def update(self, state: State, dt: float, rejected: int, before: int) -> NewtonResult:
        """A design update over dt (infinite: the final one) from an accepted state.

        ``rejected`` attempts were made from it; ``before`` iterations led to it.
        """

    @abstractmethod
    def grown(self, dt: float, outcome: NewtonResult, rejected: int, calm: int) -> float:
        """Next dt after an update that was accepted after so many rejected attempts.

        ``calm`` counts the updates in a row, this one included, without any.
        """

    @abstractmethod
    def shrunk(self, dt: float, rejected: int) -> float:
        """Next dt after so many rejected attempts, the last one with dt."""


class BackwardEuler(Stepper):
    """The paper's updates: each one iterated to convergence (2.7)."""

    def __init__(self, system: CoupledSystem, newton: NewtonSettings, rule: StepRule) -> None:
        self.system = system
        self.newton = newton
        self.rule = rule
        self._elimination = Elimination(system)

    def update(self, state: State, dt: float, rejected: int, before: int) -> NewtonResult:
        """See `Stepper`."""
        outcome = solve_update(self.system, state, state.chi, dt, self.newton, self._elimination)
        return self._polished(outcome) if outcome.converged and np.isinf(dt) else outcome

    def _polished(self, outcome: NewtonResult) -> NewtonResult:
        """The exact stationary point to rounding: two more Newton iterations, if they help."""
        again = solve_update(self.system, outcome.state, outcome.state.chi, np.inf, POLISHING)
        better = again if again.optimality < outcome.optimality else outcome
        iterations = outcome.iterations + again.iterations
        return dataclasses.replace(better, converged=True, reason="", iterations=iterations)

    def grown(self, dt: float, outcome: NewtonResult, rejected: int, calm: int) -> float:
        """See `Stepper`."""
        return self.rule.grown(dt, outcome.iterations, rejected)

    def shrunk(self, dt: float, rejected: int) -> float:
        """See `Stepper`."""
        return dt / self.rule.shrink


class Mixed(Stepper):
    """Converged updates and single iterations (`MixedRule`)."""

    def __init__(self, system: CoupledSystem, newton: NewtonSettings, rule: MixedRule) -> None:
        self.rule = rule.converged
        self._mixed = rule
        self._euler = BackwardEuler(system, newton, rule.converged)
        self._descent = Descent(system)
        self._minimum = system.eigenvalues_of_a_minimum
        self._follow = rule.follow * time_unit(system.problem)
        #: Of the last attempt, None after one that was iterated to convergence.
        self._ratio: float | None = None
        self._beyond = False

    def update(self, state: State, dt: float, rejected: int, before: int) -> NewtonResult:
        """See `Stepper`."""
        self._ratio = None
        if np.isinf(dt):
            outcome = self._euler.update(state, dt, rejected, before)
            negative = outcome.negative_eigenvalues
            if outcome.converged and negative not in (None, self._minimum):
                reason = "the stationary point is not a minimum of C"
                outcome = dataclasses.replace(outcome, converged=False, reason=reason)
            return outcome
        # Attempts by turns, see `MixedRule`.
        self._beyond = dt > self._follow
        third, second = rejected % 3 == 2, (rejected % 2 == 1) == (before == 1)
        if (self._beyond and third) or (not self._beyond and second):
            return self._euler.update(state, dt, rejected, before)
        step = self._descent.step(
            state, dt, self._mixed.least if self._beyond else self._mixed.good[0]
        )
        self._ratio = step.ratio
        return NewtonResult(step.state, step.accepted, 1, step.reason, None, step.optimality)

    def grown(self, dt: float, outcome: NewtonResult, rejected: int, calm: int) -> float:
        """See `Stepper`."""
        if self._ratio is None:
            return self._euler.grown(dt, outcome, rejected, calm)
        return self._mixed.grown(dt, self._ratio, outcome.optimality, calm)

    def shrunk(self, dt: float, rejected: int) -> float:
        """See `Stepper`."""
        again = rejected % 3 == 2 if self._beyond else rejected % 2 == 1
        return dt if again else dt / self.rule.shrink


def make_stepper(
    system: CoupledSystem, newton: NewtonSettings, rule: StepRule | MixedRule
) -> Stepper:
    """The kind of step that a rule is for."""
    if isinstance(rule, StepRule):
        return BackwardEuler(system, newton, rule)
    return Mixed(system, newton, rule)

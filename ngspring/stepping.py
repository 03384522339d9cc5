"""One design update of the evolution: a converged backward Euler step, or a single iteration."""

from __future__ import annotations

import dataclasses

import numpy as np

from ngspring.backward_euler import BackwardEuler, Past, Stepper
from ngspring.descent import Descent
from ngspring.kkt import CoupledSystem
from ngspring.leaps import Leaping
from ngspring.newton import NewtonResult, NewtonSettings
from ngspring.steprule import LeapRule, MixedRule, StepRule, time_unit

Rule = StepRule | LeapRule | MixedRule


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

    def update(self, past: Past, dt: float) -> NewtonResult:
        """See `Stepper`."""
        self._ratio = None
        if np.isinf(dt):
            outcome = self._euler.update(past, dt)
            negative = outcome.negative_eigenvalues
            if outcome.converged and negative not in (None, self._minimum):
                reason = "the stationary point is not a minimum of C"
                outcome = dataclasses.replace(outcome, converged=False, reason=reason)
            return outcome
        # Attempts by turns, see `MixedRule`.
        self._beyond = dt > self._follow
        third = past.rejected % 3 == 2
        second = (past.rejected % 2 == 1) == (past.iterations == 1)
        if (self._beyond and third) or (not self._beyond and second):
            return self._euler.update(past, dt)
        step = self._descent.step(
            past.state, dt, self._mixed.least if self._beyond else self._mixed.good[0]
        )
        self._ratio = step.ratio
        return NewtonResult(step.state, step.accepted, 1, step.reason, None, step.optimality)

    def grown(self, past: Past, dt: float, outcome: NewtonResult) -> float:
        """See `Stepper`."""
        if self._ratio is None:
            return self._euler.grown(past, dt, outcome)
        return self._mixed.grown(dt, self._ratio, outcome.optimality, past.calm)

    def shrunk(self, past: Past, dt: float) -> float:
        """See `Stepper`."""
        again = past.rejected % 3 == 2 if self._beyond else past.rejected % 2 == 1
        return dt if again else dt / self.rule.shrink


def make_stepper(system: CoupledSystem, newton: NewtonSettings, rule: Rule) -> Stepper:
    """The kind of step that a rule is for."""
    if isinstance(rule, StepRule):
        return BackwardEuler(system, newton, rule)
    if isinstance(rule, LeapRule):
        return Leaping(system, newton, rule)
    return Mixed(system, newton, rule)

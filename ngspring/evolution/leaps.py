"""Leaps along the flow of the design, where the pseudo-time step does not grow any more (2.7).

Near the optimum of a spring with contact the flow is stiff: creases and pieces of void settle fast,
while the walls still drift for thousands of times as long. Backward Euler damps what is fast, but
where the creases snap on the way its Newton iteration does not converge over the large dt that the
drift would allow. Projective integration (Gear and Kevrekidis, SIAM J. Sci. Comput. 24, 2003)
takes the two apart: a converged update shows the drift, then the design is moved on by a multiple
of it, explicitly, and the next converged update from there damps what the leap has stirred up. A
leap is kept if C is lower after it. The stationary point, where nothing drifts, is the same.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ngspring.basics.errors import ConvergenceError
from ngspring.evolution.stepping import BackwardEuler, Past, Stepper
from ngspring.evolution.steprule import LeapRule, Rule
from ngspring.kkt.newton import NewtonResult, NewtonSettings
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem


class Leaping(Stepper):
    """Converged updates, with leaps between them where dt is held back (`LeapRule`)."""

    def __init__(self, system: CoupledSystem, newton: NewtonSettings, rule: LeapRule) -> None:
        self.system = system
        self.rule = rule.converged
        self._leaps = rule
        self._euler = BackwardEuler(system, newton, rule.converged)
        self._newton = dataclasses.replace(newton, max_iterations=rule.iterations)
        #: Length of the leap that was tried in this update, in pseudo-time.
        self._tried = 0.0

    def update(self, past: Past, dt: float) -> NewtonResult:
        """See `Stepper`."""
        if past.rejected == 0:
            factor = 0.0 if np.isinf(dt) else self._leaps.factor(past.rows)
            self._tried = factor * dt if factor else 0.0
            if factor:
                return self._leapt(past, dt, factor)
        outcome = self._euler.update(past, dt)
        return dataclasses.replace(outcome, leap=-self._tried if self._tried else 0.0)

    def _leapt(self, past: Past, dt: float, factor: float) -> NewtonResult:
        state, previous = past.state, past.previous
        factor *= dt / past.rows[-1].dt
        ahead = State(
            state.chi + factor * (state.chi - previous.chi),
            state.u + factor * (state.u - previous.u),
            state.lam,
        )
        try:
            ahead = self._euler.elimination.relax(state, ahead)
        except ConvergenceError as error:
            return NewtonResult(state, False, 0, f"a leap too far: {error}", None, np.inf)
        outcome = self._euler.solved(ahead, dt, past.newton(self._newton))
        if not outcome.converged:
            return dataclasses.replace(outcome, reason=f"a leap too far: {outcome.reason}")
        rise = self.system.terms(outcome.state)["C"] - past.rows[-1].C
        if not rise < 0:
            reason = f"a leap too far: C rises by {rise:.1e}"
            return dataclasses.replace(outcome, converged=False, reason=reason)
        return dataclasses.replace(outcome, leap=self._tried)

    def grown(self, past: Past, dt: float, outcome: NewtonResult) -> float:
        """See `Stepper`."""
        if outcome.leap > 0.0:
            far = outcome.leap / dt * self._leaps.growth > self._leaps.largest
            return dt * self.rule.growth if far else dt
        grown = self.rule.grown(dt, outcome.iterations, past.rows[-1].failed)
        return self._leaps.held(past.rows, dt, grown)

    def shrunk(self, past: Past, dt: float) -> float:
        """See `Stepper`."""
        leap = past.rejected == 1 and self._tried > 0.0
        return dt if leap else self.rule.shrunk(dt, past.searches)


def make_stepper(system: CoupledSystem, newton: NewtonSettings, rule: Rule) -> Stepper:
    """The kind of step that a rule is for."""
    if isinstance(rule, LeapRule):
        return Leaping(system, newton, rule)
    return BackwardEuler(system, newton, rule)

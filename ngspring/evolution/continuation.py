"""Continuation: the stationary point of a system while its control points move.

A stationary point of C* depends on the targets. When these move a little, so does it: Newton's
method without transient term, from a guess extrapolated over the last points, finds the next one in
a few iterations. That goes on until the branch of stationary points folds back (it is no minimum of
C any more, or there is none nearby).
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import barycentric_interpolate

from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.evolution.branches import on_same_branch
from ngspring.evolution.stepping import polished
from ngspring.kkt.elimination import Elimination
from ngspring.kkt.newton import EXACT, NewtonResult, solve_update
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)

#: The control points at a share of the way.
Way = Callable[[float], Sequence[ControlPoint]]


@dataclass(frozen=True)
class FollowSteps:
    """How far the targets move between two stationary points, as shares of the whole way.

    Parameters
    ----------
    first, smallest, largest : float
        Below the smallest step the branch is taken to have ended.
    few, many : int
        After fewer iterations the next step is longer; more are a failed step.
    growth, shrink : float
        By which factors.
    points : int
        Points of the way that the guess is extrapolated over.
    dt : float
        First dt of the evolution beyond a fold, in units of `time_unit`.
    """

    first: float = 0.1
    smallest: float = 0.01
    largest: float = 0.5
    few: int = 5
    many: int = 8
    growth: float = 1.5
    shrink: float = 3.0
    points: int = 3
    dt: float = 1e6


def moved_points(
    start: SpringProblem, goal: SpringProblem, share: float
) -> tuple[ControlPoint, ...]:
    """Control points on the straight way from one problem's to another's, pair by pair.

    Raises
    ------
    ProblemError
        If there is no such way: the problems differ in more than their control points, or have
        different numbers of them.
    """
    pairs = list(zip(start.control_points, goal.control_points, strict=False))
    count, wanted = len(start.control_points), len(goal.control_points)
    if count != wanted:
        raise ProblemError(f"{count} control points cannot become {wanted}: as many are needed")
    for field in dataclasses.fields(start):
        here, there = (getattr(problem, field.name) for problem in (start, goal))
        if field.name not in ("name", "control_points") and here != there:
            raise ProblemError(
                f"{field.name} = {shown(there)} instead of {shown(here)}: only control points can"
                " move, all else must be as in the design"
            )
    for here, there in pairs:
        if here.d * there.d <= 0:
            raise ProblemError(
                f"a control point cannot move from d = {here.d:g} to {there.d:g} mm, through 0"
            )
        if (here.eta_odd or there.eta_odd) and here.odd_in != there.odd_in:
            raise ProblemError(
                f"an imperfection in {there.odd_in} instead of {here.odd_in} cannot be followed to"
            )

    def between(a: ControlPoint, b: ControlPoint, name: str) -> float:
        return float((1 - share) * getattr(a, name) + share * getattr(b, name))

    def moved(a: ControlPoint, b: ControlPoint) -> ControlPoint:
        end = b if share else a
        plain = share in (0.0, 1.0) or a.aim == b.aim
        changes: dict[str, Any] = {
            name: between(a, b, name) for name in ("d", "q", "weight", "eta", "eta_odd")
        }
        changes["aim"] = end.aim if plain else between(a, b, "q_star")
        return dataclasses.replace(end, **changes)

    return tuple(moved(a, b) for a, b in pairs)


class Continuation:
    """The stationary point of a system on the way from one set of control points to another.

    Parameters
    ----------
    system : CoupledSystem
        Is given the control points of the way, see `CoupledSystem.retarget`.
    way : function
        From a share of the way, 0 to 1, to the control points there.
    state : State
        The stationary point at the beginning.
    steps : FollowSteps

    Attributes
    ----------
    share : float
        How much of the way lies behind.
    state : State
        The stationary point there.
    folded : bool
        Whether the branch has ended here.
    rejected, rejected_iterations : int
        Attempts since the last stationary point, and their Newton iterations.
    iterations : int
        Newton iterations of all steps.
    """

    def __init__(self, system: CoupledSystem, way: Way, state: State, steps: FollowSteps) -> None:
        self._system, self._way, self._steps = system, way, steps
        self._elimination = Elimination(system)
        self._newton = dataclasses.replace(EXACT, max_iterations=steps.many)
        self.iterations = 0
        self.begin(state, 0.0)

    def begin(self, state: State, share: float) -> None:
        """Go on from the stationary point at a share of the way, whatever was before."""
        self.share, self.state, self.folded = share, state, False
        self._known = [(share, state)]
        self._step = self._steps.first
        self.rejected = self.rejected_iterations = 0

    def settled(self) -> NewtonResult:
        """The stationary point where the way stands, iterated to rounding if there is one."""
        outcome = self._solved(self.state, self.share)
        return polished(self._system, outcome) if outcome.converged else outcome

    def advance(self, end: float) -> NewtonResult:
        """One step towards a share of the way; where it fails the next one is shorter."""
        steps = self._steps
        ahead = min(end, self.share + self._step)
        # What would be left is no step of its own.
        ahead = end if end - ahead < steps.smallest else ahead
        outcome = self._solved(self._guess(ahead), ahead)
        if outcome.converged and ahead == end:
            outcome = polished(self._system, outcome)
        outcome = on_same_branch(self._system, self.state, outcome)
        self.iterations += outcome.iterations
        if outcome.converged:
            self._accept(outcome, ahead)
        else:
            self._reject(outcome, ahead)
        return outcome

    def _accept(self, outcome: NewtonResult, ahead: float) -> None:
        easy = outcome.iterations < self._steps.few
        grown = max(ahead - self.share, self._step) * (self._steps.growth if easy else 1.0)
        self._step = min(grown, self._steps.largest)
        self.share, self.state = ahead, outcome.state
        self._known = [*self._known[-self._steps.points :], (ahead, outcome.state)]
        self.rejected = self.rejected_iterations = 0

    def _reject(self, outcome: NewtonResult, ahead: float) -> None:
        self.rejected += 1
        self.rejected_iterations += outcome.iterations
        self._step = (ahead - self.share) / self._steps.shrink
        self.folded = self._step < self._steps.smallest
        logger.info("the step to %.3f of the way fails: %s", ahead, outcome.reason)
        if self.folded:
            logger.info("the branch of stationary points ends at %.3f of the way", self.share)

    def _solved(self, guess: State, share: float) -> NewtonResult:
        self._system.retarget(self._way(share))
        return solve_update(self._system, guess, guess.chi, np.inf, self._newton, self._elimination)

    def _guess(self, share: float) -> State:
        """The state extrapolated over the last points of the way."""
        shares, states = zip(*self._known[-self._steps.points :], strict=True)
        if len(shares) == 1:
            return self.state
        parts = []
        for name in ("chi", "u", "lam"):
            values = np.array([getattr(state, name) for state in states])
            parts.append(np.asarray(barycentric_interpolate(shares, values, share)))
        return State(*parts)

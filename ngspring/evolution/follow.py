"""From one stationary design to its neighbour: the stationary point followed while targets move.

A finished design is a stationary point of C* for its targets. When these move a little, so does it:
Newton's method without transient term, from a guess extrapolated over the last points, finds the
next one in a few iterations. That goes on until the branch of stationary points folds back (it is
no minimum of C any more, or there is none nearby); from there the evolution takes over, with dt
that begins large.
"""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import barycentric_interpolate

from ngspring.basics.checks import shown
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.design.design import Design
from ngspring.design.history import History, Row
from ngspring.evolution.branches import on_same_branch, path_from_rest
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.evolve import evolve
from ngspring.evolution.ladder import NO_LADDER
from ngspring.evolution.rows import row_of
from ngspring.evolution.stepping import polished
from ngspring.evolution.updates import Observer, Result, Update
from ngspring.fem.process import parallel
from ngspring.kkt.elimination import Elimination
from ngspring.kkt.newton import EXACT, NewtonResult, solve_update
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.stationarity import grey_shares
from ngspring.kkt.system import CoupledSystem
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)


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


@dataclass(frozen=True, eq=False)
class Reached:
    """A design on the way.

    Attributes
    ----------
    share : float
        Of the way.
    design : Design
    evolved : bool
        Whether the branch of the design before had ended, and the evolution was needed.
    message : str
        Why the evolution failed, or nothing.
    """

    share: float
    design: Design
    evolved: bool
    message: str = ""


class Following:
    """The stationary point of a design while its targets move; made once for a whole way.

    Attributes
    ----------
    share : float
        How much of the way lies behind.
    state : State
        The stationary point there.
    rows : list of Row
        One for each stationary point so far.
    folded : bool
        Whether the branch has ended here.
    """

    state: State

    def __init__(
        self, design: Design, goal: SpringProblem, steps: FollowSteps, solver: str, threads: int
    ) -> None:
        self._start, self._goal, self._steps = design.problem, goal, steps
        moved_points(design.problem, goal, 0.0)
        self._clock = time.perf_counter()
        self._solver, self._threads = solver, threads
        self._system = CoupledSystem(design.problem, solver, threads)
        self._elimination = Elimination(self._system)
        self._newton = dataclasses.replace(EXACT, max_iterations=steps.many)
        self.share, self.folded = 0.0, False
        self._known: list[tuple[float, State]] = []
        self.rows: list[Row] = []
        self._step = steps.first
        self._rejected = self._rejected_iterations = 0
        state = initial_state(self._system, design)
        outcome = self._solved(state, 0.0)
        if not outcome.converged:
            raise ProblemError(
                f"{design.problem.name or 'the design'} is no stationary point to follow"
                f" ({outcome.reason}): finish it first"
            )
        self._accept(polished(self._system, outcome), 0.0)

    @property
    def problem(self) -> SpringProblem:
        """The problem whose stationary point `state` is."""
        name = self._goal.name if self.share == 1.0 else self._start.name
        points = moved_points(self._start, self._goal, self.share)
        return self._start.replace(control_points=points, name=name)

    @property
    def design(self) -> Design:
        """The stationary design here."""
        info = {
            "start": f"followed from {self._start.name or 'a design'}",
            "q": [float(q) for q in self.state.forces(self.problem)],
            "converged": self.rows[-1].is_end,
            "grey": list(grey_shares(self._system, self.state)),
        }
        chi = self.state.chi.reshape(self.problem.coefficient_shape)
        return Design(self.problem, chi, self.history, info)

    @property
    def history(self) -> History:
        """A row for every stationary point so far, and those of the evolution."""
        return History.from_rows(self.rows)

    def reach(self, share: float, observers: Sequence[Observer] = ()) -> Reached:
        """Go on to a share of the way: follow the branch, and evolve where it ends."""
        for row in self.towards(share):
            if observers:  # A design with its notes takes a while.
                update = Update(True, row, row.dt, "", self.design)
                for observer in observers:
                    observer(update)
        if self.share == share and not self._leaves_path_from_rest():
            return Reached(share, self.design, evolved=False)
        message = self.evolve(share, observers)
        return Reached(share, self.design, evolved=True, message=message)

    def _leaves_path_from_rest(self) -> bool:
        """Whether the spring, loaded from rest, takes other states, which are taken up then."""
        try:
            rest = path_from_rest(self._system, self.state)
        except ConvergenceError:
            return True
        self.state = self.state if rest is None else rest
        return rest is not None

    def towards(self, share: float) -> Iterator[Row]:
        """Go on to a share of the way, or until the branch ends; a row for every point."""
        while self.share < share and not self.folded:
            ahead = min(share, self.share + self._step)
            # What would be left is no step of its own.
            ahead = share if share - ahead < self._steps.smallest else ahead
            outcome = self._solved(self._guess(ahead), ahead)
            if outcome.converged and ahead == share:
                outcome = polished(self._system, outcome)
            outcome = on_same_branch(self._system, self.state, outcome)
            if outcome.converged:
                tried = ahead - self.share
                self._accept(outcome, ahead)
                easy = outcome.iterations < self._steps.few
                grown = max(tried, self._step) * (self._steps.growth if easy else 1.0)
                self._step = min(grown, self._steps.largest)
                yield self.rows[-1]
                continue
            self._rejected += 1
            self._rejected_iterations += outcome.iterations
            self._step = (ahead - self.share) / self._steps.shrink
            self.folded = self._step < self._steps.smallest
        if self.folded:
            logger.info("the branch of stationary points ends at %.3f of the way", self.share)

    def evolve(self, share: float, observers: Sequence[Observer] = ()) -> str:
        """Go on to a share of the way by the evolution; why it failed, or nothing."""
        self.share = share
        problem = self.problem
        self._system.retarget(problem.control_points)
        self.rows.append(self._row(0.0, 0))
        dt = self._steps.dt * time_unit(problem)
        checkpoint = Checkpoint(problem, self.state, self.state, 0.0, dt, self.history, "followed")
        evolution = evolve(
            problem,
            resume_from=checkpoint,
            solver=self._solver,
            threads=self._threads,
            ladder=NO_LADDER,
        )
        for update in evolution:
            for observer in observers:
                observer(update)
        self.rows = evolution.history.rows()
        self.state = evolution.checkpoint.state
        self._known = [(share, self.state)]
        self._step, self.folded = self._steps.first, False
        self._rejected = self._rejected_iterations = 0
        return evolution.message

    def _solved(self, guess: State, share: float) -> NewtonResult:
        self._system.retarget(moved_points(self._start, self._goal, share))
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

    def _accept(self, outcome: NewtonResult, share: float) -> None:
        self.share, self.state = share, outcome.state
        self._known = [*self._known[-self._steps.points :], (share, outcome.state)]
        self.rows.append(self._row(np.inf, outcome.iterations))
        self._rejected = self._rejected_iterations = 0

    def _row(self, dt: float, iterations: int) -> Row:
        effort = {
            "update": len(self.rows),
            "dt": dt,
            "newton_iterations": iterations,
            "rejected": self._rejected,
            "rejected_iterations": self._rejected_iterations,
            "seconds": time.perf_counter() - self._clock,
        }
        return row_of(self._system, self.state, effort)


def follow(
    design: Design,
    problem: SpringProblem,
    *,
    observers: Sequence[Observer] = (),
    steps: FollowSteps | None = None,
    threads: int | None = None,
    solver: str = "auto",
) -> Result:
    """The design for other control points, from a finished one: seconds instead of minutes.

    The stationary point is followed while the control points move in straight lines from the
    design's own to those of ``problem``. Where its branch ends, the evolution goes on from there.

    Parameters
    ----------
    design : Design
        A stationary one, as `ngspring.optimize` ends with.
    problem : SpringProblem
        The design's own with other control points, as many: other d, q, weights or eta.
    observers : sequence of callables
        Called with an `Update` after every step.
    steps : FollowSteps, optional
    threads, solver
        See `ngspring.optimize`.

    Returns
    -------
    Result
        Its history has a row with ``dt = inf`` for every stationary point on the way, and those of
        the evolution, if it was needed.

    Raises
    ------
    ProblemError
        If the problems differ in more than their control points, or the design is not stationary.
    ConvergenceError
        If the load paths of the design cannot be followed to its control points.

    Examples
    --------
    >>> design = ngspring.gallery["C4"]  # doctest: +SKIP
    >>> points = [ngspring.ControlPoint(p.d, 1.1 * p.q) for p in design.problem.control_points]
    ... # doctest: +SKIP
    >>> stiffer = design.problem.replace(control_points=points)  # doctest: +SKIP
    >>> ngspring.follow(design, stiffer).design.save("stiffer.npz")  # doctest: +SKIP
    """
    with parallel(threads, problem) as count:
        following = Following(design, problem, steps or FollowSteps(), solver, count)
        reached = following.reach(1.0, observers)
    done = reached.design
    q, converged = np.array(done.info["q"]), bool(done.info["converged"])
    return Result(done, following.history, q, converged, reached.message)

"""From one stationary design to its neighbour: the stationary point followed while targets move.

A finished design is a stationary point of C* for its targets, which is followed
(`ngspring.evolution.continuation`) until its branch folds back; from there the evolution takes
over, with dt that begins large.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.design.design import Design
from ngspring.design.history import History, Row
from ngspring.evolution.branches import path_from_rest
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.continuation import Continuation, FollowSteps, moved_points
from ngspring.evolution.evolve import evolve
from ngspring.evolution.ladder import NO_LADDER
from ngspring.evolution.rows import row_of
from ngspring.evolution.updates import Observer, Result, Update
from ngspring.fem.process import parallel
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.stationarity import grey_shares
from ngspring.kkt.system import CoupledSystem
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem


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
    state : State
        The stationary point reached so far.
    rows : list of Row
        One for each stationary point so far.
    """

    def __init__(
        self, design: Design, goal: SpringProblem, steps: FollowSteps, solver: str, threads: int
    ) -> None:
        self._start, self._goal, self._steps = design.problem, goal, steps
        moved_points(design.problem, goal, 0.0)
        self._clock = time.perf_counter()
        self._solver, self._threads = solver, threads
        self._system = CoupledSystem(design.problem, solver, threads)
        self.rows: list[Row] = []
        state = initial_state(self._system, design)
        self._branch = Continuation(self._system, self._way, state, steps)
        outcome = self._branch.settled()
        if not outcome.converged:
            raise ProblemError(
                f"{design.problem.name or 'the design'} is no stationary point to follow"
                f" ({outcome.reason}): finish it first"
            )
        self._branch.begin(outcome.state, 0.0)
        self.rows.append(self._row(np.inf, outcome.iterations))

    def _way(self, share: float) -> tuple[ControlPoint, ...]:
        return moved_points(self._start, self._goal, share)

    @property
    def state(self) -> State:
        """The stationary point reached so far."""
        return self._branch.state

    @property
    def problem(self) -> SpringProblem:
        """The problem whose stationary point `state` is."""
        share = self._branch.share
        name = self._goal.name if share == 1.0 else self._start.name
        return self._start.replace(control_points=self._way(share), name=name)

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
        if self._branch.share == share and not self._leaves_path_from_rest():
            return Reached(share, self.design, evolved=False)
        message = self.evolve(share, observers)
        return Reached(share, self.design, evolved=True, message=message)

    def _leaves_path_from_rest(self) -> bool:
        """Whether the spring, loaded from rest, takes other states, which are taken up then."""
        try:
            rest = path_from_rest(self._system, self.state)
        except ConvergenceError:
            return True
        if rest is not None:
            self._branch.begin(rest, self._branch.share)
        return rest is not None

    def towards(self, share: float) -> Iterator[Row]:
        """Go on to a share of the way, or until the branch ends; a row for every point."""
        branch = self._branch
        while branch.share < share and not branch.folded:
            rejected, in_vain = branch.rejected, branch.rejected_iterations
            outcome = branch.advance(share)
            if outcome.converged:
                self.rows.append(self._row(np.inf, outcome.iterations, rejected, in_vain))
                yield self.rows[-1]

    def evolve(self, share: float, observers: Sequence[Observer] = ()) -> str:
        """Go on to a share of the way by the evolution; why it failed, or nothing."""
        self._branch.begin(self.state, share)
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
        self._branch.begin(evolution.checkpoint.state, share)
        return evolution.message

    def _row(self, dt: float, iterations: int, rejected: int = 0, in_vain: int = 0) -> Row:
        effort = {
            "update": len(self.rows),
            "dt": dt,
            "newton_iterations": iterations,
            "rejected": rejected,
            "rejected_iterations": in_vain,
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

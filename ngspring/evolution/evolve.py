"""The evolution of a design as a loop that belongs to the caller (2.4, 2.7).

Each design update solves the coupled system by backward Euler over dt
(`ngspring.evolution.stepping`). After an easy update the next dt is larger, a failed one is
repeated with a smaller dt; where dt does not grow any more, the design leaps along its drift
between two updates (`ngspring.evolution.leaps`). Coarse meshes come first
(`ngspring.evolution.ladder`). In the end the transient term is removed and a last update gives the
exact saddle point. Nothing is written here: see `ngspring.optimize`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import logging
import time
from collections.abc import Iterator, Sequence

import ngsolve as ng
import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import positive_number
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.design.corrections import (
    CORRECTIONS,
    MISSED,
    Correction,
    best_of,
    corrections_of,
    with_aims,
)
from ngspring.design.design import Design
from ngspring.design.history import History, Row, stages
from ngspring.evolution.branches import on_same_branch, path_from_rest
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.climb import carried
from ngspring.evolution.continuation import Continuation, FollowSteps, moved_points
from ngspring.evolution.ladder import Ladder
from ngspring.evolution.leaps import make_stepper
from ngspring.evolution.rows import row_of
from ngspring.evolution.stepping import Past, Stepper
from ngspring.evolution.steprule import LeapRule, Rule
from ngspring.evolution.updates import Result, Update
from ngspring.fem.process import checked_threads, parallel
from ngspring.kkt.newton import NewtonResult, NewtonSettings
from ngspring.kkt.start import Start, initial_state, start_design, state_near
from ngspring.kkt.state import State
from ngspring.kkt.stationarity import grey_shares
from ngspring.kkt.system import CoupledSystem
from ngspring.kkt.timings import Timings
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)

#: Returns to the path from rest before a run gives up, and dt after each (times `time_unit`).
RETURNS, DT_RETURN = 3, 1e4
#: How a stationary point is followed to corrected targets: mostly it is no step too far.
AT_ONCE = FollowSteps(first=1.0, largest=1.0)


class Evolution:
    """Design updates, one after the other; made by `evolve`.

    Iterating gives an `Update` for the start and after every accepted or rejected update, until
    the design is stationary or the evolution has failed. A loop may be left and taken up again.

    Attributes
    ----------
    over : bool
        Whether there is nothing more to do.
    message : str
        Why it ended without a stationary design; empty otherwise.
    checkpoint : Checkpoint
        All that is needed to continue from the last accepted update, see `evolve`.
    """

    checkpoint: Checkpoint
    _state: State

    def __init__(
        self,
        problem: SpringProblem,
        start: Start | None,
        dt_initial: float | None,
        start_name: str | None,
        rule: Rule,
        newton: NewtonSettings,
        solver: str,
        threads: int | None,
        ladder: Ladder,
        timings: Timings | None = None,
    ) -> None:
        self.problem = problem
        self.over = False
        self._ladder = ladder
        #: The meshes that are still to come, the present one first.
        self._rungs = ladder.rungs(problem, start)
        self.message = ""
        self._initial, self._dt_initial = start, dt_initial
        self._start = start_name or ("column" if start is None else "given")
        self._rule, self._newton = rule, newton
        self._solver, self._threads, self._timings = solver, threads, timings
        self._unit = time_unit(problem)
        self._system: CoupledSystem | None = None
        self._stepper: Stepper | None = None
        self._branch: Continuation | None = None
        self._rows: list[Row] = []
        self._rejected = self._rejected_iterations = self._searches = 0
        self._given_up = False
        self._ended: dict[str, object] = {}
        self._found: tuple[Correction, ...] = ()
        self._best: FloatArray | None = None
        self._correction = 0
        self._seconds, self._clock = 0.0, time.perf_counter()

    # -- beginning -----------------------------------------------------------------------------

    def continue_from(self, checkpoint: Checkpoint) -> None:
        """Take up what a checkpoint holds.

        Raises
        ------
        ProblemError
            If it is another problem's.
        """
        asked = checkpoint.goal
        if not asked.equals_but_for_name(self.problem):
            raise ProblemError(
                "the checkpoint to resume from belongs to another problem"
                f" ({asked.name or 'no name'}, {asked.elements} elements)"
            )
        here = checkpoint.problem
        above = [rung for rung in self._ladder.rungs(asked) if rung.elements > here.elements]
        self._rungs = (here, *above)
        self._state, self._previous = checkpoint.state, checkpoint.previous
        self._dt, self._dt_previous = checkpoint.dt, checkpoint.dt_previous
        self._rows = checkpoint.history.rows()
        self._start = checkpoint.start
        self._found, self._best = corrections_of(checkpoint.notes), checkpoint.best
        self._correction = self._rows[-1].correction
        self._seconds = self._rows[-1].seconds
        self._forget_attempts()
        self._given_up, self._branch = False, None
        self.checkpoint = checkpoint
        self.over, self.message = self._rows[-1].is_end, ""
        self._ended = {k: v for k, v in checkpoint.notes.items() if k != CORRECTIONS}

    def _set_up(self, threads: int) -> Update:
        """Make the system, and tell where the evolution stands."""
        design = None if self._rows else start_design(self._rungs[0], self._initial)
        self._make_system(threads)
        if design is None:
            if self._state.u.shape[1] != self._standing_on.free:
                raise ProblemError("the checkpoint to resume from belongs to another mesh")
            return self._update(True, self._rows[-1].dt, resumed=True)
        return self._begin(initial_state(self._standing_on, design), self._first_dt)

    def _make_system(self, threads: int) -> None:
        self._system = CoupledSystem(self._rungs[0], self._solver, threads, timings=self._timings)
        self._stepper = make_stepper(self._system, self._newton, self._rule)

    def _begin(self, state: State, dt: float) -> Update:
        """Take a state loaded from rest, with dt for the update to come."""
        self._state = self._previous = state
        self._dt, self._dt_previous = dt, 0.0
        self._forget_attempts()
        self._rows.append(self._row(0.0))
        return self._update(True, 0.0 if len(self._rows) > 1 else dt)

    @property
    def _first_dt(self) -> float:
        return self._unit if self._dt_initial is None else self._dt_initial

    @property
    def _standing_on(self) -> CoupledSystem:
        assert self._system is not None
        return self._system

    # -- meshes --------------------------------------------------------------------------------

    @property
    def _climbs(self) -> bool:
        """Whether the present mesh has done its work, and another one is to come."""
        if len(self._rungs) == 1 or self._stepper is None:
            return False
        return self._given_up or self._dt_previous >= self._ladder.leave * self._unit

    def _climb(self, threads: int) -> Update:
        """Go on from the present design on the next mesh, which decides what becomes of it."""
        design = self.design
        self._rungs, self._given_up = self._rungs[1:], False
        self._make_system(threads)
        start = start_design(self._rungs[0], self._initial)
        state, is_carried = carried(self._standing_on, design, start, self._ladder)
        logger.info("on to %d elements", self._rungs[0].elements)
        return self._begin(state, self._ladder.dt * self._unit if is_carried else self._first_dt)

    # -- corrected targets ---------------------------------------------------------------------

    @property
    def found(self) -> tuple[Correction, ...]:
        """What the solids of the stationary designs so far carry (`ngspring.realise`)."""
        return self._found

    def aim_at(self, aims: Sequence[float]) -> None:
        """Begin with these forces in N asked of the third medium, on the last mesh."""
        self._rungs = (with_aims(self.problem, aims),)

    def carrying(self, solid: Sequence[float]) -> Correction:
        """The present stationary design, whose solid carries these forces (N) by real contact."""
        aims = tuple(point.q_star for point in self._rungs[0].control_points)
        return Correction(self._rows[-1].update, aims, tuple(map(float, solid)))

    def note(self, correction: Correction, missed: str = "") -> Update:
        """Take down what the solid of the stationary design carries, and why that is the end.

        Parameters
        ----------
        correction : Correction
            See `carrying`.
        missed : str
            Why no further correction follows although the targets are missed.
        """
        self._found = (*self._found, correction)
        if best_of(self._found, self.problem.control_points) == len(self._found) - 1:
            self._best = self._state.chi
        self._ended = {k: v for k, v in self._ended.items() if k != MISSED}
        if missed:
            self._ended[MISSED] = missed
        return self._update(True, self._rows[-1].dt)

    def correct(self, aims: Sequence[float]) -> Update:
        """Go on from the stationary design with other forces asked of the third medium.

        The stationary point is followed while the targets move; where its branch ends, the design
        evolves.

        Parameters
        ----------
        aims : sequence of float
            In N, one for each control point.

        Raises
        ------
        ConvergenceError
            If the equilibria of the present design are lost.
        """
        (here,) = self._rungs
        self._rungs = (with_aims(here, aims),)
        with parallel(self._threads, here) as count:
            if self._system is None:
                self._make_system(count)
            self._standing_on.retarget(self._rungs[0].control_points)
            state = state_near(self._standing_on, self._state)
        self._correction, self._branch = self._correction + 1, None
        self.over, self.message, self._ended = False, "", {}
        update = self._begin(state, np.inf)
        # What a failed try goes on with, see `_reject`.
        self._dt_previous = self._ladder.dt * self._unit / 2
        self.checkpoint = self._standing()
        return dataclasses.replace(update, checkpoint=self.checkpoint)

    # -- loop ----------------------------------------------------------------------------------

    def __iter__(self) -> Iterator[Update]:
        # Why an earlier loop was left is of no importance to one that goes on.
        if not self.over:
            self.message, self._ended = "", {}
        self._clock = time.perf_counter()
        while not self.over:
            # How many threads pay is another question on every mesh.
            with parallel(self._threads, self._rungs[self._climbs]) as count:
                yield from self._on_a_mesh(count)

    def _on_a_mesh(self, threads: int) -> Iterator[Update]:
        """Updates until the next mesh is due, or the end."""
        if self._stepper is None:
            yield self._set_up(threads)
        elif self._climbs:
            yield self._climb(threads)
        while not self.over and not self._climbs:
            update = self._advance(self._stepper)
            if update is not None:
                yield update

    def _advance(self, stepper: Stepper | None) -> Update | None:
        """One design update, tried once; None if the evolution has failed without one."""
        assert stepper is not None
        end = stepper.rule.end * self._unit
        dt = np.inf if self._dt > end else self._dt
        first = np.isinf(dt) and len(self._on_this_stage()) == 1
        if first and self._found and self._correction:
            return self._follow(stepper, end)
        outcome = stepper.update(self._past(), dt)
        if first:
            outcome = on_same_branch(self._standing_on, self._state, outcome)
        return self._judge(stepper, outcome, dt, end)

    def _follow(self, stepper: Stepper, end: float) -> Update | None:
        """One step of the stationary point from the targets before to the corrected ones."""
        system, (here,) = self._standing_on, self._rungs
        if self._branch is None:
            before = with_aims(here, self._found[-1].aims)
            system.retarget(before.control_points)
            state = state_near(system, self._state)
            way = functools.partial(moved_points, before, here)
            self._branch = Continuation(system, way, state, AT_ONCE)
        branch = self._branch
        outcome = branch.advance(1.0)
        if branch.share < 1.0 and not branch.folded:
            update = self._update(False, np.inf, outcome.reason)
            return dataclasses.replace(update, followed=branch.share)
        system.retarget(here.control_points)
        if branch.folded and branch.share > 0.0:
            # The end of the branch is nearer than where it began.
            with contextlib.suppress(ConvergenceError):
                self._state = self._previous = state_near(system, branch.state)
        self._branch = None
        outcome = dataclasses.replace(outcome, iterations=branch.iterations)
        return self._judge(stepper, outcome, np.inf, end)

    def _judge(
        self, stepper: Stepper, outcome: NewtonResult, dt: float, end: float
    ) -> Update | None:
        """What has become of an update; None if the evolution has failed without one."""
        if not outcome.converged:
            return self._reject(stepper, outcome, dt, end)
        if np.isinf(dt):
            try:
                rest = self._on_path_from_rest(outcome.state)
            except ConvergenceError as error:
                self._fail(f"this design does not follow its path from rest: {error}")
                return None
            if rest is not None:
                return self._return_to(rest)
        return self._accept(stepper, outcome, dt)

    def _accept(self, stepper: Stepper, outcome: NewtonResult, dt: float) -> Update:
        self._previous, self._dt_previous = self._state, dt
        self._state = outcome.state
        self._rows.append(self._row(dt, outcome))
        rest = stepper.rule.at_rest(dt / self._unit, outcome.iterations, self._rejected)
        self._dt = np.inf if rest else stepper.grown(self._past(), dt, outcome)
        self._forget_attempts()
        if np.isinf(dt) and len(self._rungs) == 1:
            self.over = True
            self._ended = self._kind(outcome)
        return self._update(True, dt)

    def _reject(self, stepper: Stepper, outcome: NewtonResult, dt: float, end: float) -> Update:
        self._rejected += 1
        self._rejected_iterations += outcome.iterations
        update = self._update(False, dt, outcome.reason)
        if np.isinf(dt):
            self._searches = 1
        if np.isinf(self._dt):
            # The end was tried too early, after an update whose dt could have grown.
            self._dt = 2 * self._dt_previous
        else:
            self._dt = stepper.shrunk(self._past(), min(self._dt, end))
            if self._searches:
                self._searches += 1
        if not self._dt >= stepper.rule.smallest * self._unit:
            self._fail(f"dt fell below {self._dt:.1e}: {outcome.reason}")
        return update

    def _on_path_from_rest(self, final: State) -> State | None:
        """The state on the path from rest, if ``final`` was on another branch and is given up.

        Raises
        ------
        ConvergenceError
            If the path from rest ends early, or was left too often.
        """
        rest = path_from_rest(self._standing_on, final)
        if rest is not None and sum(row.dt == 0.0 for row in self._on_this_stage()[1:]) == RETURNS:
            raise ConvergenceError(f"it left it after each of {RETURNS} returns; try another start")
        return rest

    def _return_to(self, rest: State) -> Update:
        return self._begin(rest, DT_RETURN * self._unit)

    def _past(self) -> Past:
        rows = self._on_this_stage()
        in_vain = self._in_vain(rows)
        return Past(self._state, self._previous, rows, self._rejected, in_vain, self._searches)

    def _in_vain(self, rows: list[Row]) -> bool:
        """Whether the end was due after one of the updates since the last start, and failed."""
        assert self._stepper is not None
        due = self._stepper.rule.end_is_due
        followed = rows if self._rejected else rows[:-1]
        since = itertools.takewhile(lambda row: row.dt > 0.0, reversed(followed))
        return any(due(row.dt / self._unit, row.newton_iterations, row.rejected) for row in since)

    def _on_this_stage(self) -> list[Row]:
        """The rows of the present mesh and targets; the first one is its start."""
        return stages(self._rows)[-1]

    def _kind(self, final: NewtonResult) -> dict[str, object]:
        """What is noted of the stationary point: what hangs on grey, and whether it is a minimum.

        The latter as far as the solver tells.
        """
        system = self._standing_on
        notes: dict[str, object] = {"grey": list(grey_shares(system, final.state))}
        negative = final.negative_eigenvalues
        if negative is None or negative == system.eigenvalues_of_a_minimum:
            return notes
        falling = negative - system.eigenvalues_of_a_minimum
        logger.warning("C falls from the stationary point in %d directions", falling)
        return {**notes, "falling_directions": falling}

    def _fail(self, message: str) -> None:
        if len(self._rungs) > 1:
            logger.warning("given up on %d elements: %s", self._rungs[0].elements, message)
            self._given_up = True
            return
        self.over, self.message = True, message
        self._ended = {"failed": message}

    def stop(self, message: str) -> None:
        """Say why the caller leaves the loop: it becomes a note of the design."""
        self.message = message
        self._ended = {"stopped": message}

    def _forget_attempts(self) -> None:
        self._rejected = self._rejected_iterations = self._searches = 0

    # -- what there is to tell -----------------------------------------------------------------

    def _row(self, dt: float, outcome: NewtonResult | None = None) -> Row:
        effort = {
            "update": len(self._rows),
            "dt": dt,
            "rejected": self._rejected,
            "rejected_iterations": self._rejected_iterations,
            "seconds": self._elapsed(),
            "correction": self._correction,
        }
        if outcome is not None:
            effort |= {"newton_iterations": outcome.iterations, "leap": outcome.leap}
        return row_of(self._standing_on, self._state, effort)

    def _update(self, accepted: bool, dt: float, reason: str = "", resumed: bool = False) -> Update:
        row = self._rows[-1]
        if accepted:
            logger.info("update %d: dt %.1e, C %.6e", row.update, dt, row.C)
        elif reason:
            logger.info("dt %.1e rejected: %s", dt, reason)
        if accepted and not resumed:
            self.checkpoint = self._standing()
        return Update(accepted, row, dt, reason, self.design, self.checkpoint, resumed)

    def _elapsed(self) -> float:
        """Seconds up to now, without those while no loop was going on."""
        now = time.perf_counter()
        self._seconds += now - self._clock
        self._clock = now
        return self._seconds

    @property
    def history(self) -> History:
        """The accepted updates so far."""
        return History.from_rows(self._rows)

    @property
    def design(self) -> Design:
        """The last accepted design, on the mesh that it was found on."""
        info = {
            "start": self._start,
            "q": [float(value) for value in self._state.forces(self._rungs[0])],
            "converged": self._rows[-1].is_end,
            "ngsolve": ng.__version__,
            **self._ended,
            **self._corrections,
        }
        here = self._rungs[0]
        chi = self._state.chi.reshape(here.coefficient_shape)
        return Design(here, chi, self.history, info)

    def _standing(self) -> Checkpoint:
        return Checkpoint(
            self._rungs[0],
            self._state,
            self._previous,
            self._dt_previous,
            self._dt,
            self.history,
            self._start,
            {**self._ended, **self._corrections},
            self.problem,
            self._best,
        )

    @property
    def _corrections(self) -> dict[str, object]:
        """The note of them, if there are any."""
        return {CORRECTIONS: [one.to_note() for one in self._found]} if self._found else {}

    @property
    def result(self) -> Result:
        """What has been reached."""
        design = self.design
        q = self._state.forces(self._rungs[0])
        return Result(design, self.history, q, self._rows[-1].is_end, self.message)


def evolve(
    problem: SpringProblem,
    initial: Start | None = None,
    dt_initial: float | None = None,
    *,
    resume_from: Checkpoint | None = None,
    threads: int | None = None,
    solver: str = "auto",
    rule: Rule | None = None,
    newton: NewtonSettings | None = None,
    start_name: str | None = None,
    ladder: Ladder | None = None,
    timings: Timings | None = None,
) -> Evolution:
    """The evolution of a design, update by update, in a loop of the caller's.

    Nothing is written and nobody is told; `ngspring.optimize` is the loop with a run folder and
    observers.

    Parameters
    ----------
    problem : SpringProblem
    initial : Design or function f(x, y), optional
        Start; `Design.column` by default. A design of another mesh is interpolated.
    dt_initial : float, optional
        First pseudo-time step; 1 (times `time_unit`) by default.
    resume_from : Checkpoint, optional
        Continue from there, for example from an `Update.checkpoint`, instead of ``initial``.
    threads, solver, rule, newton, start_name, ladder, timings
        See `ngspring.optimize`.

    Returns
    -------
    Evolution

    Raises
    ------
    ConvergenceError
        While it is iterated, if the initial design's load paths cannot be followed to the control
        points.
    ProblemError
        If the start is no design, the solver is unknown, or ``resume_from`` is another problem's.

    Examples
    --------
    >>> evolution = ngspring.evolve(ngspring.cases["C7"])  # doctest: +SKIP
    >>> for update in evolution:  # doctest: +SKIP
    ...     print(update.row.update, update.row.C, update.row.q)
    ...     if update.row.update == 20:
    ...         break
    >>> evolution.result.design.save("halfway.npz")  # doctest: +SKIP
    """
    if dt_initial is not None:
        positive_number("dt_initial", dt_initial)
    checked_threads(threads)
    evolution = Evolution(
        problem,
        initial,
        dt_initial,
        start_name,
        rule or LeapRule(),
        newton or NewtonSettings(),
        solver,
        threads,
        ladder or Ladder(),
        timings,
    )
    if resume_from is not None:
        evolution.continue_from(resume_from)
    return evolution

"""The evolution of a design as a loop that belongs to the caller (2.4, 2.7).

Each design update solves the coupled system by backward Euler over dt
(`ngspring.evolution.stepping`). After an easy update the next dt is larger, a failed one is
repeated with a smaller dt; where dt does not grow any more, the design leaps along its drift
between two updates (`ngspring.evolution.leaps`). In the end the transient term is removed and a
last update gives the exact saddle point. Nothing is written here: see `ngspring.optimize`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator

import ngsolve as ng
import numpy as np

from ngspring.basics.checks import positive_number
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.design.design import Design
from ngspring.design.history import History, Row
from ngspring.evolution.branches import path_from_rest
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.leaps import make_stepper
from ngspring.evolution.stepping import Past, Stepper
from ngspring.evolution.steprule import LeapRule, Rule
from ngspring.evolution.updates import Result, Update
from ngspring.fem.process import checked_threads, parallel
from ngspring.kkt.newton import NewtonResult, NewtonSettings
from ngspring.kkt.start import Start, initial_state, start_design
from ngspring.kkt.stationarity import grey_shares
from ngspring.kkt.system import CoupledSystem, State
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)

#: Returns to the path from rest before a run gives up, and dt after each (times `time_unit`).
RETURNS, DT_RETURN = 3, 1e4


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
    ) -> None:
        self.problem = problem
        self.over = False
        self.message = ""
        self._initial, self._dt_initial = start, dt_initial
        self._start = start_name or ("column" if start is None else "given")
        self._rule, self._newton = rule, newton
        self._solver, self._threads = solver, threads
        self._unit = time_unit(problem)
        self._system: CoupledSystem | None = None
        self._stepper: Stepper | None = None
        self._rows: list[Row] = []
        self._rejected = self._rejected_iterations = 0
        self._ended: dict[str, object] = {}
        self._seconds = 0.0

    # -- beginning -----------------------------------------------------------------------------

    def continue_from(self, checkpoint: Checkpoint) -> None:
        """Take up what a checkpoint holds.

        Raises
        ------
        ProblemError
            If it is another problem's.
        """
        if not checkpoint.problem.equals_but_for_name(self.problem):
            raise ProblemError(
                "the checkpoint to resume from belongs to another problem"
                f" ({checkpoint.problem.name or 'no name'}, {checkpoint.problem.elements} elements)"
            )
        self._state, self._previous = checkpoint.state, checkpoint.previous
        self._dt, self._dt_previous = checkpoint.dt, checkpoint.dt_previous
        self._rows = checkpoint.history.rows()
        self._start = checkpoint.start
        self._seconds = self._rows[-1].seconds
        self._rejected = self._rejected_iterations = 0
        self.checkpoint = checkpoint
        self.over, self.message = self._rows[-1].is_end, ""
        self._ended = dict(checkpoint.notes)

    def _set_up(self, threads: int) -> Update:
        """Make the system, and tell where the evolution stands."""
        design = None if self._rows else start_design(self.problem, self._initial)
        self._system = CoupledSystem(self.problem, self._solver, threads)
        self._stepper = make_stepper(self._system, self._newton, self._rule)
        if design is None:
            if self._state.u.shape[1] != self._system.free:
                raise ProblemError("the checkpoint to resume from belongs to another mesh")
            return self._update(True, self._rows[-1].dt, resumed=True)
        self._state = initial_state(self._system, design)
        self._previous, self._dt_previous = self._state, 0.0
        self._dt = self._unit if self._dt_initial is None else self._dt_initial
        self._rows = [self._row(0.0)]
        return self._update(True, self._dt)

    # -- loop ----------------------------------------------------------------------------------

    def __iter__(self) -> Iterator[Update]:
        # Why an earlier loop was left is of no importance to one that goes on.
        if not self.over:
            self.message, self._ended = "", {}
        with parallel(self._threads, self.problem) as count:
            self._clock = time.perf_counter()
            if self._stepper is None:
                yield self._set_up(count)
            while not self.over:
                update = self._advance(self._stepper)
                if update is not None:
                    yield update

    def _advance(self, stepper: Stepper | None) -> Update | None:
        """One design update, tried once; None if the evolution has failed without one."""
        assert stepper is not None
        end = stepper.rule.end * self._unit
        dt = np.inf if self._dt > end else self._dt
        outcome = stepper.update(self._past(), dt)
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
        self._dt = stepper.grown(self._past(), dt, outcome)
        self._rejected = self._rejected_iterations = 0
        if np.isinf(dt):
            self.over = True
            self._ended = self._kind(outcome)
        return self._update(True, dt)

    def _reject(self, stepper: Stepper, outcome: NewtonResult, dt: float, end: float) -> Update:
        self._rejected += 1
        self._rejected_iterations += outcome.iterations
        update = self._update(False, dt, outcome.reason)
        if np.isinf(self._dt):
            # The end was tried too early, after an update whose dt could have grown.
            self._dt = 2 * self._dt_previous
        else:
            self._dt = stepper.shrunk(self._past(), min(self._dt, end))
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
        assert self._system is not None
        rest = path_from_rest(self._system, final)
        if rest is not None and sum(row.is_return for row in self._rows) == RETURNS:
            raise ConvergenceError(f"it left it after each of {RETURNS} returns; try another start")
        return rest

    def _return_to(self, rest: State) -> Update:
        self._state = self._previous = rest
        self._dt, self._dt_previous = DT_RETURN * self._unit, 0.0
        self._rejected = self._rejected_iterations = 0
        self._rows.append(self._row(0.0))
        return self._update(True, 0.0)

    def _past(self) -> Past:
        return Past(self._state, self._previous, self._rows, self._rejected)

    def _kind(self, final: NewtonResult) -> dict[str, object]:
        """What is noted of the stationary point: what hangs on grey, and whether it is a minimum.

        The latter as far as the solver tells.
        """
        assert self._system is not None
        notes: dict[str, object] = {"grey": list(grey_shares(self._system, final.state))}
        negative = final.negative_eigenvalues
        if negative is None or negative == self._system.eigenvalues_of_a_minimum:
            return notes
        falling = negative - self._system.eigenvalues_of_a_minimum
        logger.warning("C falls from the stationary point in %d directions", falling)
        return {**notes, "falling_directions": falling}

    def _fail(self, message: str) -> None:
        self.over, self.message = True, message
        self._ended = {"failed": message}

    def stop(self, message: str) -> None:
        """Say why the caller leaves the loop: it becomes a note of the design."""
        self.message = message
        self._ended = {"stopped": message}

    # -- what there is to tell -----------------------------------------------------------------

    def _row(self, dt: float, outcome: NewtonResult | None = None) -> Row:
        assert self._system is not None
        values = self._system.terms(self._state)
        width = self.problem.equivalent_width(values["V"]) / self.problem.H
        counts = {} if outcome is None else {"newton_iterations": outcome.iterations}
        numbers = {
            **values,
            **counts,
            "update": len(self._rows),
            "dt": dt,
            "rejected": self._rejected,
            "rejected_iterations": self._rejected_iterations,
            "leap": 0.0 if outcome is None else outcome.leap,
            "width": width,
            "seconds": self._elapsed(),
        }
        return Row.from_columns(numbers)

    def _update(self, accepted: bool, dt: float, reason: str = "", resumed: bool = False) -> Update:
        row = self._rows[-1]
        if accepted:
            logger.info("update %d: dt %.1e, C %.6e", row.update, dt, row.C)
        else:
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
        """The last accepted design."""
        info = {
            "start": self._start,
            "q": [float(value) for value in self._state.forces(self.problem)],
            "converged": self._rows[-1].is_end,
            "ngsolve": ng.__version__,
            **self._ended,
        }
        shape = self.problem.coefficient_shape
        return Design(self.problem, self._state.chi.reshape(shape), self.history, info)

    def _standing(self) -> Checkpoint:
        return Checkpoint(
            self.problem,
            self._state,
            self._previous,
            self._dt_previous,
            self._dt,
            self.history,
            self._start,
            self._ended,
        )

    @property
    def result(self) -> Result:
        """What has been reached."""
        design = self.design
        q = self._state.forces(self.problem)
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
    threads, solver, rule, newton, start_name
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
    )
    if resume_from is not None:
        evolution.continue_from(resume_from)
    return evolution

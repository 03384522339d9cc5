"""Pseudo-time integration of the design to an exact stationary point (2.4, 2.7).

Each design update solves the coupled system by backward Euler over dt
(`ngspring.evolution.stepping`). After an easy update the next dt is larger, a failed one is
repeated with a smaller dt; where dt does not grow any more, the design leaps along its drift
between two updates (`ngspring.evolution.leaps`). In the end the transient term is removed and a
last update gives the exact saddle point.
"""

from __future__ import annotations

import logging
import numbers
import time
from collections.abc import Sequence
from pathlib import Path

import ngsolve as ng
import numpy as np

from ngspring.basics.checks import shown
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.basics.files import PathLike, write_text
from ngspring.design.design import Design
from ngspring.design.history import History
from ngspring.evolution.branches import path_from_rest
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.folder import CHECKPOINT, DESIGN, HISTORY, SNAPSHOTS, checkpoint_of, locked
from ngspring.evolution.leaps import make_stepper
from ngspring.evolution.recorder import SnapshotRecorder
from ngspring.evolution.stepping import Past, Stepper
from ngspring.evolution.steprule import LeapRule, Rule
from ngspring.evolution.updates import Observer, Result, Update
from ngspring.fem.process import parallel
from ngspring.kkt.newton import NewtonResult, NewtonSettings
from ngspring.kkt.start import Start, initial_state, start_design
from ngspring.kkt.system import CoupledSystem, State
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)


#: Returns to the path from rest before a run gives up, and dt after each (times `time_unit`).
RETURNS, DT_RETURN = 3, 1e4


def optimize(
    problem: SpringProblem,
    initial: Start | None = None,
    dt_initial: float | None = None,
    max_updates: int | None = None,
    out: PathLike | None = None,
    observers: Sequence[Observer] = (),
    *,
    resume: bool = False,
    threads: int | None = None,
    solver: str = "auto",
    rule: Rule | None = None,
    newton: NewtonSettings | None = None,
    start_name: str | None = None,
) -> Result:
    """Evolve a design until it is an exact stationary point of C* (Eq. 5).

    Parameters
    ----------
    problem : SpringProblem
    initial : Design or function f(x, y), optional
        Start; `Design.column` by default. A design of another mesh is interpolated.
    dt_initial : float, optional
        First pseudo-time step; 1 (times `time_unit`) by default.
    max_updates : int, optional
        Stop after this many design updates in all.
    out : path, optional
        Run folder: a checkpoint and ``snapshots.npz`` (see `ngspring.design.snapshots`) after every
        accepted update, at the end ``design.npz`` and ``history.csv``.
    observers : sequence of callables
        Called with an `Update` after every accepted or rejected update.
    resume : bool
        Continue the run in ``out``; a finished one is returned as it is.
    threads : int, optional
        All available ones by default.
    solver : str
        See `ngspring.fem.linear.make_factorization`.
    rule : LeapRule or StepRule, optional
        How dt changes: with leaps where it does not grow (`LeapRule`, the default), or without any
        as in the paper (`StepRule`).
    newton : NewtonSettings, optional
    start_name : str, optional
        Name of the start for the design's notes.

    Returns
    -------
    Result

    Raises
    ------
    RunFolderError
        If ``out`` holds a run already (and not ``resume``), another problem's run, is in use, or
        cannot be written.
    ConvergenceError
        If the initial design's load paths cannot be followed to the control points.
    ProblemError
        If an argument is not valid.
    """
    if dt_initial is not None and not (_is_number(dt_initial) and 0 < dt_initial < np.inf):
        raise ProblemError(f"dt_initial = {shown(dt_initial)} must be a positive number")
    for name, value in (("max_updates", max_updates), ("threads", threads)):
        if value is not None and not (isinstance(value, int) and _is_number(value) and value > 0):
            raise ProblemError(f"{name} = {shown(value)} must be an integer of at least 1")
    if resume and out is None:
        raise ProblemError("resume needs the run folder, out")
    run = _Run(problem, rule or LeapRule(), newton or NewtonSettings(), tuple(observers))
    run.max_updates = max_updates
    if out is None:
        with parallel(threads) as count:
            run.begin(initial, dt_initial, start_name, solver, count)
            return run.loop()
    folder = Path(out)
    with locked(folder):
        checkpoint = checkpoint_of(folder, problem, resume)
        if checkpoint is not None and checkpoint.dt == np.inf and run.finished(checkpoint):
            run.restore(checkpoint)
            run.folder = folder
            run.write()
            return run.result(True, "")
        run.folder = folder
        run.observers = (SnapshotRecorder(folder / SNAPSHOTS), *run.observers)
        try:
            with parallel(threads) as count:
                if checkpoint is None:
                    run.begin(initial, dt_initial, start_name, solver, count)
                else:
                    run.restore(checkpoint)
                    run.use(CoupledSystem(problem, solver, count))
                    run.tell_restored()
                return run.loop()
        except KeyboardInterrupt:
            # It may have come between any two lines: what counts is the last checkpoint.
            if (folder / CHECKPOINT).exists():
                run.restore(Checkpoint.load(folder / CHECKPOINT))
                run.write()
            raise


def _is_number(value: object) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


class _Run:
    """One evolution: what lives across design updates."""

    def __init__(
        self,
        problem: SpringProblem,
        rule: Rule,
        newton: NewtonSettings,
        observers: tuple[Observer, ...],
    ) -> None:
        self.problem = problem
        self.rule = rule
        self.newton = newton
        self.observers = observers
        self.unit = time_unit(problem)
        self.folder: Path | None = None
        self.max_updates: int | None = None
        self.system: CoupledSystem | None = None
        self.stepper: Stepper | None = None
        self.rows: list[dict[str, float]] = []
        self.ended: dict[str, object] = {}
        self.seconds_before = 0.0
        self.clock = time.perf_counter()

    # -- beginning ---------------------------------------------------------------------------------

    def begin(
        self,
        initial: Start | None,
        dt_initial: float | None,
        start_name: str | None,
        solver: str,
        threads: int,
    ) -> None:
        design = start_design(self.problem, initial)
        self.start = start_name or ("column" if initial is None else "given")
        self.use(CoupledSystem(self.problem, solver, threads))
        assert self.system is not None
        self.state = initial_state(self.system, design)
        self.previous, self.dt_previous = self.state, 0.0
        self.dt = self.unit if dt_initial is None else dt_initial
        self.rows = [self._row(0.0)]
        self._save()
        self._tell(True, self.dt, "")

    def use(self, system: CoupledSystem) -> None:
        """Take the steps with this system."""
        self.system = system
        self.stepper = make_stepper(system, self.newton, self.rule)

    def restore(self, checkpoint: Checkpoint) -> None:
        self.state, self.previous = checkpoint.state, checkpoint.previous
        self.dt, self.dt_previous = checkpoint.dt, checkpoint.dt_previous
        # Histories of older versions know no leaps.
        self.rows = [{**row, "leap": row.get("leap", 0.0)} for row in checkpoint.history.rows()]
        self.start = checkpoint.start
        self.seconds_before = self.rows[-1]["seconds"]

    def tell_restored(self) -> None:
        """Tell the observers where a resumed run stands."""
        self._tell(True, self.rows[-1]["dt"], "")

    def finished(self, checkpoint: Checkpoint) -> bool:
        return bool(np.isinf(checkpoint.history.last()["dt"]))

    # -- loop --------------------------------------------------------------------------------------

    def loop(self) -> Result:
        assert self.stepper is not None
        rejected = rejected_iterations = 0
        end = self.stepper.rule.end * self.unit
        while True:
            if self.max_updates is not None and len(self.rows) > self.max_updates:
                message = f"stopped after {self.max_updates} design updates, as asked"
                self.ended = {"stopped": message}
                self.write()
                return self.result(False, message)
            dt = np.inf if self.dt > end else self.dt
            outcome = self.stepper.update(self._past(rejected), dt)
            if outcome.converged and np.isinf(dt):
                try:
                    if self._returned(outcome.state):
                        rejected = rejected_iterations = 0
                        continue
                except ConvergenceError as error:
                    return self._failed(f"this design does not follow its path from rest: {error}")
            if outcome.converged:
                self.previous, self.dt_previous = self.state, dt
                self.state = outcome.state
                self.rows.append(self._row(dt, outcome, rejected, rejected_iterations))
                self.dt = self.stepper.grown(self._past(rejected), dt, outcome)
                rejected = rejected_iterations = 0
                self._save()
                self._tell(True, dt, "")
                if np.isinf(dt):
                    self.ended = self._kind(outcome)
                    self.write()
                    return self.result(True, "")
                continue
            rejected += 1
            rejected_iterations += outcome.iterations
            self._tell(False, dt, outcome.reason)
            if np.isinf(self.dt):
                # The end was tried too early, after an update whose dt could have grown.
                self.dt = 2 * self.dt_previous
            else:
                self.dt = self.stepper.shrunk(self._past(rejected), min(self.dt, end))
            if not self.dt >= self.stepper.rule.smallest * self.unit:
                return self._failed(f"dt fell below {self.dt:.1e}: {outcome.reason}")

    def _past(self, rejected: int) -> Past:
        return Past(self.state, self.previous, self.rows, rejected)

    def _kind(self, final: NewtonResult) -> dict[str, object]:
        """A note if the stationary point is not a minimum of C, as far as the solver tells."""
        assert self.system is not None
        negative = final.negative_eigenvalues
        if negative is None or negative == self.system.eigenvalues_of_a_minimum:
            return {}
        falling = negative - self.system.eigenvalues_of_a_minimum
        logger.warning("C falls from the stationary point in %d directions", falling)
        return {"falling_directions": falling}

    def _failed(self, message: str) -> Result:
        self.ended = {"failed": message}
        self.write()
        return self.result(False, message)

    def _returned(self, final: State) -> bool:
        """Whether ``final`` was on another branch than the path from rest, and is given up for it.

        The history then has a row with dt = 0, where C jumps up.

        Raises
        ------
        ConvergenceError
            If the path from rest ends early, or was left too often.
        """
        assert self.system is not None
        rest = path_from_rest(self.system, final)
        if rest is None:
            return False
        if sum(row["dt"] == 0.0 for row in self.rows[1:]) == RETURNS:
            raise ConvergenceError(f"it left it after each of {RETURNS} returns; try another start")
        self.state = self.previous = rest
        self.dt, self.dt_previous = DT_RETURN * self.unit, 0.0
        self.rows.append(self._row(0.0))
        self._save()
        self._tell(True, 0.0, "")
        return True

    def _row(
        self,
        dt: float,
        outcome: NewtonResult | None = None,
        rejected: int = 0,
        rejected_iterations: int = 0,
    ) -> dict[str, float]:
        assert self.system is not None
        terms = self.system.terms(self.state)
        seconds = self.seconds_before + time.perf_counter() - self.clock
        return {
            "update": float(len(self.rows)),
            "dt": dt,
            "newton_iterations": 0.0 if outcome is None else float(outcome.iterations),
            "rejected": float(rejected),
            "rejected_iterations": float(rejected_iterations),
            "leap": 0.0 if outcome is None else outcome.leap,
            **{name: terms[name] for name in ("C", "volume", "interface", "curvature")},
            **{name: value for name, value in terms.items() if name.startswith("C_q")},
            **{name: value for name, value in terms.items() if name[0] == "q"},
            "V": terms["V"],
            "width": self.problem.equivalent_width(terms["V"]) / self.problem.H,
            "seconds": seconds,
        }

    # -- output ------------------------------------------------------------------------------------

    @property
    def history(self) -> History:
        return History.from_rows(self.rows)

    def design(self) -> Design:
        info = {
            "start": self.start,
            "q": [float(value) for value in self.state.forces(self.problem)],
            "converged": bool(np.isinf(self.rows[-1]["dt"])),
            "ngsolve": ng.__version__,
            **self.ended,
        }
        shape = self.problem.coefficient_shape
        return Design(self.problem, self.state.chi.reshape(shape), self.history, info)

    def result(self, converged: bool, message: str) -> Result:
        design = self.design()
        assert design.history is not None
        q = self.state.forces(self.problem)
        return Result(design, design.history, q, converged, message)

    def write(self) -> None:
        """Write the last accepted design and the history into the run folder."""
        if self.folder is None or not self.rows:
            return
        self.design().save(self.folder / DESIGN)
        write_text(self.folder / HISTORY, self.history.to_csv())

    def _save(self) -> None:
        if self.folder is None:
            return
        checkpoint = Checkpoint(
            self.problem,
            self.state,
            self.previous,
            self.dt_previous,
            self.dt,
            self.history,
            self.start,
        )
        checkpoint.save(self.folder / CHECKPOINT)

    def _tell(self, accepted: bool, dt: float, reason: str) -> None:
        row = self.rows[-1]
        if accepted:
            logger.info("update %d: dt %.1e, C %.6e", row["update"], dt, row["C"])
        else:
            logger.info("dt %.1e rejected: %s", dt, reason)
        update = Update(accepted, dict(row), dt, reason, self.design())
        for observer in self.observers:
            observer(update)

"""One run of a campaign, wherever it is computed, and the processes that compute runs here.

Every run has a process of its own, so that one that is killed takes no other with it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import multiprocessing
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ngspring.basics.errors import ConvergenceError, DesignFileError, NgspringError, RunFolderError
from ngspring.campaign.plan import Run
from ngspring.problem.point import worst_deviation

if TYPE_CHECKING:
    from ngspring.design.design import Design
    from ngspring.evolution.updates import Observer, Update

logger = logging.getLogger(__name__)

CONVERGED, NOT_CONVERGED = "converged", "not converged"
FAILED, SKIPPED, INTERRUPTED = "failed", "skipped", "interrupted"

SECONDS_TO_STOP = 60.0


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes
    ----------
    run : Run
    status : str
        ``"converged"``, ``"not converged"``, ``"failed"`` (an error) or ``"skipped"`` (it
        should have continued from a run that failed); ``"interrupted"`` only on the way.
    message : str
        Why it did not converge, in one line.
    start : str
        Start of the design; empty, as what follows, where there is no design.
    q : tuple of float
        Reached forces in N.
    width : float or None
        W/H (Eq. 20) or D/H (Eq. 25).
    updates, newton_iterations : int or None
    seconds : float or None
        Time the design took, interrupted pieces included.
    """

    run: Run
    status: str
    message: str = ""
    start: str = ""
    q: tuple[float, ...] = ()
    width: float | None = None
    updates: int | None = None
    newton_iterations: int | None = None
    seconds: float | None = None

    @property
    def converged(self) -> bool:
        """Whether the design is a stationary point at dt = infinity."""
        return self.status == CONVERGED

    @property
    def has_design(self) -> bool:
        """Whether a run may continue from this one."""
        return self.status in (CONVERGED, NOT_CONVERGED)

    @property
    def worst_deviation(self) -> float | None:
        """Largest relative deviation of a force from its target, for points without eta."""
        return worst_deviation(self.run.problem.control_points, self.q)

    @classmethod
    def of_design(cls, run: Run, design: Design, status: str, message: str) -> Outcome:
        """Outcome of a run that ended with a design."""
        start = str(design.info.get("start", ""))
        if start != run.start_name:
            # Only a finished design is taken over from another start.
            message = f"begun from {start or 'an unknown start'}, not from {run.start_name}"
        history = design.history
        return cls(
            run,
            status,
            message,
            start,
            tuple(map(float, design.info.get("q", ()))),
            design.relative_width,
            None if history is None else len(history) - 1,
            None if history is None else history.newton_iterations,
            None if history is None else history.last().seconds,
        )


def finished(run: Run, out: Path) -> Outcome | None:
    """The outcome of a run whose folder holds a converged design of its problem, or None."""
    from ngspring.design.design import Design
    from ngspring.evolution.folder import DESIGN

    try:
        design = Design.load(out / run.name / DESIGN)
    except DesignFileError:
        return None
    if design.problem != run.problem or design.info.get("converged") is not True:
        return None
    return Outcome.of_design(run, design, CONVERGED, "")


def execute(run: Run, out: Path, threads: int, observer: Observer) -> Outcome:
    """Compute or continue a run in its folder ``out / run.name``; never raises.

    Parameters
    ----------
    run : Run
    out : Path
        Folder of the campaign.
    threads : int
    observer : callable
        See `ngspring.evolution.optimize.optimize`.
    """
    try:
        from ngspring.evolution.optimize import optimize

        result = optimize(
            run.problem,
            _start(run, out),
            run.dt_initial,
            run.max_updates,
            out / run.name,
            (lambda update: observer(dataclasses.replace(update, checkpoint=None)),),
            resume=True,
            threads=threads,
            start_name=run.start_name,
        )
    except KeyboardInterrupt:
        return Outcome(run, INTERRUPTED)
    except MemoryError:
        return Outcome(run, FAILED, "not enough memory")
    except (NgspringError, ConvergenceError) as error:
        return Outcome(run, FAILED, _one_line(str(error)))
    except Exception as error:
        return Outcome(run, FAILED, _one_line(f"{type(error).__name__}: {error}"))
    _report(out / run.name)
    status = CONVERGED if result.converged else NOT_CONVERGED
    return Outcome.of_design(run, result.design, status, _one_line(result.message))


def _report(folder: Path) -> None:
    """Close a run with its report; one that cannot be written is no reason to fail."""
    from ngspring.evolution.runstate import read_run
    from ngspring.view.report import REPORT, write_report

    try:
        write_report(read_run(folder, ended=True), folder / REPORT)
    except NgspringError as error:
        logger.warning("no report of the run: %s", error)


def _start(run: Run, out: Path) -> Design | None:
    """The design to begin from; None if the run goes on from its checkpoint."""
    from ngspring.design.design import Design
    from ngspring.evolution.checkpoint import Checkpoint
    from ngspring.evolution.folder import CHECKPOINT, DESIGN, read_design

    folder = out / run.name
    if (folder / CHECKPOINT).exists():
        checkpoint = Checkpoint.load(folder / CHECKPOINT)
        if checkpoint.problem == run.problem and checkpoint.start != run.start_name:
            raise RunFolderError(
                f"{folder} holds an unfinished run from {checkpoint.start}, not from"
                f" {run.start_name}: give this one another name, or remove the folder"
            )
        return None
    if run.after is not None:
        return Design.load(out / run.after / DESIGN)
    if run.design is not None:
        return read_design(run.design)[0]
    if run.start == "random":
        return Design.random(run.problem, run.seed or 0)
    return Design.column(run.problem)


def _one_line(text: str) -> str:
    return " ".join(text.split())


# -- processes of this machine ---------------------------------------------------------------------


@dataclass(frozen=True)
class Death:
    """A worker process ended without an outcome."""

    run: Run
    reason: str


News = tuple[Run, "Update"] | Outcome | Death


class LocalWorkers:
    """Worker processes on this machine, one per run."""

    def __init__(self, count: int, threads: int, out: Path) -> None:
        self._count, self._threads, self._out = count, threads, out
        self._context = multiprocessing.get_context("spawn")
        self._running: dict[Connection, tuple[Run, SpawnProcess]] = {}

    @property
    def full(self) -> bool:
        """Whether a further run has to wait."""
        return len(self._running) >= self._count

    def start(self, run: Run) -> None:
        """Begin or continue a run."""
        here, there = self._context.Pipe(duplex=False)
        process = self._context.Process(
            target=_work,
            args=(run, self._out, self._threads, there),
            name=f"ngspring {run.name}",
            daemon=True,
        )
        process.start()
        # Only the worker holds this end now: its death closes it.
        there.close()
        self._running[here] = run, process

    def news(self) -> list[News]:
        """Wait until something happens, and return it."""
        found: list[News] = []
        for connection in wait(list(self._running)):
            assert isinstance(connection, Connection)
            run, process = self._running[connection]
            try:
                message = connection.recv()
            except Exception:
                # The worker was killed, perhaps in the middle of a message.
                message = None
            if isinstance(message, Outcome):
                found.append(message)
            elif message is not None:
                found.append((run, message))
                continue
            del self._running[connection]
            connection.close()
            if message is None:
                process.kill()
            process.join()
            if message is None:
                found.append(Death(run, _reason(process.exitcode)))
        return found

    def stop(self) -> None:
        """Stop all runs; each writes its last accepted design first."""
        for _, process in self._running.values():
            process.terminate()
        end = time.monotonic() + SECONDS_TO_STOP
        for connection, (_, process) in self._running.items():
            # A worker that waits for its message to be read would never come to an end.
            while process.is_alive() and time.monotonic() < end:
                with contextlib.suppress(Exception):
                    if connection.poll(0.1):
                        connection.recv()
                process.join(0.05)
            process.kill()
            process.join()
            connection.close()
        self._running.clear()


def _reason(code: int | None) -> str:
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-code).name}"
    return f"ended with code {code}"


def _work(run: Run, out: Path, threads: int, pipe: Connection) -> None:
    """Body of a worker process."""

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    # Ctrl-C reaches all processes of a terminal; the campaign alone decides, and says SIGTERM.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, stop)
    send: Callable[[object], None] = pipe.send
    # Without the campaign's process there is nobody to tell: then the run ends, to be resumed.
    with contextlib.suppress(OSError, KeyboardInterrupt):
        send(execute(run, out, threads, send))

"""What computes runs, here or on a cluster: its interface, and one run wherever it is computed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ngspring.basics.errors import ConvergenceError, NgspringError, RunFolderError
from ngspring.campaign.outcome import CONVERGED, FAILED, INTERRUPTED, NOT_CONVERGED, Outcome
from ngspring.campaign.plan import Run
from ngspring.design.design import Design
from ngspring.evolution.folder import CHECKPOINT, DESIGN, last_checkpoint, read_design
from ngspring.evolution.ladder import NO_LADDER
from ngspring.evolution.optimize import optimize
from ngspring.evolution.runstate import read_run
from ngspring.evolution.updates import Observer, Update
from ngspring.part.realise import realise
from ngspring.view.report import REPORT, keep_report


@dataclass(frozen=True)
class Death:
    """A worker process ended without an outcome."""

    run: Run
    reason: str


News = tuple[Run, Update] | Outcome | Death


class Workers(Protocol):
    """Where runs are computed."""

    @property
    def full(self) -> bool:
        """Whether a further run has to wait."""

    def start(self, run: Run) -> None:
        """Begin or continue a run."""

    def news(self) -> list[News]:
        """Wait until something happens, and return it."""

    def stop(self) -> None:
        """Stop all runs."""


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
        design_it = realise if run.part else optimize
        result = design_it(
            run.problem,
            _start(run, out),
            run.dt_initial,
            run.max_updates,
            out / run.name,
            (lambda update: observer(dataclasses.replace(update, checkpoint=None)),),
            resume=True,
            threads=threads,
            start_name=run.start_name,
            ladder=None if run.ladder else NO_LADDER,
        )
    except KeyboardInterrupt:
        return Outcome(run, INTERRUPTED)
    except MemoryError:
        return Outcome(run, FAILED, "not enough memory")
    except (NgspringError, ConvergenceError) as error:
        return Outcome(run, FAILED, one_line(str(error)))
    except Exception as error:
        return Outcome(run, FAILED, one_line(f"{type(error).__name__}: {error}"))
    folder = out / run.name
    keep_report(lambda: read_run(folder, ended=True), folder / REPORT)
    status = CONVERGED if result.converged else NOT_CONVERGED
    return Outcome.of_design(run, result.design, status, one_line(result.message))


def _start(run: Run, out: Path) -> Design | None:
    """The design to begin from; None if the run goes on from its checkpoint."""
    folder = out / run.name
    if (folder / CHECKPOINT).exists():
        checkpoint = last_checkpoint(folder)
        same = checkpoint.goal.equals_but_for_name(run.problem)
        if same and checkpoint.start != run.start_name:
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


def one_line(text: str) -> str:
    """A message without its line breaks."""
    return " ".join(text.split())

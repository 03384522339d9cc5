"""An evolution carried out: its loop, with observers and a run folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.basics.files import PathLike
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.folder import CHECKPOINT, SNAPSHOTS, checkpoint_of, last_checkpoint, locked
from ngspring.evolution.recorder import CheckpointRecorder, SnapshotRecorder, write_result
from ngspring.evolution.updates import Observer, Result, Update
from ngspring.kkt.timings import Timings
from ngspring.problem.spring import SpringProblem


class Updates(Protocol):
    """What goes from update to update: `ngspring.Evolution`, or one whose targets are corrected."""

    @property
    def over(self) -> bool:
        """Whether there is nothing more to do."""

    @property
    def result(self) -> Result:
        """What has been reached."""

    def __iter__(self) -> Iterator[Update]:
        """The updates that are still to come."""

    def stop(self, message: str) -> None:
        """Say why the loop is left before its end."""

    def continue_from(self, checkpoint: Checkpoint) -> None:
        """Take up what a checkpoint holds."""


def carried_out(
    updates: Updates,
    problem: SpringProblem,
    max_updates: int | None,
    out: PathLike | None,
    observers: Sequence[Observer],
    resume: bool,
    timings: Timings,
) -> Result:
    """Go through all updates; see `ngspring.optimize`, whose arguments these are.

    Raises
    ------
    RunFolderError, ProblemError
        See `ngspring.optimize`.
    """
    if max_updates is not None and not (type(max_updates) is int and max_updates > 0):
        raise ProblemError(f"max_updates = {shown(max_updates)} must be an integer of at least 1")
    if resume and out is None:
        raise ProblemError("resume needs the run folder, out")
    if out is None:
        return _loop(updates, max_updates, observers)
    folder = Path(out)
    with locked(folder):
        checkpoint = checkpoint_of(folder, problem, resume)
        if checkpoint is not None:
            updates.continue_from(checkpoint)
        recorders = (CheckpointRecorder(folder / CHECKPOINT), SnapshotRecorder(folder / SNAPSHOTS))
        files = [timings.timed("files", recorder) for recorder in recorders]
        try:
            result = _loop(updates, max_updates, (*files, *observers))
        except KeyboardInterrupt:
            # It may have come between any two lines: what counts is the last checkpoint.
            if (folder / CHECKPOINT).exists():
                updates.continue_from(last_checkpoint(folder))
                write_result(folder, updates.result)
            raise
        with timings.part("files"):
            write_result(folder, result)
        return result


def _loop(updates: Updates, max_updates: int | None, observers: Sequence[Observer]) -> Result:
    """Go through all updates, or as many as are asked for, and tell the observers of each."""
    if updates.over:
        return updates.result
    for update in updates:
        for observer in observers:
            observer(update)
        if max_updates is not None and update.row.update >= max_updates and not updates.over:
            updates.stop(f"stopped after {max_updates} design updates, as asked")
            break
    return updates.result

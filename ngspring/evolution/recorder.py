"""Observers that write an evolution into its run folder."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.errors import DesignFileError
from ngspring.basics.files import PathLike, write_text
from ngspring.design.snapshots import LARGEST, Snapshots
from ngspring.evolution.folder import DESIGN, HISTORY, keep_previous
from ngspring.evolution.updates import Result, Update
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)


class CheckpointRecorder:
    """Observer for `ngspring.optimize` that keeps a checkpoint of every accepted update.

    The one before is kept, too, see `ngspring.evolution.folder.last_checkpoint`.

    Parameters
    ----------
    path : path
        File to write.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)

    def __call__(self, update: Update) -> None:
        """Take in a design update."""
        if update.accepted and not update.resumed and update.checkpoint is not None:
            keep_previous(self.path)
            update.checkpoint.save(self.path)


def write_result(folder: Path, result: Result) -> None:
    """Write the last accepted design and the history into the run folder.

    Raises
    ------
    RunFolderError
        If they cannot be written.
    """
    result.design.save(folder / DESIGN)
    write_text(folder / HISTORY, result.history.to_csv())


class SnapshotRecorder:
    """Observer for `ngspring.optimize` that keeps some designs, and always the last one.

    The file is complete after every design update. In a resumed run it continues the file that is
    there; a run that starts anew replaces it.

    Parameters
    ----------
    path : path
        File to write.
    updates : iterable of int, optional
        After which design updates; 0 is the initial design. All by default.

    Examples
    --------
    >>> recorder = SnapshotRecorder("runs/C7/snapshots.npz", (0, 10, 50))  # doctest: +SKIP
    >>> ngspring.optimize(problem, observers=[recorder])  # doctest: +SKIP
    """

    def __init__(self, path: PathLike, updates: Iterable[int] | None = None) -> None:
        self.path = Path(path)
        self.updates = None if updates is None else frozenset(updates)
        self._kept: dict[int, NDArray[np.float16]] | None = None

    def __call__(self, update: Update) -> None:
        """Take in a design update."""
        if not update.accepted:
            return
        number = update.row.update
        checkpoint = update.checkpoint
        problem = update.design.problem if checkpoint is None else checkpoint.goal
        before = self._stored(problem) if self._kept is None else self._kept
        kept = {k: chi for k, chi in before.items() if k < number and self._wanted(k)}
        # Half precision ends at 65504; so deep in the void the digits do not matter.
        # All on the last mesh of a ladder.
        design = update.design.with_problem(problem)
        chi = np.clip(design.coefficients, -LARGEST, LARGEST)
        kept[number] = chi.astype(np.float16)
        self._kept = kept
        numbers = np.array(sorted(kept), dtype=np.int64)
        Snapshots(problem, numbers, np.array([kept[k] for k in numbers])).save(self.path)

    def _wanted(self, update: int) -> bool:
        return self.updates is None or update in self.updates

    def _stored(self, problem: SpringProblem) -> dict[int, NDArray[np.float16]]:
        if not os.path.exists(self.path):
            return {}
        try:
            stored = Snapshots.load(self.path)
        except DesignFileError as error:
            # They are for pictures only: no reason to lose a run.
            logger.warning("%s; the snapshots begin anew", error)
            return {}
        if not stored.problem.equals_but_for_name(problem):
            return {}
        return dict(zip(map(int, stored.updates), stored.coefficients, strict=True))

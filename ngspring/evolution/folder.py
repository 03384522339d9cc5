"""The folder of a run: who holds it, and what it holds."""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from ngspring.basics.errors import DesignFileError, RunFolderError
from ngspring.basics.files import remove_leftovers, replacing
from ngspring.design.design import Design
from ngspring.design.gallery import stored_design
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.problem.spring import SpringProblem

try:
    import fcntl
except ImportError:  # not a Unix system
    fcntl = None  # type: ignore[assignment]

logger = logging.getLogger(__name__)

CHECKPOINT = "checkpoint.npz"
#: The one before, for a disk that damages files.
PREVIOUS = "checkpoint-before.npz"
DESIGN = "design.npz"
HISTORY = "history.csv"
SNAPSHOTS = "snapshots.npz"
LOCK = ".lock"

#: `in_use` holds the lock for an instant: no reason for a run to give up.
_SECONDS_TO_LOCK = 0.2

#: Short, so that many tries fall between the instants of a process that looks again and again.
_SECONDS_BETWEEN_TRIES = 0.002


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a run folder; it is let go when the process ends, however it ends.

    Raises
    ------
    RunFolderError
        If another process holds it, or the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot make the folder {folder}: {error.strerror}") from error
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=_SECONDS_TO_LOCK, poll_interval=_SECONDS_BETWEEN_TRIES)
    except Timeout:
        raise RunFolderError(
            f"another run is writing to {folder}: wait for it, or use another folder"
        ) from None
    except OSError as error:
        raise RunFolderError(f"cannot write to {folder}: {error.strerror}") from error
    try:
        with contextlib.suppress(OSError):
            # Says since when the folder is held, see `in_use_since`.
            os.utime(folder / LOCK)
        remove_leftovers(folder)
        yield
    finally:
        lock.release()


def in_use(folder: Path) -> bool | None:
    """Whether a process holds a run folder; nothing is written. None where that is unknown."""
    if fcntl is None:
        return None
    try:
        handle = os.open(folder / LOCK, os.O_RDONLY)
    except FileNotFoundError:
        return False
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return None
    finally:
        os.close(handle)
    return False


def in_use_since(folder: Path) -> float:
    """When a process last took a run folder, in seconds since 1970; 0 if none ever did."""
    try:
        return (folder / LOCK).stat().st_mtime
    except OSError:
        return 0.0


def keep_previous(path: Path) -> None:
    """Keep the checkpoint that is about to be replaced.

    Raises
    ------
    RunFolderError
        If it cannot be written.
    """
    if path.exists():
        with replacing(path.with_name(PREVIOUS), logging.DEBUG, archive=True) as temporary:
            shutil.copyfile(path, temporary)


def last_checkpoint(folder: Path) -> Checkpoint:
    """The last checkpoint of a run folder, or the one before if that is damaged.

    Raises
    ------
    DesignFileError
        If neither can be read; the message is about the last one.
    """
    try:
        return Checkpoint.load(folder / CHECKPOINT)
    except DesignFileError as error:
        try:
            before = Checkpoint.load(folder / PREVIOUS)
        except DesignFileError:
            raise error from None
        logger.warning("%s; the one before is used, of update %d", error, len(before.history) - 1)
        return before


def checkpoint_of(folder: Path, problem: SpringProblem, resume: bool) -> Checkpoint | None:
    """The checkpoint to resume in a run folder; None if there is no run yet.

    It takes over the name of the problem, which may have been corrected.

    Raises
    ------
    RunFolderError
        If there is a run and not ``resume``, or it is another problem's, or has no checkpoint.
    """
    path = folder / CHECKPOINT
    if not os.path.exists(path):
        if os.path.exists(folder / DESIGN):
            raise RunFolderError(
                f"{folder} holds a design but no checkpoint to resume: choose another folder"
            )
        return None
    if not resume:
        raise RunFolderError(
            f"{folder} holds a run already: resume it (--resume) or choose another folder"
        )
    checkpoint = last_checkpoint(folder)
    asked = checkpoint.goal
    if not asked.equals_but_for_name(problem):
        raise RunFolderError(
            f"{folder} holds a run of another problem ({asked.name or 'no name'},"
            f" {asked.elements} elements): choose another folder"
        )
    if asked != problem:
        checkpoint = checkpoint.named(problem.name)
        checkpoint.save(path)
    return checkpoint


def read_design(text: str) -> tuple[Design, Path]:
    """A design with the path of its file: a file, a run folder, or a stored design's name.

    A stored design has no folder of its own to write to: its path is in the working directory.

    Raises
    ------
    DesignFileError
        If there is no such design, or it cannot be read.
    """
    path = Path(text)
    # These functions say no where Path's methods raise, for names that are too long.
    if os.path.isdir(path):
        path = path / DESIGN
    if path.suffix or path.parent != Path() or os.path.exists(path):
        return Design.load(path), path
    return stored_design(text), Path(f"{text}.npz")

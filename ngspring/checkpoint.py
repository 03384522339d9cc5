"""The state of a run after an accepted design update, and the folder it is kept in."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

try:
    import fcntl
except ImportError:  # not a Unix system
    fcntl = None  # type: ignore[assignment]

from ngspring.errors import DesignFileError, RunFolderError
from ngspring.files import PathLike, read_arrays, write_arrays
from ngspring.history import History
from ngspring.kkt import State
from ngspring.problem import SpringProblem
from ngspring.problem_toml import parse_toml

VERSION = 1
CHECKPOINT = "checkpoint.npz"
DESIGN = "design.npz"
HISTORY = "history.csv"
SNAPSHOTS = "snapshots.npz"
LOCK = ".lock"
#: `in_use` holds the lock for an instant: no reason for a run to give up.
_SECONDS_TO_LOCK = 0.2
#: Short, so that many tries fall between the instants of a process that looks again and again.
_SECONDS_BETWEEN_TRIES = 0.002


@dataclass(frozen=True)
class Checkpoint:
    """Everything needed to continue a run: last state, the one before, next dt, history."""

    problem: SpringProblem
    state: State
    previous: State
    dt_previous: float
    dt: float
    history: History
    start: str

    def save(self, path: PathLike) -> None:
        """Write the checkpoint atomically."""
        arrays: dict[str, object] = {
            "format": "ngspring-checkpoint",
            "version": VERSION,
            "problem": self.problem.to_toml(),
            "dt": self.dt,
            "dt_previous": self.dt_previous,
            "start": self.start,
            "history": self.history.values,
            "history_columns": np.array(self.history.columns),
        }
        for name, state in (("state", self.state), ("previous", self.previous)):
            for part in ("chi", "u", "lam"):
                arrays[f"{name}_{part}"] = getattr(state, part)
        # Written after every update, which is logged itself.
        write_arrays(path, arrays, logging.DEBUG)

    @classmethod
    def load(cls, path: PathLike) -> Checkpoint:
        """Read a checkpoint.

        Raises
        ------
        DesignFileError
            If the file is missing, truncated, of another version, or not a checkpoint.
        """
        arrays = read_arrays(path, "checkpoint", VERSION)
        try:
            states = [
                State(*(arrays[f"{name}_{part}"] for part in ("chi", "u", "lam")))
                for name in ("state", "previous")
            ]
            checkpoint = cls(
                problem=parse_toml(str(arrays["problem"])),
                state=states[0],
                previous=states[1],
                dt_previous=float(arrays["dt_previous"]),
                dt=float(arrays["dt"]),
                history=History(tuple(map(str, arrays["history_columns"])), arrays["history"]),
                start=str(arrays["start"]),
            )
            checkpoint._check()
        except KeyError as error:
            raise DesignFileError(f"{path} lacks its part {error}") from None
        except (ValueError, TypeError, IndexError, AttributeError) as error:
            raise DesignFileError(f"{path} does not hold a valid checkpoint: {error}") from None
        return checkpoint

    def _check(self) -> None:
        """Raise ValueError if the parts do not fit together or are not finite."""
        nx, ny = self.problem.coefficient_shape
        points = len(self.problem.control_points)
        for state in (self.state, self.previous):
            if state.chi.shape != (nx * ny,) or state.u.ndim != 2 or len(state.u) != points:
                raise ValueError("the state does not fit the problem")
            if state.lam.shape != (points, state.u.shape[1] + 1):
                raise ValueError("the multipliers do not fit the displacements")
            for part in (state.chi, state.u, state.lam):
                if part.dtype.kind != "f" or not np.isfinite(part).all():
                    raise ValueError("the state holds something else than finite numbers")
        table = self.history
        if table.values.ndim != 2 or table.values.shape[1] != len(table.columns):
            raise ValueError("the history table is damaged")
        if not len(table) or not {"dt", "seconds"} <= set(table.columns):
            raise ValueError("the history is incomplete")
        if not self.dt > 0 or not self.dt_previous >= 0:
            raise ValueError(f"dt = {self.dt} is not a positive number")


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
        # Left behind by a process that was killed while it wrote.
        for leftover in folder.glob(".*-*.npz"):
            leftover.unlink(missing_ok=True)
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


def checkpoint_of(folder: Path, problem: SpringProblem, resume: bool) -> Checkpoint | None:
    """The checkpoint to resume in a run folder; None if there is no run yet.

    Raises
    ------
    RunFolderError
        If there is a run and not ``resume``, or it is another problem's, or has no checkpoint.
    """
    path = folder / CHECKPOINT
    if not path.exists():
        if (folder / DESIGN).exists():
            raise RunFolderError(
                f"{folder} holds a design but no checkpoint to resume: choose another folder"
            )
        return None
    if not resume:
        raise RunFolderError(
            f"{folder} holds a run already: resume it (--resume) or choose another folder"
        )
    checkpoint = Checkpoint.load(path)
    if checkpoint.problem != problem:
        raise RunFolderError(
            f"{folder} holds a run of another problem ({checkpoint.problem.name or 'no name'},"
            f" {checkpoint.problem.elements} elements): choose another folder"
        )
    return checkpoint

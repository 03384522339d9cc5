"""The state of a run after an accepted design update, and the folder it is kept in."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ngspring.basics.errors import DesignFileError
from ngspring.basics.files import PathLike, read_arrays, write_arrays
from ngspring.design.history import History
from ngspring.kkt.system import State
from ngspring.problem.spring import SpringProblem

VERSION = 1


@dataclass(frozen=True)
class Checkpoint:
    """Everything needed to continue a run: last state, the one before, next dt, history.

    A finished run has notes about its design, too.
    """

    problem: SpringProblem
    state: State
    previous: State
    dt_previous: float
    dt: float
    history: History
    start: str
    notes: Mapping[str, Any] = field(default_factory=dict)

    def save(self, path: PathLike) -> None:
        """Write the checkpoint atomically."""
        arrays: dict[str, object] = {
            "format": "ngspring-checkpoint",
            "version": VERSION,
            "problem": self.problem.to_toml(),
            "dt": self.dt,
            "dt_previous": self.dt_previous,
            "start": self.start,
            "notes": json.dumps(dict(self.notes)),
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
                problem=SpringProblem.parse_toml(str(arrays["problem"])),
                state=states[0],
                previous=states[1],
                dt_previous=float(arrays["dt_previous"]),
                dt=float(arrays["dt"]),
                history=History(tuple(map(str, arrays["history_columns"])), arrays["history"]),
                start=str(arrays["start"]),
                # Checkpoints of older versions have none.
                notes=dict(json.loads(str(arrays.get("notes", "{}")))),
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

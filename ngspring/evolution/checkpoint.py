"""The state of a run after an accepted design update, and the folder it is kept in."""

from __future__ import annotations

import dataclasses
import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import printable
from ngspring.basics.files import NUMBER, TEXT, Part, PathLike, reading_arrays, write_arrays
from ngspring.design.history import HISTORY_PARTS, History
from ngspring.design.notes import LONGEST_NOTE, checked_notes
from ngspring.kkt.state import State
from ngspring.problem.spring import SpringProblem

VERSION = 1
_STATES = ("state", "previous")
#: Parts of a state, with their dimensions.
_STATE = {"chi": 1, "u": 2, "lam": 2}
_PARTS = {
    **dict.fromkeys(("problem", "start"), TEXT),
    **dict.fromkeys(("dt", "dt_previous"), NUMBER),
    **{f"{name}_{part}": Part("f", ndim) for name in _STATES for part, ndim in _STATE.items()},
    # Checkpoints of older versions have none.
    **dict.fromkeys(("notes", "asked"), Part("U", 0, needed=False)),
    "best": Part("f", 1, needed=False),
    **HISTORY_PARTS,
}


@dataclass(frozen=True)
class Checkpoint:
    """Everything needed to continue a run: last state, the one before, next dt, history.

    A finished run has notes about its design, too. ``problem`` is that of the state; where that
    lives on a coarser mesh (`ngspring.evolution.ladder`) or has corrected targets
    (`ngspring.realise`), ``asked`` is the one that was asked for. ``best`` is chi of the part that
    is nearest to its targets so far, if another one is followed since.
    """

    problem: SpringProblem
    state: State
    previous: State
    dt_previous: float
    dt: float
    history: History
    start: str
    notes: Mapping[str, Any] = field(default_factory=dict)
    asked: SpringProblem | None = None
    best: FloatArray | None = None

    @property
    def goal(self) -> SpringProblem:
        """The problem that was asked for."""
        return self.problem if self.asked is None else self.asked

    def named(self, name: str) -> Checkpoint:
        """The same for a problem of another name."""
        return dataclasses.replace(
            self, problem=self.problem.replace(name=name), asked=self.goal.replace(name=name)
        )

    def save(self, path: PathLike) -> None:
        """Write the checkpoint atomically."""
        arrays: dict[str, object] = {
            "format": "ngspring-checkpoint",
            "version": VERSION,
            "problem": self.problem.to_toml(),
            "asked": self.goal.to_toml(),
            "dt": self.dt,
            "dt_previous": self.dt_previous,
            "start": self.start,
            "notes": json.dumps(dict(self.notes)),
            **({} if self.best is None else {"best": self.best}),
            **self.history.parts,
        }
        for name, state in zip(_STATES, (self.state, self.previous), strict=True):
            for part in _STATE:
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
        with reading_arrays(path, "checkpoint", VERSION, _PARTS) as parts:
            problem = SpringProblem.parse_toml(parts["problem"])
            history = History.of_parts(parts, len(problem.control_points))
            if history is None or not len(history):
                raise ValueError("it has no history")
            state, previous = (
                State(*(parts[f"{name}_{part}"] for part in _STATE)) for name in _STATES
            )
            steps = float(parts["dt_previous"]), float(parts["dt"])
            checkpoint = cls(
                problem,
                state,
                previous,
                *steps,
                history,
                printable(parts["start"], LONGEST_NOTE),
                checked_notes(json.loads(parts.get("notes", "{}")), len(problem.control_points)),
                SpringProblem.parse_toml(parts["asked"]) if "asked" in parts else problem,
                parts.get("best"),
            )
            checkpoint._check()
            return checkpoint

    def _check(self) -> None:
        """Raise ValueError if the parts do not fit together or are not finite."""
        nx, ny = self.problem.coefficient_shape
        points = len(self.problem.control_points)
        for state in (self.state, self.previous):
            if state.chi.shape != (nx * ny,) or len(state.u) != points:
                raise ValueError("the state does not fit the problem")
            if state.lam.shape != (points, state.u.shape[1] + 1):
                raise ValueError("the multipliers do not fit the displacements")
            for part in (state.chi, state.u, state.lam):
                if not np.isfinite(part).all():
                    raise ValueError("the state holds something else than finite numbers")
        if self.best is not None and not (
            self.best.shape == (nx * ny,) and np.isfinite(self.best).all()
        ):
            raise ValueError("the best design so far does not fit the problem")
        if not self.dt > 0 or not self.dt_previous >= 0:
            raise ValueError(f"dt = {self.dt} is not a positive number")

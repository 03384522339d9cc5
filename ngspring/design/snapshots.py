"""Designs on the way of an evolution, kept in one small file (Fig. 16).

A picture needs no more than three digits of chi, so half precision is enough: seven designs on
80 x 80 elements take about 20 kB.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.files import TEXT, Part, PathLike, reading_arrays, write_arrays
from ngspring.design.design import Design
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)

VERSION = 1
#: The updates that Fig. 16 shows, besides the last one.
UPDATES = (0, 5, 10, 20, 30, 40)
#: Half precision ends here.
LARGEST = float(np.finfo(np.float16).max)
_PARTS = {"problem": TEXT, "updates": Part("i", 1), "coefficients": Part("f", 3)}


@dataclass(frozen=True, eq=False)
class Snapshots:
    """Designs of one evolution.

    Attributes
    ----------
    problem : SpringProblem
    updates : array (k,) of int
        Design updates, in increasing order; 0 is the initial design.
    coefficients : array (k, *problem.coefficient_shape), float16
        Spline coefficients of chi after each of these updates.
    """

    problem: SpringProblem
    updates: NDArray[np.int64]
    coefficients: NDArray[np.float16]

    def designs(self) -> dict[int, Design]:
        """The designs by design update."""
        pairs = zip(self.updates, self.coefficients, strict=True)
        return {int(update): Design(self.problem, chi.astype(float)) for update, chi in pairs}

    def select(self, updates: Iterable[int] = UPDATES) -> Snapshots:
        """Those of these updates that are there, and the last one."""
        wanted = np.isin(self.updates, list(updates))
        wanted[-1:] = True
        return Snapshots(self.problem, self.updates[wanted], self.coefficients[wanted])

    def save(self, path: PathLike) -> None:
        """Write one small .npz, atomically.

        Raises
        ------
        RunFolderError
            If it cannot be written.
        """
        arrays: dict[str, Any] = {
            "format": "ngspring-snapshots",
            "version": VERSION,
            "problem": self.problem.to_toml(),
            "updates": self.updates,
            "coefficients": self.coefficients,
        }
        # Written after every update, which is logged itself.
        write_arrays(path, arrays, logging.DEBUG)

    @classmethod
    def load(cls, path: PathLike) -> Snapshots:
        """Read what `save` wrote.

        Raises
        ------
        DesignFileError
            If the file is missing, truncated, of another version, or holds no snapshots.
        """
        with reading_arrays(path, "snapshots", VERSION, _PARTS) as parts:
            problem = SpringProblem.parse_toml(parts["problem"])
            updates, coefficients = parts["updates"], parts["coefficients"]
            if coefficients.shape != (len(updates), *problem.coefficient_shape):
                raise ValueError("its designs have another mesh than its problem")
            if not len(updates) or updates[0] < 0 or not (np.diff(updates) > 0).all():
                raise ValueError("its updates do not increase")
            if not np.isfinite(coefficients).all():
                raise ValueError("the coefficients of chi must be finite numbers")
            return cls(problem, updates.astype(np.int64), coefficients.astype(np.float16))

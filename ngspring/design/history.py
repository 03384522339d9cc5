"""What happened in an evolution: one row per accepted design update."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.arrays import LARGEST, FloatArray
from ngspring.basics.files import Part

_FIRST = (
    "update",
    "elements",
    "correction",
    "dt",
    "newton_iterations",
    "rejected",
    "rejected_iterations",
    "leap",
    "C",
)
_LAST = ("V", "width", "seconds")
_KNOWN = (*_FIRST, *_LAST)
#: Columns that count something.
_WHOLE = (
    "update",
    "elements",
    "correction",
    "newton_iterations",
    "rejected",
    "rejected_iterations",
)
#: Columns that histories of older versions do not have.
_ADDED = ("leap", "elements", "correction")
#: Neither counts nor seconds are as large.
_MOST = 1e12
_OF_POINT = re.compile(r"(C_q|q)\d+")
#: The parts of a file that hold a history, if there is one.
HISTORY_PARTS = {"history": Part("f", 2, False), "history_columns": Part("U", 1, False)}


@dataclass(frozen=True)
class Row:
    """One accepted design update.

    Attributes
    ----------
    update : int
        Number of the design update; 0 is the initial design.
    dt : float
        Pseudo-time step; infinite in the final one, 0 for the start, for the first state on another
        mesh (`ngspring.evolution.ladder`) or with corrected targets (`ngspring.realise`), and for a
        return to the path from rest (`ngspring.evolution.branches`).
    newton_iterations : int
        Of the accepted step.
    rejected, rejected_iterations : int
        Steps that failed before it, and the Newton iterations they took.
    leap : float
        Pseudo-time leapt over before it, negative if that was given up
        (`ngspring.evolution.leaps`).
    C : float
        The objective.
    terms : mapping
        Its terms beside the control points', by name.
    C_q, q : tuple of float
        Term and reaction force in N of each control point.
    V, width : float
        Volume in mm^3, and Eq. 20 or 25 over H.
    seconds : float
        Since the start.
    elements : int
        N of the N x N mesh; 0 in histories of older versions, of runs on one mesh.
    correction : int
        How often the targets of the third medium have been corrected (`ngspring.realise`).
    """

    update: int
    dt: float = math.nan
    newton_iterations: int = 0
    rejected: int = 0
    rejected_iterations: int = 0
    leap: float = 0.0
    C: float = math.nan
    terms: Mapping[str, float] = field(default_factory=dict)
    C_q: tuple[float, ...] = ()
    q: tuple[float, ...] = ()
    V: float = math.nan
    width: float = math.nan
    seconds: float = math.nan
    elements: int = 0
    correction: int = 0

    @property
    def is_end(self) -> bool:
        """Whether the transient term was removed: the design is stationary."""
        return math.isinf(self.dt)

    @property
    def leapt(self) -> bool:
        """Whether a leap came before it and was kept."""
        return self.leap > 0.0

    @property
    def leap_given_up(self) -> bool:
        """Whether a leap was tried before it and given up."""
        return self.leap < 0.0

    @property
    def failed(self) -> int:
        """Attempts before it that failed, without a leap: that says nothing of dt."""
        return self.rejected - self.leap_given_up

    @property
    def iterations(self) -> int:
        """Newton iterations, those of rejected steps included."""
        return self.newton_iterations + self.rejected_iterations

    @property
    def columns(self) -> dict[str, float]:
        """The row of the stored table, by column name."""
        return {
            **{name: float(getattr(self, name)) for name in _FIRST},
            **self.terms,
            **{f"C_q{j}": value for j, value in enumerate(self.C_q, start=1)},
            **{f"q{j}": value for j, value in enumerate(self.q, start=1)},
            **{name: float(getattr(self, name)) for name in _LAST},
        }

    def __getitem__(self, column: str) -> float:
        return self.columns[column]

    @classmethod
    def from_columns(cls, columns: Mapping[str, float]) -> Row:
        """A row of the stored table; what it does not hold has the default.

        Histories of older versions have no ``leap``, ``elements`` or ``correction``.
        """
        plain: dict[str, Any] = {name: columns[name] for name in _KNOWN if name in columns}
        whole = {name: int(plain.pop(name)) for name in _WHOLE if name in plain}
        of_q, of_C_q = (_numbered(prefix, columns) for prefix in ("q", "C_q"))
        return cls(
            **{"update": 0, **whole},
            **plain,
            terms={name: value for name, value in columns.items() if _is_term(name)},
            C_q=of_C_q,
            q=of_q,
        )


def _is_term(column: str) -> bool:
    """Whether it is a term of the objective that belongs to no control point."""
    return column not in _KNOWN and not _OF_POINT.fullmatch(column)


def _numbered(prefix: str, columns: Mapping[str, float]) -> tuple[float, ...]:
    """The columns prefix1, prefix2, ..., as many as there are."""
    values: list[float] = []
    while (name := f"{prefix}{len(values) + 1}") in columns:
        values.append(columns[name])
    return tuple(values)


def stages(rows: Iterable[Row]) -> list[list[Row]]:
    """Rows of a history, in order, parted where the mesh or the corrected targets change.

    The first of each is where the stage starts.
    """
    groups = itertools.groupby(rows, key=lambda row: (row.elements, row.correction))
    return [list(group) for _, group in groups]


@dataclass(frozen=True, eq=False)
class History:
    """A table of numbers with named columns, those of `Row`; row 0 is the initial design.

    The columns ``C_q1`` ... and ``q1`` ... belong to the control points.
    """

    columns: tuple[str, ...]
    values: FloatArray

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, column: str) -> FloatArray:
        return np.asarray(self.values[:, self.columns.index(column)])

    def q(self, j: int) -> FloatArray:
        """Reaction force in N at control point j (from 0) after each update."""
        return self[f"q{j + 1}"]

    def C_q(self, j: int) -> FloatArray:
        """Term of control point j (from 0) after each update."""
        return self[f"C_q{j + 1}"]

    @property
    def newton_iterations(self) -> int:
        """All coupled Newton iterations, those of rejected steps included."""
        return int(self["newton_iterations"].sum() + self["rejected_iterations"].sum())

    def last(self) -> Row:
        """The last row."""
        return self.rows(slice(-1, None))[0]

    @classmethod
    def from_rows(cls, rows: Sequence[Row] | Sequence[Mapping[str, float]]) -> History:
        """Table of rows; a term that is not asked for on all meshes is 0 where it is not."""
        tables = [row.columns if isinstance(row, Row) else row for row in rows]
        longest_first = sorted(tables, key=len, reverse=True)
        columns = tuple(dict.fromkeys(name for table in longest_first for name in table))
        none = {name: 0.0 for name in columns if _is_term(name)}
        full = [{**none, **table} for table in tables]
        return cls(columns, np.array([[row[name] for name in columns] for row in full]))

    @property
    def parts(self) -> dict[str, NDArray[Any]]:
        """The parts of a file that hold it, see `of_parts`."""
        return {"history": self.values, "history_columns": np.array(self.columns)}

    @classmethod
    def of_parts(cls, parts: Mapping[str, NDArray[Any]], points: int) -> History | None:
        """The history that a file holds, if it holds one, of so many control points.

        Raises
        ------
        ValueError
            If a column is missing or there twice, or a number cannot be what its column says.
        """
        if "history" not in parts:
            return None
        columns, values = tuple(map(str, parts["history_columns"])), parts["history"].astype(float)
        if values.shape[1] != len(columns) or len(set(columns)) != len(columns):
            raise ValueError("the history table is damaged")
        of_points = [f"{name}{j}" for name in ("q", "C_q") for j in range(1, points + 1)]
        for name in (*_KNOWN, *of_points):
            if name not in columns and name not in _ADDED:
                raise ValueError(f"its history has no column {name}")
        history = cls(columns, values)
        counted = [name for name in (*_WHOLE, "seconds") if name in columns]
        counts = values[:, [columns.index(name) for name in counted]]
        others = np.delete(values, columns.index("dt"), axis=1)
        right = (history["dt"] >= 0.0).all() and (np.abs(others) < LARGEST).all()
        right &= ((counts >= 0.0) & (counts < _MOST)).all() and (counts[:, :-1] % 1 == 0).all()
        if not right:
            raise ValueError("its history holds numbers that cannot be right")
        return history

    def rows(self, which: slice = slice(None)) -> list[Row]:
        """All rows, or some of them."""
        return [Row.from_columns(row) for row in self._tables(self.values[which])]

    def _tables(self, values: FloatArray) -> Iterable[dict[str, float]]:
        return (dict(zip(self.columns, map(float, row), strict=True)) for row in values)

    def to_csv(self) -> str:
        """Comma-separated text with a header line; numbers round-trip exactly."""

        def text(name: str, value: float) -> str:
            return str(int(value)) if name in _WHOLE else repr(float(value))

        lines = [",".join(self.columns)]
        for row in self.values:
            lines.append(",".join(map(text, self.columns, row)))
        return "\n".join(lines) + "\n"

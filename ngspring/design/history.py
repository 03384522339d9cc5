"""What happened in an evolution: one row per accepted design update."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class History:
    """A table of numbers with named columns; row 0 is the initial design.

    Columns: ``update``, ``dt`` (inf in the final step), ``newton_iterations`` of the accepted step,
    ``rejected`` steps before it and the ``rejected_iterations`` they took, ``leap`` (pseudo-time
    leapt over before it, negative if that was given up, see `ngspring.evolution.leaps`; not in
    histories of older versions), ``C`` with its terms ``volume``, ``interface``, ``curvature`` and
    ``C_q1`` ..., the forces ``q1`` ... in N, ``V`` in mm^3, ``width`` (Eq. 20 or 25 over H) and
    ``seconds`` since the start.
    """

    columns: tuple[str, ...]
    values: FloatArray

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, column: str) -> FloatArray:
        return np.asarray(self.values[:, self.columns.index(column)])

    @property
    def newton_iterations(self) -> int:
        """All coupled Newton iterations, those of rejected steps included."""
        return int(self["newton_iterations"].sum() + self["rejected_iterations"].sum())

    def last(self) -> dict[str, float]:
        """The last row by column name."""
        return dict(zip(self.columns, map(float, self.values[-1]), strict=True))

    @classmethod
    def from_rows(cls, rows: Sequence[Mapping[str, float]]) -> History:
        """Table of rows that all have the same keys."""
        columns = tuple(rows[0])
        return cls(columns, np.array([[row[name] for name in columns] for row in rows]))

    def rows(self) -> list[dict[str, float]]:
        """All rows by column name."""
        return [dict(zip(self.columns, map(float, row), strict=True)) for row in self.values]

    def to_csv(self) -> str:
        """Comma-separated text with a header line; numbers round-trip exactly."""
        whole = {"update", "newton_iterations", "rejected", "rejected_iterations"}

        def text(name: str, value: float) -> str:
            return str(int(value)) if name in whole else repr(float(value))

        lines = [",".join(self.columns)]
        for row in self.values:
            lines.append(",".join(map(text, self.columns, row)))
        return "\n".join(lines) + "\n"

"""Tables and lines that several commands print."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence

from rich.console import Console
from rich.table import Table

from ngspring.basics.text import significant
from ngspring.design.design import Design
from ngspring.design.history import History
from ngspring.view.targets import targets_table
from ngspring.view.text import duration, width_symbol


def make_console() -> Console:
    """The standard output; wide enough for the tables where it is not a terminal."""
    width = None if sys.stdout.isatty() else 120
    # Units such as [mm] would be taken for markup.
    return Console(highlight=False, markup=False, width=width)


def new_table(*columns: str, texts: Collection[str] = (), title: str | None = None) -> Table:
    """A table whose columns are numbers, at the right, but for ``texts``."""
    table = Table(title=title)
    for column in columns:
        table.add_column(column, justify="left" if column in texts else "right")
    return table


def points_table(design: Design, forces: Sequence[float | None]) -> Table:
    """Forces of a design against their targets; None where the path ends before."""
    columns, rows = targets_table(design.problem, forces, design.solid)
    table = new_table(*columns)
    for row in rows:
        table.add_row(*row)
    return table


def design_lines(design: Design) -> list[str]:
    """What a design is, and how it came about."""
    problem = design.problem
    ratio = design.relative_width
    lines = [
        f"{problem.name or 'spring without name'}: {problem.kinematics},"
        f" {problem.elements} x {problem.elements} elements ({problem.domain}),"
        f" {problem.L:g} x {problem.H:g} mm, l_i = {problem.l_i:g} mm",
        f"{width_symbol(problem)} = {ratio:.4f}, V = {significant(design.volume, 6)} mm³",
    ]
    if design.info.get("start"):
        lines.append(f"start: {design.info['start']}")
    if design.history is not None and len(design.history):
        end = "converged to dt = ∞" if design.info.get("converged") else "not converged"
        if design.info.get("falling_directions"):
            end += f" at a saddle: C falls in {design.info['falling_directions']} directions"
        lines.append(f"{history_line(design.history)}, {end}")
    return lines


def history_line(history: History) -> str:
    """Size of a run in one line."""
    seconds = history.last().seconds
    return (
        f"{len(history) - 1} design updates, {history.newton_iterations} Newton iterations,"
        f" {duration(seconds)} ({seconds:.1f} s)"
    )

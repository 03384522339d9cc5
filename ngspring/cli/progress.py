"""What the command line shows while a design evolves: a live table, or plain lines."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table

from ngspring.design.history import Row
from ngspring.problem.spring import SpringProblem
from ngspring.view.text import deviation, duration, point_label, width_symbol

if TYPE_CHECKING:
    from ngspring.evolution.updates import Observer, Update


def plain_line(update: Update, problem: SpringProblem) -> str:
    """One line about one design update."""
    if not update.accepted:
        return f"rejected    dt {update.dt:.1e}  {update.reason}"
    row = update.row
    forces = " ".join(
        f"{q:.4f}/{point.q:g}" for q, point in zip(row.q, problem.control_points, strict=True)
    )
    return (
        f"update {row.update:4} dt {row.dt:.1e}"
        f"  newton {row.newton_iterations}  C {row.C:.4e}"
        f"  {width_symbol(problem)} {row.width:.4f}  q/target {forces}"
        f"  {row.seconds:.1f} s"
    )


class LiveTable:
    """The state of a run as a table, drawn anew several times a second."""

    def __init__(self, problem: SpringProblem) -> None:
        self._problem = problem
        self._row: Row | None = None
        self._shown = time.monotonic()
        self._rejected = ""

    def __call__(self, update: Update) -> None:
        """Take in a design update."""
        self._shown = time.monotonic()
        if update.accepted:
            self._row, self._rejected = update.row, ""
        else:
            self._rejected = f"dt {update.dt:.1e} rejected: {update.reason}"

    def __rich__(self) -> Table:
        row, problem = self._row, self._problem
        since = time.monotonic() - self._shown
        table = Table(title=problem.name or "spring", min_width=50)
        table.add_column()
        table.add_column(justify="right")
        table.add_column("target", justify="right")
        table.add_column("deviation", justify="right")
        if row is None:
            table.add_row("starting", duration(since))
            return table
        table.add_row("design update", str(row.update))
        table.add_row("dt", f"{row.dt:.1e}")
        table.add_row("Newton iterations", str(row.newton_iterations))
        table.add_row("C", f"{row.C:.4e}")
        table.add_row(width_symbol(problem), f"{row.width:.4f}")
        for q, point in zip(row.q, problem.control_points, strict=True):
            name = f"q [N] at {point_label(point)}"
            table.add_row(name, f"{q:.4f}", f"{point.q:g}", deviation(q, point.q))
        table.add_row("elapsed", duration(row.seconds + since))
        if self._rejected:
            table.caption = self._rejected
        return table


@contextmanager
def shown_progress(problem: SpringProblem, console: Console) -> Iterator[Observer]:
    """An observer for `ngspring.optimize`: a live table on a terminal, plain lines elsewhere."""
    if console.is_terminal:
        table = LiveTable(problem)
        with Live(table, console=console, refresh_per_second=4, transient=True):
            yield table
        return

    def tell(update: Update) -> None:
        click.echo(plain_line(update, problem))

    yield tell

"""What the command line shows while a design evolves: a live table, or plain lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol, TypeVar

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table

from ngspring.basics.text import significant
from ngspring.design.corrections import Correction
from ngspring.design.history import Row
from ngspring.evolution.updates import Observer, Update
from ngspring.problem.spring import SpringProblem
from ngspring.view.text import (
    deviation_percent,
    duration,
    point_label,
    signed_percent,
    width_symbol,
)

News = TypeVar("News", contravariant=True)


def plain_line(update: Update, problem: SpringProblem) -> str:
    """One line about one design update."""
    if update.followed is not None:
        return f"followed    {followed_text(update)}"
    if update.rejected:
        return f"rejected    dt {update.dt:.1e}  {update.reason}"
    row = update.row
    if update.correction is not None:
        return solid_line(update.correction, row.correction, problem)
    mesh = f" on {row.elements} elements" if row.elements != problem.elements else ""
    mesh += f" correction {row.correction}" if row.correction else ""
    forces = " ".join(
        f"{significant(q, 5)}/{point.q_star:.5g}"
        for q, point in zip(row.q, update.design.problem.control_points, strict=True)
    )
    return (
        f"update {row.update:4}{mesh} dt {row.dt:.1e}"
        f"  newton {row.newton_iterations}  C {row.C:.4e}"
        f"  {width_symbol(problem)} {row.width:.4f}  q/target {forces}"
        f"  {row.seconds:.1f} s"
    )


def followed_text(update: Update) -> str:
    """How far the way to corrected targets is gone, and why a step of it failed."""
    share = 100 * (update.followed or 0.0)
    failed = f"; a step of it failed: {update.reason}" if update.reason else ""
    return f"{share:.0f} % of the way to the corrected targets{failed}"


def solid_line(correction: Correction, number: int, problem: SpringProblem) -> str:
    """One line about what the solid of a stationary design carries."""
    points = problem.control_points
    forces = " ".join(
        f"{significant(q, 5)}/{point.q:g}"
        for q, point in zip(correction.solid, points, strict=True)
    )
    worst = signed_percent(correction.worst(points), 2)
    return f"the solid after {number} corrections: q/target {forces}, worst {worst}"


class LiveTable:
    """The state of a run as a table, drawn anew several times a second."""

    def __init__(self, problem: SpringProblem) -> None:
        self._problem = problem
        self._row: Row | None = None
        self._points = problem.control_points
        self._solid = ""
        self._shown = time.monotonic()
        self._caption = ""

    def __call__(self, update: Update) -> None:
        """Take in a design update."""
        self._shown = time.monotonic()
        if update.accepted:
            self._row, self._caption = update.row, ""
            self._points = update.design.problem.control_points
            if update.correction is not None:
                worst = update.correction.worst(self._points)
                self._solid = signed_percent(worst, 2)
        elif update.followed is not None:
            self._caption = followed_text(update)
        else:
            self._caption = f"dt {update.dt:.1e} rejected: {update.reason}"

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
        if row.elements != problem.elements:
            table.add_row("elements", str(row.elements), str(problem.elements))
        if self._solid:
            table.add_row("corrections", str(row.correction))
            table.add_row("worst of the last solid", "", "", self._solid)
        table.add_row("dt", f"{row.dt:.1e}")
        table.add_row("Newton iterations", str(row.newton_iterations))
        table.add_row("C", f"{row.C:.4e}")
        table.add_row(width_symbol(problem), f"{row.width:.4f}")
        for q, point in zip(row.q, self._points, strict=True):
            name, asked = f"q [N] at {point_label(point)}", point.q_star
            table.add_row(name, significant(q, 5), f"{asked:.5g}", deviation_percent(q, asked))
        table.add_row("elapsed", duration(row.seconds + since))
        if self._caption:
            table.caption = self._caption
        return table


def shown_progress(problem: SpringProblem, console: Console) -> AbstractContextManager[Observer]:
    """An observer for `ngspring.optimize`: a live table on a terminal, plain lines elsewhere."""
    return live_or_lines(
        console, LiveTable(problem), lambda update: click.echo(plain_line(update, problem))
    )


class Board(Protocol[News]):
    """An observer that shows what it was told as a table."""

    def __call__(self, news: News, /) -> None:
        """Take in what happened."""

    def __rich__(self) -> Table:
        """What there is to see now."""


@contextmanager
def live_or_lines(
    console: Console, board: Board[News], tell: Callable[[News], None]
) -> Iterator[Callable[[News], None]]:
    """The observer for this console: the board on a terminal, ``tell`` elsewhere."""
    if not console.is_terminal:
        yield tell
        return
    with Live(board, console=console, refresh_per_second=4, transient=True):
        yield board

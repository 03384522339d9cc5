"""The table of a campaign's runs: on the terminal, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from ngspring.basics.files import write_text
from ngspring.campaign.local import Outcome
from ngspring.view.text import duration, width_symbol

RESULTS_CSV = "results.csv"
RESULTS_JSON = "results.json"


def record(outcome: Outcome) -> dict[str, Any]:
    """The outcome in JSON types; lists have one entry per control point."""
    points = outcome.run.problem.control_points
    return {
        "name": outcome.run.name,
        "status": outcome.status,
        "converged": outcome.converged,
        "d": [point.d for point in points],
        "eta": [point.eta for point in points],
        "target": [point.q for point in points],
        "q": list(outcome.q),
        "worst_deviation": outcome.worst_deviation,
        "width": outcome.width,
        "width_symbol": width_symbol(outcome.run.problem),
        "updates": outcome.updates,
        "newton_iterations": outcome.newton_iterations,
        "minutes": None if outcome.seconds is None else outcome.seconds / 60,
        "start": outcome.start,
        "message": outcome.message,
    }


def results_csv(outcomes: Iterable[Outcome]) -> str:
    """Comma-separated table; several numbers in a field have spaces between them."""

    def text(value: object) -> str:
        if isinstance(value, list):
            return " ".join(map(repr, value))
        return "" if value is None else str(value)

    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    records = [record(outcome) for outcome in outcomes]
    writer.writerow(records[0])
    writer.writerows([text(value) for value in row.values()] for row in records)
    return file.getvalue()


def write_results(outcomes: Sequence[Outcome], out: Path) -> None:
    """Write results.csv and results.json, each atomically.

    Raises
    ------
    RunFolderError
        If they cannot be written.
    """
    write_text(out / RESULTS_CSV, results_csv(outcomes))
    text = json.dumps([record(outcome) for outcome in outcomes], indent=1)
    write_text(out / RESULTS_JSON, text + "\n")


def results_table(outcomes: Iterable[Outcome]) -> Table:
    """The same for the terminal."""
    table = Table()
    for column in ("run", "status"):
        table.add_column(column, overflow="fold")
    for column in ("q/target [N]", "deviation", "W/H or D/H", "updates", "Newton", "time"):
        table.add_column(column, justify="right", no_wrap=True)
    for column in ("start", "message"):
        table.add_column(column, overflow="fold")

    def whole(value: int | None) -> str:
        return "" if value is None else str(value)

    for outcome in outcomes:
        points = outcome.run.problem.control_points[: len(outcome.q)]
        forces = [
            f"{q:.4f}/{point.q:g}" + (" (η)" if point.eta else "")
            for q, point in zip(outcome.q, points, strict=True)
        ]
        worst = outcome.worst_deviation
        table.add_row(
            outcome.run.name,
            outcome.status,
            "\n".join(forces),
            "" if worst is None else f"{100 * worst:.3f} %",
            "" if outcome.width is None else f"{outcome.width:.4f}",
            whole(outcome.updates),
            whole(outcome.newton_iterations),
            "" if outcome.seconds is None else duration(outcome.seconds),
            outcome.start,
            outcome.message,
        )
    return table

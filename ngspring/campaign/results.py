"""The table of a campaign's runs, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ngspring.basics.files import finite_or_none, write_text
from ngspring.campaign.outcome import Outcome
from ngspring.view.text import width_symbol

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
        "eta_odd": [point.eta_odd for point in points],
        "target": [point.q for point in points],
        "q": [finite_or_none(q) for q in outcome.q],
        "worst_deviation": outcome.worst_deviation,
        "width": outcome.width,
        "width_symbol": width_symbol(outcome.run.problem),
        "updates": outcome.updates,
        "newton_iterations": outcome.newton_iterations,
        "minutes": None if outcome.seconds is None else outcome.seconds / 60,
        "start": outcome.start,
        "message": outcome.message,
        "flaw": outcome.flaw,
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

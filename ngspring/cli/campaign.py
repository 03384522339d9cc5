"""The command ``ngspring campaign``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click
from rich.table import Table

from ngspring.basics.text import significant
from ngspring.campaign.outcome import Outcome
from ngspring.campaign.plan import read_campaign
from ngspring.campaign.results import RESULTS_CSV, RESULTS_JSON
from ngspring.campaign.run import Event, run_campaign
from ngspring.cli.arguments import command_line
from ngspring.cli.options import NOT_CONVERGED, OK, UNSOUND
from ngspring.cli.progress import live_or_lines, plain_line
from ngspring.cli.signals import INTERRUPTED
from ngspring.cli.tables import make_console, new_table
from ngspring.view.text import duration, signed_percent


@click.command("campaign")
@click.argument("file", metavar="FILE.toml", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder of all runs; runs/FILE by default."
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Runs at the same time; by default as many as there are processors for.",
)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Threads of each run.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Dask scheduler, such as tcp://host:8786, whose workers compute the runs instead.",
)
def campaign_command(
    file: Path, out: Path | None, workers: int | None, threads: int, scheduler: str | None
) -> int:
    """Compute the runs listed in a TOML file, several at a time, each in a folder of its own.

    The same command again resumes what was stopped, repeats what failed, and leaves alone what is
    finished. Exit code 3 if not all runs converged, 4 if one
    of them to what is no part (not connected, or held by grey).
    """
    campaign = read_campaign(file)
    folder = Path("runs", file.stem) if out is None else out
    console = make_console()
    ended: dict[str, Outcome] = {}

    def collect(event: Event) -> None:
        if event.outcome is not None:
            ended[event.run.name] = event.outcome

    try:
        with live_or_lines(console, _Board(len(campaign.runs)), _tell) as observer:
            run_campaign(campaign, folder, workers, threads, scheduler, (collect, observer))
    except KeyboardInterrupt:
        again = command_line(
            ("campaign", str(file)),
            {
                "--out": folder,
                "--workers": workers,
                "--scheduler": scheduler,
                "--threads": None if threads == 1 else threads,
            },
        )
        ends = f"{len(ended)} of {len(campaign.runs)} runs ended"
        click.echo(f"interrupted with {ends}; resume with: {again}", err=True)
        return INTERRUPTED
    finally:
        # Also where the results cannot be written.
        outcomes = [ended[run.name] for run in campaign.runs if run.name in ended]
        if outcomes:
            console.print(_results_table(outcomes))
    click.echo(f"files in {folder}: {RESULTS_CSV}, {RESULTS_JSON}, and a folder for each run")
    missed = sum(not outcome.converged for outcome in outcomes)
    if missed:
        click.echo(f"not converged: {missed} of {len(outcomes)} runs", err=True)
        return NOT_CONVERGED
    flawed = sum(bool(outcome.flaw) for outcome in outcomes)
    if flawed:
        click.echo(f"no part: {flawed} of {len(outcomes)} runs, see the table", err=True)
    return UNSOUND if flawed else OK


def _tell(event: Event) -> None:
    if event.update is not None:
        line = plain_line(event.update, event.run.problem)
    elif event.outcome is not None:
        line = ": ".join(filter(None, (event.outcome.status, event.outcome.message)))
    elif event.reason:
        line = f"restarted: its worker process was {event.reason}"
    else:
        line = event.kind
    click.echo(f"{event.run.name}: {line}")


class _Board:
    """The runs that are computed at the moment, as a table."""

    def __init__(self, count: int) -> None:
        self._count, self._ended = count, 0
        self._last: dict[str, Event] = {}

    def __call__(self, event: Event) -> None:
        if event.outcome is not None:
            self._ended += 1
            self._last.pop(event.run.name, None)
        else:
            self._last[event.run.name] = event

    def __rich__(self) -> Table:
        columns = ("run", "update", "dt", "Newton", "C", "W/H or D/H", "elapsed")
        title = f"{self._ended} of {self._count} runs ended"
        table = new_table(*columns, texts=("run",), title=title)
        for name, event in list(self._last.items()):
            if event.update is None:
                table.add_row(name, event.kind)
                continue
            row = event.update.row
            table.add_row(
                name,
                str(row.update),
                f"{event.update.dt:.1e}" + (" rejected" if event.update.rejected else ""),
                str(row.newton_iterations),
                f"{row.C:.4e}",
                f"{row.width:.4f}",
                duration(row.seconds),
            )
        return table


def _results_table(outcomes: Iterable[Outcome]) -> Table:
    """What is written into results.csv, for people."""
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
            f"{significant(q, 5)}/{point.q:g}" + ("" if point.own else " (η)")
            for q, point in zip(outcome.q, points, strict=True)
        ]
        worst = outcome.worst_deviation
        table.add_row(
            outcome.run.name,
            outcome.status,
            "\n".join(forces),
            "" if worst is None else signed_percent(worst, 3),
            "" if outcome.width is None else f"{outcome.width:.4f}",
            whole(outcome.updates),
            whole(outcome.newton_iterations),
            "" if outcome.seconds is None else duration(outcome.seconds),
            outcome.start,
            "; ".join(filter(None, (outcome.message, outcome.flaw))),
        )
    return table

"""The command ``ngspring campaign``."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ngspring.cli.options import INTERRUPTED, NOT_CONVERGED, OK

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from ngspring.campaign.local import Outcome
    from ngspring.campaign.run import CampaignObserver, Event


@click.command("campaign", short_help="Compute the runs listed in a TOML file.")
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
    finished. Exit code 3 if not all runs converged.
    """
    from ngspring.campaign.plan import read_campaign
    from ngspring.campaign.results import RESULTS_CSV, RESULTS_JSON, results_table
    from ngspring.campaign.run import run_campaign
    from ngspring.cli.tables import make_console

    campaign = read_campaign(file)
    folder = Path("runs", file.stem) if out is None else out
    console = make_console()
    ended: dict[str, Outcome] = {}

    def collect(event: Event) -> None:
        if event.outcome is not None:
            ended[event.run.name] = event.outcome

    again = ["ngspring", "campaign", str(file), "--out", str(folder)]
    for option, value in (("--workers", workers), ("--scheduler", scheduler)):
        again += [] if value is None else [option, str(value)]
    again += [] if threads == 1 else ["--threads", str(threads)]
    try:
        with _shown(console, len(campaign.runs)) as observer:
            run_campaign(campaign, folder, workers, threads, scheduler, (collect, observer))
    except KeyboardInterrupt:
        click.echo(
            f"interrupted with {len(ended)} of {len(campaign.runs)} runs ended; resume with:"
            f" {shlex.join(again)}",
            err=True,
        )
        return INTERRUPTED
    finally:
        # Also where the results cannot be written.
        outcomes = [ended[run.name] for run in campaign.runs if run.name in ended]
        if outcomes:
            console.print(results_table(outcomes))
    click.echo(f"files in {folder}: {RESULTS_CSV}, {RESULTS_JSON}, and a folder for each run")
    missed = sum(not outcome.converged for outcome in outcomes)
    if missed:
        click.echo(f"not converged: {missed} of {len(outcomes)} runs", err=True)
    return NOT_CONVERGED if missed else OK


@contextmanager
def _shown(console: Console, count: int) -> Iterator[CampaignObserver]:
    """An observer: a live table of what is computed on a terminal, plain lines elsewhere."""
    if not console.is_terminal:
        yield _tell
        return
    from rich.live import Live

    board = _Board(count)
    with Live(board, console=console, refresh_per_second=4, transient=True):
        yield board


def _tell(event: Event) -> None:
    from ngspring.cli.progress import plain_line

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
        from rich.table import Table

        from ngspring.view.text import duration

        table = Table(title=f"{self._ended} of {self._count} runs ended")
        for column in ("run", "update", "dt", "Newton", "C", "W/H or D/H", "elapsed"):
            table.add_column(column, justify="left" if column == "run" else "right")
        for name, event in list(self._last.items()):
            if event.update is None:
                table.add_row(name, event.kind)
                continue
            row = event.update.row
            table.add_row(
                name,
                str(row.update),
                f"{event.update.dt:.1e}" + ("" if event.update.accepted else " rejected"),
                str(row.newton_iterations),
                f"{row.C:.4e}",
                f"{row.width:.4f}",
                duration(row.seconds),
            )
        return table

"""The command ``ngspring watch``."""

from __future__ import annotations

import os
import time
from pathlib import Path

import click

from ngspring.basics.checks import printable
from ngspring.basics.errors import DesignFileError, ProblemError, RunFolderError
from ngspring.cli.options import OK, FiniteRange
from ngspring.design.notes import LONGEST_NOTE
from ngspring.evolution.folder import in_use, read_design
from ngspring.evolution.runstate import RunState, campaign_runs, holds_run, read_run, stored_state
from ngspring.problem.spring import LONGEST_NAME
from ngspring.view.report import REPORT, write_index, write_report

_SHORTEST, _LONGEST = 0.2, 86400.0


@click.command("watch")
@click.argument("name", metavar="RUN|CAMPAIGN|DESIGN")
@click.option("--once", is_flag=True, help="Write the report once, even if the run goes on.")
@click.option(
    "--interval",
    type=FiniteRange(_SHORTEST, _LONGEST),
    default=5.0,
    show_default=True,
    help="Seconds between two looks into the folder.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write; report.html in the folder by default.",
)
def watch_command(name: str, once: bool, interval: float, out: Path | None) -> int:
    """Write the report of a run, and again after every design update until the run ends.

    The report is one HTML file: design, curve, convergence, estimated time left. Open it in a
    browser; it loads itself again while the run goes on. What it tells is what the run has stored;
    nothing but volume and width is computed anew. RUN is the folder of a run or of a
    campaign (an index, and a report of each run). The report of a DESIGN, a file or the name of a
    stored one, is written once.
    """
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise ProblemError(f"--out {out} must end with .html")
    folder = Path(name)
    if not os.path.isdir(folder):
        return _write_design(name, out)
    if not holds_run(folder) and campaign_runs(folder):
        _watch_campaign(folder, out, once, interval)
    else:
        _watch_run(folder, out, once, interval)
    return OK


def _write_design(name: str, out: Path | None) -> int:
    if not Path(name).suffix and Path(name).parent != Path():
        raise RunFolderError(f"there is no run folder {name}")
    design, path = read_design(name)
    target = path.with_suffix(".html") if out is None else out
    write_report(stored_state(design, path.parent), target)
    click.echo(f"report: {target}")
    return OK


def _watch_run(folder: Path, out: Path | None, once: bool, interval: float) -> None:
    target = folder / REPORT if out is None else out
    told = False
    while not once and not holds_run(folder) and in_use(folder):
        if not told:
            click.echo(f"waiting for the first design in {folder}")
        told = True
        time.sleep(interval)
    state = read_run(folder)
    write_report(state, target, _refresh(interval))
    click.echo(f"report: {target}")
    while not once and state.going_on:
        time.sleep(interval)
        before, state = state, read_run(folder)
        if _key(state) != _key(before):
            write_report(state, target, _refresh(interval))
    click.echo(_status_line(folder.resolve().name, state))


def _watch_campaign(folder: Path, out: Path | None, once: bool, interval: float) -> None:
    target = folder / REPORT if out is None else out
    name = folder.resolve().name
    seen: dict[str, RunState | str] = {}
    told = False
    while True:
        # The campaign may begin another run between two looks.
        campaign_goes_on = in_use(folder)
        states: dict[str, RunState | str] = {}
        for path in campaign_runs(folder):
            states[path.name] = state = _read(path)
            new = isinstance(state, RunState) and _key(state) != _key(seen.get(path.name))
            if out is None and new and isinstance(state, RunState):
                write_report(state, path / REPORT, _refresh(interval))
        changed = {k: _key(v) for k, v in states.items()} != {k: _key(v) for k, v in seen.items()}
        seen = states
        goes_on = campaign_goes_on or any(
            state.going_on for state in states.values() if isinstance(state, RunState)
        )
        if changed or not told or not goes_on:
            refresh = _refresh(interval) if goes_on else None
            write_index(states.items(), target, name, links=out is None, refresh=refresh)
        if not told:
            click.echo(f"report: {target}")
        told = True
        if once or not goes_on:
            break
        time.sleep(interval)
    for run, run_state in states.items():
        click.echo(_status_line(run, run_state))


def _read(folder: Path) -> RunState | str:
    """The state of one of several runs; one that cannot be read is no reason to stop."""
    try:
        return read_run(folder)
    except (DesignFileError, RunFolderError) as error:
        return str(error)


def _key(state: RunState | str | None) -> object:
    """What has to change for a report to be written again."""
    if state is None or isinstance(state, str):
        return state
    extras = state.curve is None, state.states is None, state.closing
    return state.status, state.reason, state.updated, extras


def _refresh(interval: float) -> int:
    return max(1, round(interval))


def _status_line(name: str, state: RunState | str) -> str:
    name = printable(name, LONGEST_NAME)
    if isinstance(state, str):
        return f"{name}: {printable(state, LONGEST_NOTE)}"
    history = state.design.history
    updates = "" if history is None else f" after {len(history) - 1} design updates"
    reason = f": {state.reason}" if state.reason else ""
    return f"{name}: {state.status}{updates}{reason} (as stored)"

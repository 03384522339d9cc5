"""The command ``ngspring optimize``."""

from __future__ import annotations

import contextlib
import shlex
from pathlib import Path

import click

from ngspring.basics.errors import NgspringError
from ngspring.cli.arguments import read_problem, read_start
from ngspring.cli.options import (
    INTERRUPTED,
    NOT_CONVERGED,
    OK,
    complain,
    domain_option,
    solver_option,
    threads_option,
)
from ngspring.cli.targets import refuse_implausible
from ngspring.problem.scaling import on_mesh


@click.command("optimize", short_help="Design a spring for a case or a TOML file.")
@click.argument("case", metavar="CASE|FILE.toml")
@click.option(
    "--elements",
    type=int,
    help="N of an N x N mesh instead of the problem's own. If it is coarser, l_i grows by the"
    " same factor, so that the mesh resolves the interface.",
)
@domain_option
@click.option(
    "--initial",
    default="column",
    show_default=True,
    metavar="column|random|DESIGN",
    help="Start: a column, random, or a design (not used by --resume of a run that has begun).",
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the random start (default: 0).")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Run folder; runs/NAME by default, runs/NAME-N with --elements.",
)
@click.option("--resume", is_flag=True, help="Continue the run in the folder.")
@threads_option
@click.option("--max-updates", type=int, help="Stop after this many design updates in all.")
@click.option("--dt-initial", type=float, help="First pseudo-time step.")
@solver_option
@click.option("--report", is_flag=True, help="Keep report.html up to date while the run goes on.")
@click.option("--anyway", is_flag=True, help="Try even if the targets are out of reach.")
def optimize_command(
    case: str,
    elements: int | None,
    domain: str | None,
    initial: str,
    seed: int | None,
    out: Path | None,
    resume: bool,
    threads: int | None,
    max_updates: int | None,
    dt_initial: float | None,
    solver: str,
    report: bool,
    anyway: bool,
) -> int:
    """Design a spring: a case of the paper, or your own problem in a TOML file.

    Targets are checked first, as by `ngspring targets`: what is doubtful is said on stderr, what
    cannot be met is refused.

    A checkpoint is written after every design update: after Ctrl-C, a crash or a power failure,
    the same command with --resume continues. The end is told in report.html, for a browser.
    """
    problem, name = read_problem(case)
    if elements is not None:
        problem, note = on_mesh(problem, elements)
        if note:
            click.echo(note)
        name = f"{name}-{elements}"
    if domain is not None:
        problem = problem.replace(domain=domain)
    if seed is not None and initial != "random":
        raise click.UsageError("--seed belongs to --initial random")
    folder = Path("runs", name) if out is None else out
    if not resume:
        refuse_implausible(problem, anyway)

    from ngspring.cli.progress import shown_progress
    from ngspring.cli.tables import design_lines, make_console, points_table
    from ngspring.evolution.folder import CHECKPOINT, locked
    from ngspring.evolution.optimize import optimize
    from ngspring.evolution.runstate import read_run
    from ngspring.view.report import REPORT, ReportWriter, write_report
    from ngspring.view.run_files import write_pictures

    if resume and not (folder / CHECKPOINT).exists():
        click.echo(f"there is no run in {folder} yet: it begins", err=True)
    start, start_name = read_start(problem, initial, seed or 0)
    options: list[tuple[str, object]]
    options = [("--elements", elements), ("--domain", domain), ("--threads", threads)]
    options += [("--max-updates", max_updates), ("--out", folder)]
    again = ["ngspring", "optimize", case]
    again += [text for key, value in options if value is not None for text in (key, str(value))]
    again += ([] if solver == "auto" else ["--solver", solver]) + ["--report"] * report
    again.append("--resume")
    writers = (ReportWriter(folder / REPORT),) if report else ()
    try:
        with shown_progress(problem, make_console()) as observer:
            result = optimize(
                problem,
                start,
                dt_initial,
                max_updates,
                folder,
                (observer, *writers),
                resume=resume,
                threads=threads,
                solver=solver,
                start_name=start_name,
            )
        # Whoever watches the folder waits for what is still to come.
        with locked(folder):
            lines = write_pictures(result, folder, threads)
    except KeyboardInterrupt:
        if not (folder / CHECKPOINT).exists():
            return complain("interrupted before there was anything to save", INTERRUPTED)
        with contextlib.suppress(NgspringError):
            write_report(read_run(folder), folder / REPORT)
        click.echo(
            f"interrupted: the last accepted design is saved in {folder}; resume with:"
            f" {shlex.join(again)}",
            err=True,
        )
        return INTERRUPTED
    make_console().print(points_table(problem, [float(q) for q in result.q]))
    for line in [*design_lines(result.design), *lines]:
        click.echo(line)
    if result.converged:
        return OK
    click.echo(f"not converged: {result.message}", err=True)
    updates = len(result.history) - 1
    return OK if max_updates is not None and updates >= max_updates else NOT_CONVERGED

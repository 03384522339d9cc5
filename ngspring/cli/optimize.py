"""The command ``ngspring optimize``."""

from __future__ import annotations

import difflib
import os
from functools import partial
from pathlib import Path

import click

from ngspring.basics.checks import shown
from ngspring.basics.errors import DesignFileError, ProblemError
from ngspring.cli.arguments import command_line, read_problem
from ngspring.cli.options import (
    NOT_CONVERGED,
    OK,
    Finite,
    FiniteRange,
    anywhere_option,
    complain,
    domain_option,
    odd_in_option,
    solver_option,
    threads_option,
    unsound,
)
from ngspring.cli.progress import shown_progress
from ngspring.cli.signals import INTERRUPTED
from ngspring.cli.tables import design_lines, make_console, points_table
from ngspring.design.corrections import MISSED
from ngspring.design.design import Design
from ngspring.design.gallery import UnknownDesignError, gallery
from ngspring.design.soundness import flaw
from ngspring.evolution.folder import CHECKPOINT, locked, read_design
from ngspring.evolution.ladder import NO_LADDER
from ngspring.evolution.optimize import optimize
from ngspring.evolution.runstate import read_run
from ngspring.part.realisation import PartSettings
from ngspring.part.realise import realise
from ngspring.problem.scaling import on_mesh
from ngspring.problem.spring import SpringProblem
from ngspring.problem.targets.plausibility import check_targets
from ngspring.view.report import REPORT, ReportWriter, keep_report
from ngspring.view.run_files import write_pictures


@click.command("optimize")
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
    help="Run folder; runs/NAME by default, runs/NAME-N with --elements, runs/NAME-part with"
    " --part.",
)
@click.option("--resume", is_flag=True, help="Continue the run in the folder.")
@threads_option
@click.option("--max-updates", type=int, help="Stop after this many design updates in all.")
@click.option("--dt-initial", type=Finite(), help="First pseudo-time step.")
@click.option(
    "--ladder",
    type=click.Choice(("on", "off")),
    default="on",
    show_default=True,
    help="Coarse meshes come first (N/4, N/2), unless the start is a finished design.",
)
@click.option(
    "--part",
    is_flag=True,
    help="Correct what the third medium is asked for, until the solid goes through the targets.",
)
@click.option(
    "--tolerance",
    type=FiniteRange(1e-4, 99.0),
    help="With --part: largest deviation of the solid's forces in percent (default: 0.5).",
)
@click.option(
    "--corrections",
    type=click.IntRange(1, 1000),
    help="With --part: corrections at most (default: 12).",
)
@click.option(
    "--imperfection",
    type=FiniteRange(1e-9, 1e9),
    metavar="MM",
    help="Do nearly the same with surfaces moved by up to so many mm in a pattern that breaks the"
    " symmetries, so that the spring does not buckle.",
)
@odd_in_option("--imperfection")
@solver_option
@click.option("--report", is_flag=True, help="Keep report.html up to date while the run goes on.")
@click.option("--anyway", is_flag=True, help="Try even if the targets are out of reach.")
@anywhere_option
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
    ladder: str,
    part: bool,
    tolerance: float | None,
    corrections: int | None,
    imperfection: float | None,
    odd_in: str | None,
    solver: str,
    report: bool,
    anyway: bool,
    targets_anywhere: bool,
) -> int:
    """Design a spring: a case of the paper, or your own problem in a TOML file.

    Targets are checked first, as by `ngspring targets`: what is doubtful is said on stderr, what
    cannot be met is refused.

    With --part the design is corrected until its solid, computed with real contact, goes through
    the targets.

    A checkpoint is written after every design update: after Ctrl-C, a crash or a power failure,
    the same command with --resume continues. The end is told in report.html, for a browser.
    """
    notes: list[str] = []
    problem, name = read_problem(case, notes, targets_anywhere)
    if elements is not None:
        problem, note = on_mesh(problem, elements)
        if note:
            click.echo(note)
        name = f"{name}-{elements}"
    if domain is not None:
        problem = problem.replace(domain=domain)
    problem = _with_imperfection(problem, imperfection, odd_in)
    if seed is not None and initial != "random":
        raise click.UsageError("--seed belongs to --initial random")
    settings = _part_settings(part, tolerance, corrections)
    name = f"{name}-part" if part else name
    folder = Path("runs", name) if out is None else out
    if not resume:
        for note in notes:
            click.echo(f"ngspring: note: {note}", err=True)
        _refuse_implausible(problem, anyway)
    elif not os.path.exists(folder / CHECKPOINT):
        click.echo(f"there is no run in {folder} yet: it begins", err=True)
    start, start_name = _read_start(problem, initial, seed or 0)
    writers = (ReportWriter(folder / REPORT),) if report else ()
    try:
        with shown_progress(problem, make_console()) as observer:
            design_it = optimize if settings is None else partial(realise, settings=settings)
            result = design_it(
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
                ladder=None if ladder == "on" else NO_LADDER,
            )
        # Whoever watches the folder waits for what is still to come.
        with locked(folder):
            lines = write_pictures(result, folder, threads)
    except KeyboardInterrupt:
        options = {
            "--elements": elements,
            "--domain": domain,
            "--threads": threads,
            "--max-updates": max_updates,
            "--ladder": None if ladder == "on" else ladder,
            "--part": part,
            "--tolerance": tolerance,
            "--corrections": corrections,
            "--imperfection": imperfection,
            "--odd-in": odd_in,
            "--out": folder,
            "--solver": None if solver == "auto" else solver,
            "--report": report,
            "--targets-anywhere": targets_anywhere,
            "--resume": True,
        }
        return _interrupted(folder, command_line(("optimize", case), options))
    make_console().print(points_table(result.design, [float(q) for q in result.q]))
    for line in [*design_lines(result.design), *lines]:
        click.echo(line)
    if result.converged:
        if result.design.info.get(MISSED):
            return unsound(flaw(result.design), "try more --corrections, or more elements")
        return unsound(flaw(result.design))
    click.echo(f"not converged: {result.message}", err=True)
    updates = len(result.history) - 1
    return OK if max_updates is not None and updates >= max_updates else NOT_CONVERGED


def _with_imperfection(
    problem: SpringProblem, imperfection: float | None, odd_in: str | None
) -> SpringProblem:
    """The problem with what --imperfection and --odd-in add."""
    if imperfection is None:
        if odd_in is not None:
            raise click.UsageError("--odd-in belongs to --imperfection")
        return problem
    return problem.with_offsets(imperfection=imperfection, odd_in=odd_in)


def _part_settings(
    part: bool, tolerance: float | None, corrections: int | None
) -> PartSettings | None:
    """What --part and the options that belong to it ask for."""
    if not part:
        for name, value in (("--tolerance", tolerance), ("--corrections", corrections)):
            if value is not None:
                raise click.UsageError(f"{name} belongs to --part")
        return None
    default = PartSettings()
    return PartSettings(
        default.tolerance if tolerance is None else tolerance / 100,
        default.corrections if corrections is None else corrections,
    )


def _interrupted(folder: Path, again: str) -> int:
    """Close a run after Ctrl-C with its report, and say how it goes on."""
    if not os.path.exists(folder / CHECKPOINT):
        return complain("interrupted before there was anything to save", INTERRUPTED)
    keep_report(lambda: read_run(folder), folder / REPORT)
    where = f"the last accepted design is saved in {folder}"
    click.echo(f"interrupted: {where}; resume with: {again}", err=True)
    return INTERRUPTED


def _refuse_implausible(problem: SpringProblem, anyway: bool) -> None:
    """Say on stderr what is doubtful about a problem, and refuse what cannot be met.

    Raises
    ------
    ProblemError
        If there is an error and not ``anyway``.
    """
    findings = check_targets(problem)
    errors = [finding.message for finding in findings if finding.level == "error"]
    if errors and not anyway:
        raise ProblemError(f"{'; '.join(errors)}. To try nevertheless: --anyway")
    for finding in findings:
        if finding.level != "note":
            click.echo(f"ngspring: warning: {finding.message}", err=True)


def _read_start(problem: SpringProblem, text: str, seed: int) -> tuple[Design, str]:
    """The design to start from, and its name for the notes.

    Raises
    ------
    DesignFileError
        If a design is named that cannot be read.
    """
    if text == "column":
        return Design.column(problem), text
    if text == "random":
        return Design.random(problem, seed), f"random, seed {seed}"
    try:
        return read_design(text)[0], f"design {text}"
    except UnknownDesignError:
        close = difflib.get_close_matches(text, ("column", "random", *gallery), n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise DesignFileError(
            f"there is no stored design {shown(text)} for --initial{hint}: it must be column,"
            " random, a design's file or run folder, or the name of a stored design"
        ) from None

"""The command line, ``ngspring``.

Modules that need NGSolve or matplotlib are imported inside the commands that use them, so that
``ngspring --help`` and ``ngspring cases`` answer at once.
"""

from __future__ import annotations

import contextlib
import logging
import math
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import click

from ngspring import __version__
from ngspring.animation_cli import animate_command
from ngspring.arguments import make_folder, on_mesh, read_design, read_problem, read_start
from ngspring.campaign_cli import campaign_command
from ngspring.cases import cases
from ngspring.errors import ConvergenceError, NgspringError, ProblemError
from ngspring.problem import DOMAINS
from ngspring.stability_cli import stability_command
from ngspring.targets_cli import materials_command, refuse_implausible, targets_command
from ngspring.verification_cli import export_command, tolerance_command, verify_command
from ngspring.watch_cli import watch_command

OK, FAILED, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
SOLVERS = ("auto", "sparsecholesky", "pardiso")

Command = TypeVar("Command", bound=Callable[..., Any])


class _Commands(click.Group):
    """A group of commands whose errors are one line each, with the exit codes of this program."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        kwargs["standalone_mode"] = False
        try:
            with _terminated_as_interrupted():
                code = super().main(*args, **kwargs)
        except click.ClickException as error:
            code = _complain(error.format_message(), BAD_INPUT)
        except (click.Abort, KeyboardInterrupt):
            code = _complain("interrupted", INTERRUPTED)
        except NgspringError as error:
            code = _complain(str(error), BAD_INPUT)
        except ConvergenceError as error:
            code = _complain(str(error), NOT_CONVERGED)
        except MemoryError:
            code = _complain("not enough memory: use fewer elements", BAD_INPUT)
        sys.exit(code or OK)


@contextlib.contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Make SIGTERM end a command as Ctrl-C does: what was reached is written, workers are stopped.

    A campaign that was simply killed would leave its workers behind until their next update.
    """

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    # Only the main thread may set handlers; elsewhere the caller has its own.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _complain(message: str, code: int) -> int:
    click.echo(f"ngspring: error: {' '.join(message.split())}", err=True)
    return code


class _StderrHandler(logging.Handler):
    """Writes to what is the standard error now: the live table replaces it while it is shown."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr)


@click.group(
    cls=_Commands, invoke_without_command=True, context_settings={"max_content_width": 100}
)
@click.version_option(__version__, prog_name="ngspring", message="%(prog)s %(version)s")
@click.option("-v", "--verbose", is_flag=True, help="Say on stderr what goes on inside.")
@click.option("--log-file", type=click.Path(path_type=Path), help="Write the same into a file.")
@click.pass_context
def cli(context: click.Context, verbose: bool, log_file: Path | None) -> None:
    """Design springs with a prescribed nonlinear load-displacement curve.

    Exit codes: 0 done, 1 a check failed, 2 bad input, 3 no convergence, 130 interrupted.
    """
    _start_logging(context, verbose, log_file)
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def _start_logging(context: click.Context, verbose: bool, log_file: Path | None) -> None:
    # Without any handler Python would print warnings that the commands report themselves.
    handlers: list[logging.Handler] = [logging.NullHandler()]
    if verbose:
        handlers.append(_StderrHandler())
    if log_file is not None:
        try:
            handlers.append(logging.FileHandler(log_file, encoding="utf-8"))
        except OSError as error:
            raise NgspringError(
                f"cannot write the log file {log_file}: {error.strerror}"
            ) from error
    logger = logging.getLogger("ngspring")
    level = logger.level
    logger.setLevel(logging.INFO)
    form = logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s")
    for handler in handlers:
        handler.setFormatter(form)
        logger.addHandler(handler)

    def stop() -> None:
        logger.setLevel(level)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()

    context.call_on_close(stop)


def _domain_option(command: Command) -> Command:
    text = "Part of the spring that is analysed, instead of the problem's own."
    return click.option("--domain", type=click.Choice(DOMAINS), help=text)(command)


def _threads_option(command: Command) -> Command:
    text = "Threads to use; all available ones by default."
    return click.option("--threads", type=click.IntRange(min=1), help=text)(command)


def _solver_option(command: Command) -> Command:
    text = "Linear solver; auto takes pardiso if it is installed."
    option = click.option(
        "--solver", type=click.Choice(SOLVERS), default="auto", show_default=True, help=text
    )
    return option(command)


# -- commands --------------------------------------------------------------------------------------


@cli.command("cases")
def show_cases() -> None:
    """List the cases of the paper."""
    from ngspring.report import cases_table, make_console

    make_console().print(cases_table(cases))


@cli.command("optimize", short_help="Design a spring for a case or a TOML file.")
@click.argument("case", metavar="CASE|FILE.toml")
@click.option(
    "--elements",
    type=int,
    help="N of an N x N mesh instead of the problem's own. If it is coarser, l_i grows by the"
    " same factor, so that the mesh resolves the interface.",
)
@_domain_option
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
@_threads_option
@click.option("--max-updates", type=int, help="Stop after this many design updates in all.")
@click.option("--dt-initial", type=float, help="First pseudo-time step.")
@_solver_option
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

    from ngspring.checkpoint import CHECKPOINT, locked
    from ngspring.evolution import optimize
    from ngspring.html_report import REPORT, ReportWriter, write_report
    from ngspring.output import write_pictures
    from ngspring.progress import shown_progress
    from ngspring.report import design_lines, make_console, points_table
    from ngspring.runstate import read_run

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
            return _complain("interrupted before there was anything to save", INTERRUPTED)
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


@cli.command("response", short_help="Load-displacement curve of a design.")
@click.argument("name", metavar="DESIGN")
@click.option("--from", "low", type=float, help="First displacement d in mm.")
@click.option("--to", "high", type=float, help="Last displacement d in mm.")
@click.option("--points", type=click.IntRange(min=2), default=41, show_default=True)
@_domain_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for response.csv and response.png; the design's own by default.",
)
@_threads_option
def response_command(
    name: str,
    low: float | None,
    high: float | None,
    points: int,
    domain: str | None,
    out: Path | None,
    threads: int | None,
) -> int:
    """Load-displacement curve of a design: a file, a run folder, or the name of a stored design.

    The range goes from zero to the outermost control points by default.
    """
    from ngspring.files import write_text
    from ngspring.plots import response_figure, save_figure
    from ngspring.report import response_csv, response_lines
    from ngspring.response import load_displacement
    from ngspring.states import curve_displacements

    design, path = read_design(name)
    for option, value in (("--from", low), ("--to", high)):
        if value is not None and not math.isfinite(value):
            raise ProblemError(f"{option} {value} must be a finite number")
    displacements = curve_displacements(design, low, high, points)
    response = load_displacement(design, displacements, domain, threads=threads)
    for line in response_lines(response):
        click.echo(line)
    folder = path.parent if out is None else out
    make_folder(folder)
    write_text(folder / "response.csv", response_csv(response))
    save_figure(response_figure(response, design.problem), folder / "response.png")
    if not response.complete:
        click.echo(f"incomplete: {response.message}", err=True)
        return NOT_CONVERGED
    return OK


@cli.command("show", short_help="Summary and picture of a design.")
@click.argument("name", metavar="DESIGN")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture; beside the design by default, with its name.",
)
@_threads_option
def show_command(name: str, out: Path | None, threads: int | None) -> int:
    """Summary and picture of a design: a file, a run folder, or the name of a stored design."""
    from ngspring.plots import design_figure, save_figure
    from ngspring.report import design_lines, make_console, points_table
    from ngspring.states import control_point_responses, curve_displacements, reached

    design, path = read_design(name)
    picture = path.with_suffix(".png") if out is None else out
    for line in design_lines(design):
        click.echo(line)
    responses = control_point_responses(
        design, curve_displacements(design), domain="quarter", threads=threads
    )
    forces = [reached(responses, point) for point in design.problem.control_points]
    make_console().print(points_table(design.problem, forces))
    save_figure(design_figure(design, responses, responses[0.0]), picture)
    click.echo(f"picture: {picture}")
    if None in forces:
        message = "; ".join(r.message for r in responses.values() if r.message)
        click.echo(f"incomplete: {message}", err=True)
        return NOT_CONVERGED
    return OK


@cli.command("check", short_help="Check that designs are optimal and on target.")
@click.argument("names", metavar="[DESIGN]...", nargs=-1)
@click.option("--gallery", "all_stored", is_flag=True, help="Check every stored design.")
@click.option(
    "--tolerance",
    type=float,
    default=1e-6,
    show_default=True,
    help="Largest residual of Eq. 8 relative to its terms.",
)
@_threads_option
def check_command(
    names: tuple[str, ...], all_stored: bool, tolerance: float, threads: int | None
) -> int:
    """Check that designs are stationary points and meet their targets within 0.1 %.

    Everything is computed anew from the design field. Control points with an offset of chi
    (eta) are shown, but need not be met.
    """
    from ngspring.report import add_check, check_table, make_console
    from ngspring.stationarity import optimality
    from ngspring.stored import gallery

    if not tolerance > 0:
        raise ProblemError(f"--tolerance {tolerance} must be positive")
    designs = [(name, read_design(name)[0]) for name in names]
    if all_stored:
        designs += list(gallery.items())
    if not designs:
        raise click.UsageError(
            "there are no stored designs" if all_stored else "name a design, or use --gallery"
        )
    table = check_table()
    passed = True
    for name, design in designs:
        try:
            outcome: Any = optimality(design, threads=threads)
        except ConvergenceError as error:
            outcome = str(error)
        passed &= add_check(table, name, design, outcome, tolerance)
    make_console().print(table)
    return OK if passed else FAILED


@cli.command("bench", short_help="Time a coupled Newton iteration here.")
@click.option("--elements", type=int, default=80, show_default=True)
@click.option("--domain", type=click.Choice(DOMAINS), default="quarter", show_default=True)
@click.option("--control-points", type=int, default=3, show_default=True)
@_threads_option
@_solver_option
@click.option("--repeat", type=click.IntRange(min=1), default=5, show_default=True)
def bench_command(
    elements: int,
    domain: str,
    control_points: int,
    threads: int | None,
    solver: str,
    repeat: int,
) -> int:
    """Time the parts of a coupled Newton iteration on this machine."""
    from ngspring.bench import bench_problem, benchmark
    from ngspring.report import bench_table, make_console

    problem = bench_problem(elements, control_points, domain)
    result = benchmark(problem, threads=threads, solver=solver, repeat=repeat)
    make_console().print(bench_table(problem, result))
    return OK


for _command in (
    materials_command,
    targets_command,
    campaign_command,
    stability_command,
    verify_command,
    tolerance_command,
    export_command,
    watch_command,
    animate_command,
):
    cli.add_command(_command)


def main() -> None:
    """Entry point of the console script."""
    cli.main(prog_name="ngspring")

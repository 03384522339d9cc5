"""The command line, ``ngspring``.

Modules that need NGSolve or matplotlib are imported inside the commands that use them, so that
``ngspring --help`` and ``ngspring cases`` answer at once.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from ngspring import __version__
from ngspring.basics.errors import ConvergenceError, NgspringError
from ngspring.cli.animate import animate_command
from ngspring.cli.campaign import campaign_command
from ngspring.cli.design import check_command, response_command, show_command
from ngspring.cli.optimize import optimize_command
from ngspring.cli.options import (
    BAD_INPUT,
    INTERRUPTED,
    NOT_CONVERGED,
    OK,
    complain,
    solver_option,
    threads_option,
)
from ngspring.cli.stability import stability_command
from ngspring.cli.targets import materials_command, targets_command
from ngspring.cli.verify import export_command, tolerance_command, verify_command
from ngspring.cli.watch import watch_command
from ngspring.problem.cases import cases
from ngspring.problem.sector import DOMAINS


class _Commands(click.Group):
    """A group of commands whose errors are one line each, with the exit codes of this program."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        kwargs["standalone_mode"] = False
        try:
            with _terminated_as_interrupted():
                code = super().main(*args, **kwargs)
        except click.ClickException as error:
            code = complain(error.format_message(), BAD_INPUT)
        except (click.Abort, KeyboardInterrupt):
            code = complain("interrupted", INTERRUPTED)
        except NgspringError as error:
            code = complain(str(error), BAD_INPUT)
        except ConvergenceError as error:
            code = complain(str(error), NOT_CONVERGED)
        except MemoryError:
            code = complain("not enough memory: use fewer elements", BAD_INPUT)
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


class _StderrHandler(logging.Handler):
    """Writes to what is the standard error now: the live table replaces it while it is shown."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr)


def _log_to(context: click.Context, handler: logging.Handler) -> None:
    """Let a handler have what is logged until the program ends."""
    logger = logging.getLogger("ngspring")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logger.addHandler(handler)

    def stop() -> None:
        logger.removeHandler(handler)
        handler.close()

    context.find_root().call_on_close(stop)


def _verbose(context: click.Context, _: click.Parameter, value: bool) -> None:
    # Once, if it stands both before and after the command, which share what is in meta.
    if value and "verbose" not in context.meta:
        context.meta["verbose"] = True
        _log_to(context, _StderrHandler())


def _log_file(context: click.Context, _: click.Parameter, value: Path | None) -> None:
    if value is None:
        return
    try:
        _log_to(context, logging.FileHandler(value, encoding="utf-8"))
    except OSError as error:
        raise NgspringError(f"cannot write the log file {value}: {error.strerror}") from error


#: They may stand before a command or among its options.
_LOGGING = (
    click.Option(
        ["-v", "--verbose"],
        is_flag=True,
        expose_value=False,
        callback=_verbose,
        help="Say on stderr what goes on inside.",
    ),
    click.Option(
        ["--log-file"],
        type=click.Path(path_type=Path),
        expose_value=False,
        callback=_log_file,
        help="Write the same into a file.",
    ),
)


@click.group(
    cls=_Commands, invoke_without_command=True, context_settings={"max_content_width": 100}
)
@click.version_option(__version__, prog_name="ngspring", message="%(prog)s %(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """Design springs with a prescribed nonlinear load-displacement curve.

    Exit codes: 0 done (also when --max-updates ended a run), 1 a check failed, 2 bad input, 3 no
    convergence, 130 interrupted.
    """
    logger = logging.getLogger("ngspring")
    level = logger.level
    logger.setLevel(logging.INFO)
    context.call_on_close(lambda: logger.setLevel(level))
    # Without any handler Python would print warnings that the commands report themselves.
    _log_to(context, logging.NullHandler())
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


# -- commands --------------------------------------------------------------------------------------


@cli.command("cases")
def show_cases() -> None:
    """List the cases of the paper, and which have a stored design."""
    from ngspring.cli.tables import cases_table, make_console
    from ngspring.design.gallery import gallery

    make_console().print(cases_table(cases, list(gallery)))


@cli.command("bench", short_help="Time a coupled Newton iteration here.")
@click.option("--elements", type=int, default=80, show_default=True)
@click.option("--domain", type=click.Choice(list(DOMAINS)), default="quarter", show_default=True)
@click.option("--control-points", type=int, default=3, show_default=True)
@threads_option
@solver_option
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
    from ngspring.cli.tables import bench_table, make_console
    from ngspring.kkt.bench import bench_problem, benchmark

    problem = bench_problem(elements, control_points, domain)
    result = benchmark(problem, threads=threads, solver=solver, repeat=repeat)
    make_console().print(bench_table(problem, result))
    return OK


for _command in (
    optimize_command,
    response_command,
    show_command,
    check_command,
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
for _command in (cli, *cli.commands.values()):
    _command.params.extend(_LOGGING)


def main() -> None:
    """Entry point of the console script."""
    cli.main(prog_name="ngspring")

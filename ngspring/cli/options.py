"""What the commands share: exit codes, the line for an error, and options of the same meaning."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from ngspring.basics.errors import NgspringError
from ngspring.problem.sector import DOMAINS

OK, FAILED, BAD_INPUT, NOT_CONVERGED, UNSOUND = 0, 1, 2, 3, 4

Command = TypeVar("Command", bound=Callable[..., Any])


def complain(message: str, code: int) -> int:
    """Say in one line on stderr what is wrong, and hand the exit code on."""
    click.echo(f"ngspring: error: {' '.join(message.split())}", err=True)
    return code


def incomplete(message: str) -> int:
    """Say on stderr why a result is not all that was asked for; the exit code."""
    click.echo(f"incomplete: {message}", err=True)
    return NOT_CONVERGED


def unsound(flaw: str) -> int:
    """Say on stderr why a design is no part, if it is none; the exit code."""
    if not flaw:
        return OK
    click.echo(f"converged, but {flaw}: try more elements and a smaller l_i", err=True)
    return UNSOUND


domain_option = click.option(
    "--domain",
    type=click.Choice(list(DOMAINS)),
    help="Part of the spring that is analysed, instead of the problem's own.",
)
anywhere_option = click.option(
    "--targets-anywhere",
    is_flag=True,
    help="Let the targets of a TOML file be outside of its folder.",
)
threads_option = click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Threads to use; all available ones by default.",
)
solver_option = click.option(
    "--solver",
    type=click.Choice(["auto", "sparsecholesky", "pardiso"]),
    default="auto",
    show_default=True,
    help="Linear solver; auto takes pardiso if it is installed.",
)
offset_option = click.option(
    "--offset",
    type=float,
    default=0.0,
    show_default=True,
    help="Move the surface outwards by this many mm on average first.",
)
across_option = click.option(
    "--elements-across",
    type=click.IntRange(min=1),
    default=4,
    show_default=True,
    help="Fewest elements across a wall.",
)
results_option = click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results; the design's own by default.",
)


def points_option(default: int) -> Callable[[Command], Command]:
    """``--points N``: displacements on the load path."""
    return click.option(
        "--points",
        type=click.IntRange(min=2),
        default=default,
        show_default=True,
        help="Displacements between the outermost control points (which are added, and zero).",
    )


# -- logging, before a command or among its options ------------------------------------------------


class _StderrHandler(logging.Handler):
    """Writes to what is the standard error now: the live table replaces it while it is shown."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr)


def log_to(context: click.Context, handler: logging.Handler) -> None:
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
        log_to(context, _StderrHandler())


def _log_file(context: click.Context, _: click.Parameter, value: Path | None) -> None:
    if value is None:
        return
    try:
        log_to(context, logging.FileHandler(value, encoding="utf-8"))
    except OSError as error:
        raise NgspringError(f"cannot write the log file {value}: {error.strerror}") from error


LOGGING = (
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

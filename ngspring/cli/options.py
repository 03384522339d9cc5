"""What the commands share: exit codes, the line for an error, and options of the same meaning."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from ngspring.basics.checks import printable, shown
from ngspring.basics.errors import NgspringError
from ngspring.basics.files import holds_archive
from ngspring.problem.imperfection import ODD_IN
from ngspring.problem.sector import DOMAINS

#: Displacements that an analysis is asked for.
MOST_POINTS = 10_000

OK, FAILED, BAD_INPUT, NOT_CONVERGED, UNSOUND = 0, 1, 2, 3, 4

#: Characters of a line that says what is wrong.
_LONGEST_LINE = 300

Command = TypeVar("Command", bound=Callable[..., Any])


def complain(message: str, code: int) -> int:
    """Say in one short line on stderr what is wrong, and hand the exit code on."""
    click.echo(printable(f"ngspring: error: {message}", _LONGEST_LINE), err=True)
    return code


def incomplete(message: str) -> int:
    """Say on stderr why a result is not all that was asked for; the exit code."""
    click.echo(printable(f"incomplete: {message}", _LONGEST_LINE), err=True)
    return NOT_CONVERGED


def unsound(flaw: str, advice: str = "try more elements and a smaller l_i") -> int:
    """Say on stderr why a design is no part, if it is none, and what to try; the exit code."""
    if not flaw:
        return OK
    click.echo(f"converged, but {flaw}: {advice}", err=True)
    return UNSOUND


class Finite(click.types.FloatParamType):
    """A finite number."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number that a text stands for, or a click.BadParameter."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{shown(value)} is not a finite number", param, ctx)
        return number


class FiniteRange(click.FloatRange, Finite):
    """A finite number between bounds, which NaN would slip through."""


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


def odd_in_option(option: str) -> Callable[[Command], Command]:
    """--odd-in, which belongs to an option that moves surfaces."""
    return click.option(
        "--odd-in",
        type=click.Choice(ODD_IN),
        help=f"With {option}: in which axes the pattern of the moves is odd, so which symmetries it"
        " breaks.  [default: xy; y in a body of revolution]",
    )


offset_option = click.option(
    "--offset",
    type=Finite(),
    default=0.0,
    show_default=True,
    help="Move the surface outwards by this many mm on average first.",
)
across_option = click.option(
    "--elements-across",
    type=click.IntRange(min=1, max=100),
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
        type=click.IntRange(min=2, max=MOST_POINTS),
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
    logger = logging.getLogger()
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
        if holds_archive(value):
            raise NgspringError(f"cannot write the log file {value}: it holds a design or the like")
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

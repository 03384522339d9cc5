"""What the commands share: exit codes, the line for an error, and options of the same meaning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from ngspring.problem.sector import DOMAINS

OK, FAILED, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
SOLVERS = ("auto", "sparsecholesky", "pardiso")

Command = TypeVar("Command", bound=Callable[..., Any])


def complain(message: str, code: int) -> int:
    """Say in one line on stderr what is wrong, and hand the exit code on."""
    click.echo(f"ngspring: error: {' '.join(message.split())}", err=True)
    return code


def domain_option(command: Command) -> Command:
    """``--domain quarter|full``; None means the problem's own."""
    text = "Part of the spring that is analysed, instead of the problem's own."
    return click.option("--domain", type=click.Choice(list(DOMAINS)), help=text)(command)


def threads_option(command: Command) -> Command:
    """``--threads N``; None means all that are available."""
    text = "Threads to use; all available ones by default."
    return click.option("--threads", type=click.IntRange(min=1), help=text)(command)


def solver_option(command: Command) -> Command:
    """``--solver``, the linear solver."""
    text = "Linear solver; auto takes pardiso if it is installed."
    option = click.option(
        "--solver", type=click.Choice(SOLVERS), default="auto", show_default=True, help=text
    )
    return option(command)

"""The command line, ``ngspring``.

A command's module is imported when that command is wanted, so that ``ngspring --help`` answers at
once and the modules import what they need at their top.
"""

from __future__ import annotations

import importlib
import logging
import sys
from typing import Any

import click

from ngspring.basics.errors import ConvergenceError, NgspringError
from ngspring.basics.quiet import warnings_logged
from ngspring.basics.version import __version__
from ngspring.cli.options import (
    BAD_INPUT,
    LOGGING,
    NOT_CONVERGED,
    OK,
    complain,
)
from ngspring.cli.signals import INTERRUPTED, leaving_at_once, terminated_as_interrupted
from ngspring.cli.streams import tolerant_streams

#: Each command with its short help. The command ``name`` is ``name_command`` in ``name.py`` here.
COMMANDS = {
    "animate": "Film of a design's deformation or evolution.",
    "bench": "Time a Newton iteration or a whole run here.",
    "campaign": "Compute the runs listed in a TOML file.",
    "cases": "List the cases of the paper, and which have a stored design.",
    "check": "Check that designs are optimal and on target.",
    "family": "Designs between two sets of targets, to pick one from.",
    "fit": "Law of a material from its tests.",
    "export": "Drawing, solid or mesh for a workshop.",
    "materials": "List common elastomers with their hardness and Young's modulus.",
    "optimize": "Design a spring for a case or a TOML file.",
    "response": "Load-displacement curve of a design.",
    "show": "Summary and picture of a design.",
    "stability": "Does a design buckle out of its symmetry?",
    "targets": "Check a target curve, and make a problem of it.",
    "tolerance": "What moved surfaces do to the curve.",
    "verify": "Remodel a design with real contact and compare.",
    "watch": "Report of a run as an HTML file, while it goes on.",
}


class _LazyGroup(click.Group):
    """The group of `COMMANDS`, whose errors are one line each, with the exit codes of this program.

    After "Lazily Loading Subcommands" of click's documentation.
    """

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        command = super().get_command(context, name)
        if command is not None and command.callback is None:
            with leaving_at_once():
                module = importlib.import_module(f"ngspring.cli.{name}")
            command = getattr(module, f"{name}_command")
            command.short_help = COMMANDS[name]
            command.params.extend(LOGGING)
            self.add_command(command)
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(sorted(COMMANDS.items()))

    def main(self, *args: Any, **kwargs: Any) -> Any:
        with tolerant_streams():
            code = self._outcome(*args, **kwargs, standalone_mode=False)
        sys.exit(code)

    def _outcome(self, *args: Any, **kwargs: Any) -> int:
        """The exit code; what went wrong is said."""
        try:
            with warnings_logged(), terminated_as_interrupted():
                return super().main(*args, **kwargs) or OK
        except click.ClickException as error:
            return complain(error.format_message(), BAD_INPUT)
        except (click.Abort, KeyboardInterrupt):
            return complain("interrupted", INTERRUPTED)
        except NgspringError as error:
            return complain(str(error), BAD_INPUT)
        except ConvergenceError as error:
            return complain(str(error), NOT_CONVERGED)
        except MemoryError:
            return complain("not enough memory: use fewer elements", BAD_INPUT)


@click.group(
    cls=_LazyGroup, invoke_without_command=True, context_settings={"max_content_width": 100}
)
@click.version_option(__version__, prog_name="ngspring", message="%(prog)s %(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """Design springs with a prescribed nonlinear load-displacement curve.

    Exit codes: 0 done (also when --max-updates ended a run), 1 a check failed, 2 bad input, 3 no
    convergence, 4 converged to what is no part (not connected, or held by grey), 130 interrupted.
    """
    logger = logging.getLogger("ngspring")
    level = logger.level
    logger.setLevel(logging.INFO)
    context.call_on_close(lambda: logger.setLevel(level))
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


cli.params.extend(LOGGING)
for _name, _help in COMMANDS.items():
    # Known by name, for click's suggestions; the group puts the real one in its place.
    cli.add_command(click.Command(_name, short_help=_help))

"""Commands are found by their names in one table, and loaded when they are wanted."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import click
import pytest
from support.commands import environment, invoke

import ngspring.cli
from ngspring.cli.main import COMMANDS, cli


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_of_the_table_is_the_function_of_that_name(name: str) -> None:
    context = click.Context(cli)
    command = cli.get_command(context, name)
    assert command is not None
    assert command is cli.get_command(context, name)
    assert command.name == name
    assert command.callback is not None
    assert command.help
    # Once each, however often it was asked for.
    assert [p.name for p in command.params].count("verbose") == 1
    assert [p.name for p in command.params].count("log_file") == 1


def test_every_file_with_a_command_is_in_the_table() -> None:
    files = Path(ngspring.cli.__file__).parent.glob("*.py")
    commands = {path.stem for path in files if f"def {path.stem}_command(" in path.read_text()}
    assert commands == set(COMMANDS)


def test_the_help_names_every_command_in_a_line_of_its_own() -> None:
    lines = [" ".join(line.split()) for line in invoke("--help").stdout.splitlines()]
    first = lines.index("Commands:") + 1
    assert lines[first:] == [f"{name} {COMMANDS[name]}" for name in sorted(COMMANDS)]


def test_the_help_loads_no_command() -> None:
    code = (
        "import sys\nfrom ngspring.cli.main import COMMANDS, cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "sys.exit(any(f'ngspring.cli.{name}' in sys.modules for name in COMMANDS))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr

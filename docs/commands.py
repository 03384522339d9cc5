"""The command reference, docs/commands.md, from what every command says with ``--help``.

python docs/commands.py
"""

from __future__ import annotations

from pathlib import Path

import click

from ngspring.cli.main import cli

PAGE = Path(__file__).with_name("commands.md")

_HEAD = """\
# Commands

What `ngspring --help` and `ngspring COMMAND --help` say. This page is made by
`python docs/commands.py`; [the guide](guide.md) tells which command serves what.
"""


def help_of(command: click.Command, name: str, parent: click.Context | None = None) -> str:
    """What a command says with ``--help``, 80 columns wide wherever this runs."""
    with click.Context(
        command, info_name=name, parent=parent, terminal_width=80, max_content_width=80
    ) as context:
        return f"```text\n{command.get_help(context).rstrip()}\n```\n"


def text() -> str:
    """The whole page."""
    context = click.Context(cli, info_name="ngspring")
    parts = [_HEAD, help_of(cli, "ngspring")]
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        assert command is not None
        parts.append(f"## {name}\n\n{help_of(command, name, context)}")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")

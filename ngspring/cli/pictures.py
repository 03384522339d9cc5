"""Pictures of commands: one that fails costs nothing but itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ngspring.basics.errors import NgspringError
from ngspring.basics.files import attempt
from ngspring.view.figure import save_figure


def write_pictures(pictures: dict[Path, Callable[[], Any]]) -> list[str]:
    """Draw and write pictures; why one could not be drawn is a line on stderr.

    Parameters
    ----------
    pictures : dict
        What draws the picture of a path, a figure.

    Returns
    -------
    list of str
        Names of the files that were written.

    Raises
    ------
    NgspringError
        If a file cannot be written, or its suffix is none of a picture.
    """

    def draw(path: Path) -> None:
        save_figure(pictures[path](), path)

    written = []
    for path in pictures:
        reason = attempt(path, draw, NgspringError)
        if reason:
            click.echo(reason, err=True)
        else:
            written.append(path.name)
    return written

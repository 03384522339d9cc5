"""Pictures of commands: one that fails costs nothing but itself."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ngspring.basics.checks import printable
from ngspring.basics.errors import NgspringError
from ngspring.view.figure import save_figure

logger = logging.getLogger(__name__)


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
    written = []
    for path, draw in pictures.items():
        try:
            save_figure(draw(), path)
            written.append(path.name)
        except NgspringError:
            raise
        except Exception as error:  # matplotlib may raise anything
            logger.warning("%s was not written", path, exc_info=True)
            click.echo(printable(f"not written: {path.name}: {error}", 300), err=True)
    return written

"""Keeping the warnings of Python and of libraries off the standard error of a program."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator


@contextlib.contextmanager
def warnings_logged() -> Iterator[None]:
    """Within it, warnings are logged, and nothing is printed that no handler of a log asks for."""
    root, silent = logging.getLogger(), logging.NullHandler()
    # Without any handler logging prints warnings itself, and how writing to one has failed.
    root.addHandler(silent)
    before, logging.raiseExceptions = logging.raiseExceptions, False
    logging.captureWarnings(True)
    try:
        yield
    finally:
        logging.captureWarnings(False)
        logging.raiseExceptions = before
        root.removeHandler(silent)

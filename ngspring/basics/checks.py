"""Checks of what a user gives, and how a refusal is worded."""

from __future__ import annotations

import difflib
import math
import numbers
from collections.abc import Iterable
from typing import Any

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ProblemError

_LONGEST_SHOWN = 80


def shown(value: object) -> str:
    """Return `value` as it appears in an error message: one line of at most 80 characters."""
    try:
        text = repr(value)
    except Exception:  # Python refuses to print integers of more than 4300 digits
        text = f"<{type(value).__name__}>"
    text = " ".join(line.strip() for line in text.splitlines())
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."


def printable(text: str, most: int) -> str:
    """Return `text` as one line that a terminal shows and does not obey.

    What cannot be printed, such as escape sequences, becomes a question mark, and the middle of
    more than `most` characters an ellipsis.
    """
    line = " ".join(text.split())
    if len(line) > most:
        line = f"{line[: most // 2]} ... {line[len(line) - (most - most // 2 - 5) :]}"
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def nearest(word: str, choices: Iterable[str]) -> str:
    """Return the one of `choices` that is spelled most like `word`, whatever the case."""
    folded = {choice.casefold(): choice for choice in choices}
    return folded[difflib.get_close_matches(word.casefold(), folded, n=1, cutoff=0.0)[0]]


def refused(field: str, value: object, right: str) -> ProblemError:
    """The error for a value of a field, with what would be right."""
    return ProblemError(f"{field} = {shown(value)} is not valid: it must be {right}")


def finite_number(field: str, value: object) -> float:
    """Return `value` as a float.

    Raises
    ------
    ProblemError
        If it is not a finite number; the message names `field`.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise refused(field, value, "a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise refused(field, value, "a finite number")
    return number


def real_array(what: str, values: Any) -> FloatArray:
    """Return a copy of `values` as an array of floats.

    Raises
    ------
    ProblemError
        If they are not finite real numbers; the message names `what`.
    """
    try:
        given = np.asarray(values)
    except ValueError:  # rows of different lengths
        given = np.empty(0, dtype=object)
    if given.dtype.kind not in "fiu" or not np.isfinite(given).all():
        raise ProblemError(f"{what} must be finite real numbers")
    return given.astype(float)


def positive_number(field: str, value: object) -> float:
    """Return `value` as a float.

    Raises
    ------
    ProblemError
        If it is not a positive finite number; the message names `field`.
    """
    number = finite_number(field, value)
    if number <= 0.0:
        raise refused(field, number, "positive")
    return number


def choice(field: str, value: object, choices: tuple[str, ...]) -> str:
    """Return `value` if it is one of `choices`.

    Raises
    ------
    ProblemError
        If it is not; the message names the nearest one.
    """
    right = " or ".join(map(repr, choices))
    if not isinstance(value, str):
        raise refused(field, value, right)
    if value not in choices:
        raise refused(field, value, f"{right} (did you mean {nearest(value, choices)!r}?)")
    return value

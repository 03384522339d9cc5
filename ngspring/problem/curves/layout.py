"""Tables of numbers in text, whatever program and country it comes from.

A file may begin with lines about the test, name its separator (``sep=;``), have its units in a row
of their own, comments with ``#`` or ``%`` (the last of which is the header where there is no
other), and hold several tables, one below the other.

The csv module splits the lines. Reading them with pandas would not make this any shorter: it would
have to be told where the header is, what separates the columns and how decimals are written, which
is what all of this finds out, and it turns what should be refused (``1,000``) into numbers.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import LARGEST, FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.curves.heading import Heading, is_unit

#: How a file that cannot be read should be written.
REMEDY = "save it as CSV with a header such as d [mm];q [N] and numbers only below"

MOST_LINES = 300_000

_SEPARATORS = (";", "\t", ",", " ")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|[+-]?inf(inity)?", re.IGNORECASE)
_TIME = re.compile(r"\d+(:\d+)+(\.\d+)?")
_COMMENT = re.compile(r"(#+|%+(?!\s*[;,\t]))\s*")
_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


@dataclass(frozen=True)
class _Line:
    number: int
    text: str
    comment: bool = False


@dataclass(frozen=True)
class Table:
    """Rows of numbers, as text, below a header.

    Attributes
    ----------
    header : tuple of str
        A name per column; empty if there is no header.
    lines : tuple of int
        Numbers of the rows' lines in the file.
    rows : tuple of tuple of str
    """

    header: tuple[str, ...]
    lines: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]

    def numbers(self, columns: Sequence[int]) -> FloatArray:
        """Some of the columns, (rows, columns); rows in which all of them are empty are left out.

        Raises
        ------
        ProblemError
            If a field is no finite number, or cannot be read without guessing.
        """
        _check_decimal_commas([text for row in self.rows for text in row])
        values = []
        for line, row in zip(self.lines, self.rows, strict=True):
            fields = [row[k] if k < len(row) else "" for k in columns]
            if not any(fields):
                continue
            try:
                numbers = [float(text.replace(",", ".")) for text in fields]
            except ValueError:
                raise ProblemError(
                    f"line {line}: not all fields of the columns {_places(columns)} are numbers;"
                    f" {REMEDY}"
                ) from None
            if not all(abs(number) < LARGEST for number in numbers):
                raise ProblemError(
                    f"line {line}: {shown(' '.join(fields))} are not finite numbers, or too large:"
                    " leave the row out"
                )
            values.append(numbers)
        if not values:
            raise ProblemError(f"the columns {_places(columns)} have no rows of numbers")
        found = np.array(values)
        return np.where(np.abs(found) < 1.0 / LARGEST, 0.0, found)


def _places(columns: Sequence[int]) -> str:
    return " and ".join(str(k + 1) for k in columns)


def read_tables(text: str) -> tuple[list[Table], int]:
    """The tables of a text that have a header, or the only one if it has none.

    Returns
    -------
    list of Table
    int
        How many rows of numbers before the first header were left out.

    Raises
    ------
    ProblemError
        If there is none, or there are other lines between its rows. As the text may be that of
        any file, the message does not show a line of it that is not one of numbers.
    """
    text, separator = _declared_separator(text.replace("\N{MINUS SIGN}", "-"))
    tables: list[Table] = []
    skipped: list[Table] = []
    errors: list[ProblemError] = []
    for texts, rows in _blocks(text):
        try:
            table = _table(texts, rows, separator)
        except ProblemError as error:
            if tables or (skipped and not errors):
                raise _unreadable(texts, error) from None
            errors.append(error)
            continue
        (tables if table.header else skipped).append(table)
    if not tables and errors:
        raise errors[-1]
    if not tables and not skipped:
        raise ProblemError(f"the file has no rows of numbers: {REMEDY}")
    if tables:
        return tables, sum(len(table.rows) for table in skipped)
    return skipped, 0


def _unreadable(texts: Sequence[_Line], error: ProblemError) -> ProblemError:
    """The error for lines between rows or below them that are no header."""
    if not texts:
        return error
    return ProblemError(
        f"line {texts[0].number} below the first row has fields that are not numbers: correct it or"
        " leave it out"
    )


def _declared_separator(text: str) -> tuple[str, str | None]:
    """The text without the line ``sep=;`` that spreadsheets understand, and what it says."""
    first, end, rest = text.partition("\n")
    match = re.fullmatch(r'"?sep=(.)"?\r?', first.lstrip("\ufeff"), re.IGNORECASE)
    # An empty line in its place, so that lines keep their numbers.
    return (f"{end}{rest}", match[1]) if match else (text, None)


def _blocks(text: str) -> Iterator[tuple[list[_Line], list[_Line]]]:
    """Lines of text and the rows of numbers that follow them, again and again."""
    texts: list[_Line] = []
    comments: list[_Line] = []
    rows: list[_Line] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if number > MOST_LINES:
            raise ProblemError(
                f"the file has more than {MOST_LINES} lines: keep, for example, every tenth row"
            )
        plain = line.strip()
        comment = _COMMENT.match(plain)
        if comment:
            comments.append(_Line(number, plain[comment.end() :], comment=True))
        elif _is_row(plain):
            if not texts and not rows:
                # Without any other header the comments above the first row may be one.
                texts, comments = [c for c in comments if c.text], []
            rows.append(_Line(number, line))
        elif plain.strip(';,"'):
            if rows:
                yield texts, rows
                texts, rows = [], []
            texts.append(_Line(number, line))
    if texts or rows:
        yield texts, rows


def _is_row(line: str) -> bool:
    """Whether a line holds numbers (and times of day) only."""
    fields = [field for field in re.split(r'[;,\s"]+', line) if field]
    return bool(fields) and all(_NUMBER.fullmatch(f) or _TIME.fullmatch(f) for f in fields)


def _table(texts: Sequence[_Line], rows: Sequence[_Line], declared: str | None) -> Table:
    if not rows:
        raise ProblemError(f"the file has no rows of numbers below a header: {REMEDY}")
    separator = declared or _separator([row.text for row in rows])
    fields = [tuple(_split(row.text, separator)) for row in rows]
    width = max(map(len, fields))
    header = _header(texts, separator, width)
    for row, values in zip(rows, fields, strict=True):
        if len(values) != len(fields[0]) and (separator == " " or not header):
            raise ProblemError(
                f"line {row.number} has {len(values)} columns, but the first row has"
                f" {len(fields[0])}"
            )
    if not header and width != 2:
        raise ProblemError(
            f"the rows have {width} columns but no header says what they are: begin with a line"
            " such as d [mm];q [N] (decimal commas need semicolons between columns)"
        )
    return Table(header, tuple(row.number for row in rows), tuple(fields))


def _header(texts: Sequence[_Line], separator: str, width: int) -> tuple[str, ...]:
    """The names above rows of this width, units included; empty if there are none.

    Raises
    ------
    ProblemError
        If the last line of text, unless it is a comment, is no header.
    """
    if not texts:
        return ()
    last = texts[-1]
    names = _names(last.text, separator, width)
    if len(texts) > 1 and _are_units(names):
        names = _with_units(_names(texts[-2].text, separator, width), names)
    fits = len(names) == width or (len(names) > width and separator != " ")
    headings = [Heading.of(name, numbered=True) for name in names]
    if fits and any(h.kind or h.kind_of_unit or h.has_other_measure for h in headings):
        return tuple(names)
    if last.comment:
        return ()
    if fits:
        raise ProblemError(
            f"line {last.number}: none of its {len(names)} columns is named d (or displacement) and"
            " q (or force), or strain and stress; write for example d [mm];q [N]"
        )
    raise ProblemError(
        f"the header has {len(names)} columns but the rows have {width} (decimal commas need"
        " semicolons between columns)"
    )


def _names(line: str, separator: str, width: int) -> list[str]:
    """The fields of a header, which may be separated in another way than the rows."""
    for other in (separator, *_SEPARATORS):
        names = _split(line, other)
        if len(names) == width:
            return names
    names = re.split(r"\s{2,}", line.strip())
    return names if len(names) == width else _split(line, separator)


def _are_units(names: Sequence[str]) -> bool:
    """Whether a row below the header holds the units: all in brackets, or two that are known."""
    given = [name for name in names if name]
    bracketed = all(re.fullmatch(r"[\[(].*[\])]", name) for name in given)
    return bracketed or sum(map(is_unit, given)) >= 2


def _with_units(names: Sequence[str], units: list[str]) -> list[str]:
    if len(names) < len(units):
        return units
    bare = [unit.strip("[]() ") for unit in units] + [""] * (len(names) - len(units))
    return [f"{n} [{unit}]" if unit else n for n, unit in zip(names, bare, strict=True)]


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        # A blank between a name and its unit separates nothing.
        return re.sub(r"\s+(?=[\[(])|\s*(/)\s*", r"\1", line.replace('"', " ")).split()
    try:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        raise ProblemError(f"the file is not CSV: {error}; {REMEDY}") from error
    parts = [field.strip() for field in fields]
    while len(parts) > 1 and not parts[-1]:
        parts.pop()
    return parts


def _separator(lines: Sequence[str]) -> str:
    """The separator by which all rows have the same number of at least two readable fields."""
    for separator in _SEPARATORS:
        fields = [_split(line, separator) for line in lines]
        pattern = r"[\d.,:eE+-]*|[+-]?nan|[+-]?inf(inity)?"
        if separator == ",":
            pattern = pattern.replace(",", "", 1)
        readable = all(re.fullmatch(pattern, field, re.I) for row in fields for field in row)
        if len(fields[0]) >= 2 and readable and len({len(row) for row in fields}) == 1:
            return separator
    for separator in _SEPARATORS:
        if all(separator in line.strip() for line in lines):
            return separator
    raise ProblemError(
        f"{shown(lines[0])} is not a row of two numbers: write d and q with a comma, a semicolon, a"
        " tab or a blank between them"
    )


def _check_decimal_commas(texts: Sequence[str]) -> None:
    """Refuse what may be a decimal comma or a thousands separator."""
    numbers = [text for text in texts if ":" not in text]
    with_comma = [text for text in numbers if "," in text]
    if not with_comma:
        return
    example = shown(with_comma[0])
    if any("." in text for text in numbers) or any(text.count(",") > 1 for text in with_comma):
        raise ProblemError(
            f"{example}: commas and points are mixed, or a number has two commas; write numbers"
            " without thousands separators"
        )
    if all(_GROUPS.fullmatch(text) for text in with_comma):
        raise ProblemError(
            f"{example} may be a decimal comma or a thousands separator: write it with a point"
        )

"""Numbers out of a CSV file, whatever program and country it comes from.

Fields may be separated by semicolons, tabs, commas or blanks; decimals may have a comma where that
cannot be mistaken; lines that begin with ``#`` are comments. A header names the columns and may
give a unit, ``d [mm]``, ``force (kN)``, ``F / N`` or ``d_mm``; where the name is not known the unit
tells.
Without a header the first column is d in mm and the second q in N. A name may also tell in which
direction the test went, ``compression [mm]``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError

_NEWTON_PER_POUND = 4.4482216152605

#: Factors to mm, N, MPa and 1.
UNITS: dict[str, dict[str, float]] = {
    "d": {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "in": 25.4},
    "q": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "lbf": _NEWTON_PER_POUND, "kgf": 9.80665},
    "strain": {"-": 1.0, "1": 1.0, "": 1.0, "mm/mm": 1.0, "%": 0.01},
    "stress": {
        "MPa": 1.0,
        "N/mm^2": 1.0,
        "N/mm2": 1.0,
        "N/mm²": 1.0,
        "kPa": 1e-3,
        "Pa": 1e-6,
        "GPa": 1e3,
        "bar": 0.1,
        "psi": _NEWTON_PER_POUND / 25.4**2,
    },
}

#: Names of the columns that are understood, in lower case.
NAMES: dict[str, str] = {
    **dict.fromkeys(("d", "displacement", "deflection", "travel", "extension"), "d"),
    **dict.fromkeys(("q", "force", "load", "reaction", "f"), "q"),
    **dict.fromkeys(("strain", "epsilon", "ε"), "strain"),
    **dict.fromkeys(("stress", "sigma", "σ"), "stress"),
}

#: Parts of names, in lower case, of columns that count compression, or tension, as positive.
_COMPRESSION = ("compress", "crush", "druck", "stauch")
_TENSION = ("tens", "exten", "elong", "stretch", "zug", "dehn")

_HEADER = re.compile(r"\s*(?P<name>[^\[\](),/]*?)\s*(?:[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])])?\s*")
#: ``name / unit`` as in ISO 80000, and ``name_unit``.
_HEADER_WITH_SLASH = re.compile(
    r"(?P<name>[^/\[\](),]*[^/\[\](),\s])(?P<slash>\s*/\s*)[(\[]?(?P<unit>[^\[\]()]+?)[)\]]?"
)
_HEADER_WITH_UNDERSCORE = re.compile(r"(?P<name>[^/\[\](),]+)_(?P<unit>[^_\[\]()\s]+)")
_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_EXAMPLE = "write for example d [mm];q [N]"


@dataclass(frozen=True, eq=False)
class Columns:
    """Two columns of numbers.

    Attributes
    ----------
    x, y : arrays
        Displacements in mm and forces in N, or strains and stresses in MPa.
    stress : bool
        Whether they are strains and stresses.
    remarks : tuple of str
        What was assumed.
    compression, tension : str
        The column whose name says that the test was one in compression, or in tension; empty if
        none does.
    """

    x: FloatArray
    y: FloatArray
    stress: bool
    remarks: tuple[str, ...]
    compression: str = ""
    tension: str = ""


def parse_columns(text: str) -> Columns:
    """Displacement and force, or strain and stress, from CSV text.

    Raises
    ------
    ProblemError
        If the text has no such columns, or a number cannot be read without guessing.
    """
    lines = [
        (number, line.strip())
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise ProblemError("the file has no rows of numbers")
    header = lines[0][1] if _is_header(lines[0][1]) else None
    rows = lines if header is None else lines[1:]
    if not rows:
        raise ProblemError("the file has a header but no rows of numbers")
    separator = _separator([line for _, line in rows])
    table = _numbers(rows, separator)
    if header is None:
        if table.shape[1] != 2:
            raise ProblemError(
                f"the rows have {table.shape[1]} columns but no header says what they are: begin"
                " with a line such as d [mm];q [N] (decimal commas need semicolons between columns)"
            )
        remark = "no header: the first column is taken as d in mm, the second as q in N"
        return Columns(table[:, 0], table[:, 1], False, (remark,))
    names = _split(header, separator)
    if len(names) != table.shape[1]:
        raise ProblemError(
            f"the header has {len(names)} columns but the rows have {table.shape[1]}"
            " (decimal commas need semicolons between columns)"
        )
    return _named(names, table)


def _named(names: Sequence[str], table: FloatArray) -> Columns:
    columns = [_Heading.of(text) for text in names]
    found: dict[str, FloatArray] = {}
    texts: dict[str, str] = {}
    remarks = []
    by_unit = [c.kind_of_unit for c in columns if not c.kind]
    for k, column in enumerate(columns):
        kind = column.kind
        if not kind and by_unit.count(column.kind_of_unit) == 1:
            # A name in another language; its unit tells what it is.
            kind = column.kind_of_unit
            if kind in [c.kind for c in columns]:
                continue
            if kind:
                remarks.append(f"column {column.text!r} is taken as {kind}, by its unit")
        if not kind:
            continue
        if kind in found:
            raise ProblemError(f"two columns are named like {kind!r}: {', '.join(names)}")
        unit = column.unit
        if unit is None:
            unit = next(iter(UNITS[kind]))
            remarks.append(f"column {column.text!r} has no unit: taken as [{unit}]")
        if unit not in UNITS[kind]:
            right = ", ".join(u for u in UNITS[kind] if u)
            raise ProblemError(
                f"unit {shown(unit)} of column {column.text!r} is not one of {right}"
            )
        found[kind] = table[:, k] * UNITS[kind][unit]
        texts[kind] = column.text
    for pair in (("d", "q"), ("strain", "stress")):
        if all(kind in found for kind in pair):
            used = [texts[kind] for kind in pair]
            return Columns(
                found[pair[0]],
                found[pair[1]],
                "stress" in pair,
                tuple(remarks),
                compression=_first_with(_COMPRESSION, used),
                tension=_first_with(_TENSION, used),
            )
    missing = {"d": "q", "q": "d", "strain": "stress", "stress": "strain"}
    for kind in found:
        raise ProblemError(
            f"there is a column for {kind} but none for {missing[kind]}: {', '.join(names)};"
            f" {_EXAMPLE}"
        )
    raise ProblemError(
        f"none of the columns {', '.join(names)} is named d (or displacement) and q (or force), or"
        f" strain and stress; {_EXAMPLE}"
    )


def _kind_of_name(name: str) -> str:
    """The kind of quantity that has this name; empty if it is not known."""
    # "compressive force" is a force.
    return NAMES.get(re.sub(r"^compress\w*[\s_]+(?=\w)", "", name.casefold()), "")


def _ends_with_unit(name: str) -> bool:
    """Whether the last word of a name is a unit, where it is not a known name as F and d are."""
    word = name.split()[-1]
    return word.casefold() not in NAMES and any(word in units for units in UNITS.values())


def _first_with(parts: Sequence[str], names: Sequence[str]) -> str:
    """The first name that contains one of the parts; empty if none does."""
    return next((name for name in names if any(part in name.casefold() for part in parts)), "")


@dataclass(frozen=True)
class _Heading:
    """A column's name, unit (None if it has none) and kind (empty if the name is not known)."""

    text: str
    kind: str
    unit: str | None

    @classmethod
    def of(cls, text: str) -> _Heading:
        text = text.strip().strip('"')
        for name, unit in cls._with_unit(text):
            heading = cls(text, _kind_of_name(name), unit)
            if unit in UNITS.get(heading.kind or heading.kind_of_unit, {}):
                return heading
        match = _HEADER.fullmatch(text)
        if match is None:
            return cls(text, "", None)
        name, unit = match["name"], match["unit"]
        if unit is None and name.casefold() == "compression":
            return cls(text, "d", None)
        return cls(text, _kind_of_name(name), unit)

    @staticmethod
    def _with_unit(text: str) -> Iterator[tuple[str, str]]:
        """Names and units without brackets, if these are what they may be."""
        match = _HEADER_WITH_SLASH.fullmatch(text)
        # "N/mm" and "rate mm/s" are units themselves.
        if match and (match["slash"] != "/" or not _ends_with_unit(match["name"])):
            yield match["name"], match["unit"]
        match = _HEADER_WITH_UNDERSCORE.fullmatch(text)
        # The number of "d_1" is no unit.
        if match and match["unit"] not in ("1", "-"):
            yield match["name"].strip(), match["unit"]

    @property
    def kind_of_unit(self) -> str:
        """The kind of quantity that is measured in this unit; empty if there is none or several."""
        kinds = [kind for kind, units in UNITS.items() if self.unit and self.unit in units]
        return kinds[0] if len(kinds) == 1 else ""


# -- text to numbers -------------------------------------------------------------------------------


def _is_header(line: str) -> bool:
    """Whether a line has letters other than those of numbers (1e-3, nan, inf)."""
    words = re.findall(r"[^\W\d_]+", line)
    return any(word.casefold() not in ("e", "nan", "inf", "infinity") for word in words)


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        # A blank between a name and its unit separates nothing.
        return re.sub(r"\s+(?=[\[(])|\s*(/)\s*", r"\1", line).split()
    parts = [part.strip() for part in line.split(separator)]
    while len(parts) > 1 and not parts[-1]:
        parts.pop()
    return parts


def _separator(lines: Sequence[str]) -> str:
    """The separator by which all rows have the same number of at least two readable fields."""
    for separator in (";", "\t", ",", " "):
        fields = [_split(line, separator) for line in lines]
        pattern = r"[+-]?[\d.,eE+-]+|nan|[+-]?inf" if separator != "," else r"[+-]?[\d.eE+-]+|nan"
        readable = all(re.fullmatch(pattern, field, re.I) for row in fields for field in row)
        if len(fields[0]) >= 2 and readable and len({len(row) for row in fields}) == 1:
            return separator
    for separator in (";", "\t", ",", " "):
        if all(len(_split(line, separator)) >= 2 for line in lines):
            return separator
    raise ProblemError(
        f"{shown(lines[0])} is not a row of two numbers: write d and q with a comma, a semicolon, a"
        " tab or a blank between them"
    )


def _numbers(rows: Sequence[tuple[int, str]], separator: str) -> FloatArray:
    fields = [(number, _split(line, separator)) for number, line in rows]
    with_comma = [text for _, row in fields for text in row if "," in text]
    if with_comma:
        _check_decimal_commas(with_comma, [text for _, row in fields for text in row])
    table = []
    for number, row in fields:
        if len(row) != len(fields[0][1]):
            raise ProblemError(
                f"line {number} has {len(row)} columns, but the first row has {len(fields[0][1])}"
            )
        try:
            values = [float(text.strip('"').replace(",", ".")) for text in row]
        except ValueError:
            raise ProblemError(f"line {number}: {shown(' '.join(row))} are not numbers") from None
        if not all(map(math.isfinite, values)):
            raise ProblemError(f"line {number}: {shown(' '.join(row))} are not finite numbers")
        table.append(values)
    return np.array(table)


def _check_decimal_commas(with_comma: Sequence[str], everything: Sequence[str]) -> None:
    """Refuse what may be a decimal comma or a thousands separator."""
    example = shown(with_comma[0])
    if any("." in text for text in everything) or any(text.count(",") > 1 for text in with_comma):
        raise ProblemError(
            f"{example}: commas and points are mixed, or a number has two commas; write numbers"
            " without thousands separators"
        )
    if all(_GROUPS.fullmatch(text) for text in with_comma):
        raise ProblemError(
            f"{example} may be a decimal comma or a thousands separator: write it with a point"
        )

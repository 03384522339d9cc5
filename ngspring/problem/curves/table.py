"""Displacement and force, or strain and stress, out of a CSV file.

How the file is laid out is found by `ngspring.problem.curves.layout`, what its headings mean by
`ngspring.problem.curves.heading`. A header names the columns and may give a unit, ``d [mm]``,
``force (kN)``, ``F / N`` or ``d_mm``; where the name is not known the unit tells. Without a header
the first column is d in mm and the second q in N. A name may also tell in which direction the test
went, ``compression [mm]``, or that stress and strain are true ones or a stretch, which are
converted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import choice, shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.curves.heading import UNITS, Heading
from ngspring.problem.curves.layout import Table, read_tables

#: Pairs of quantities that make a curve, by what they are called.
QUANTITIES = {"force": ("d", "q"), "stress": ("strain", "stress")}

#: Parts of names, in lower case, of columns that count compression, or tension, as positive.
_COMPRESSION = ("compress", "crush", "druck", "stauch")
_TENSION = ("tens", "exten", "elong", "stretch", "zug", "dehn")

_EXAMPLE = "write for example d [mm];q [N]"


@dataclass(frozen=True, eq=False)
class Columns:
    """Two columns of numbers.

    Attributes
    ----------
    x, y : arrays
        Displacements in mm and forces in N, or strains and nominal stresses in MPa, in the order of
        the file.
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


@dataclass(frozen=True)
class _Pair:
    """Where the two columns of a specimen are."""

    table: Table
    headings: tuple[Heading, Heading]
    columns: tuple[int, int]


def parse_columns(
    text: str,
    specimen: int | None = None,
    quantities: str | None = None,
    header_needed: str = "",
) -> Columns:
    """Displacement and force, or strain and stress, from CSV text.

    Parameters
    ----------
    text : str
    specimen : int, optional
        Which of several specimens, from 1, side by side or one below the other.
    quantities : {"force", "stress"}, optional
        Which to take if there are both: force and displacement by default.
    header_needed : str
        An example of a header, if it must not be missing: then stress and strain are preferred.

    Raises
    ------
    ProblemError
        If the text has no such columns, several specimens of which none is chosen, or a number that
        cannot be read without guessing.
    """
    tables, skipped = read_tables(text)
    remarks = []
    if skipped:
        remarks.append(f"{skipped} rows of numbers before the header are left out")
    if not tables[0].header and header_needed:
        raise ProblemError(
            f"no header says what the columns are: begin with a line such as {header_needed}"
        )
    if not tables[0].header:
        chosen_specimen(specimen, 1)
        x, y = tables[0].numbers((0, 1)).T
        remarks.append("no header: the first column is taken as d in mm, the second as q in N")
        return Columns(x, y, False, tuple(remarks))
    found = [_pairs(table) for table in tables]
    if header_needed and all(pairs.get("stress") for pairs in found):
        quantities = "stress"
    kind = _kind_of_curve(found, quantities, remarks)
    pairs = [pair for each in found for pair in each[kind]]
    pair = pairs[chosen_specimen(specimen, len(pairs))]
    x, y = (column for column in pair.table.numbers(pair.columns).T)
    x, y = (
        values * _factor(heading, remarks)
        for values, heading in zip((x, y), pair.headings, strict=True)
    )
    if kind == "stress":
        x, y = _nominal(x, y, pair.headings, remarks)
    texts = [heading.text for heading in pair.headings]
    return Columns(
        x,
        y,
        kind == "stress",
        tuple(remarks),
        compression=_first_with(_COMPRESSION, texts),
        tension=_first_with(_TENSION, texts),
    )


def chosen_specimen(specimen: int | None, count: int) -> int:
    """Index of the chosen one of several curves in a file.

    Raises
    ------
    ProblemError
        If none is chosen, or there is none of this number.
    """
    if specimen is None and count > 1:
        raise ProblemError(
            f"the file holds {count} curves (specimens): choose one with --specimen 1 to {count}"
            " (specimen = 1 in TOML and Python)"
        )
    if specimen is not None and not 1 <= specimen <= count:
        raise ProblemError(f"there is no specimen {shown(specimen)}: the file holds {count}")
    return (specimen or 1) - 1


def _kind_of_curve(
    found: Sequence[dict[str, list[_Pair]]], quantities: str | None, remarks: list[str]
) -> str:
    """Whether force or stress is taken, of the pairs found in each table."""
    there = [kind for kind in QUANTITIES if all(pairs.get(kind) for pairs in found)]
    if quantities is not None:
        if choice("quantities", quantities, tuple(QUANTITIES)) not in there:
            x, y = QUANTITIES[quantities]
            raise ProblemError(f"quantities = {quantities!r}, but there are no columns {x} and {y}")
        return quantities
    if len(there) == 2:
        remarks.append(
            "the file has displacement and force as well as strain and stress: displacement and"
            " force are taken as they are, for a spring as large as the specimen;"
            " --quantities stress takes the others"
        )
    if not there:
        raise ProblemError("not every table of the file has the same kind of columns")
    return there[0]


def _pairs(table: Table) -> dict[str, list[_Pair]]:
    """The columns that belong together, by kind of curve; one pair for each specimen.

    Raises
    ------
    ProblemError
        If there is no pair, or more than one column could be meant.
    """
    for numbered in (False, True):
        headings = [Heading.of(text, numbered) for text in table.header]
        by_name = {kind: [k for k, h in enumerate(headings) if h.kind == kind] for kind in UNITS}
        nominal = {kind: _nominal_ones(headings, found) for kind, found in by_name.items()}
        places = {kind: found or _by_unit(headings, kind) for kind, found in nominal.items()}
        pairs = {
            kind: _paired(table, headings, places[x], places[y])
            for kind, (x, y) in QUANTITIES.items()
            if places[x] and places[y]
        }
        if pairs:
            return pairs
    raise _no_pair(headings, {kind for kind in places if places[kind]})


def _nominal_ones(headings: Sequence[Heading], places: list[int]) -> list[int]:
    """Columns of a quantity without the true ones, where a file has both."""
    return [k for k in places if headings[k].measure != "true"] or places


def _by_unit(headings: Sequence[Heading], kind: str) -> list[int]:
    """Columns in another language, whose unit tells what they are, if they have one name."""
    places = [k for k, h in enumerate(headings) if not h.kind and h.kind_of_unit == kind]
    return places if len({headings[k].name for k in places}) == 1 else []


def _paired(
    table: Table, headings: Sequence[Heading], x: Sequence[int], y: Sequence[int]
) -> list[_Pair]:
    count = max(len(x), len(y))
    same_names = all(len({headings[k].name for k in places}) == 1 for places in (x, y))
    if len(y) < count or len(x) not in (1, count) or not same_names:
        twice = x if len(x) > 1 else y
        names = ", ".join(headings[k].text for k in twice)
        raise ProblemError(
            f"two columns are named like {headings[twice[0]].kind!r}: {shown(names)}; leave all but"
            " one out"
        )
    return [
        _Pair(table, (headings[i], headings[j]), (i, j))
        for i, j in zip(x if len(x) == count else [*x] * count, y, strict=True)
    ]


def _no_pair(headings: Sequence[Heading], kinds: set[str]) -> ProblemError:
    """The error for a header without a pair of columns; it shows only names that are known."""
    for heading in headings:
        if not heading.kind and heading.has_other_measure:
            return ProblemError(
                f"column {shown(heading.text)} is neither nominal nor true: convert it to nominal"
                " strain and stress"
            )
    missing = {"d": "q", "q": "d", "strain": "stress", "stress": "strain"}
    for kind in UNITS:
        if kind in kinds:
            return ProblemError(
                f"there is a column for {kind} but none for {missing[kind]} among the"
                f" {len(headings)} columns; {_EXAMPLE}"
            )
    return ProblemError(
        f"none of the {len(headings)} columns is named d (or displacement) and q (or force), or"
        f" strain and stress; {_EXAMPLE}"
    )


def _factor(heading: Heading, remarks: list[str]) -> float:
    """The factor of a column's unit; what was assumed is added to the remarks."""
    kind = heading.kind or heading.kind_of_unit
    if not heading.kind:
        remarks.append(f"column {shown(heading.text)} is taken as {kind}, by its unit")
    unit = heading.unit
    if unit is None:
        unit = next(iter(UNITS[kind]))
        remarks.append(f"column {shown(heading.text)} has no unit: taken as [{unit}]")
    allowed = UNITS[kind] if heading.measure != "stretch" else {"-": 1.0, "1": 1.0, "": 1.0}
    if unit not in allowed:
        right = ", ".join(u for u in allowed if u)
        raise ProblemError(
            f"unit {shown(unit)} of column {shown(heading.text)} is not one of {right}"
        )
    return allowed[unit]


def _nominal(
    strain: FloatArray, stress: FloatArray, headings: tuple[Heading, Heading], remarks: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Nominal strain and stress from stretch, true strain, or true stress."""
    of_x, of_y = headings
    if of_x.measure == "stretch":
        strain = strain - 1.0
        remarks.append(f"column {shown(of_x.text)} is a stretch: strain = stretch - 1")
    if of_x.measure == "true":
        strain = np.expm1(strain)
        remarks.append(f"column {shown(of_x.text)} is converted to nominal: exp(strain) - 1")
    if (strain <= -1.0).any() or not np.isfinite(strain).all():
        raise ProblemError(
            f"column {shown(of_x.text)} goes beyond what is possible: nominal strain is above -1"
            " (a stretch above 0); is it in %?"
        )
    if of_y.measure == "true":
        stress = stress / (1.0 + strain)
        remarks.append(
            f"column {shown(of_y.text)} is converted to nominal: divided by the stretch, as if the"
            " volume stayed the same"
        )
    return strain, stress


def _first_with(parts: Sequence[str], names: Sequence[str]) -> str:
    """The first name that contains one of the parts; empty if none does."""
    return next((name for name in names if any(part in name.casefold() for part in parts)), "")

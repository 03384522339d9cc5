"""Spring problems as TOML text: from text to the fields of a problem, and back.

Every field of `ngspring.SpringProblem` is a key, and every control point a table::

    name = "C4"
    elements = 80

    [[control_points]]
    d = 10.0
    q = 2.0

Only `control_points`, and `d` and `q` in each of them, must be there; the rest has the defaults of
Table 1. Besides the fields a file may have

- ``E`` (MPa), ``shore_A`` or ``material`` (a name), with ``nu`` (0.4 by default), instead of ``K``
  and ``G``, see `ngspring.problem.material`; ``material`` may also be a table, a law with its
  parameters, or the name of a file beside this one that has such a table,
  ``material = "material.toml"``;
- ``robust`` and ``imperfection`` (mm), which add eroded and dilated control points, and imperfect
  ones, see `ngspring.problem.offsets`;
- ``w_q``, the weight of all control points that have none of their own;
- ``targets = "curve.csv"`` instead of `control_points`, a file in the folder of the TOML file or
  below it, or a table ``targets = {file = "curve.csv", points = 4}`` or with
  ``at = [-20, -10, 10]``, and with ``compression = true`` if the file counts compression as
  positive, ``branch``, ``specimen`` and ``quantities``, see
  `ngspring.problem.curves.curve.parse_curve`.
"""

from __future__ import annotations

import dataclasses
import logging
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import tomli_w

from ngspring.basics.checks import finite_number, nearest, positive_number, refused, shown
from ngspring.basics.errors import ProblemError
from ngspring.basics.files import naming, read_text
from ngspring.problem.curves.curve import read_curve
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.laws import Law, law_from, with_material
from ngspring.problem.material import MATERIAL_KEYS
from ngspring.problem.offsets import ODD_KEY, OFFSET_KEYS, taken_offsets, with_offsets
from ngspring.problem.point import ControlPoint

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

logger = logging.getLogger(__name__)


#: A TOML file has no more characters, and none of its keys more parts with points between them.
LONGEST_TEXT, _MOST_PARTS = 1_000_000, 20
_LONG_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]+|"(?:[^"\\\n]|\\.)*"|'[^'\n]*')[ \t]*\.[ \t]*){{{_MOST_PARTS}}}"""
)

#: Keys that are not fields.
FURTHER_KEYS = (*MATERIAL_KEYS, "w_q", "targets", *OFFSET_KEYS, ODD_KEY)
#: What to take of a curve's file; handed on.
_READING_KEYS = ("compression", "branch", "specimen", "quantities")
_TARGETS_KEYS = ("file", "points", "at", *_READING_KEYS)

#: What else displacement and force of a control point are called, in lower case.
_OTHER_NAMES = {
    **dict.fromkeys(("u", "displacement", "deflection", "travel", "extension", "x"), "d"),
    **dict.fromkeys(("f", "force", "load", "reaction", "p"), "q"),
}

Parsed = TypeVar("Parsed")

#: Values by field name.
Fields: TypeAlias = dict[str, Any]
#: Height in mm and area of the loaded side in mm^2 of a spring with these fields.
SizeOf: TypeAlias = Callable[[Mapping[str, Any]], tuple[float, float]]


def write_fields(values: Fields) -> str:
    """Return the fields of a problem as TOML text that `parse_fields` turns into equal ones."""
    points = values["control_points"]
    # What is None is left out; tables come last, or what follows would belong to them.
    plain = _without_none({k: v for k, v in values.items() if k != "control_points"})
    plain = dict(sorted(plain.items(), key=lambda item: isinstance(item[1], dict)))
    # tomli_w would put short control points into one line of inline tables.
    return tomli_w.dumps(plain) + "".join(
        f"\n[[control_points]]\n{tomli_w.dumps(_without_none(point))}" for point in points
    )


def _without_none(table: Fields) -> Fields:
    """A point without an imperfection has no kind of it either."""
    without = () if table.get("eta_odd", 1.0) else ("eta_odd", "odd_in")
    return {k: value for k, value in table.items() if value is not None and k not in without}


def read(text_or_path: str | os.PathLike[str], parse: Callable[[str, Path], Parsed]) -> Parsed:
    """Hand the text of a TOML file, or a TOML text, to `parse`, with the folder it stands in.

    Parameters
    ----------
    text_or_path : str or path
        A path, or a string that names an existing file or is one line that ends with ``.toml``, is
        read as a file; any other string is TOML text.
    parse : callable

    Raises
    ------
    ProblemError
        With a message of one line, which starts with the name of the file if there is one.
    """
    if not isinstance(text_or_path, str | os.PathLike):
        raise ProblemError(f"{shown(text_or_path)} is neither TOML text nor the path of a file")
    if isinstance(text_or_path, str) and not _names_a_file(text_or_path):
        return parse(text_or_path, Path())
    path = os.fsdecode(text_or_path)
    with naming(path):
        return parse(read_text(path), Path(path).parent)


def _names_a_file(text: str) -> bool:
    one_line = len(text.splitlines()) == 1
    return os.path.isfile(text) or (one_line and text.endswith(".toml"))


def load_tables(text: str) -> dict[str, Any]:
    """Parse TOML; what is malformed, or too much, is a ProblemError of one line."""
    if len(text) > LONGEST_TEXT:
        raise ProblemError(f"not valid TOML here: more than {LONGEST_TEXT} characters")
    if _LONG_KEY.search(text):
        # The parser's memory grows with the square of the parts.
        raise ProblemError(f"not valid TOML here: a key of more than {_MOST_PARTS} parts")
    try:
        tables: dict[str, Any] = tomllib.loads(text)
    except RecursionError as error:
        raise ProblemError("not valid TOML: nested too deeply") from error
    except ValueError as error:
        # Besides TOMLDecodeError, the parser lets Python's own complaints about numbers through.
        reason = " ".join(str(error).split())
        raise ProblemError(f"not valid TOML: {reason}") from error
    return tables


def parse_fields(
    text: str,
    described: type,
    size: SizeOf,
    folder: Path | None = None,
    notes: list[str] | None = None,
    targets_anywhere: bool = False,
) -> Fields:
    """Read the fields of a problem from TOML text, never from a file of that name.

    Parameters
    ----------
    text : str
    described : dataclass
        Whose fields are the keys.
    size : callable
        Tells from the other fields what turns strain and stress of ``targets`` into d and q.
    folder : path, optional
        Where the file of ``targets`` is looked for; without it, such a key is refused.
    notes : list of str, optional
        What was assumed about ``targets`` is added; without it, it is logged.
    targets_anywhere : bool
        Whether the file of ``targets`` may be outside of the folder.
    """
    values = load_tables(text)
    _check_keys(values, described, "", FURTHER_KEYS)
    further = {key: values.pop(key) for key in FURTHER_KEYS if key in values}
    if names_material_file(further.get("material")):
        further["material"] = _law_beside(folder, further["material"])
    values = with_material({**values, **{k: further[k] for k in MATERIAL_KEYS if k in further}})
    weight = finite_number("w_q", further["w_q"]) if "w_q" in further else None
    offsets = taken_offsets(further)
    if "targets" in further:
        if "control_points" in values:
            raise ProblemError("both targets and control_points are given: give one of them")
        table = _targets_table(further["targets"])
        if folder is None:
            raise ProblemError("targets names a file, but this text does not come from a file")
        path = folder / table["file"] if targets_anywhere else _inside(folder, table["file"])
        points = _points_of_curve(path, table, size(values), weight, notes)
        return {**values, "control_points": _offset(points, values, described, offsets)}
    if "control_points" not in values:
        raise ProblemError("missing key 'control_points' (or 'targets')")
    tables = values["control_points"]
    if not isinstance(tables, list):
        raise ProblemError(
            f"control_points = {shown(tables)} is not valid: it must be [[control_points]] tables"
        )
    points = [_control_point(table, i, weight) for i, table in enumerate(tables)]
    return {**values, "control_points": _offset(points, values, described, offsets)}


def names_material_file(material: object) -> bool:
    """Whether ``material`` is the name of a file and not that of an elastomer."""
    return isinstance(material, str) and material.strip().lower().endswith(".toml")


def read_law(path: str | os.PathLike[str]) -> Law:
    """The law of a file with a ``[material]`` table and nothing else, as `ngspring fit` writes it.

    Raises
    ------
    ProblemError
        With the name of the file, if it cannot be read, has anything else, or no valid law.
    """
    name = os.fsdecode(path)
    with naming(name):
        tables = load_tables(read_text(name))
        others = [key for key in tables if key != "material"]
        if others:
            raise ProblemError(
                f"unknown key {shown(others[0])}: a file of a material has a [material] table only"
            )
        if not isinstance(tables.get("material"), dict):
            raise ProblemError("there is no [material] table in it")
        return law_from(tables["material"])


def _law_beside(folder: Path | None, name: str) -> Law:
    """The law of a file in the folder of a problem's file, or below it."""
    if folder is None:
        raise ProblemError("material names a file, but this text does not come from a file")
    return read_law(_inside(folder, name, "material"))


def _offset(
    points: Sequence[ControlPoint], values: Fields, described: type, offsets: Mapping[str, Any]
) -> Sequence[ControlPoint]:
    """The points, with those that the keys of offsets and imperfections add."""
    if not offsets:
        return points
    defaults = {field.name: field.default for field in dataclasses.fields(described)}
    l_i = positive_number("l_i", values.get("l_i", defaults["l_i"]))
    kinematics = KINEMATICS.get(str(values.get("kinematics", defaults["kinematics"])))
    axis = kinematics is not None and kinematics.axis
    return with_offsets(points, l_i, axis=axis, **offsets)


def _targets_table(described: object) -> Fields:
    """``targets`` as a table, its values checked."""
    table = {"file": described} if isinstance(described, str) else described
    right = "the name of a CSV file, or a table with file, and points or at"
    if not isinstance(table, dict) or not isinstance(table.get("file"), str):
        listed = " (points with their d and q are control_points)"
        hint = listed if isinstance(described, list) else ""
        raise ProblemError(f"targets = {shown(described)} is not valid: it must be {right}{hint}")
    for key in table:
        if key not in _TARGETS_KEYS:
            raise ProblemError(
                f"unknown key {shown(key)} in targets:"
                f" did you mean {nearest(key, _TARGETS_KEYS)!r}?"
            )
    for key in ("points", "specimen"):
        if type(table.get(key, 1)) is not int:
            raise refused(f"targets.{key}", table[key], "an integer")
    if not isinstance(table.get("at", []), list):
        raise refused("targets.at", table["at"], "a list of d in mm")
    if not isinstance(table.get("compression", False), bool):
        raise ProblemError(
            f"targets.compression = {shown(table['compression'])} must be true or false"
        )
    return table


def _inside(folder: Path, name: str, key: str = "targets") -> Path:
    """The path of a file in a folder or below it, links followed.

    Raises
    ------
    ProblemError
        If it is elsewhere: whoever opens a TOML file from others must not read what else there is.
    """
    path = folder / name
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError) as error:
        raise ProblemError(f"{key} = {shown(name)} cannot be read: {error}") from error
    if not inside:
        allowed = ", or allow it with --targets-anywhere (targets_anywhere=True in Python)"
        raise ProblemError(
            f"{key} = {shown(name)} is not in the folder of this file or below it: copy it there"
            f"{allowed if key == 'targets' else ''}"
        )
    return path


def _points_of_curve(
    path: Path,
    table: Fields,
    size: tuple[float, float],
    weight: float | None,
    notes: list[str] | None,
) -> list[ControlPoint]:
    """Control points of ``targets``, for a spring of this height and area."""
    reading = {key: table[key] for key in _READING_KEYS if key in table}
    curve = read_curve(path, *size, **reading)
    chosen = curve.control_points(table.get("points"), table.get("at"))
    for note in curve.notes(chosen):
        if notes is None:
            logger.info("%s: %s", table["file"], note)
        else:
            notes.append(note)
    return [p if weight is None else dataclasses.replace(p, weight=weight) for p in chosen]


def _control_point(table: object, i: int, weight: float | None = None) -> ControlPoint:
    where = f"control_points[{i}]"
    if not isinstance(table, dict):
        raise ProblemError(
            f"{where} = {shown(table)} is not valid: it must be a table with d and q"
        )
    _check_keys(table, ControlPoint, f" in {where}")
    try:
        return ControlPoint(**(table if weight is None else {"weight": weight, **table}))
    except ProblemError as error:
        raise ProblemError(f"{where}.{error}") from None


def _check_keys(
    table: Mapping[str, object],
    described: type,
    where: str,
    further: tuple[str, ...] = (),
) -> None:
    fields = dataclasses.fields(described)
    names = [*(field.name for field in fields), *further]
    for key in table:
        if key not in names:
            meant = nearest(key, names)
            if described is ControlPoint:
                meant = _OTHER_NAMES.get(key.casefold(), meant)
            raise ProblemError(f"unknown key {shown(key)}{where}: did you mean {meant!r}?")
    for field in fields:
        required = field.default is dataclasses.MISSING and field.name != "control_points"
        if required and field.name not in table:
            raise ProblemError(f"missing key {field.name!r}{where}")

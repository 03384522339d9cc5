"""Spring problems as TOML text.

Every field of `SpringProblem` is a key, and every control point a table::

    name = "C4"
    elements = 80

    [[control_points]]
    d = 10.0
    q = 2.0

Only `control_points`, and `d` and `q` in each of them, must be there; the rest has the defaults of
Table 1.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Mapping
from typing import Any

import tomli_w

from ngspring.errors import ProblemError
from ngspring.problem import ControlPoint, SpringProblem, nearest, shown

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def write_toml(problem: SpringProblem) -> str:
    """Return `problem` as TOML text that `read_toml` turns into an equal problem."""
    values = dataclasses.asdict(problem)
    points = values.pop("control_points")
    # tomli_w would put short control points into one line of inline tables.
    return tomli_w.dumps(values) + "".join(
        f"\n[[control_points]]\n{tomli_w.dumps(point)}" for point in points
    )


def read_toml(text_or_path: str | os.PathLike[str]) -> SpringProblem:
    """Return the problem that a TOML file or a TOML text describes.

    Parameters
    ----------
    text_or_path : str or path
        A path, or a string that names an existing file or is one line that ends with ``.toml``, is
        read as a file; any other string is TOML text.

    Raises
    ------
    ProblemError
        With a message of one line, which starts with the name of the file if there is one.
    """
    if not isinstance(text_or_path, str | os.PathLike):
        raise ProblemError(f"{shown(text_or_path)} is neither TOML text nor the path of a file")
    if isinstance(text_or_path, str) and not _names_a_file(text_or_path):
        return parse_toml(text_or_path)
    path = os.fsdecode(text_or_path)
    try:
        return parse_toml(read_text(path))
    except ProblemError as error:
        raise ProblemError(f"{path!r}: {error}") from error.__cause__


def _names_a_file(text: str) -> bool:
    one_line = len(text.splitlines()) == 1
    return os.path.isfile(text) or (one_line and text.endswith(".toml"))


def read_text(path: str) -> str:
    """Content of a UTF-8 text file; what is wrong with it is a ProblemError of one line."""
    try:
        with open(path, "rb") as file:
            # Some editors begin UTF-8 files with a byte order mark, which TOML does not allow.
            return file.read().decode("utf-8-sig")
    except OSError as error:
        raise ProblemError(f"the file cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ProblemError(
            f"the file cannot be read, it is not UTF-8 text: byte {error.start} is wrong"
        ) from error
    except ValueError as error:
        raise ProblemError(f"the file cannot be read: {error}") from error


def load_tables(text: str) -> dict[str, Any]:
    """Parse TOML; what is malformed is a ProblemError of one line."""
    try:
        tables: dict[str, Any] = tomllib.loads(text)
    except RecursionError as error:
        raise ProblemError("not valid TOML: nested too deeply") from error
    except ValueError as error:
        # Besides TOMLDecodeError, the parser lets Python's own complaints about numbers through.
        reason = " ".join(str(error).split())
        raise ProblemError(f"not valid TOML: {reason}") from error
    return tables


def parse_toml(text: str) -> SpringProblem:
    """Read a problem from TOML text, never from a file of that name."""
    values = load_tables(text)
    _check_keys(values, SpringProblem, "")
    tables = values["control_points"]
    if not isinstance(tables, list):
        raise ProblemError(
            f"control_points = {shown(tables)} is not valid: it must be [[control_points]] tables"
        )
    points = [_control_point(table, i) for i, table in enumerate(tables)]
    return SpringProblem(**{**values, "control_points": points})


def _control_point(table: object, i: int) -> ControlPoint:
    where = f"control_points[{i}]"
    if not isinstance(table, dict):
        raise ProblemError(
            f"{where} = {shown(table)} is not valid: it must be a table with d and q"
        )
    _check_keys(table, ControlPoint, f" in {where}")
    try:
        return ControlPoint(**table)
    except ProblemError as error:
        raise ProblemError(f"{where}.{error}") from None


def _check_keys(
    table: Mapping[str, object], described: type[SpringProblem] | type[ControlPoint], where: str
) -> None:
    fields = dataclasses.fields(described)
    names = [field.name for field in fields]
    for key in table:
        if key not in names:
            raise ProblemError(
                f"unknown key {shown(key)}{where}: did you mean {nearest(key, names)!r}?"
            )
    for field in fields:
        if field.default is dataclasses.MISSING and field.name not in table:
            raise ProblemError(f"missing key {field.name!r}{where}")

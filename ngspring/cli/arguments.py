"""What the arguments of the command line stand for."""

from __future__ import annotations

import difflib
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from ngspring.basics.checks import shown
from ngspring.basics.errors import DesignFileError, ProblemError, RunFolderError
from ngspring.problem.cases import cases, get_case
from ngspring.problem.spring import SpringProblem

if TYPE_CHECKING:
    from ngspring.basics.arrays import FloatArray
    from ngspring.design.design import Design


#: How the names of files with curves end.
_CURVES = (".csv", ".tsv", ".svg")


def read_problem(text: str) -> tuple[SpringProblem, str]:
    """The case of this name, or the problem in a TOML file, and a name for its run folder.

    Raises
    ------
    ProblemError
        If there is no such case, or the file is not in order.
    """
    path = Path(text)
    if path.suffix.lower() in _CURVES:
        raise ProblemError(
            f"{shown(text)} is no problem in TOML: a curve first becomes a problem:"
            f" ngspring targets {shlex.quote(text)} --write mine.toml"
        )
    is_case = text.strip().upper() in cases
    if not is_case and (path.suffix.lower() == ".toml" or path.parent != Path() or path.is_file()):
        problem = SpringProblem.from_toml(path)
        return (problem if problem.name else problem.replace(name=path.stem)), path.stem
    problem = get_case(text)
    return problem, problem.name


def read_start(problem: SpringProblem, text: str, seed: int) -> tuple[Design, str]:
    """The design to start from, and its name for the notes.

    Raises
    ------
    DesignFileError
        If a design is named that cannot be read.
    """
    from ngspring.design.design import Design
    from ngspring.design.gallery import UnknownDesignError, gallery
    from ngspring.evolution.folder import read_design

    if text == "column":
        return Design.column(problem), text
    if text == "random":
        return Design.random(problem, seed), f"random, seed {seed}"
    try:
        return read_design(text)[0], f"design {text}"
    except UnknownDesignError:
        close = difflib.get_close_matches(text, ("column", "random", *gallery), n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise DesignFileError(
            f"there is no stored design {shown(text)} for --initial{hint}: it must be column,"
            " random, a design's file or run folder, or the name of a stored design"
        ) from None


def displacements_between(
    design: Design, low: float | None = None, high: float | None = None, points: int = 41
) -> FloatArray:
    """Evenly spaced displacements in mm for ``--from``, ``--to`` and ``--points``.

    Raises
    ------
    ProblemError
        If an end is not a finite number.
    """
    from ngspring.analysis.states import curve_displacements

    for option, value in (("--from", low), ("--to", high)):
        if value is not None and not math.isfinite(value):
            raise ProblemError(f"{option} {value} must be a finite number")
    return curve_displacements(design, low, high, points)


def make_folder(folder: Path) -> None:
    """Make a folder with those above it.

    Raises
    ------
    RunFolderError
        If that cannot be done.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot make the folder {folder}: {error.strerror}") from error

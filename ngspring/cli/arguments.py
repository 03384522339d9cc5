"""What the arguments of the command line stand for."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path

from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError, RunFolderError
from ngspring.problem.cases import cases, get_case
from ngspring.problem.spring import SpringProblem

#: How the names of files with curves end.
_CURVES = (".csv", ".tsv", ".svg")


def read_problem(
    text: str, notes: list[str] | None = None, targets_anywhere: bool = False
) -> tuple[SpringProblem, str]:
    """The case of this name, or the problem in a TOML file, and a name for its run folder.

    See `SpringProblem.from_toml` for ``notes`` and ``targets_anywhere``.

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
    if not is_case and (
        path.suffix.lower() == ".toml" or path.parent != Path() or os.path.isfile(path)
    ):
        problem = SpringProblem.from_toml(path, notes=notes, targets_anywhere=targets_anywhere)
        return (problem if problem.name else problem.replace(name=path.stem)), path.stem
    problem = get_case(text)
    return problem, problem.name


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


def results_folder(path: Path, out: Path | None) -> Path:
    """The folder of a design's file, or the one that is asked for instead, which is made.

    Raises
    ------
    RunFolderError
        If that cannot be done.
    """
    folder = path.parent if out is None else out
    make_folder(folder)
    return folder


def command_line(words: Iterable[str], options: Mapping[str, object]) -> str:
    """A command of ngspring for the user's shell, without the options that are None or False."""
    texts: list[object] = ["ngspring", *words]
    for option, value in options.items():
        if value is not None and value is not False:
            texts += [option] if value is True else [option, value]
    return shlex.join(map(str, texts))


def check_writable(out: Path) -> None:
    """Raise ProblemError unless a new TOML file can have this name."""
    if out.suffix.lower() != ".toml":
        raise ProblemError(f"--write {out} must end with .toml")
    if os.path.exists(out):
        raise ProblemError(f"{out} exists already: choose another name, or remove it first")
    if not os.path.isdir(out.parent):
        raise ProblemError(
            f"--write {out} is not possible: there is no folder {out.parent}, make it first"
        )

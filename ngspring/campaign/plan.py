"""A campaign: many runs with their starts and parameter variations, described by a TOML file.

Every run is a table; its keys other than ``case`` or ``file`` are optional::

    [[run]]
    case = "C6"                     # or file = "own.toml", beside the campaign file

    [[run]]
    case = "C7"
    name = "C7-continued"           # also its folder; the case's or the file's name by default
    start = "run:C6"                # "column", "random", "design:PATH" or "run:NAME"
    elements = 40                   # a coarser mesh widens l_i, as `ngspring optimize` does
    dt_initial = 0.1
    max_updates = 300
    ladder = false                  # no coarse meshes before this one
    part = true                     # until its solid goes through the targets
    changes = {k_rho = [1e-8, 2e-8], p = 6.0}

A list in ``changes`` gives one run per value, with a suffix such as ``-k_rho=2e-08`` to its name,
and several lists all their combinations. ``seed`` belongs to ``start = "random"``;
``robust = false`` leaves out the control points with an offset eta (Appendix A);
``offsets = {robust = 0.2, imperfection = 0.2}`` adds some, see `ngspring.problem.offsets`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from ngspring.basics.checks import nearest, printable, shown
from ngspring.basics.errors import NgspringError, ProblemError
from ngspring.basics.files import naming, read_text
from ngspring.design.notes import LONGEST_NOTE
from ngspring.problem.cases import get_case
from ngspring.problem.offsets import ODD_KEY, OFFSET_KEYS, taken_offsets
from ngspring.problem.scaling import on_mesh
from ngspring.problem.spring import SpringProblem
from ngspring.problem.toml import load_tables

#: Keys of the file itself, and of a [[run]] table.
TOP = ("run",)
KEYS = (
    "case",
    "file",
    "name",
    "start",
    "seed",
    "elements",
    "dt_initial",
    "max_updates",
    "ladder",
    "part",
    "changes",
    "robust",
    "offsets",
)
#: Those of its tables ``offsets`` and ``changes``.
OFFSETS = (*OFFSET_KEYS, ODD_KEY)
FIELDS = tuple(field.name for field in dataclasses.fields(SpringProblem))
STARTS = ("column", "random", "design:PATH", "run:NAME")
MOST_RUNS = 10_000
LONGEST_NAME = 200
RESERVED = ("results.csv", "results.json", "report.html")


@dataclass(frozen=True)
class Run:
    """One run of a campaign.

    Parameters
    ----------
    name : str
        Name of the run and of its folder.
    problem : SpringProblem
    start : str
        ``"column"``, ``"random"``, ``"design:PATH"`` (a file, a run folder or the name of a stored
        design) or ``"run:NAME"`` (the final design of that run of the same campaign).
    seed : int, optional
        Seed of the random start; 0 by default.
    dt_initial : float, optional
        First pseudo-time step.
    max_updates : int, optional
        Stop after this many design updates.
    ladder : bool
        Whether coarse meshes come first (`ngspring.evolution.ladder`).
    part : bool
        Whether the design is corrected until its solid goes through the targets
        (`ngspring.realise`).
    folder : str
        What the path of a start's design is relative to; the working directory by default.

    Raises
    ------
    ProblemError
        If a value has the wrong type or is out of range.
    """

    name: str
    problem: SpringProblem
    start: str = "column"
    seed: int | None = None
    dt_initial: float | None = None
    max_updates: int | None = None
    ladder: bool = True
    part: bool = False
    folder: str = ""

    def __post_init__(self) -> None:
        _check_name(self.name)
        kind, _, what = self.start.partition(":") if isinstance(self.start, str) else ("", "", "")
        if self.start not in ("column", "random") and not (kind in ("design", "run") and what):
            raise ProblemError(
                f"start = {shown(self.start)} is not valid: it must be {', '.join(STARTS[:-1])}"
                f" or {STARTS[-1]}"
            )
        if self.seed is not None:
            if self.start != "random":
                raise ProblemError('seed belongs to start = "random"')
            if not _is_integer(self.seed) or self.seed < 0:
                raise ProblemError(f"seed = {shown(self.seed)} must be an integer of at least 0")
        dt = self.dt_initial
        if dt is not None and not (_is_number(dt) and 0 < dt < math.inf):
            raise ProblemError(f"dt_initial = {shown(dt)} must be a positive number")
        updates = self.max_updates
        if updates is not None and (not _is_integer(updates) or updates < 1):
            raise ProblemError(f"max_updates = {shown(updates)} must be an integer of at least 1")
        for name in ("ladder", "part"):
            value = getattr(self, name)
            if not isinstance(value, bool):
                raise ProblemError(f"{name} = {shown(value)} must be true or false")

    @property
    def after(self) -> str | None:
        """Name of the run whose final design is the start."""
        return self.start[4:] if self.start.startswith("run:") else None

    @property
    def design(self) -> str | None:
        """The design that is the start: a path or the name of a stored design."""
        if not self.start.startswith("design:"):
            return None
        text = self.start[len("design:") :]
        path = Path(text)
        if path.suffix or path.parent != Path() or os.path.exists(Path(self.folder, path)):
            return str(Path(self.folder, path))
        return text

    @property
    def start_name(self) -> str:
        """Name of the start in the design's notes."""
        if self.start == "random":
            return f"random, seed {self.seed or 0}"
        return printable(self.start.replace(":", " ", 1), LONGEST_NOTE)


@dataclass(frozen=True)
class Campaign:
    """Runs with different names, in the order of the file.

    Raises
    ------
    ProblemError
        If there are none, two have the same name, or one continues from a run that does not
        exist or that waits for it.
    """

    runs: tuple[Run, ...]

    def __post_init__(self) -> None:
        if not self.runs:
            raise ProblemError("a campaign needs at least one [[run]]")
        names: dict[str, str] = {}
        for run in self.runs:
            # Some file systems do not tell upper from lower case.
            folded = run.name.casefold()
            if folded in names:
                raise ProblemError(
                    f"two runs would share a folder, {shown(names[folded])} and"
                    f" {shown(run.name)}: give each a name of its own"
                )
            names[folded] = run.name
        graph = {run.name: [run.after] if run.after else [] for run in self.runs}
        for run in self.runs:
            if run.after and run.after not in graph:
                raise ProblemError(
                    f"run {shown(run.name)} continues from {shown(run.after)}, which is not a run"
                    f" of this campaign: did you mean {nearest(run.after, graph)!r}?"
                )
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            circle = " -> ".join(error.args[1])
            raise ProblemError(f"runs continue from each other in a circle: {circle}") from None


def read_campaign(path: str | os.PathLike[str]) -> Campaign:
    """Read a campaign file; the paths in it are relative to its folder.

    Raises
    ------
    ProblemError
        With a message of one line, which starts with the name of the file.
    """
    name = os.fspath(path)
    with naming(name):
        return parse_campaign(read_text(name), Path(name).parent, name)


def parse_campaign(text: str, folder: Path = Path(), file: str = "FILE.toml") -> Campaign:
    """Read a campaign from TOML text; the paths in it are relative to ``folder``.

    Parameters
    ----------
    text : str
    folder : path
    file : str
        What the text's file is called in the advice of an error.

    Raises
    ------
    ProblemError
        With a message of one line.
    """
    values = load_tables(text)
    if "run" not in values and ("control_points" in values or "targets" in values):
        raise ProblemError(
            f"this is a problem, not a campaign: ngspring optimize {shlex.quote(file)}"
        )
    _check_keys(values, TOP)
    tables = values.get("run", [])
    if not isinstance(tables, list):
        raise ProblemError(f"run = {shown(tables)} is not valid: it must be [[run]] tables")
    runs: list[Run] = []
    for i, table in enumerate(tables):
        where = f"run[{i}]"
        if not isinstance(table, dict):
            raise ProblemError(f"{where} = {shown(table)} is not valid: it must be a table")
        try:
            runs += _runs(table, folder)
        except NgspringError as error:
            raise ProblemError(f"{where}: {error}") from None
        if len(runs) > MOST_RUNS:
            raise ProblemError(f"more than {MOST_RUNS} runs: divide the campaign")
    return Campaign(tuple(runs))


# -- one table -------------------------------------------------------------------------------------


def _runs(table: Mapping[str, Any], folder: Path) -> Iterator[Run]:
    """The runs that a [[run]] table stands for."""
    _check_keys(table, KEYS)
    problem, name = _problem(table, folder)
    if "name" in table:
        name = table["name"]
        _check_name(name)
    start = table.get("start", "column")
    names = ("seed", "dt_initial", "max_updates", "ladder", "part")
    options = {key: table[key] for key in names if key in table}
    if isinstance(start, str) and start.startswith("design:"):
        options["folder"] = str(folder)
    for suffix, varied in _variations(problem, table):
        yield Run(name + suffix, varied, start, **options)


def _problem(table: Mapping[str, Any], folder: Path) -> tuple[SpringProblem, str]:
    """The problem without its changes, and the run's default name."""
    if ("case" in table) == ("file" in table):
        raise ProblemError('give either case = "C4" or file = "own.toml"')
    if "case" in table:
        problem = get_case(table["case"])
        name = problem.name
    else:
        if not isinstance(table["file"], str):
            raise ProblemError(f"file = {shown(table['file'])} must be the path of a TOML file")
        path = folder / table["file"]
        problem, name = SpringProblem.from_toml(path), path.stem
        problem = problem if problem.name else problem.replace(name=name)
    robust = table.get("robust", True)
    if not isinstance(robust, bool):
        raise ProblemError(f"robust = {shown(robust)} must be true or false")
    if not robust:
        points = [point for point in problem.control_points if point.own]
        problem = problem.replace(control_points=points)
    if "elements" in table:
        problem = on_mesh(problem, table["elements"])[0]
    return _with_offsets(problem, table.get("offsets", {})), name


def _with_offsets(problem: SpringProblem, given: object) -> SpringProblem:
    """The problem with what a run's table ``offsets`` adds."""
    if not isinstance(given, dict):
        raise ProblemError(f"offsets = {shown(given)} must be a table of {', '.join(OFFSETS)}")
    if not given:
        return problem
    _check_keys(given, OFFSETS)
    return problem.with_offsets(**taken_offsets(given))


def _variations(
    problem: SpringProblem, table: Mapping[str, Any]
) -> Iterator[tuple[str, SpringProblem]]:
    """The problem with each combination of the listed changes, and what tells it in the name."""
    changes = table.get("changes", {})
    if not isinstance(changes, dict):
        raise ProblemError(f"changes = {shown(changes)} must be a table of problem parameters")
    if "control_points" in changes:
        raise ProblemError("changes cannot hold control_points: describe the problem in a file")
    try:
        _check_keys(changes, FIELDS)
    except ProblemError as error:
        raise ProblemError(f"in changes: {error}") from None
    if "elements" in changes and "elements" in table:
        raise ProblemError("elements is given twice, in the run and in its changes")
    lists = [value if isinstance(value, list) else [value] for value in changes.values()]
    if math.prod(map(len, lists)) > MOST_RUNS:
        raise ProblemError(f"changes stand for more than {MOST_RUNS} runs")
    for key, values in zip(changes, lists, strict=True):
        if not values:
            raise ProblemError(f"changes.{key} = [] must hold at least one value")
    for combination in itertools.product(*lists):
        try:
            varied = problem.replace(**dict(zip(changes, combination, strict=True)))
        except ProblemError as error:
            raise ProblemError(f"in changes: {error}") from None
        suffix = "".join(
            f"-{key}={value}"
            for key, value in zip(changes, combination, strict=True)
            if isinstance(changes[key], list)
        )
        yield suffix, varied


def _check_keys(table: Mapping[str, object], keys: tuple[str, ...]) -> None:
    for key in table:
        if key not in keys:
            right = (keys != TOP and _place(key)) or f"did you mean {nearest(key, keys)!r}?"
            raise ProblemError(f"unknown key {shown(key)}: {right}")


def _place(key: str) -> str:
    """Where in a [[run]] table a key belongs, if it is one of them; otherwise empty."""
    if key in KEYS:
        return "it belongs to the run itself"
    if key in OFFSETS:
        return f"it belongs to a run's offsets = {{{key} = ...}}"
    if key in FIELDS:
        return f"it belongs to a run's changes = {{{key} = ...}}"
    return ""


def _check_name(name: object) -> None:
    """Raise ProblemError unless the name can be that of a folder everywhere."""
    right = "letters, digits, inner spaces and _ - + = . , ( )"
    if not isinstance(name, str) or not re.fullmatch(r"\w([\w .,=+()-]*[\w)+])?", name):
        raise ProblemError(f"the name {shown(name)} is not valid: it must be {right}")
    if len(name.encode()) > LONGEST_NAME:
        raise ProblemError(f"the name {shown(name)} is longer than {LONGEST_NAME} bytes")
    if name.casefold() in RESERVED:
        raise ProblemError(f"the name {name!r} is that of a file of the campaign")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_integer(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)

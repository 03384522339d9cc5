"""Hundreds of bad inputs: one short line each, exit code 2, nothing lost, little memory."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner
from markupsafe import Markup

from ngspring.cli.main import COMMANDS, cli
from ngspring.evolution.evolve import evolve
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.problem.toml import FURTHER_KEYS

#: Exit codes: done, a check failed, bad input, no convergence.
OUTCOMES = (0, 1, 2, 3)
MEMORY = 1_000_000_000

POINTS = "\n[[control_points]]\nd = -10.0\nq = -2.0\n[[control_points]]\nd = 10.0\nq = 2.0\n"


@contextlib.contextmanager
def memory_limit() -> Iterator[None]:
    """Let the system refuse this process more than a gigabyte beyond what it has."""
    resource = pytest.importorskip("resource")
    status = Path("/proc/self/statm")
    if not status.exists():
        pytest.skip("the memory of the process is not known here")
    pages = int(status.read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def contents(folder: Path) -> dict[str, bytes]:
    """What the user has in a folder."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != ".lock")
    return {os.fspath(path): path.read_bytes() for path in files}


def complaint(*args: object, home: Path) -> str:
    """Run a command with an input that may be bad, and hold it to its contract."""
    before = contents(home)
    with memory_limit():
        result = CliRunner().invoke(cli, [str(arg) for arg in args], prog_name="ngspring")
    if not isinstance(result.exception, SystemExit | None):
        raise result.exception
    assert result.exit_code in OUTCOMES
    assert "Traceback" not in result.output
    after = contents(home)
    assert {path: after.get(path) for path in before} == before
    lines = result.stderr.splitlines()
    if result.exit_code == 2:
        assert after == before
        assert len(lines) == 1, lines
        assert lines[0].startswith("ngspring: error: ")
        assert "not enough memory" not in lines[0]
    for line in lines:
        assert len(line) <= 300
        assert line.isprintable()
    return "\n".join(lines)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


# -- TOML ------------------------------------------------------------------------------------------

VALUES = (
    *("0", "-1", "1e200", "-1e200", "1e-300", "1.7e308", "5e-324", "nan", "inf", "-inf"),
    *("1" + 400 * "0", '""', '"text"', "true", "[]", "{}", "[[1]]", "1979-05-27", "0x7f"),
    *('"\\u001b[2J"', '"$x^2$"', '"\\u0000"', f'"{5000 * "x"}"', '"C:\\\\x"'),
)
KEYS = (*(field.name for field in dataclasses.fields(SpringProblem)), *FURTHER_KEYS)


@pytest.mark.long
@pytest.mark.parametrize("key", KEYS)
def test_any_value_of_any_key(key: str, home: Path) -> None:
    for value in VALUES:
        points = "" if key in ("control_points", "targets") else POINTS
        others = "".join(f"{k} = {v}\n" for k, v in (("elements", 12), ("l_i", 7.0)) if k != key)
        Path("mine.toml").write_text(f"{key} = {value}\n{others}{points}")
        complaint("targets", "mine.toml", home=home)


@pytest.mark.parametrize("key", ["d", "q", "weight", "eta", "u", ""])
def test_any_value_in_a_control_point(key: str, home: Path) -> None:
    for value in VALUES:
        table = {"d": "-10.0", "q": "-2.0", key or '""': value}
        rows = "".join(f"{k} = {v}\n" for k, v in table.items())
        Path("mine.toml").write_text(f"elements = 12\n[[control_points]]\n{rows}")
        complaint("targets", "mine.toml", home=home)


TEXTS = {
    "100 kB of points": 100_000 * ".",
    "a key of 50,000 parts": "a." * 50_000 + "b = 1",
    "a key of 50,000 quoted parts": '"\\"".' * 50_000 + "b = 1",
    "a table of 50,000 parts": f"[{'a.' * 50_000}b]",
    "nested lists": "L = " + "[" * 100_000,
    "nested tables": "L = " + "{a = " * 100_000,
    "a long line": "L = " + "1" * 900_000,
    "a long name": f'name = "{"x" * 900_000}"' + POINTS,
    "many points": "[[control_points]]\nd = 1\nq = 1\n" * 20_000,
    "too much": "# comment\n" * 200_000,
    "zeros": "\0" * 1000,
    "nothing": "",
    "carriage returns": "\r" * 1000,
}


@pytest.mark.long
@pytest.mark.parametrize("command", ["targets", "optimize", "campaign"])
@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS.keys())
def test_any_text_as_toml(text: str, command: str, home: Path) -> None:
    Path("mine.toml").write_text(text)
    assert "error" in complaint(command, "mine.toml", home=home)


RUNS = (
    *('name = "report.html"', 'name = "results.csv"', 'name = "a/b"', 'name = "\\u001b[2J"'),
    *('name = "$"', f'name = "{300 * "x"}"', "name = 3", "elements = 1e200", "elements = nan"),
    *("elements = 1000000", "dt_initial = inf", "dt_initial = nan", "max_updates = 1e300"),
    *('start = "design:nowhere"', f'start = "design:{5000 * "x"}"', "start = 1", "seed = nan"),
    *("changes = {L = 1e200}", "changes = {L = [nan]}", "changes = {p = [[1]]}", "changes = 3"),
    *('file = "mine.toml"', 'changes = {name = "\\u001b"}', "robust = 1e200"),
)


@pytest.mark.parametrize("line", RUNS)
def test_any_line_of_a_campaign(line: str, home: Path) -> None:
    Path("mine.toml").write_text(f'[[run]]\ncase = "C4"\n{line}\n')
    assert "error" in complaint("campaign", "mine.toml", home=home)


# -- curves ----------------------------------------------------------------------------------------

NUMBERS = (
    *("1e200", "-1e200", "1e-300", "1.7e308", "5e-324", "nan", "inf", "0", "", "text", "1,5"),
    *("--1", "0x10", "\x1b[2J", "é", "1e", "$"),
)


@pytest.mark.parametrize("number", NUMBERS)
def test_any_number_in_a_csv_file(number: str, home: Path) -> None:
    for text in (
        f"{number};1\n",
        f"{number};1\n10;{number}\n",
        f"d [mm];q [N]\n-10;-2\n{number};3\n10;2\n",
        f"d [mm];q [N]\n-10;-2\n5;{number}\n10;2\n",
        f"strain;stress\n-.1;-2\n.05;{number}\n.1;2\n",
        f"{number} [mm];q [{number}]\n10;2\n",
    ):
        Path("curve.csv").write_text(text, encoding="utf-8")
        complaint("targets", "curve.csv", home=home)


@pytest.mark.long
def test_a_table_is_bounded(home: Path) -> None:
    for text, why in (
        ("d;q\n" + "1;2\n" * 300_000, "more than 300000 lines"),
        ("1;" * 500_000, "error"),
        (";" * 1_000_000, "error"),
        ("d;q\n" + ("1;" * 10_000 + "1\n") * 50, "error"),
    ):
        Path("curve.csv").write_text(text)
        assert why in complaint("targets", "curve.csv", home=home)


SIZE = 'width="100" height="100"'


@pytest.mark.parametrize("number", NUMBERS)
def test_any_number_in_a_drawing(number: str, home: Path) -> None:
    pytest.importorskip("svgelements")
    for shapes in (
        f'<svg {SIZE}><path d="M0 0 L{number} 10"/>',
        f'<svg width="{number}" height="100"><path d="M0 0 L10 10"/>',
        f'<svg {SIZE} viewBox="0 0 10 {number}"><path d="M0 0 L10 10"/>',
        f'<svg {SIZE}><rect width="{number}" height="9"/><path d="M0 0 L10 10"/>',
        f'<svg {SIZE}><path transform="scale({number})" d="M0 0 L10 10"/>',
        f'<svg {SIZE}><path d="M0 0 A {number} 3 0 0 1 5 5"/>',
    ):
        Path("curve.svg").write_text(f"{shapes}</svg>".replace("\x1b", "&#27;"), encoding="utf-8")
        complaint("targets", "curve.svg", "--d-range=-20,20", "--q-range=-6,6", home=home)


def path_of(segments: int) -> str:
    places = " ".join(f"L {k % 100} {k % 77}" for k in range(segments))
    return f'<path d="M0 0 {places}"/>'


CLONES = "".join(f'<g id="a{k}">' + 10 * f'<use href="#a{k - 1}"/>' + "</g>" for k in range(1, 9))
DRAWINGS = {
    "60,000 segments": (path_of(60_000), "more than 10000"),
    "3 MB": (path_of(300_000), "more than 2000000 characters"),
    "clones of clones": (f'<g id="a0">{path_of(2)}</g>{CLONES}', "clones"),
    "deep groups": ("<g>" * 20_000, "not a valid SVG"),
}


@pytest.mark.long
@pytest.mark.parametrize(("shapes", "why"), DRAWINGS.values(), ids=DRAWINGS.keys())
def test_a_drawing_is_bounded(shapes: str, why: str, home: Path) -> None:
    pytest.importorskip("svgelements")
    Path("curve.svg").write_text(f"<svg {SIZE}>{shapes}</svg>")
    options = "--d-range=-20,20", "--q-range=-6,6"
    assert why in complaint("targets", "curve.svg", *options, home=home)


# -- what ngspring has written ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a small run that was stopped after one design update."""
    folder = tmp_path_factory.mktemp("run")
    points = (ControlPoint(-5.0, -1.0), ControlPoint(5.0, 1.0))
    problem = SpringProblem(points, name="small", elements=4, l_i=20.0)
    evolution = evolve(problem, threads=1)
    for update in evolution:
        if update.row.update == 1:
            break
    evolution.checkpoint.save(folder / "checkpoint.npz")
    evolution.result.design.save(folder / "design.npz")
    (folder / "mine.toml").write_text(problem.to_toml())
    return folder


def parts_of(path: Path) -> dict[str, Any]:
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def wrong_parts(right: Any) -> list[Any]:
    """What may stand in place of a part of a file."""
    array = np.asarray(right)
    wrong = [np.array("text"), np.array("\x1b[2J"), np.array(b"x"), np.array([]), np.zeros((2, 3))]
    wrong += [np.array(np.nan), np.array(np.inf), np.array(-1), np.array(1j), np.array(True)]
    wrong += [np.array(["a", "b"]), np.array(np.datetime64("2023-01-01")), np.zeros((1, 1, 1, 1))]
    wrong += [np.array("[" * 100_000), np.array("x" * 2_000_000)]
    if array.dtype.kind == "f" and array.ndim:
        wrong += [np.full_like(array, value) for value in (np.nan, np.inf, 1e308, 1e-320)]
        wrong += [array + 1j]
        wrong += [array[:-1], array[:, :-1] if array.ndim > 1 else array[None], array.astype("U8")]
    return wrong


def with_part(path: Path, parts: Mapping[str, Any], name: str, value: Any) -> None:
    np.savez(path, **{**parts, name: value})


@pytest.mark.long
@pytest.mark.parametrize(
    "part", ["format", "version", "problem", "coefficients", "info", "history", "history_columns"]
)
def test_any_part_of_a_design(part: str, run: Path, home: Path) -> None:
    parts = parts_of(run / "design.npz")
    for wrong in wrong_parts(parts[part]):
        with_part(Path("d.npz"), parts, part, wrong)
        complaint("watch", "d.npz", "--once", "--out", home.parent / "x.html", home=home)


NOTES = (
    None,
    True,
    3,
    -1e308,
    "text",
    "\x1b[2J",
    "$",
    [],
    [None, None],
    [1e308, -1e308],
    [1, "2"],
    {"a": []},
)


@pytest.mark.long
@pytest.mark.parametrize("note", ["q", "start", "converged", "failed", "falling_directions"])
def test_any_note_of_a_design(
    note: str, run: Path, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if note != "q":  # the only one that could get into a picture
        monkeypatch.setattr("ngspring.view.report.picture", lambda *_, **__: Markup("a picture"))
    parts = parts_of(run / "design.npz")
    for wrong in NOTES:
        with_part(Path("d.npz"), parts, "info", json.dumps({note: wrong}))
        complaint("watch", "d.npz", "--once", "--out", home.parent / "x.html", home=home)


@pytest.mark.long
@pytest.mark.parametrize(
    "part",
    *[["version", "problem", "start", "dt", "state_chi", "state_u", "previous_lam", "history"]],
)
def test_any_part_of_a_checkpoint(part: str, run: Path, home: Path) -> None:
    parts = parts_of(run / "checkpoint.npz")
    folder = Path("run")
    folder.mkdir()
    for wrong in wrong_parts(parts[part]):
        with_part(folder / "checkpoint.npz", parts, part, wrong)
        complaint("watch", folder, "--once", "--out", home.parent / "x.html", home=home)


@pytest.mark.parametrize("kind", ["a pipe", "a device", "a folder", "a bomb", "sparse", "a loop"])
@pytest.mark.parametrize("command", ["targets", "optimize", "campaign", "show", "check", "watch"])
def test_what_is_no_file_of_bounded_size(kind: str, command: str, run: Path, home: Path) -> None:
    path = home / ("x.toml" if command in ("targets", "optimize", "campaign") else "x.npz")
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a folder":
        path.mkdir()
    elif kind == "a bomb":
        shutil.copy(run / "design.npz", path)
        with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("bomb.npy", bytes(1000))
            archive.getinfo("bomb.npy").file_size = 1_200_000_000
    elif kind == "sparse":
        # Not where everything is read afterwards.
        path = home.parent / f"{home.name}-{path.name}"
        with path.open("wb") as file:
            file.truncate(10**11)
    else:
        path.symlink_to("/dev/zero" if kind == "a device" else path)
    assert "error" in complaint(command, path, home=home)


LONG, FOREIGN = 300 * "x", os.fsdecode(b"caf\xe9")


@pytest.mark.parametrize(
    "name", [LONG, f"{LONG}.toml", f"{LONG}.npz", f"a/{LONG}/b.npz", "\x1b[2J"]
)
@pytest.mark.parametrize("command", ["targets", "optimize", "campaign", "show", "watch", "export"])
def test_a_name_that_no_file_can_have(name: str, command: str, home: Path) -> None:
    more = ("--format", "svg") if command == "export" else ()
    assert "error" in complaint(command, name, *more, home=home)


@pytest.mark.skipif(os.name == "nt", reason="names are bytes on Unix systems")
def test_a_name_that_is_not_utf_8(run: Path, home: Path) -> None:
    shutil.copy(run / "mine.toml", f"{FOREIGN}.toml")
    text = (run / "mine.toml").read_text().replace('name = "small"\n', "")
    Path(f"{FOREIGN}-2.toml").write_text(text)
    Path(f"{FOREIGN}.npz").write_bytes(b"PK\3\4")
    for args in (("optimize", f"{FOREIGN}-2.toml"), ("watch", f"{FOREIGN}.npz")):
        assert "error" in complaint(*args, home=home)


# -- options ---------------------------------------------------------------------------------------


def numeric_options() -> Iterator[tuple[str, str]]:
    context = click.Context(cli)
    for name in COMMANDS:
        command = cli.get_command(context, name)
        assert command is not None
        for option in command.params:
            if isinstance(option, click.Option) and isinstance(
                option.type, type(click.INT) | type(click.FLOAT)
            ):
                yield name, option.opts[0]


@pytest.mark.parametrize(("command", "option"), list(numeric_options()))
def test_any_text_as_a_numeric_option(command: str, option: str, home: Path) -> None:
    arguments = {"targets": ["c.csv"], "export": ["C4", "--format", "svg"], "bench": []}
    for value in ("nan", "inf", "-inf", "1e400", "", "text", "\x1b[2J", "1" + 5000 * "0"):
        args = arguments.get(command, ["C4"])
        assert "error" in complaint(command, *args, f"{option}={value}", home=home)


@pytest.mark.long
def test_nothing_takes_the_place_of_a_design(run: Path, home: Path) -> None:
    for name in ("d.npz", "d.html", "d.svg", "d.toml"):
        shutil.copy(run / "design.npz", name)
    for args in (
        ("watch", "d.npz", "--out", "d.npz"),
        ("watch", "d.npz", "--out", "d.toml"),
        ("watch", "d.html"),
        ("cases", "--log-file", "d.npz"),
        ("export", "d.svg", "--format", "svg"),
    ):
        assert "error" in complaint(*args, home=home)

"""A design file is read whole or refused in one line, and written whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import subprocess
import sys
import tempfile
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ngspring import (
    ControlPoint,
    Design,
    DesignFileError,
    History,
    ProblemError,
    RunFolderError,
    SpringProblem,
)
from ngspring.basics.files import (
    read_bounded,
    read_text,
    remove_leftovers,
    write_arrays,
    write_text,
)
from ngspring.design.history import Row

PROBLEM = SpringProblem((ControlPoint(10, 2), ControlPoint(-20, -4)), elements=8, name="test")


def row(update: int, dt: float) -> Row:
    values = {"C": 1.0, "V": 2.0, "width": 0.3, "seconds": 4.0}
    return Row(update, dt, C_q=(0.5, 0.5), q=(2.0, -4.0), **values)  # type: ignore[arg-type]


DESIGN = Design(
    PROBLEM,
    np.random.default_rng(0).uniform(-4, 4, PROBLEM.coefficient_shape),
    History.from_rows([row(0, 0.0), row(1, np.inf)]),
    {"start": "column", "q": [2.0, -4.0]},
)


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "design.npz"
    DESIGN.save(path)
    return path.read_bytes()


@pytest.fixture
def path(tmp_path: Path, content: bytes) -> Path:
    path = tmp_path / "design.npz"
    path.write_bytes(content)
    return path


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch") / "design.npz"


def parts_of(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def refusal(path: Any) -> str:
    """Return the one line with which the file is refused; it names the file."""
    with pytest.raises(DesignFileError) as caught:
        Design.load(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert str(path) in message
    return message


def is_test_design(design: Design) -> bool:
    history = design.history
    return (
        design.problem == PROBLEM
        and np.array_equal(design.coefficients, DESIGN.coefficients)
        and dict(design.info) == dict(DESIGN.info)
        and history is not None
        and DESIGN.history is not None
        and history.columns == DESIGN.history.columns
        and np.array_equal(history.values, DESIGN.history.values)
    )


def assert_equal_or_refused(path: Path) -> None:
    with contextlib.suppress(DesignFileError):
        assert is_test_design(Design.load(path))


def test_a_whole_design_file_is_read(path: Path) -> None:
    assert is_test_design(Design.load(path))


# -- damaged files --------------------------------------------------------------------------------


@settings(deadline=None, max_examples=100)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_truncated_design_file_is_refused(content: bytes, scratch: Path, share: float) -> None:
    scratch.write_bytes(content[: int(share * len(content))])
    refusal(scratch)


@pytest.mark.long
@settings(deadline=None, max_examples=300)
@given(
    places=st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=4),
    values=st.binary(min_size=4, max_size=4),
)
def test_a_design_file_with_wrong_bytes_is_refused_or_still_equal(
    content: bytes, scratch: Path, places: list[float], values: bytes
) -> None:
    damaged = bytearray(content)
    for place, value in zip(places, values, strict=False):
        damaged[int(place * len(damaged))] = value
    scratch.write_bytes(damaged)
    assert_equal_or_refused(scratch)


@settings(deadline=None, max_examples=100)
@given(
    first=st.floats(0, 1), last=st.floats(0, 1), insert=st.binary(max_size=40) | st.just(b"\0" * 9)
)
def test_a_design_file_with_a_piece_replaced_is_refused_or_still_equal(
    content: bytes, scratch: Path, first: float, last: float, insert: bytes
) -> None:
    i, j = sorted((int(first * len(content)), int(last * len(content))))
    scratch.write_bytes(content[:i] + insert + content[j:])
    assert_equal_or_refused(scratch)


def test_every_byte_of_the_archive_s_directory_may_be_wrong(content: bytes, scratch: Path) -> None:
    directory = content.index(b"PK\x01\x02")
    for place in range(directory, len(content)):
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        scratch.write_bytes(damaged)
        assert_equal_or_refused(scratch)


# -- files that are something else ----------------------------------------------------------------


def test_a_design_of_another_version_says_which_version_it_is(path: Path) -> None:
    parts = parts_of(path)
    np.savez(path, **{**parts, "version": 99})
    message = refusal(path)
    assert "99" in message
    assert "version" in message
    np.savez(path, **{**parts, "version": 0})
    assert "version" in refusal(path)


@pytest.mark.parametrize("version", ["one", [1, 1], np.nan, [], 1j, np.inf, -np.inf])
def test_a_version_that_is_no_number_is_refused(path: Path, version: Any) -> None:
    np.savez(path, **{**parts_of(path), "version": version})
    assert "version" in refusal(path)


def test_a_checkpoint_is_not_a_design(path: Path) -> None:
    np.savez(path, **{**parts_of(path), "format": "ngspring-checkpoint"})
    assert "not a design file" in refusal(path)


def test_a_foreign_npz_is_not_a_design(path: Path) -> None:
    np.savez(path, x=np.zeros(3))
    assert "not a design file" in refusal(path)


def test_a_foreign_npy_is_not_a_design(tmp_path: Path) -> None:
    path = tmp_path / "array.npy"
    np.save(path, np.zeros(3))
    assert "not a design file" in refusal(path)


@pytest.mark.parametrize("text", ["", "\n", "d = 10\nq = 2\n", "PK", "\x93NUMPY", "\x80\x04."])
def test_text_is_not_a_design(tmp_path: Path, text: str) -> None:
    path = tmp_path / "spring.toml"
    path.write_text(text, encoding="latin-1")
    assert "not a design file" in refusal(path)


def test_a_zip_archive_of_other_things_is_not_a_design(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("format", "ngspring-design")
        archive.writestr("readme.txt", "hello")
    assert "not a design file" in refusal(path)


def test_a_folder_is_not_a_design(tmp_path: Path) -> None:
    assert "folder" in refusal(tmp_path)


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    assert "no file" in refusal(tmp_path / "nowhere" / "design.npz")
    refusal(tmp_path / ("x" * 5000))


def test_a_path_through_a_file_is_refused(path: Path) -> None:
    refusal(path / "design.npz")


@pytest.mark.parametrize("part", ["format", "version", "problem", "coefficients", "info"])
def test_a_design_that_lacks_a_part_is_refused(path: Path, part: str) -> None:
    parts = parts_of(path)
    del parts[part]
    np.savez(path, **parts)
    refusal(path)


WRONG_PARTS = {
    "text": "x",
    "file name": "x.toml",
    "several lines": "a\nb",
    "bytes": b"x",
    "number": 3,
    "nan": np.full((5, 4), np.nan),
    "inf": np.full((5, 4), np.inf),
    "complex": np.full((5, 4), 1j),
    "empty": np.zeros((0, 4)),
    "empty text": "",
    "shape": np.zeros((4, 5)),
    "texts": np.array(["a", "b", "c"]),
    "dates": np.full((5, 4), np.datetime64("2023-01-01")),
    "structured": np.zeros((5, 4), dtype=[("a", float), ("b", int)]),
    "json": "[1, 2]",
    "deep json": "[" * 100_000,
}


@pytest.mark.parametrize("wrong", WRONG_PARTS.values(), ids=WRONG_PARTS.keys())
@pytest.mark.parametrize("part", ["problem", "coefficients", "info"])
def test_a_design_with_a_wrong_part_is_refused(path: Path, part: str, wrong: Any) -> None:
    np.savez(path, **{**parts_of(path), part: wrong})
    refusal(path)


@pytest.mark.parametrize("wrong", WRONG_PARTS.values(), ids=WRONG_PARTS.keys())
@pytest.mark.parametrize("part", ["history", "history_columns"])
def test_a_design_whose_history_does_not_fit_is_refused(path: Path, part: str, wrong: Any) -> None:
    np.savez(path, **{**parts_of(path), part: wrong})
    refusal(path)


def test_a_design_whose_parts_are_not_arrays_is_refused(path: Path) -> None:
    for part in ("problem", "coefficients", "info", "history", "history_columns"):
        parts = parts_of(path)
        del parts[part]
        other = path.with_name(f"{part}.npz")
        np.savez(other, **parts)
        with zipfile.ZipFile(other, "a") as archive:
            archive.writestr(part, b"not an array")
        refusal(other)


HISTORY = History.from_rows([row(0, 0.0), row(1, np.inf)])


def damaged_history(name: str, value: float | None) -> dict[str, Any]:
    """The parts of a history with a number in place of the second row's, or without a column."""
    column = HISTORY.columns.index(name)
    if value is None:
        columns = np.delete(HISTORY.columns, column)
        return {"history": np.delete(HISTORY.values, column, 1), "history_columns": columns}
    values = HISTORY.values.copy()
    values[1, column] = value
    return {**HISTORY.parts, "history": values}


@pytest.mark.parametrize("value", [None, np.nan, -np.inf, -1.5], ids=str)
@pytest.mark.parametrize("name", ["update", "dt", "newton_iterations", "rejected_iterations"])
def test_a_history_with_a_wrong_count_or_step_is_refused(
    path: Path, name: str, value: float | None
) -> None:
    np.savez(path, **{**parts_of(path), **damaged_history(name, value)})
    assert "history" in refusal(path)


@pytest.mark.parametrize("value", [None, np.nan, np.inf], ids=str)
@pytest.mark.parametrize("name", ["C", "C_q1", "q2", "V", "width", "seconds"])
def test_a_history_with_a_wrong_number_or_without_a_column_is_refused(
    path: Path, name: str, value: float | None
) -> None:
    np.savez(path, **{**parts_of(path), **damaged_history(name, value)})
    assert "history" in refusal(path)


def test_a_history_with_a_column_twice_is_refused(path: Path) -> None:
    columns = np.array(["C" if name == "V" else name for name in HISTORY.columns])
    np.savez(path, **{**parts_of(path), "history_columns": columns})
    assert "history" in refusal(path)


WRONG_NOTES = {
    "q": [None, "2", [None, 1], [np.nan, 1.0], [1.0], [1, 2, 3], {"a": 1}, [[1], [2]], True],
    "converged": ["yes", 1, None],
    "falling_directions": ["many", 1.5, [1]],
    "start": [3, None, ["column"]],
    "failed": [3, None, {}],
    "stopped": [False],
}


@pytest.mark.parametrize(
    ("note", "wrong"), [(note, wrong) for note, all_ in WRONG_NOTES.items() for wrong in all_]
)
def test_a_design_with_a_wrong_note_is_refused(path: Path, note: str, wrong: Any) -> None:
    np.savez(path, **{**parts_of(path), "info": json.dumps({note: wrong})})
    assert f"the note {note}" in refusal(path)


def test_notes_cannot_tell_a_terminal_what_to_do(path: Path) -> None:
    notes = {"start": "\x1b[2J\x1b]0;owned\x07" + "x" * 5000, "failed": "a\nb\u202e"}
    np.savez(path, **{**parts_of(path), "info": json.dumps(notes)})
    read = Design.load(path).info
    assert read["start"].startswith("?[2J?]0;owned?xxx")
    assert len(read["start"]) == 300
    assert read["failed"] == "a b?"


@pytest.mark.parametrize("values", [np.full((5, 4), 1j), np.full((5, 4), "1"), [[1], [1, 2]]])
def test_an_array_that_is_not_real_is_no_design(values: Any) -> None:
    with pytest.raises(ProblemError, match="finite real numbers"):
        Design(PROBLEM, values)
    with pytest.raises(ProblemError, match="finite real numbers"):
        Design.from_function(PROBLEM, lambda x, y: values)


# -- files without an end -------------------------------------------------------------------------


@pytest.mark.parametrize("where", ["a pipe", "/dev/zero", "/dev/null"])
def test_what_is_no_regular_file_is_not_read(tmp_path: Path, where: str) -> None:
    path = Path(where)
    if where == "a pipe":
        path = tmp_path / "pipe"
        os.mkfifo(path)
    assert "not a regular file" in refusal(path)
    with pytest.raises(ProblemError, match="not a regular file"):
        read_text(str(path))


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    large = tmp_path / "large.npz"
    with large.open("wb") as file:
        file.truncate(10**12)
    assert "larger than 500 MB" in refusal(large)
    with pytest.raises(ProblemError, match="larger than 20 MB"):
        read_text(str(large))


def test_a_file_of_exactly_the_limit_is_read(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"12345")
    assert read_bounded(tmp_path / "x", 5) == b"12345"
    with pytest.raises(OSError, match="larger"):
        read_bounded(tmp_path / "x", 4)


@pytest.mark.long
def test_an_archive_that_unpacks_to_too_much_is_not_unpacked(path: Path) -> None:
    archive = zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED)
    with archive, archive.open("bomb.npy", "w", force_zip64=True) as file:
        for _ in range(12):
            file.write(bytes(100_000_000))
    assert path.stat().st_size < 2_000_000
    tracemalloc.start()
    try:
        assert "unpacks to 1200 MB, more than 500 MB" in refusal(path)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


def test_a_long_text_in_a_design_file_is_not_taken_apart(path: Path) -> None:
    np.savez_compressed(path, **{**parts_of(path), "info": "[" * 1_000_001})
    assert "info" in refusal(path)


def test_a_design_whose_problem_is_not_valid_is_refused(path: Path) -> None:
    parts = parts_of(path)
    text = str(parts["problem"]).replace("elements = 8", "elements = 7")
    np.savez(path, **{**parts, "problem": text})
    assert "elements" in refusal(path)


def test_a_design_file_never_reads_another_file(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(PROBLEM.to_toml())
    np.savez(path, **{**parts_of(path), "problem": str(other)})
    refusal(path)


# -- writing --------------------------------------------------------------------------------------

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextlib.contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Let the system cut every file that this process writes at ``size`` bytes."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def assert_writing_fails_cleanly(path: Path, content: bytes, why: str) -> None:
    changed = Design(PROBLEM, DESIGN.coefficients + 1)
    with pytest.raises(RunFolderError) as caught:
        changed.save(path)
    message = str(caught.value)
    assert str(path) in message
    assert why in message
    assert len(message.splitlines()) == 1
    assert path.read_bytes() == content
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_a_file_that_the_system_cuts_short_leaves_the_old_one(path: Path, content: bytes) -> None:
    with file_size_limit(len(content) // 2):
        assert_writing_fails_cleanly(path, content, os.strerror(errno.EFBIG))


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_leaves_the_old_file(
    path: Path, content: bytes, call: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: object, **kwargs: object) -> None:
        raise FULL

    monkeypatch.setattr(os, call, fail)
    assert_writing_fails_cleanly(path, content, os.strerror(errno.ENOSPC))


def test_a_full_disk_in_the_middle_of_the_data_leaves_the_old_file(
    path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole: Callable[[Path, bytes], int] = Path.write_bytes

    def half(self: Path, data: bytes) -> int:
        whole(self, data[: len(data) // 2])
        raise FULL

    monkeypatch.setattr(Path, "write_bytes", half)
    assert_writing_fails_cleanly(path, content, os.strerror(errno.ENOSPC))


def test_ctrl_c_while_writing_leaves_the_old_file(
    path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        Design(PROBLEM, DESIGN.coefficients + 1).save(path)
    monkeypatch.undo()
    assert path.read_bytes() == content
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_a_folder_that_may_not_be_written_to_is_named(
    path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object, **kwargs: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    # Not by chmod: root may write anywhere.
    monkeypatch.setattr(tempfile, "mkstemp", refuse)
    assert_writing_fails_cleanly(path, content, os.strerror(errno.EACCES))


def test_writing_into_a_missing_folder_or_through_a_file_is_refused(path: Path) -> None:
    for target in (path.parent / "nowhere" / "design.npz", path / "design.npz"):
        with pytest.raises(RunFolderError, match=r"cannot write .*design\.npz"):
            DESIGN.save(target)


def test_writing_over_a_folder_is_refused_and_leaves_it(tmp_path: Path) -> None:
    folder = tmp_path / "design.npz"
    folder.mkdir()
    with pytest.raises(RunFolderError, match="cannot write"):
        DESIGN.save(folder)
    assert folder.is_dir()
    assert list(tmp_path.iterdir()) == [folder]


def test_a_pipe_or_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    # As root, a design saved to /dev/null must not take the place of /dev/null.
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(RunFolderError):
        DESIGN.save(pipe)
    assert pipe.is_fifo()


def test_a_written_file_has_the_permissions_of_any_other_new_file(tmp_path: Path) -> None:
    DESIGN.save(tmp_path / "design.npz")
    (tmp_path / "plain").touch()
    modes = {entry.stat().st_mode for entry in tmp_path.iterdir()}
    assert len(modes) == 1


def test_text_is_written_as_utf_8_and_atomically(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "history.csv"
    write_text(path, "χ,λ\n")
    assert path.read_bytes() == "χ,λ\n".encode()

    def fail(*args: object) -> None:
        raise FULL

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(RunFolderError):
        write_text(path, "other\n")
    assert path.read_bytes() == "χ,λ\n".encode()
    assert list(tmp_path.iterdir()) == [path]


def test_what_would_need_pickle_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="pickle"):
        write_arrays(tmp_path / "x.npz", {"format": "x", "thing": [object()]})
    assert not list(tmp_path.iterdir())


def test_only_what_killed_processes_left_behind_is_removed(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left = [f".ngspring-{gone.pid}-abc.npz", f".ngspring-{gone.pid}-x.html"]
    kept = [".my-best-design.npz", f".ngspring-{os.getpid()}-abc.npz", ".ngspring-notes"]
    for name in (*left, *kept):
        (tmp_path / name).touch()
    (tmp_path / f".ngspring-{gone.pid}-folder").mkdir()
    remove_leftovers(tmp_path)
    found = {path.name for path in tmp_path.iterdir()}
    assert found == {*kept, f".ngspring-{gone.pid}-folder"}


def test_a_file_of_the_longest_name_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 251 + ".txt")
    write_text(path, "here")
    assert path.read_text() == "here"

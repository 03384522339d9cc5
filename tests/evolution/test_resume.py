"""A run that is stopped, however it is stopped, goes on to the same design; nothing is lost."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ngspring
from ngspring import Design, DesignFileError, NgspringError, Result, RunFolderError
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.runstate import read_run

PROBLEM = ngspring.cases["C4"].replace(elements=8, l_i=10.0)
ROOT = Path(ngspring.__file__).parents[1]
CHECKPOINT, PREVIOUS = "checkpoint.npz", "checkpoint-before.npz"
DESIGN, HISTORY = "design.npz", "history.csv"

SCRIPT = """
import sys, time
import ngspring

pause = float(sys.argv[2])

def tell(update):
    print(int(update.row.update), update.dt, flush=True)
    if update.row.update >= 8:
        time.sleep(pause)

problem = ngspring.cases["C4"].replace(elements=8, l_i=10.0)
try:
    ngspring.optimize(problem, out=sys.argv[1], observers=[tell], threads=1)
except KeyboardInterrupt:
    print("interrupted", flush=True)
    sys.exit(130)
"""


@contextlib.contextmanager
def run_elsewhere(folder: Path, pause: float = 0.0) -> Iterator[subprocess.Popen[str]]:
    """The run in a process of its own; ``pause`` seconds after every update from the 8th."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(folder), str(pause)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def wait_for(process: subprocess.Popen[str], update: int) -> None:
    """Read the process's lines until it has accepted this update."""
    assert process.stdout is not None
    end = time.monotonic() + 120
    while time.monotonic() < end:
        if not select.select([process.stdout], [], [], 1.0)[0]:
            continue
        line = process.stdout.readline()
        if not line:
            assert process.stderr is not None
            pytest.fail(f"the run ended before update {update}: {process.stderr.read()}")
        if int(line.split()[0]) >= update:
            return
    pytest.fail(f"no update {update} in two minutes")


def contents(folder: Path) -> dict[str, bytes]:
    return {e.name: e.read_bytes() for e in folder.iterdir() if e.name != ".lock"}


def resume(folder: Path, problem: Any = PROBLEM, **options: Any) -> Result:
    return ngspring.optimize(problem, out=folder, resume=True, threads=1, **options)


def assert_refused(folder: Path, match: str, problem: Any = PROBLEM, **options: Any) -> None:
    """The folder is refused in one line that names it, and is left as it is."""
    before = contents(folder)
    with pytest.raises(RunFolderError, match=match) as caught:
        ngspring.optimize(problem, out=folder, threads=1, max_updates=1, **options)
    assert str(folder) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert contents(folder) == before


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """An uninterrupted run and its folder."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    return ngspring.optimize(PROBLEM, out=folder, threads=1), folder


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of a run that was stopped after three updates."""
    folder = tmp_path_factory.mktemp("runs") / "begun"
    ngspring.optimize(PROBLEM, out=folder, threads=1, max_updates=3)
    return contents(folder)


@pytest.fixture
def folder(tmp_path: Path, begun: dict[str, bytes]) -> Path:
    """A run folder of its own, three updates into the run, with nothing but the last checkpoint."""
    folder = tmp_path / "run"
    folder.mkdir()
    for name, content in begun.items():
        if name != PREVIOUS:
            (folder / name).write_bytes(content)
    return folder


def assert_same_end(result: Result, whole: Result) -> None:
    assert result.converged
    width, expected = result.history.last().width, whole.history.last().width
    assert width == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(
        result.design.coefficients, whole.design.coefficients, rtol=0, atol=1e-5
    )
    # One continuous history: the same updates, without a gap or a repetition.
    assert len(result.history) == len(whole.history)
    np.testing.assert_array_equal(result.history["update"], np.arange(len(whole.history)))
    np.testing.assert_allclose(result.history["dt"], whole.history["dt"], rtol=1e-12)
    assert (np.diff(result.history["seconds"]) >= 0).all()


# -- stopped and continued ------------------------------------------------------------------------


@pytest.mark.long
def test_a_run_killed_with_signal_9_is_resumed_to_the_same_design(
    tmp_path: Path, whole: tuple[Result, Path]
) -> None:
    folder = tmp_path / "run"
    with run_elsewhere(folder, pause=0.05) as process:
        wait_for(process, 12)
        process.send_signal(signal.SIGKILL)
        assert process.wait(60) == -signal.SIGKILL
    kept = Checkpoint.load(folder / CHECKPOINT)
    assert 12 <= kept.history.last().update < len(whole[0].history) - 1
    result = resume(folder)
    assert_same_end(result, whole[0])
    np.testing.assert_array_equal(result.history.values[: len(kept.history)], kept.history.values)
    stored = Design.load(folder / DESIGN)
    np.testing.assert_array_equal(stored.coefficients, result.design.coefficients)
    assert (folder / HISTORY).read_text() == result.history.to_csv()


@pytest.mark.long
def test_ctrl_c_leaves_the_last_accepted_design_and_a_run_to_resume(
    tmp_path: Path, whole: tuple[Result, Path]
) -> None:
    folder = tmp_path / "run"
    with run_elsewhere(folder, pause=0.05) as process:
        wait_for(process, 10)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        assert process.stdout is not None
        assert process.stdout.read().endswith("interrupted\n")
    checkpoint = Checkpoint.load(folder / CHECKPOINT)
    design = Design.load(folder / DESIGN)
    np.testing.assert_array_equal(design.coefficients.ravel(), checkpoint.state.chi)
    assert design.history is not None
    assert design.history.last() == checkpoint.history.last()
    assert (folder / HISTORY).read_text() == design.history.to_csv()
    assert design.info["converged"] is False
    updates = len(design.history) - 1
    assert updates >= 10
    result = resume(folder, max_updates=updates + 1)
    np.testing.assert_allclose(result.history["C"], whole[0].history["C"][: updates + 2], rtol=1e-9)


def test_a_run_is_continued_in_pieces_to_the_same_designs(
    folder: Path, whole: tuple[Result, Path]
) -> None:
    for updates in (4, 7):
        result = resume(folder, max_updates=updates)
        assert len(result.history) == updates + 1
        np.testing.assert_allclose(
            result.history["C"], whole[0].history["C"][: updates + 1], rtol=1e-9
        )


def test_a_checkpoint_is_written_after_every_accepted_update(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    updates = []

    def look(update: ngspring.Update) -> None:
        if update.accepted:
            kept = Checkpoint.load(folder / CHECKPOINT)
            assert kept.history.last() == update.row
            assert kept.problem == PROBLEM
            updates.append(update.row.update)

    ngspring.optimize(PROBLEM, out=folder, threads=1, max_updates=3, observers=[look])
    assert updates == [0, 1, 2, 3]
    assert not [name for name in contents(folder) if name.startswith(".")]


def test_resuming_where_nothing_was_begun_starts_the_run(tmp_path: Path) -> None:
    # A run may have been killed before its first checkpoint.
    result = resume(tmp_path / "run", max_updates=1)
    assert len(result.history) == 2
    assert (tmp_path / "run" / CHECKPOINT).exists()


# -- finished runs --------------------------------------------------------------------------------


def test_resuming_a_finished_run_returns_it_without_computing(
    whole: tuple[Result, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def compute(*args: object, **kwargs: object) -> None:
        raise AssertionError("computed")

    monkeypatch.setattr("ngspring.evolution.evolve.CoupledSystem", compute)
    monkeypatch.setattr("ngspring.evolution.stepping.solve_update", compute)
    result = resume(whole[1])
    assert result.converged
    np.testing.assert_array_equal(result.design.coefficients, whole[0].design.coefficients)
    np.testing.assert_array_equal(result.history.values, whole[0].history.values)
    np.testing.assert_array_equal(result.q, whole[0].q)
    assert (whole[1] / DESIGN).exists()


def test_a_finished_run_is_not_overwritten(whole: tuple[Result, Path]) -> None:
    assert_refused(whole[1], "resume")


def test_an_unfinished_run_is_not_overwritten(folder: Path) -> None:
    assert_refused(folder, "resume")


def test_a_design_without_its_checkpoint_is_not_overwritten(folder: Path) -> None:
    (folder / CHECKPOINT).unlink()
    assert_refused(folder, "design")


def test_a_design_without_its_checkpoint_is_not_overwritten_by_resuming(folder: Path) -> None:
    (folder / CHECKPOINT).unlink()
    assert_refused(folder, "design", resume=True)


def test_the_run_of_another_problem_is_not_resumed(folder: Path) -> None:
    for other in (
        PROBLEM.replace(elements=12),
        PROBLEM.replace(l_i=9.0),
        ngspring.cases["C5"].replace(elements=8, l_i=10.0),
    ):
        assert_refused(folder, "another problem", problem=other, resume=True)


@pytest.mark.parametrize("more", [0, 1])
def test_a_name_is_corrected_on_resume_and_everywhere_in_the_folder(
    folder: Path, more: int
) -> None:
    renamed = PROBLEM.replace(name="costs $5 and $6")
    result = resume(folder, renamed, max_updates=3 + more)
    assert len(result.history) == 4 + more
    assert result.design.problem.name == renamed.name
    assert Design.load(folder / DESIGN).problem == renamed
    assert Checkpoint.load(folder / CHECKPOINT).problem == renamed
    assert read_run(folder).design.problem == renamed


def test_a_checkpoint_of_another_mesh_is_refused(folder: Path) -> None:
    """Its displacements fit each other, but not the mesh."""
    parts = parts_of(folder / CHECKPOINT)
    for name in ("state", "previous"):
        for part in ("u", "lam"):
            parts[f"{name}_{part}"] = parts[f"{name}_{part}"][:, 1:]
    np.savez(folder / CHECKPOINT, **parts)
    with pytest.raises(NgspringError, match="another mesh"):
        resume(folder, max_updates=4)


@pytest.mark.long
def test_a_folder_in_use_by_another_process_is_refused_and_free_after_its_death(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "run"
    with run_elsewhere(folder, pause=60) as process:
        wait_for(process, 8)
        assert_refused(folder, "another run", resume=True)
        assert_refused(folder, "another run")
        process.kill()
        process.wait(60)
    result = resume(folder, max_updates=9)
    assert len(result.history) == 10


# -- damage ---------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=50)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_truncated_checkpoint_is_a_design_file_error(
    begun: dict[str, bytes], share: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("run")
    content = begun[CHECKPOINT]
    (folder / CHECKPOINT).write_bytes(content[: int(share * len(content))])
    with pytest.raises(DesignFileError, match="checkpoint"):
        resume(folder)


def test_a_design_in_place_of_the_checkpoint_is_a_design_file_error(folder: Path) -> None:
    (folder / CHECKPOINT).write_bytes((folder / DESIGN).read_bytes())
    with pytest.raises(DesignFileError, match="not a checkpoint"):
        resume(folder)


def assert_damage_is_noticed(folder: Path) -> None:
    """The checkpoint is refused in one line before anything is computed from it."""

    def computed(update: ngspring.Update) -> None:
        raise AssertionError("the run went on from a damaged checkpoint")

    with pytest.raises(DesignFileError) as caught:
        resume(folder, max_updates=4, observers=[computed])
    assert len(str(caught.value).splitlines()) == 1
    assert CHECKPOINT in str(caught.value)


def parts_of(path: Path) -> dict[str, Any]:
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def test_a_checkpoint_that_lacks_any_part_is_a_design_file_error(folder: Path) -> None:
    parts = parts_of(folder / CHECKPOINT)
    for missing in parts:
        np.savez(folder / CHECKPOINT, **{name: parts[name] for name in parts if name != missing})
        assert_damage_is_noticed(folder)


@pytest.mark.parametrize(
    "part", ["version", "problem", "dt", "history", "history_columns", "state"]
)
@pytest.mark.parametrize("wrong", ["text", np.zeros((2, 3)), np.nan], ids=["text", "shape", "nan"])
def test_a_checkpoint_with_a_wrong_part_is_a_design_file_error(
    folder: Path, part: str, wrong: Any
) -> None:
    parts = parts_of(folder / CHECKPOINT)
    names = [name for name in parts if name == part or name.startswith(f"{part}_")]
    assert names
    for name in names:
        bad = wrong
        if part == "state" and isinstance(wrong, float):
            bad = parts[name].copy()
            bad.flat[0] = wrong
        np.savez(folder / CHECKPOINT, **{**parts, name: bad})
        assert_damage_is_noticed(folder)


def test_a_run_whose_checkpoint_is_damaged_goes_on_from_the_one_before(
    folder: Path, begun: dict[str, bytes], caplog: pytest.LogCaptureFixture
) -> None:
    whole = resume(folder, max_updates=4).design
    (folder / PREVIOUS).write_bytes(begun[PREVIOUS])
    (folder / CHECKPOINT).write_bytes(begun[CHECKPOINT][:-100])
    assert ngspring.read_run(folder).design.history is not None
    seen: list[ngspring.Update] = []
    again = resume(folder, max_updates=4, observers=[seen.append]).design
    assert "the one before is used, of update 2" in caplog.text
    assert [update.row.update for update in seen] == [2, 3, 4]
    np.testing.assert_allclose(again.coefficients, whole.coefficients, rtol=0, atol=1e-9)


def test_a_damaged_checkpoint_leaves_the_design_beside_it(folder: Path) -> None:
    (folder / CHECKPOINT).write_bytes(b"")
    before = contents(folder)
    with pytest.raises(DesignFileError):
        resume(folder)
    assert contents(folder) == before


def test_a_run_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for out in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(RunFolderError, match="file") as caught:
            ngspring.optimize(PROBLEM, out=out, threads=1, max_updates=1)
        assert len(str(caught.value).splitlines()) == 1
    assert (tmp_path / "file").read_text() == "x"


def test_a_full_disk_ends_the_run_with_one_line_and_the_last_checkpoint(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = contents(folder)

    def fail(*args: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail)
        with pytest.raises(NgspringError, match=os.strerror(errno.ENOSPC)) as caught:
            resume(folder, max_updates=4)
    assert isinstance(caught.value, RunFolderError)
    assert len(str(caught.value).splitlines()) == 1
    assert contents(folder) == before
    # The folder is free again.
    assert len(resume(folder, max_updates=4).history) == 5

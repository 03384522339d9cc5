"""Designs that a run keeps on its way: which, how small, and what a damaged file means."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import ngspring
from ngspring import Design, DesignFileError, SpringProblem, Update, gallery, optimize
from ngspring.design.history import Row
from ngspring.design.snapshots import Snapshots
from ngspring.evolution.recorder import SnapshotRecorder
from ngspring.problem.scaling import on_mesh


def told(recorder: SnapshotRecorder, design: Design, updates: Mapping[int, bool]) -> None:
    for number, accepted in updates.items():
        moved = Design(design.problem, design.coefficients + number)
        recorder(Update(accepted, Row(number, 1.0), 1.0, "", moved))


@pytest.fixture
def small() -> SpringProblem:
    return on_mesh(ngspring.cases["C7"], 8)[0]


def test_recorder_keeps_what_was_asked_for_and_the_last(
    tmp_path: Path, small: SpringProblem
) -> None:
    design, path = Design.column(small), tmp_path / "snapshots.npz"
    recorder = SnapshotRecorder(path, (0, 2, 3))
    told(recorder, design, {0: True, 1: True, 2: False})
    assert sorted(Snapshots.load(path).designs()) == [0, 1]
    told(recorder, design, {2: True, 3: True, 4: True, 5: True})
    kept = Snapshots.load(path)
    assert kept.problem == small
    assert sorted(kept.designs()) == [0, 2, 3, 5]
    for number, snapshot in kept.designs().items():
        expected = design.coefficients + number
        np.testing.assert_allclose(snapshot.coefficients, expected, rtol=1e-3, atol=1e-3)
    assert [p.name for p in tmp_path.iterdir()] == ["snapshots.npz"]


def test_recorder_continues_a_resumed_run_and_replaces_another(
    tmp_path: Path, small: SpringProblem
) -> None:
    design, path = Design.column(small), tmp_path / "snapshots.npz"
    told(SnapshotRecorder(path, (0, 1, 4)), design, {0: True, 1: True, 2: True})
    told(SnapshotRecorder(path, (0, 1, 4)), design, {2: True, 3: True, 4: True, 5: True})
    assert sorted(Snapshots.load(path).designs()) == [0, 1, 4, 5]
    told(SnapshotRecorder(path, (0, 1, 4)), design, {0: True})
    assert sorted(Snapshots.load(path).designs()) == [0]
    other = Design.column(small.replace(l_i=2 * small.l_i, name="other"))
    told(SnapshotRecorder(path, (0, 1, 4)), other, {7: True})
    assert sorted(Snapshots.load(path).designs()) == [7]


def test_deep_void_fits_into_half_precision(tmp_path: Path, small: SpringProblem) -> None:
    path = tmp_path / "snapshots.npz"
    design = Design(small, np.full(small.coefficient_shape, -1e9))
    told(SnapshotRecorder(path), design, {0: True})
    assert Snapshots.load(path).designs()[0].density(50, 50) == 0.0


def test_damaged_snapshots_do_not_stop_a_run(tmp_path: Path, small: SpringProblem) -> None:
    path = tmp_path / "snapshots.npz"
    path.write_bytes(b"not an archive")
    told(SnapshotRecorder(path), Design.column(small), {3: True})
    assert sorted(Snapshots.load(path).designs()) == [3]


def test_a_run_with_a_folder_keeps_all_its_designs(tmp_path: Path, small: SpringProblem) -> None:
    result = optimize(small, max_updates=2, out=tmp_path, threads=1)
    snapshots = Snapshots.load(tmp_path / "snapshots.npz")
    designs = snapshots.designs()
    assert sorted(designs) == [0, 1, 2]
    assert list(snapshots.select((0, 40)).updates) == [0, 2]
    ratio = designs[2].equivalent_width
    assert ratio == pytest.approx(result.design.equivalent_width, rel=1e-3)


def test_snapshots_of_the_paper_s_mesh_are_small(tmp_path: Path) -> None:
    design, path = gallery["C4"], tmp_path / "snapshots.npz"
    told(SnapshotRecorder(path, range(10)), design, dict.fromkeys(range(7), True))
    assert path.stat().st_size < 30_000


def test_damaged_snapshots_are_one_clear_error(tmp_path: Path, small: SpringProblem) -> None:
    path = tmp_path / "snapshots.npz"
    with pytest.raises(DesignFileError, match="there is no file"):
        Snapshots.load(path)
    shape = (1, *small.coefficient_shape)
    good = np.zeros(shape, np.float16)
    for updates, chi in (
        (np.array([0, 1]), good),
        (np.array([0]), good + np.float16(np.nan)),
        (np.array([[0]]), good),
        (np.array([0.0]), good),
        (np.array([0]), np.zeros(shape, np.int64)),
    ):
        Snapshots(small, updates, chi).save(path)  # type: ignore[arg-type]
        with pytest.raises(DesignFileError, match="is not a valid snapshots file"):
            Snapshots.load(path)
    gallery["C4"].save(path)
    with pytest.raises(DesignFileError, match="is not a snapshots file"):
        Snapshots.load(path)

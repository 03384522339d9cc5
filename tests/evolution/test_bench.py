"""A run is timed whole: its parts make up the whole, and nothing is left behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from ngspring.basics.errors import ProblemError
from ngspring.evolution.bench import PARTS, RunBenchmark, benchmark_run
from ngspring.evolution.updates import Result, Update
from ngspring.kkt.bench import bench_problem

PROBLEM = bench_problem(8)
seen: list[Update] = []


def draw(result: Result, folder: Path) -> None:
    (folder / "picture.png").write_bytes(b"")


@pytest.fixture(scope="module")
def run() -> RunBenchmark:
    return benchmark_run(PROBLEM, threads=1, max_updates=4, observers=[seen.append], pictures=draw)


def test_parts_add_up_to_the_whole(run: RunBenchmark) -> None:
    assert list(run.parts) == list(PARTS)
    assert sum(run.parts.values()) == pytest.approx(run.seconds)
    assert all(seconds >= 0 for seconds in run.parts.values())
    # What has no name is bookkeeping.
    assert run.parts["rest"] < 0.2 * run.seconds


def test_every_part_of_an_iteration_takes_time(run: RunBenchmark) -> None:
    for name in ("preparation", "path", "assembly", "factorisation", "solve", "residual", "files"):
        assert run.parts[name] > 0, name


def test_counts_are_those_of_the_updates(run: RunBenchmark) -> None:
    accepted = [update.row for update in seen if update.accepted]
    assert run.updates == accepted[-1].update == 4
    assert run.rejected == sum(not update.accepted for update in seen)
    assert run.iterations == sum(row.newton_iterations for row in accepted) >= 4
    assert run.seconds_an_iteration <= run.seconds / run.iterations
    assert not run.converged
    assert "4 design updates" in run.message


def test_the_folder_of_a_timed_run_is_thrown_away() -> None:
    folders: list[Path] = []
    benchmark_run(
        PROBLEM,
        threads=1,
        max_updates=1,
        pictures=lambda result, folder: folders.append(folder.resolve(strict=True)),
    )
    assert not folders[0].exists()


def test_refuses_no_updates() -> None:
    with pytest.raises(ProblemError, match="max_updates = 0"):
        benchmark_run(PROBLEM, threads=1, max_updates=0)

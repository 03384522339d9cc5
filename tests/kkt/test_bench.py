"""The benchmark measures every part of a Newton iteration of the problem that was asked for."""

from __future__ import annotations

import dataclasses

import pytest

from ngspring.basics.errors import ProblemError
from ngspring.kkt.bench import MOST_POINTS, PARTS, Benchmark, bench_problem, benchmark
from ngspring.problem.cases import cases


@pytest.fixture(scope="module")
def result() -> Benchmark:
    return benchmark(bench_problem(8, 2), threads=1, solver="sparsecholesky", repeat=2)


def test_sizes(result: Benchmark) -> None:
    # 5 x 4 coefficients of chi; two control points with u, lambda and the top's multiplier.
    free = (result.unknowns - 20 - 2) / 4
    assert free == int(free) > 0
    assert result.nonzeros > result.unknowns


def test_every_part_takes_time(result: Benchmark) -> None:
    parts = [getattr(result, name) for name in PARTS]
    assert all(part > 0 for part in parts)
    assert max(parts) < result.iteration < result.first_iteration
    assert result.peak_memory > 0.01
    assert (result.threads, result.repeat) == (1, 2)


def test_paper_mesh_is_case_c7() -> None:
    assert bench_problem() == cases["C7"]


def test_coarse_meshes_resolve_the_interface() -> None:
    assert bench_problem(20).l_i == 4.0
    assert bench_problem(160).l_i == 1.0


def test_more_control_points() -> None:
    assert len(bench_problem(12, MOST_POINTS).control_points) == MOST_POINTS


@pytest.mark.parametrize("points", [0, -1, MOST_POINTS + 1])
def test_refuses_control_points(points: int) -> None:
    with pytest.raises(ProblemError, match="control points"):
        bench_problem(12, points)


@pytest.mark.parametrize("bad", [{"repeat": 0}, {"threads": 0}])
def test_refuses_numbers_below_one(bad: dict[str, int]) -> None:
    with pytest.raises(ProblemError, match="must be 1 or more"):
        benchmark(bench_problem(8), **bad)


def test_result_is_frozen(result: Benchmark) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.solve = 0.0  # type: ignore[misc]

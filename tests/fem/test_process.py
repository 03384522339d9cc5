"""How many threads there may be: one check, wherever the number comes from."""

from __future__ import annotations

import pytest
from threadpoolctl import ThreadpoolController

import ngspring
from ngspring.analysis.stability import stability
from ngspring.basics.errors import ProblemError
from ngspring.fem.process import checked_threads, parallel
from ngspring.problem.cases import cases

PROBLEM = ngspring.SpringProblem((ngspring.ControlPoint(5.0, 1.0),), elements=8)
WRONG = [0, -1, 100_000, 2.0, True, "2", float("nan")]


@pytest.mark.parametrize("threads", WRONG)
def test_a_number_of_threads_that_cannot_be_is_refused(threads: object) -> None:
    with pytest.raises(ProblemError, match=r"threads = .* integer from 1 to"):
        checked_threads(threads)  # type: ignore[arg-type]


@pytest.mark.parametrize("threads", [0, 100_000])
def test_every_analysis_asks_the_same_check(threads: int) -> None:
    design = ngspring.Design.column(PROBLEM)
    for analysis in (
        lambda: ngspring.load_displacement(design, [1.0], threads=threads),
        lambda: ngspring.optimality(design, threads=threads),
        lambda: ngspring.compound_state(design, threads=threads),
        lambda: ngspring.optimize(PROBLEM, threads=threads),
        lambda: ngspring.verify(ngspring.gallery["C4"], [1.0], threads=threads),
        lambda: stability(design, [1.0], threads=threads),
    ):
        with pytest.raises(ProblemError, match="threads"):
            analysis()


def test_all_processors_are_used_by_default(all_processors: int) -> None:
    assert checked_threads(None) == all_processors
    with parallel(None, cases["C7"].replace(elements=16, l_i=5.0)) as count:
        assert count == all_processors


def test_a_mesh_too_small_for_more_threads_is_given_one_unless_more_are_asked_for(
    all_processors: int,
) -> None:
    small = cases["C7"].replace(elements=14, l_i=6.0)
    for threads, right in ((None, 1), (2, 2)):
        with parallel(threads, small) as count:
            assert count == right
    with parallel(None, small.replace(domain="full")) as count:
        assert count == all_processors


def test_numpy_does_not_take_the_processors_while_something_is_computed() -> None:
    """Its threads spin after each product of vectors; afterwards they are there again."""

    def threads_of_numpy() -> set[int]:
        pools = ThreadpoolController().select(internal_api="openblas").info()
        return {pool["num_threads"] for pool in pools}

    before = threads_of_numpy()
    with parallel(2):
        assert threads_of_numpy() <= {1}
    assert threads_of_numpy() == before

"""How many threads there may be: one check, wherever the number comes from."""

from __future__ import annotations

import pytest

import ngspring
from ngspring.analysis.stability import stability
from ngspring.basics.errors import ProblemError
from ngspring.fem.process import available, checked_threads

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


def test_all_processors_are_used_by_default() -> None:
    assert checked_threads(None) == available()
    assert checked_threads(1) == 1

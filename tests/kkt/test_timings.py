"""Seconds are added up by parts; one within another is taken out of it."""

from __future__ import annotations

import time

import pytest

from ngspring.kkt.timings import Timings, timed


class Worker:
    def __init__(self) -> None:
        self.timings = Timings()

    @timed("outer")
    def outer(self, seconds: float) -> str:
        """Said in one line."""
        time.sleep(seconds)
        self.inner(seconds)
        return "done"

    @timed("inner")
    def inner(self, seconds: float) -> None:
        time.sleep(seconds)

    @timed("failing")
    def failing(self) -> None:
        raise ArithmeticError


def test_a_part_within_another_is_taken_out_of_it() -> None:
    worker = Worker()
    start = time.perf_counter()
    assert worker.outer(0.01) == "done"
    passed = time.perf_counter() - start
    seconds = worker.timings.seconds
    assert seconds["outer"] >= 0.01
    assert seconds["inner"] >= 0.01
    assert sum(seconds.values()) <= passed


def test_parts_are_added_up_and_counted() -> None:
    worker = Worker()
    for _ in range(3):
        worker.inner(0.001)
    assert worker.timings.counts == {"inner": 3}
    assert worker.timings.seconds["inner"] >= 0.003


def test_a_part_ends_with_its_error() -> None:
    worker = Worker()
    with pytest.raises(ArithmeticError):
        worker.failing()
    worker.inner(0.0)
    assert worker.timings.counts == {"failing": 1, "inner": 1}


def test_any_callable_can_be_timed_and_keeps_its_name_and_result() -> None:
    timings = Timings()
    assert timings.timed("sum", sum)([1, 2]) == 3
    assert timings.counts == {"sum": 1}
    assert Worker.outer.__doc__ == "Said in one line."

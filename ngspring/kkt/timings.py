"""Where the seconds of a coupled system go."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")


class Timings:
    """Seconds spent in parts of a computation, summed since it was made.

    A part within another one is taken out of it, so that parts add up to no more than what
    passed.

    Attributes
    ----------
    seconds : dict
        By the name of the part.
    counts : dict
        How many times each was gone through.

    Examples
    --------
    >>> timings = Timings()
    >>> with timings.part("outer"), timings.part("inner"):
    ...     pass
    >>> timings.counts
    {'outer': 1, 'inner': 1}
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.counts: dict[str, int] = {}
        self._open: list[str] = []
        self._since = 0.0

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add what passes within the context to a part."""
        self._account()
        self._open.append(name)
        try:
            yield
        finally:
            self._account()
            self._open.pop()
            self.counts[name] = self.counts.get(name, 0) + 1

    def _account(self) -> None:
        now = time.perf_counter()
        if self._open:
            name = self._open[-1]
            self.seconds[name] = self.seconds.get(name, 0.0) + now - self._since
        self._since = now

    def timed(
        self, name: str, call: Callable[Arguments, Returned]
    ) -> Callable[Arguments, Returned]:
        """The same callable, whose calls are a part."""

        def inside(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Returned:
            with self.part(name):
                return call(*args, **kwargs)

        return inside


class HasTimings(Protocol):
    """Whatever has timings."""

    @property
    def timings(self) -> Timings:
        """Where its seconds are added up."""


Timed = TypeVar("Timed", bound=HasTimings)


def timed(
    name: str,
) -> Callable[
    [Callable[Concatenate[Timed, Arguments], Returned]],
    Callable[Concatenate[Timed, Arguments], Returned],
]:
    """Decorator: calls are a part of the timings of their first argument."""

    def decorator(
        call: Callable[Concatenate[Timed, Arguments], Returned],
    ) -> Callable[Concatenate[Timed, Arguments], Returned]:
        @wraps(call)
        def inside(first: Timed, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Returned:
            with first.timings.part(name):
                return call(first, *args, **kwargs)

        return inside

    return decorator

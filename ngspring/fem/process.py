"""How many threads NGSolve uses."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import ngsolve as ng


def available() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def parallel(threads: int | None = None) -> Iterator[int]:
    """Let NGSolve use this many threads (all available ones by default); yields the number.

    The threads run only inside `tasks`.
    """
    count = available() if threads is None else threads
    ng.SetNumThreads(count)
    yield count


def tasks() -> contextlib.AbstractContextManager[Any]:
    """Context for a computation by NGSolve.

    Kept as short as the computation: idle workers of NGSolve spin, and would take the cores from
    numpy and MKL.
    """
    return ng.TaskManager()  # type: ignore[no-any-return]

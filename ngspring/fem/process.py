"""What the process does: how many threads NGSolve uses, and when memory goes back."""

from __future__ import annotations

import contextlib
import ctypes
import numbers
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import ngsolve as ng
from threadpoolctl import ThreadpoolController

from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.spring import SpringProblem


def available() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


#: More threads than this, or than there are processors, are a mistake: each takes memory.
MOST_THREADS = 64

#: Below this number of analysed cells a second thread costs more than it brings (12 updates of C7
#: on 8 x 8 take a quarter longer with it, on 16 x 16 as long).
_WORTH_THREADS = 64


def checked_threads(threads: int | None) -> int:
    """The number of threads to use: all available ones by default.

    Raises
    ------
    ProblemError
        If it is not an integer from 1 to `MOST_THREADS` (or the number of processors).
    """
    if threads is None:
        return available()
    most = max(MOST_THREADS, available())
    whole = isinstance(threads, numbers.Integral) and not isinstance(threads, bool)
    if not whole or not 1 <= threads <= most:
        raise ProblemError(
            f"threads = {shown(threads)} is not valid: it must be an integer from 1 to {most}"
            f" (there are {available()} processors)"
        )
    return int(threads)


def threads_for(problem: SpringProblem | None, threads: int | None = None) -> int:
    """The number of threads: what is asked for, or one if the mesh is too small for more, or all.

    Raises
    ------
    ProblemError
        See `checked_threads`.
    """
    if threads is None and problem is not None and _is_small(problem):
        threads = 1
    return checked_threads(threads)


@contextmanager
def parallel(threads: int | None = None, problem: SpringProblem | None = None) -> Iterator[int]:
    """Let NGSolve use this many threads; yields the number.

    All available ones by default, or one if the mesh of ``problem`` is too small for more. They run
    only inside `tasks`.

    Raises
    ------
    ProblemError
        See `checked_threads`: NGSolve would crash with none, and take all memory for thousands.
    """
    count = threads_for(problem, threads)
    ng.SetNumThreads(count)
    # NumPy's own threads bring nothing to sums and products of vectors, and go on spinning after
    # each: they take the processors from NGSolve and MKL.
    with ThreadpoolController().select(internal_api="openblas").limit(limits=1):
        yield count


def _is_small(problem: SpringProblem) -> bool:
    nx, ny = problem.sector.cells(problem.elements)
    return nx * ny < _WORTH_THREADS


def tasks() -> contextlib.AbstractContextManager[Any]:
    """Context for a computation by NGSolve.

    Kept as short as the computation: idle workers of NGSolve spin, and would take the cores from
    numpy and MKL.
    """
    return ng.TaskManager()  # type: ignore[no-any-return]


_M_MMAP_THRESHOLD = -3
_SMALL, _LARGE = 262_144, 33_554_432


@contextmanager
def giving_memory_back() -> Iterator[None]:
    """Blocks of more than 256 kB go back to the system as soon as they are freed, where glibc is.

    Building the index maps of a mesh frees blocks of many megabytes that glibc would keep: its
    threshold for giving a block back grows with every one that is freed, and the heap fills with
    holes (0.17 GB at 80 x 80). Afterwards what is free is given back, and what iterations free and
    need again is kept: fetching it anew costs page faults, a sixth of an iteration's time.
    """
    _set_threshold(_SMALL)
    try:
        yield
    finally:
        _set_threshold(_LARGE)


def _set_threshold(size: int) -> None:
    if sys.platform.startswith("linux"):
        with contextlib.suppress(OSError, AttributeError):
            library = ctypes.CDLL("libc.so.6")
            library.mallopt(_M_MMAP_THRESHOLD, size)
            library.malloc_trim(0)

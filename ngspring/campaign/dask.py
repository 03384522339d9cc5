"""Runs of a campaign on an existing Dask cluster, whose workers see the campaign's folder.

Start the workers with one thread each (``dask worker ADDRESS --nworkers 8 --nthreads 1``): within
one process runs wait for each other.
"""

from __future__ import annotations

import contextlib
import importlib
import threading
import uuid
from pathlib import Path
from typing import Any

from ngspring.basics.errors import ProblemError
from ngspring.campaign.outcome import FAILED, Outcome
from ngspring.campaign.plan import Run
from ngspring.campaign.workers import News, execute, one_line
from ngspring.evolution.updates import Update

SECONDS_TO_CONNECT = 10

# NGSolve's number of threads belongs to the process.
_one_at_a_time = threading.Lock()


class DaskWorkers:
    """The workers of a Dask scheduler.

    Raises
    ------
    ProblemError
        If dask.distributed is not installed, or no scheduler answers.
    """

    def __init__(self, address: str, threads: int, out: Path) -> None:
        try:
            distributed: Any = importlib.import_module("distributed")
        except ImportError:
            raise ProblemError(
                "a scheduler needs dask.distributed: pip install 'ngspring[campaign]'"
            ) from None
        try:
            self._client = distributed.Client(
                address, timeout=SECONDS_TO_CONNECT, set_as_default=False
            )
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise ProblemError(f"no Dask scheduler answers at {address!r}: {error}") from error
        self._threads, self._out = threads, out
        self._runs: dict[Any, Run] = {}
        self._done = distributed.as_completed(loop=self._client.loop)
        self._stop_name = f"ngspring-stop-{uuid.uuid4()}"
        self._stop = distributed.Event(self._stop_name, client=self._client)

    @property
    def full(self) -> bool:
        """The scheduler takes any number of runs."""
        return False

    def start(self, run: Run) -> None:
        """Submit a run; Dask itself repeats it if its worker dies."""
        future = self._client.submit(
            _execute_there, run, self._out, self._threads, self._stop_name, pure=False
        )
        self._runs[future] = run
        self._done.add(future)

    def news(self) -> list[News]:
        """Wait for the next run to end, and return its outcome."""
        future = next(self._done)
        run = self._runs.pop(future)
        try:
            outcome: Outcome = future.result()
        except BaseException as error:
            # Cancelled futures raise what is not an Exception; Ctrl-C must go through.
            if isinstance(error, KeyboardInterrupt | SystemExit):
                raise
            reason = one_line(f"{type(error).__name__}: {error}")
            outcome = Outcome(run, FAILED, reason)
        return [outcome]

    def stop(self) -> None:
        """Stop all runs after their current design update."""
        with contextlib.suppress(Exception):
            if self._runs:
                self._stop.set()
                self._client.cancel(list(self._runs))
        self._runs.clear()
        self._client.close()


def _execute_there(run: Run, out: Path, threads: int, stop_name: str) -> Outcome:
    distributed: Any = importlib.import_module("distributed")
    stop = distributed.Event(stop_name)

    def look(update: Update) -> None:
        if stop.is_set():
            raise KeyboardInterrupt

    with _one_at_a_time:
        return execute(run, out, threads, look)

"""Worker processes of this machine.

Every run has a process of its own, so that one that is killed takes no other with it, says by which
signal, and can be told to stop at once. A pool of `concurrent.futures` or loky ends all runs with
the one that is killed, and cannot say why; a Dask worker stops only between two design updates.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

from ngspring.basics.quiet import warnings_logged
from ngspring.campaign.outcome import Outcome
from ngspring.campaign.plan import Run
from ngspring.campaign.workers import Death, News, execute

SECONDS_TO_STOP = 60.0


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """A process that is started here never hears Ctrl-C, not even while it still imports.

    Ctrl-C, or that the terminal was closed, reaches all processes of a terminal; the campaign alone
    decides. It gets the one that comes in between afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # not a Unix system
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class LocalWorkers:
    """Worker processes on this machine, one per run."""

    def __init__(self, count: int, threads: int, out: Path) -> None:
        self._count, self._threads, self._out = count, threads, out
        self._context = multiprocessing.get_context("spawn")
        self._running: dict[Connection, tuple[Run, SpawnProcess]] = {}

    @property
    def full(self) -> bool:
        """Whether a further run has to wait."""
        return len(self._running) >= self._count

    def start(self, run: Run) -> None:
        """Begin or continue a run."""
        here, there = self._context.Pipe(duplex=False)
        process = self._context.Process(
            target=_work,
            args=(run, self._out, self._threads, there),
            name=f"ngspring {run.name}",
            daemon=True,
        )
        with _interrupts_held_back():
            process.start()
        # Only the worker holds this end now: its death closes it.
        there.close()
        self._running[here] = run, process

    def news(self) -> list[News]:
        """Wait until something happens, and return it."""
        found: list[News] = []
        for connection in wait(list(self._running)):
            assert isinstance(connection, Connection)
            run, process = self._running[connection]
            try:
                message = connection.recv()
            except Exception:
                # The worker was killed, perhaps in the middle of a message.
                message = None
            if isinstance(message, Outcome):
                found.append(message)
            elif message is not None:
                found.append((run, message))
                continue
            del self._running[connection]
            connection.close()
            if message is None:
                process.kill()
            process.join()
            if message is None:
                found.append(Death(run, _reason(process.exitcode)))
        return found

    def stop(self) -> None:
        """Stop all runs; each writes its last accepted design first."""
        for _, process in self._running.values():
            process.terminate()
        end = time.monotonic() + SECONDS_TO_STOP
        for connection, (_, process) in self._running.items():
            # A worker that waits for its message to be read would never come to an end.
            while process.is_alive() and time.monotonic() < end:
                with contextlib.suppress(Exception):
                    if connection.poll(0.1):
                        connection.recv()
                process.join(0.05)
            process.kill()
            process.join()
            connection.close()
        self._running.clear()


def _reason(code: int | None) -> str:
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-code).name}"
    return f"ended with code {code}"


def _work(run: Run, out: Path, threads: int, pipe: Connection) -> None:
    """Body of a worker process."""

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    # Ctrl-C reaches all processes of a terminal; the campaign alone decides, and says SIGTERM.
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, stop)
    # Without the campaign's process there is nobody to tell: then the run ends, to be resumed.
    with warnings_logged(), contextlib.suppress(OSError, KeyboardInterrupt):
        pipe.send(execute(run, out, threads, pipe.send))

"""What ends a command: Ctrl-C, a plain kill, and a terminal that is closed end it alike."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from typing import NoReturn

#: Exit code of a command that was interrupted, as shells have it.
INTERRUPTED = 130
_LIKE_CTRL_C = ("SIGTERM", "SIGHUP")


def _interrupt(*_: object) -> NoReturn:
    raise KeyboardInterrupt


def _leave(*_: object) -> NoReturn:
    with contextlib.suppress(OSError):
        os.write(2, b"ngspring: error: interrupted\n")
    os._exit(INTERRUPTED)


@contextlib.contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Make SIGTERM and SIGHUP end a command as Ctrl-C does: what was reached is written.

    A campaign that was simply killed would leave its workers behind until their next update. A
    signal that is ignored (nohup) stays so.
    """
    with _handled(_interrupt, _LIKE_CTRL_C):
        yield


@contextlib.contextmanager
def leaving_at_once() -> Iterator[None]:
    """End the program by a line at Ctrl-C, while modules are imported and nothing is at stake.

    An exception in the middle of an import comes out as a traceback, or as another error.
    """
    with _handled(_leave, ("SIGINT", *_LIKE_CTRL_C)):
        yield


@contextlib.contextmanager
def _handled(handler: object, names: tuple[str, ...]) -> Iterator[None]:
    # Only the main thread may set handlers; elsewhere the caller has its own.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    heard = {number: old for number, old in before.items() if old not in (signal.SIG_IGN, None)}
    for number in heard:
        signal.signal(number, handler)  # type: ignore[arg-type]
    try:
        yield
    finally:
        for number, old in heard.items():
            signal.signal(number, old)

"""Standard output and error that may break without ending a run: a closed pipe, a full disk."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO


class TolerantStream:
    """A text stream that loses what cannot be written.

    ``ngspring optimize C7 | head -1`` ends the printing, not the run. Characters that the stream's
    encoding does not have become question marks.

    Parameters
    ----------
    stream : text stream
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        #: Why output was lost; empty as long as none was, or where a pipe was closed.
        self.reason = ""
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")

    def __getattr__(self, name: str) -> Any:
        if name == "buffer":
            raise AttributeError(name)  # click would write past this class
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write as much as can be written; what it returns is always all of it."""
        with self._losing():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, if there is still somebody to flush to."""
        with self._losing():
            self._stream.flush()

    @contextlib.contextmanager
    def _losing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:  # ValueError: it was closed
            if isinstance(error, OSError) and error.errno != errno.EPIPE:
                self.reason = str(error.strerror or error)
            # Python would complain once more at its end about what is still in the buffer.
            with contextlib.suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)


@contextlib.contextmanager
def tolerant_streams() -> Iterator[None]:
    """Make both standard streams tolerant, and say in the end on the error what output is lost."""
    before = sys.stdout, sys.stderr
    with contextlib.ExitStack() as opened:
        # A stream that was closed before the program began is None, and its number is free: the
        # next file to be opened would get what is printed.
        out, err = (
            TolerantStream(stream or opened.enter_context(open(os.devnull, "w")))
            for stream in before
        )
        sys.stdout, sys.stderr = out, err
        try:
            yield
        finally:
            out.flush()
            if out.reason:
                err.write(f"ngspring: warning: output is lost: {out.reason}\n")
            err.flush()
            sys.stdout, sys.stderr = before

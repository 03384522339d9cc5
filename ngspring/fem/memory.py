"""Giving memory back to the system, where the C library would keep it (glibc)."""

from __future__ import annotations

import contextlib
import ctypes
import sys

_M_MMAP_THRESHOLD = -3
_SMALL, _LARGE = 262_144, 33_554_432


def begin_setup() -> None:
    """From now on blocks of more than 256 kB go back to the system as soon as they are freed.

    Building the index maps of a mesh frees blocks of many megabytes that glibc would keep: its
    threshold for giving a block back grows with every one that is freed, and the heap fills with
    holes (0.17 GB at 80 x 80). Nothing happens on other systems.
    """
    _set_threshold(_SMALL)


def end_setup() -> None:
    """Give back what is free, and keep from now on what iterations free and need again.

    Fetching it anew costs page faults, a sixth of an iteration's time.
    """
    _set_threshold(_LARGE)


def _set_threshold(size: int) -> None:
    if sys.platform.startswith("linux"):
        with contextlib.suppress(OSError, AttributeError):
            library = ctypes.CDLL("libc.so.6")
            library.mallopt(_M_MMAP_THRESHOLD, size)
            library.malloc_trim(0)

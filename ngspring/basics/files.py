"""Files that are either complete or not there: written beside their place, then renamed."""

from __future__ import annotations

import codecs
import contextlib
import io
import logging
import math
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.errors import DesignFileError, ProblemError, RunFolderError

logger = logging.getLogger(__name__)

PathLike = str | os.PathLike[str]

#: How the temporary files of `replacing` begin; the number of their process follows.
_OURS = ".ngspring-"


@contextlib.contextmanager
def replacing(path: PathLike, level: int = logging.INFO) -> Iterator[Path]:
    """A temporary name in the folder of ``path`` that takes its place if the block succeeds.

    Parameters
    ----------
    path : path
    level : int
        That the file was written is logged at this level.

    Raises
    ------
    RunFolderError
        If the file cannot be written (no permission, no space left, folder missing).
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise RunFolderError(f"cannot write {path}: it exists and is not a regular file")
    try:
        handle, name = tempfile.mkstemp(
            prefix=f"{_OURS}{os.getpid()}-", suffix=path.suffix, dir=path.parent
        )
        os.close(handle)
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {error.strerror}") from error
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        os.replace(temporary, path)
        logger.log(level, "wrote %s", path)
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def remove_leftovers(folder: Path) -> None:
    """Remove what processes that were killed while they wrote have left in a folder.

    Only files that `replacing` has made, of processes that are gone.
    """
    for leftover in folder.glob(f"{_OURS}*"):
        process = leftover.name.removeprefix(_OURS).partition("-")[0]
        if leftover.is_file() and process.isdecimal() and not _is_alive(int(process)):
            with contextlib.suppress(OSError):
                leftover.unlink()


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it belongs to somebody else
        return True
    return True


def write_text(path: PathLike, text: str) -> None:
    """Write UTF-8 text atomically."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_text(path: str, foreign: bool = False) -> str:
    """Content of a text file; what is wrong with it is a ProblemError of one line.

    Parameters
    ----------
    path : str
    foreign : bool
        Whether the file comes from other programs: besides UTF-8 it may be UTF-16 with a byte order
        mark, or Latin-1.
    """
    try:
        with open(path, "rb") as file:
            content = file.read()
        if foreign:
            return _decoded(content)
        # Some editors begin UTF-8 files with a byte order mark, which TOML does not allow.
        return content.decode("utf-8-sig")
    except OSError as error:
        raise ProblemError(f"the file cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        encoding = error.encoding.upper()
        raise ProblemError(
            f"the file cannot be read, it is not {encoding} text: byte {error.start} is wrong"
        ) from error
    except ValueError as error:
        raise ProblemError(f"the file cannot be read: {error}") from error


def _decoded(content: bytes) -> str:
    """Text in any of the encodings that other programs write."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    if b"\0" in content:
        raise ProblemError(
            "the file is not text (a spreadsheet or another program's own format): save it as CSV"
            " with a header such as d [mm];q [N]"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def finite_or_none(value: float) -> float | None:
    """A number for JSON, which has neither NaN nor infinity."""
    return float(value) if math.isfinite(value) else None


def write_arrays(path: PathLike, arrays: Mapping[str, Any], level: int = logging.INFO) -> None:
    """Write named arrays as one compressed .npz, atomically and without pickle.

    See `replacing` for ``level``.
    """
    buffer = io.BytesIO()
    converted = {name: np.asarray(value) for name, value in arrays.items()}
    # A damaged archive can lose a part without any other sign.
    converted["parts"] = np.array([*sorted(converted), "parts"])
    for name, value in converted.items():
        if value.dtype.hasobject:
            raise TypeError(f"{name} would need pickle")
    np.savez_compressed(buffer, **converted)  # type: ignore[arg-type]
    with replacing(path, level) as temporary:
        temporary.write_bytes(buffer.getvalue())


def read_arrays(path: PathLike, kind: str, version: int) -> dict[str, NDArray[Any]]:
    """Read what `write_arrays` wrote, checking its format name and version.

    Raises
    ------
    DesignFileError
        If the file is missing, truncated, of another kind or of another version.
    """
    path = Path(path)
    try:
        file = np.load(path, allow_pickle=False)
        if not isinstance(file, np.lib.npyio.NpzFile) or "format" not in file.files:
            raise DesignFileError(f"{path} is not a {kind} file of ngspring")
        with file:
            arrays = {name: file[name] for name in file.files}
    except DesignFileError:
        raise
    except FileNotFoundError:
        raise DesignFileError(f"there is no file {path}") from None
    except IsADirectoryError:
        raise DesignFileError(f"{path} is a folder, not a {kind} file") from None
    except OSError as error:
        raise DesignFileError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, EOFError, BadZipFile, KeyError, NotImplementedError, AttributeError):
        raise DesignFileError(
            f"{path} is not a {kind} file of ngspring, or it is truncated"
        ) from None
    except Exception as error:
        # zipfile and zlib raise many kinds of errors on damaged archives.
        raise DesignFileError(f"{path} is damaged: {error}") from error
    found = str(arrays["format"])
    if found != f"ngspring-{kind}":
        raise DesignFileError(f"{path} is not a {kind} file of ngspring: its format is {found!r}")
    try:
        number = int(arrays["version"])
    except (KeyError, TypeError, ValueError):
        raise DesignFileError(f"{path} has no valid version number") from None
    if number != version:
        raise DesignFileError(
            f"{path} has version {number} of the {kind} format, but this ngspring reads"
            f" version {version}: {'update ngspring' if number > version else 'make it anew'}"
        )
    parts = arrays.get("parts")
    if parts is None or parts.ndim != 1 or sorted(map(str, parts)) != sorted(arrays):
        raise DesignFileError(f"{path} is damaged: a part is missing")
    return arrays

"""Files: complete or not there when they are written, bounded and regular when they are read."""

from __future__ import annotations

import codecs
import contextlib
import errno
import io
import logging
import math
import os
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.checks import printable, shown
from ngspring.basics.errors import DesignFileError, ProblemError, RunFolderError

logger = logging.getLogger(__name__)

PathLike = str | os.PathLike[str]

#: Most bytes of a text and of its parts in an .npz, and of all arrays of an .npz.
LARGEST_TEXT, LARGEST_NOTE, LARGEST_ARRAYS = 20_000_000, 4_000_000, 500_000_000

#: How the temporary files of `replacing` begin; the number of their process follows.
_OURS = ".ngspring-"
#: Characters of the line that `attempt` returns.
_LONGEST_REASON = 300


@contextlib.contextmanager
def replacing(path: PathLike, level: int = logging.INFO, archive: bool = False) -> Iterator[Path]:
    """A temporary name in the folder of ``path`` that takes its place if the block succeeds.

    Parameters
    ----------
    path : path
    level : int
        That the file was written is logged at this level.
    archive : bool
        Whether a design or another .npz is written: nothing else takes the place of one.

    Raises
    ------
    RunFolderError
        If the file cannot be written (no permission, no space left, folder missing).
    """
    path = Path(path)
    if os.path.exists(path) and not os.path.isfile(path):
        raise RunFolderError(f"cannot write {path}: it exists and is not a regular file")
    if not archive and holds_archive(path):
        raise RunFolderError(
            f"cannot write {path}: it holds a design or another archive, choose another name"
        )
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


def attempt(
    path: Path,
    write: Callable[[Path], object],
    fatal: type[Exception] | tuple[type[Exception], ...] = (),
) -> str:
    """Write a file that nothing else depends on; where that fails, nothing else is lost.

    Parameters
    ----------
    path : path
    write : callable
        Writes it; may raise anything, as drawing with matplotlib does.
    fatal : exceptions, optional
        What is raised nevertheless.

    Returns
    -------
    str
        Why it was not written, in a line, which is logged as well; empty if it was.
    """
    try:
        write(path)
    except fatal:
        raise
    except Exception as error:
        logger.warning("%s was not written", path, exc_info=True)
        return printable(f"not written: {path.name}: {error}", _LONGEST_REASON)
    return ""


def holds_archive(path: PathLike) -> bool:
    """Whether a regular file is a .npz, or another zip archive."""
    try:
        with open(path, "rb", opener=_at_once) as file:
            return file.read(4) == b"PK\3\4"
    except (OSError, ValueError):
        return False


def _at_once(name: str, flags: int) -> int:
    """Open a file; a pipe that nobody writes to would keep us waiting."""
    return os.open(name, flags | getattr(os, "O_NONBLOCK", 0))


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


def read_bounded(path: PathLike, most: int) -> bytes:
    """Content of a regular file of at most ``most`` bytes: everything that is read comes by here.

    Raises
    ------
    OSError
        If it cannot be read, is larger, or is a pipe or a device, which may never end.
    """
    with open(path, "rb", opener=_at_once) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file")
        # Some regular files of the system say that they are empty.
        end = min(max(status.st_size, 1_000_000), most) + 1
        content = file.read(end) if status.st_size <= most else b""
    if status.st_size > most or len(content) == end:
        raise OSError(errno.EFBIG, f"it is larger than {most / 1e6:g} MB")
    return content


@contextlib.contextmanager
def naming(path: str) -> Iterator[None]:
    """What a text file's content is refused for begins with the name of the file."""
    try:
        yield
    except ProblemError as error:
        raise ProblemError(f"{path!r}: {error}") from error.__cause__


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
        content = read_bounded(path, LARGEST_TEXT)
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
    with replacing(path, level, archive=True) as temporary:
        temporary.write_bytes(buffer.getvalue())


@dataclass(frozen=True)
class Part:
    """What an array of a file must be.

    Attributes
    ----------
    kinds : str
        Letters of its type, as NumPy has them: "f" floats, "i" integers, "U" text.
    ndim : int
    needed : bool
        Whether a file without it is incomplete.
    """

    kinds: str
    ndim: int
    needed: bool = True

    def refused(self, array: NDArray[Any]) -> bool:
        """Whether an array is something else, or a text is too long to be taken apart."""
        wrong = array.dtype.kind not in self.kinds or array.ndim != self.ndim
        return wrong or (array.dtype.kind == "U" and array.nbytes > LARGEST_NOTE)


TEXT, NUMBER = Part("U", 0), Part("fiu", 0)


@contextlib.contextmanager
def reading_arrays(
    path: PathLike, kind: str, version: int, parts: Mapping[str, Part]
) -> Iterator[dict[str, Any]]:
    """What `write_arrays` wrote, its format, version and parts checked, for a block that uses it.

    Arrays by name, and texts and numbers as Python's where they are single ones. Whatever is
    raised on the way, also by the block, becomes one line that names the file.

    Raises
    ------
    DesignFileError
        If the file is missing, truncated, too large, of another kind or version, or a part is.
    """
    try:
        arrays = _unpacked(read_bounded(path, LARGEST_ARRAYS), f"{path} is not a {kind} file")
        found = str(arrays["format"])
        if found != f"ngspring-{kind}":
            raise DesignFileError(f"{path} is not a {kind} file: its format is {shown(found)}")
        _check_version(path, kind, arrays.get("version"), version)
        _check_parts(path, arrays, parts)
        yield {name: part if part.ndim else part.item() for name, part in arrays.items()}
    except DesignFileError:
        raise
    except FileNotFoundError:
        raise DesignFileError(f"there is no file {path}") from None
    except IsADirectoryError:
        raise DesignFileError(f"{path} is a folder, not a {kind} file") from None
    except OSError as error:
        raise DesignFileError(f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:
        # NumPy, zipfile and zlib raise many kinds of errors on what is damaged.
        what = error or type(error).__name__
        raise DesignFileError(f"{path} is not a valid {kind} file: {what}") from error


def _unpacked(content: bytes, refusal: str) -> dict[str, NDArray[Any]]:
    """All arrays of an .npz; how large they will be is looked at before."""
    try:
        with ZipFile(io.BytesIO(content)) as archive:
            size = sum(part.file_size for part in archive.infolist())
    except (BadZipFile, NotImplementedError):
        raise DesignFileError(f"{refusal} of ngspring, or it is truncated") from None
    if size > LARGEST_ARRAYS:
        raise ValueError(
            f"it unpacks to {size / 1e6:.0f} MB, more than {LARGEST_ARRAYS / 1e6:g} MB"
        )
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        if "format" not in file.files:
            raise DesignFileError(f"{refusal} of ngspring")
        return {name: file[name] for name in file.files}


def _check_version(path: PathLike, kind: str, found: Any, version: int) -> None:
    if found is None or found.ndim or found.dtype.kind not in "iu":
        raise DesignFileError(f"{path} has no valid version number")
    if found != version:
        raise DesignFileError(
            f"{path} has version {found} of the {kind} format, but this ngspring reads"
            f" version {version}: {'update ngspring' if found > version else 'make it anew'}"
        )


def _check_parts(
    path: PathLike, arrays: Mapping[str, NDArray[Any]], parts: Mapping[str, Part]
) -> None:
    names = arrays.get("parts")
    if names is None or names.ndim != 1 or sorted(map(str, names)) != sorted(arrays):
        raise DesignFileError(f"{path} is damaged: a part is missing")
    for name, part in parts.items():
        if part.needed and name not in arrays:
            raise DesignFileError(f"{path} lacks its part {name}")
        if name in arrays and part.refused(arrays[name]):
            raise ValueError(f"its part {name} has another type or shape, or is too long")

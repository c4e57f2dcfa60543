"""Output files: checked before the long work that makes them, and written atomically.

A file is written under a temporary name in its folder and renamed when it is complete: whatever has its final name is
complete, and an interruption leaves the earlier file as it was.
"""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from insenv.base.errors import InputError, InsenvError


def as_path(what: str, value: object) -> Path:
    """A path that a caller gave as `what`.  Raises `InputError` for anything else."""
    if not isinstance(value, (str, os.PathLike)) or not str(value) or "\0" in str(value):
        raise InputError(f"{what} = {value!r}: allowed is a path")
    return Path(value)


def check_output_file(path: Path, ending: str = "") -> None:
    """Raise `InputError` if no file can be written at `path`, or if its name does not have the ending.

    Refuse anything but a regular file: renaming over it would replace a device node.
    """
    if ending and path.suffix != ending:
        raise InputError(f"output {str(path)!r}: allowed is a name that ends in {ending}")
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"cannot write {str(path)!r}: it is {'a folder' if path.is_dir() else 'not a regular file'}")
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror or error}") from None


@contextmanager
def staged(folder: Path, private: bool = False) -> Iterator[Callable[[str], Path]]:
    """Give a function from a final name in `folder` to a temporary path; rename all files at the end of the block, or none.

    If the block fails, the temporary files are removed.
    private: readable and writable by the owner alone; otherwise permissions follow the umask.
    Raises OSError, and `InsenvError` if a folder has one of the names.
    """
    parts: dict[Path, Path] = {}

    def part(name: str) -> Path:
        handle, path = tempfile.mkstemp(prefix=f".{name}.", suffix=".part", dir=folder)
        os.close(handle)
        parts[Path(path)] = folder / name
        return Path(path)

    try:
        yield part
        for final in parts.values():
            if final.is_dir():
                raise InsenvError(f"cannot write {str(final)!r}: it is a folder")
        if not private:  # mkstemp creates files for their owner alone
            mask = os.umask(0)
            os.umask(mask)
            for temporary in parts:
                temporary.chmod(0o666 & ~mask)
        for temporary, final in parts.items():
            os.replace(temporary, final)
    finally:
        for temporary in parts:
            with suppress(OSError):
                temporary.unlink()


@contextmanager
def atomic(path: Path, private: bool = False) -> Iterator[BinaryIO]:
    """Open a temporary file for `path` and rename it at the end of the block; see `staged`."""
    with staged(path.parent, private) as part, part(path.name).open("wb") as stream:
        yield stream


# What commands print: plain values as JSON text without NaN, and the width of lines without a terminal.

WIDTH = 80
"""Columns of a table where there is no terminal."""


def to_json(value: Any, indent: int | None = 2) -> str:
    """JSON text in ASCII that any parser reads: numbers that are not finite become null."""
    return json.dumps(finite(value), allow_nan=False, indent=indent)


def finite(value: Any) -> Any:
    """A copy of nested mappings, sequences and scalars, including those of NumPy, with None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(name): finite(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars
        return finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


# A lock on a file, which one process at a time holds; the system releases it when the process ends, however it ends.

if sys.platform == "win32":
    import msvcrt

    def _take(handle: int) -> None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


class LockedError(Exception):
    """Another process, or another part of this one, holds the lock."""


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Hold the lock `path` during the block; the file is created, and removed at the end.

    Raises `LockedError` at once if it is held; OSError if the file cannot be created or its file system has no locks.
    """
    handle = _locked(path)
    try:
        yield
    finally:
        with suppress(OSError):  # Windows removes no open file
            path.unlink()
        os.close(handle)


def _locked(path: Path) -> int:
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _take(handle)
            # the holder before may have removed the file after it was opened here
            if os.path.exists(path) and os.path.samestat(os.stat(path), os.fstat(handle)):
                return handle
        except (BlockingIOError, PermissionError):
            os.close(handle)
            raise LockedError from None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)

"""Output files: checked before the long work that makes them, and written atomically.

A file is written under a temporary name in its folder and renamed when it is complete: whatever has its final name is
complete, and an interruption leaves the earlier file as it was.
"""

from __future__ import annotations

import errno
import json
import math
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from insenv.base.errors import InputError, InsenvError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PART = re.compile(r"\..+\.[a-z0-9_]{8}\.part")
"""Names of temporary files, as `staged` makes them."""


def cannot_write(path: Path, error: OSError) -> InsenvError:
    """The error about a path that cannot be written: `InputError`, which another call mends, unless the disk is full."""
    kind = InsenvError if error.errno in _FULL else InputError
    return kind(f"cannot write {str(path)!r}: {error.strerror or error}")


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
    if not path.parent.is_dir():
        what = "is not a folder" if path.parent.exists() else "does not exist"
        raise InputError(f"cannot write {str(path)!r}: {str(path.parent)!r} {what}")
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"cannot write {str(path)!r}: it is {'a folder' if path.is_dir() else 'not a regular file'}")
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise cannot_write(path, error) from None


@contextmanager
def staged(folder: Path, private: bool = False) -> Iterator[Callable[[str], Path]]:
    """Give a function from a final name in `folder` to a temporary path; rename all files at the end of the block, or none.

    If the block fails, the temporary files are removed; so are, first, those that a killed process has left in the folder.
    private: readable and writable by the owner alone; otherwise permissions follow the umask.
    Raises OSError, which names a final path, and `InsenvError` if a folder has one of the names.
    """
    parts: dict[Path, Path] = {}
    handles: list[int] = []
    _remove_left(folder)

    def part(name: str) -> Path:
        try:
            handle, path = tempfile.mkstemp(prefix=f".{name}.", suffix=".part", dir=folder)
        except OSError as error:
            error.filename = str(folder / name)
            raise
        if _HELD_WHILE_WRITTEN:
            handles.append(handle)
            with suppress(OSError):  # a file system without locks
                _take(handle)
        else:
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
    except OSError as error:
        if len(parts) == 1 and (error.filename is None or Path(str(error.filename)) in parts):
            error.filename = str(*parts.values())
        elif error.filename is None and error.errno in _FULL:
            error.filename = str(folder)
        raise
    finally:
        for temporary in parts:
            with suppress(OSError):
                temporary.unlink()
        for handle in handles:
            os.close(handle)


def _remove_left(folder: Path) -> None:
    """Remove temporary files whose process has ended: it holds a lock on each while it writes; else what is old is left."""
    with suppress(OSError), os.scandir(folder) as entries:
        for path in [Path(entry.path) for entry in entries if _PART.fullmatch(entry.name)]:
            with suppress(OSError):
                if not _HELD_WHILE_WRITTEN:
                    is_left = time.time() - path.stat().st_mtime > _OLD_S
                else:
                    handle = os.open(path, os.O_RDWR)
                    try:
                        _take(handle)
                        is_left = True
                    finally:
                        os.close(handle)
                if is_left:
                    path.unlink()


@contextmanager
def atomic(path: Path, private: bool = False) -> Iterator[BinaryIO]:
    """Open a temporary file for `path` and rename it at the end of the block; see `staged`."""
    with staged(path.parent, private) as part, part(path.name).open("wb") as stream:
        yield stream


def write_unless_other(path: Path, content: bytes) -> None:
    """Write a file; one that is there with this content stays.

    Raises `InputError` if one has another content, which a user may have written, or if it cannot be written.
    """
    try:
        if path.exists() and path.read_bytes() != content:
            raise InputError(f"{str(path)!r} exists with another content: it is not overwritten")
        with atomic(path) as stream:
            stream.write(content)
    except OSError as error:
        raise cannot_write(path, error) from None


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

_HELD_WHILE_WRITTEN = sys.platform != "win32"
"""Whether a temporary file is locked while it is written: Windows renames no open file."""
_OLD_S = 3600.0

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

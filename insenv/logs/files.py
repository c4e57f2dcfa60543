"""The files of a log: their bytes, whatever the archive, and all faults of them at once."""

from __future__ import annotations

import gzip
import importlib.resources
import io
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import TypeVar

from insenv.base.errors import InputError
from insenv.base.installing import install_package

PACKAGE = "package:"
MAX_BYTES = 4 * 1024**3
"""Largest unpacked file accepted [bytes]."""


def read_bytes(file: str, folder: Path) -> tuple[str, bytes]:
    """Read one file of a log.

    file: a path, relative to `folder` (that of the description) unless absolute, or ``package:NAME/path/inside/the/package``.
    Files that end in .gz or .zip are unpacked (a zip must hold one file); of the folder of a ROS 2 bag a tar archive is made.
    Returns (name for messages, bytes). Raises InputError: not found, unreadable, empty, package not installed.
    """
    if file.startswith(PACKAGE):
        label, raw = file, _from_package(file)
    else:
        path = Path(file).expanduser()
        path = path if path.is_absolute() else folder / path
        label, raw = str(path), _from_path(path)
    data = _unpack(label, raw)
    if not data:
        raise InputError(f"{label}: the file is empty")
    return label, data


def is_there(file: str, folder: Path) -> bool:
    """Whether `read_bytes` would find a file."""
    if not file.startswith(PACKAGE):
        return (folder / Path(file).expanduser()).exists()
    name, _, inside = file[len(PACKAGE) :].partition("/")
    try:
        return importlib.resources.files(name).joinpath(*PurePosixPath(inside).parts).is_file()
    except ModuleNotFoundError:
        return False


def _from_path(path: Path) -> bytes:
    if (path / "metadata.yaml").is_file():
        return _folder(path)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: file not found") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _folder(path: Path) -> bytes:
    """A tar archive of a folder, without times and owners: the same for the same files."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for file in sorted(path.iterdir()):
            if file.is_file():
                entry = tarfile.TarInfo(file.name)
                entry.size = file.stat().st_size
                with file.open("rb") as content:
                    archive.addfile(entry, content)
    return stream.getvalue()


def _from_package(file: str) -> bytes:
    name, _, inside = file[len(PACKAGE) :].partition("/")
    parts = PurePosixPath(inside).parts
    if not name.isidentifier() or not parts or ".." in parts or inside.startswith("/"):
        raise InputError(f"{file}: must be package:NAME/path/inside/the/package")
    try:
        root = importlib.resources.files(name)
    except ModuleNotFoundError:
        raise InputError(f"{PACKAGE}{name}: the Python package {name!r} is not installed: {install_package(name)}") from None
    except Exception as error:  # a package whose own import fails: any exception can come out of it
        raise InputError(f"{file}: the Python package {name!r} cannot be imported: {error}") from None
    node = root.joinpath(*parts)
    try:
        return node.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{file}: the installed package {name!r} holds no such file; is it another version?") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None


def _unpack(label: str, raw: bytes) -> bytes:
    lower = label.lower()
    try:
        if lower.endswith(".gz"):
            with gzip.GzipFile(fileobj=io.BytesIO(raw)) as stream:
                data = stream.read(MAX_BYTES + 1)
            if len(data) > MAX_BYTES:
                raise InputError(f"{label}: unpacks to more than {MAX_BYTES} bytes")
            return data
        if lower.endswith(".zip"):
            with zipfile.ZipFile(io.BytesIO(raw)) as archive:
                members = [i for i in archive.infolist() if not i.is_dir() and not i.filename.startswith("__MACOSX/")]
                if len(members) != 1:
                    names = ", ".join(i.filename for i in members[:5]) or "none"
                    raise InputError(f"{label}: the zip must hold exactly one file, it holds {len(members)}: {names}")
                if members[0].file_size > MAX_BYTES:
                    raise InputError(f"{label}: unpacks to {members[0].file_size} bytes, allowed {MAX_BYTES}")
                return archive.read(members[0])
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
        raise InputError(f"{label}: the archive cannot be unpacked: {error}") from None
    return raw


# All faults of a description at once: steps that do not depend on one another are all tried before an error is raised.

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass
class Faults:
    """Messages of the errors so far, each once, in order."""

    messages: list[str] = field(default_factory=list)

    def attempt(self, step: Callable[[], Result]) -> Result | None:
        """What a step returns; None, with its messages kept, if it raises InputError."""
        try:
            return step()
        except InputError as error:
            self.messages += [line for line in str(error).split("\n") if line not in self.messages]
            return None

    def check(self) -> None:
        """Raise one InputError with all messages, if there are any."""
        if self.messages:
            raise InputError("\n".join(self.messages))


def all_of(step: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The results of a step for all items.  Raises one InputError for all items that have a fault."""
    faults = Faults()
    results = [faults.attempt(lambda item=item: step(item)) for item in items]  # type: ignore[misc]
    faults.check()
    return [result for result in results if result is not None]

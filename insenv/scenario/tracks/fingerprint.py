"""The fingerprint of the file of a track, which changes with whatever the track is read from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from insenv.base.errors import InputError
from insenv.base.toml import read_toml


def fingerprint(path: Path) -> str:
    """SHA-256 of a file, of the contents of an archive, or of a description of a log and the files that it names.

    Raises `InputError` for a file that cannot be read; a file that a description names is left to the reader of the log.
    """
    from insenv.logs.resources import read_bytes  # which needs scenarios

    digest = hashlib.sha256(read_bytes(str(path), Path())[1])
    if path.suffix.lower() == ".toml":
        for file in _files_of(read_toml(path)):
            with suppress(InputError):
                digest.update(hashlib.sha256(read_bytes(file, path.resolve().parent)[1]).digest())
    return digest.hexdigest()


def _files_of(data: Mapping[str, Any]) -> Iterator[str]:
    """The files that a description of a log names."""
    for name, value in data.items():
        found = value.get("file") if isinstance(value, Mapping) else value if name == "flight" else None
        for file in found if isinstance(found, list) else [found]:
            if isinstance(file, str) and file:
                yield file

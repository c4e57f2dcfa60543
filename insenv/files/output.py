"""Whether a file can be written: asked before the long work that makes it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from insenv.errors import InputError


def check_output_file(path: Path) -> None:
    """Raise `InputError` if there cannot be a file at `path`.

    What is there and is no plain file is refused: a file that is complete is renamed to its name, and would take a device's.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"cannot write {str(path)!r}: it is {'a folder' if path.is_dir() else 'no plain file'}")
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror or error}") from None

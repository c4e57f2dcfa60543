"""Writing an FMU: a zip with the same bytes for the same files, complete or not there at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from insenv.errors import InputError
from insenv.files.output import atomic, check_output_file

_DATE = (1980, 1, 1, 0, 0, 0)  # the first that a zip can tell


def check_output(path: Path, ending: str) -> None:
    """Raise `InputError`, before the long work, if a file cannot be written there."""
    if path.suffix != ending:
        raise InputError(f"output {str(path)!r}: allowed is a name that ends in {ending}")
    check_output_file(path)


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """The zip of `files` by name, sorted, with a fixed date; renamed to `path` when complete."""
    with atomic(path) as stream, ZipFile(stream, "w", ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files, key=lambda n: (n != "modelDescription.xml", n)):
            entry = ZipInfo(name, _DATE)
            entry.compress_type = ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, files[name])

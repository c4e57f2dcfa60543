"""Telemetry logs out: each frame behind its time, as ground tools write and read them.

A record is the time as an unsigned 64-bit number, big end first, in microseconds of Unix time, whose two lowest bits say the
link, and the frame as it was on the wire.  `insenv.logs.flight.telemetry` reads them again.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from insenv.errors import InputError
from insenv.files.output import check_output_file

_LINK_BITS = 0b11


class TlogWriter:
    """Writes ``PATH.part`` and renames it to PATH when closed: PATH is never half a log, and what a crash leaves behind in the
    other file can be read up to its last whole record.

    An existing PATH is replaced at the end.  frames: how many were written.  Raises InputError when the file cannot be
    created or, later, written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.frames = 0
        check_output_file(self.path)
        self._part = self.path.with_name(self.path.name + ".part")
        try:
            self._file = self._part.open("wb", buffering=1 << 16)
        except OSError as error:
            raise self._error(error) from None

    def write(self, unix_us: int, frame: bytes, link: int = 0) -> None:
        """Append a frame that was sent or received at `unix_us` (microseconds of Unix time) over `link` (0 to 3)."""
        try:
            self._file.write((unix_us & ~_LINK_BITS | link & _LINK_BITS).to_bytes(8, "big") + frame)
        except OSError as error:
            raise self._error(error) from None
        self.frames += 1

    def flush(self) -> None:
        """Hand everything to the system."""
        try:
            self._file.flush()
        except OSError as error:
            raise self._error(error) from None

    def close(self) -> None:
        """Finish the log and give it its name; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self._file.close()
            os.replace(self._part, self.path)
        except OSError as error:
            raise self._error(error) from None

    def _error(self, error: OSError) -> InputError:
        with suppress(OSError, AttributeError):
            self._file.close()
        return InputError(f"telemetry log {self.path}: cannot be written: {error.strerror or error}")

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

"""Write telemetry logs (tlog) as ground stations write and read them.

A record is the Unix time in microseconds, a big-endian unsigned 64-bit number whose two lowest bits hold the link
number, followed by the frame.  `insenv.logs.flight.telemetry` reads these files.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from insenv.base.errors import InputError
from insenv.base.output import check_output_file

_LINK_BITS = 0b11


class TlogWriter:
    """A log that is written to ``PATH.part`` and renamed to PATH when closed.

    PATH is therefore never incomplete; after a crash ``PATH.part`` is readable up to its last whole record.  An
    existing PATH is replaced.  frames: the number written.  Raises `InputError` when the file cannot be created or
    written.
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
        """Append a frame sent or received at `unix_us` (Unix time, microseconds) over `link` (0 to 3)."""
        try:
            self._file.write((unix_us & ~_LINK_BITS | link & _LINK_BITS).to_bytes(8, "big") + frame)
        except OSError as error:
            raise self._error(error) from None
        self.frames += 1

    def flush(self) -> None:
        """Pass all that is buffered to the operating system."""
        try:
            self._file.flush()
        except OSError as error:
            raise self._error(error) from None

    def close(self) -> None:
        """Complete the log and rename it; a second call does nothing."""
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

"""MAVLink 2 signing: sign outgoing frames and verify incoming ones.

A signature is the first 6 bytes of SHA-256 over key, frame, link number and signing time.  The time counts units of 10
us since the start of 2015 and must grow within a stream (link number, system, component).
https://mavlink.io/en/guide/message_signing.html

The order of the checks matters: nothing about a sender is stored before its hash has been verified, so that nobody
without the key can advance a sender's time and lock it out.

Times are kept in a file beside the key.  For each stream it holds a mark one second *ahead* of the last accepted time,
for our own signatures one ahead of the last time used, and for streams that it does not list one ahead of our clock.  A
new mark is stored before the first frame that needs it takes effect; all marks are renewed together, so that the file
is written about once a second for any number of streams.  After a restart, and even after a crash, no accepted frame is
accepted again, and no signing time of ours is used twice.  A sender that continues during our restart is accepted again
after one second at most.

The table of streams is bounded.  When it is full, streams are forgotten whose last time is so old that none of their
frames could be accepted as the first of a new stream; the newest of these times is kept, as a floor for new streams, in
case our clock is set back.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from pathlib import Path

from insenv.base.errors import InputError
from insenv.base.output import atomic
from insenv.logs.formats.tlog import SIGNATURE, sender
from insenv.mavlink.wire.frames import is_signed

KEY_BYTES = 32
EPOCH_UNIX_S = 1420070400
"""2015-01-01 00:00 UTC, the origin of signing times."""
TICKS_PER_S = 100_000
MAX_TICKS = 2**48 - 1
MAX_LAG_TICKS = 60 * TICKS_PER_S
"""Largest lag of the first signing time of a new stream behind our clock."""
AHEAD_TICKS = TICKS_PER_S
"""How far the stored marks are ahead of the times."""
MAX_STREAMS = 1024
"""Largest number of streams kept."""
HASH_BYTES = 6
MAX_LEAD_TICKS = 24 * 3600 * TICKS_PER_S
"""Largest lead of a signing time over our clock: a time that is accepted locks its stream out until then, so that a
sender whose clock was once years ahead would be locked out for good."""

Stream = tuple[int, int, int]
"""Link number, system, component."""


class Verdict(Enum):
    """The result of `Signing.verify`; the values are names in `Statistics`."""

    GOOD = "good"
    UNSIGNED = "unsigned"
    WRONGLY_SIGNED = "wrongly_signed"
    REPLAYED = "replayed"
    STALE = "stale"
    EARLY = "early"
    REFLECTED = "reflected"


def read_key(path: str | Path) -> bytes:
    """Read a key: 32 raw bytes, or 64 hexadecimal digits with optional white space around them.

    Raises `InputError` if the file is missing, is not a regular file, may be read or written by others than its owner
    (on POSIX systems), has another length or is all zero.
    """
    path = Path(path)
    try:
        # fstat of the open file: the permissions of the file that is read
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise InputError(f"signing key {path}: must be a regular file")
            if os.name == "posix" and stat.S_IMODE(status.st_mode) & 0o077:
                raise InputError(
                    f"signing key {path}: permissions {stat.S_IMODE(status.st_mode):04o} let others read or change it;"
                    f" allowed is 0600 or less (chmod 600 {path})"
                )
            raw = file.read(4096)
    except FileNotFoundError:
        raise InputError(f"signing key {path}: file not found") from None
    except OSError as error:
        raise InputError(f"signing key {path}: cannot be read: {error.strerror or error}") from None
    key = raw
    if len(raw) != KEY_BYTES:
        key = b""
        with suppress(ValueError):
            key = bytes.fromhex(raw.decode("ascii").strip())
    if len(key) != KEY_BYTES:
        raise InputError(f"signing key {path}: {len(raw)} bytes; must be {KEY_BYTES} bytes or {2 * KEY_BYTES} hex digits")
    if not any(key):
        raise InputError(f"signing key {path}: all zero; create one with: head -c {KEY_BYTES} /dev/urandom > {path}")
    return key


def signature(key: bytes, frame: bytes, link: int, ticks: int) -> bytes:
    """The 13 bytes that follow a signed frame: link number, signing time, hash."""
    tail = bytes((link,)) + ticks.to_bytes(6, "little")
    return tail + hashlib.sha256(key + frame + tail).digest()[:HASH_BYTES]


class Signing:
    """One key, our signing time and the last time of every stream.

    link: the link number in our signatures, 0 to 255.  clock: Unix time (s).  marks: the file that keeps the times;
    None keeps none, and they are lost at a restart.  unstored: how often the file could not be written in operation.
    Raises `InputError`: a wrong length of the key, a wrong link, an invalid or unwritable file of marks.
    """

    def __init__(
        self, key: bytes, *, link: int = 0, clock: Callable[[], float] = time.time, marks: str | Path | None = None
    ) -> None:
        if len(key) != KEY_BYTES:
            raise InputError(f"signing key: {len(key)} bytes, must be {KEY_BYTES}")
        if not 0 <= link <= 255:
            raise InputError(f"signing link {link}: allowed is 0 to 255")
        self._key, self._link, self._clock = key, link, clock
        self._marks = None if marks is None else Path(marks)
        self._ticks_ours = 0
        self._ticks_mark = 0
        self._last: dict[Stream, int] = {}
        self._mark: dict[Stream, int] = {}
        self._floor = self._floor_mark = 0  # times up to it are not accepted from streams that are not listed
        self.unstored = 0
        if self._marks is not None:
            self._load(self._marks)
            self._write(self._marks)  # an unwritable file is an error now, not during operation

    @classmethod
    def from_key_file(cls, path: str | Path, *, clock: Callable[[], float] = time.time) -> Signing:
        """Read the key from a file (`read_key`) and keep the times in ``<that file>.times`` beside it."""
        return cls(read_key(path), clock=clock, marks=Path(f"{path}.times"))

    def _now(self) -> int:
        return min(max(int((self._clock() - EPOCH_UNIX_S) * TICKS_PER_S), 0), MAX_TICKS)

    # --- out -------------------------------------------------------------------------------------

    def signed(self, frame: bytes, link: int | None = None) -> bytes:
        """A frame (signed flag set, checksum correct) with its signature; signing times increase strictly.

        link: the link number, instead of the object's, for one of several links that share the key.
        """
        self._ticks_ours = max(self._ticks_ours + 1, self._now())
        if self._ticks_ours > self._ticks_mark and self._marks is not None:
            self._ticks_mark = self._ticks_ours + AHEAD_TICKS
            self._store_marks()
        return frame + signature(self._key, frame, self._link if link is None else link, self._ticks_ours)

    # --- in --------------------------------------------------------------------------------------

    def verify(self, frame: bytes, *, ours: tuple[int, int] | None = None) -> Verdict:
        """Verify a checked frame; the state changes only with `Verdict.GOOD`.

        ours: our system and component; frames that state them are reflections of our own.
        """
        if not is_signed(frame):
            return Verdict.UNSIGNED
        body, link, ticks = frame[:-SIGNATURE], frame[-SIGNATURE], int.from_bytes(frame[-12:-6], "little")
        if not hmac.compare_digest(signature(self._key, body, link, ticks), frame[-SIGNATURE:]):
            return Verdict.WRONGLY_SIGNED
        who = sender(frame)
        if ours == who:
            return Verdict.REFLECTED
        stream, now = (link, *who), self._now()
        if ticks > now + MAX_LEAD_TICKS:
            return Verdict.EARLY
        last = self._last.get(stream)
        if ticks <= (self._floor if last is None else last):
            return Verdict.REPLAYED
        if last is None and (ticks + MAX_LAG_TICKS < now or not self._has_room(now)):
            return Verdict.STALE
        if (
            self._marks is not None
            and ticks > self._mark.get(stream, self._floor_mark)
            and not self._renewed(stream, ticks, now)
        ):
            return Verdict.STALE
        self._last[stream] = ticks
        # the other end compares our first frame with its own clock, which may be ahead of ours
        self._ticks_ours = max(self._ticks_ours, ticks)
        return Verdict.GOOD

    def _has_room(self, now: int) -> bool:
        """Whether a new stream fits; forgets those that are older than the window if it does not."""
        if len(self._last) < MAX_STREAMS:
            return True
        old = {stream: ticks for stream, ticks in self._last.items() if ticks + MAX_LAG_TICKS < now}
        for stream, ticks in old.items():
            self._floor = max(self._floor, ticks)
            del self._last[stream]
            self._mark.pop(stream, None)
        self._floor_mark = max(self._floor_mark, self._floor)
        return bool(old)

    def _renewed(self, stream: Stream, ticks: int, now: int) -> bool:
        """Renew the marks of all streams, of this one for a frame at `ticks`, and of new ones; whether they are stored."""
        before = self._mark, self._floor_mark
        times = {**self._last, stream: ticks}
        self._mark = {each: max(self._mark.get(each, 0), min(last + AHEAD_TICKS, MAX_TICKS)) for each, last in times.items()}
        self._floor_mark = max(self._floor_mark, min(now + AHEAD_TICKS, MAX_TICKS))
        if self._store_marks():
            return True
        self._mark, self._floor_mark = before
        return False

    # --- the file of times -------------------------------------------------------------------------

    def _load(self, path: Path) -> None:
        try:
            stored = json.loads(path.read_text("utf-8"))
            streams = {_stream(name): _ticks(ticks) for name, ticks in stored["streams"].items()}
            stamp, floor = _ticks(stored["own"]), _ticks(stored.get("others", 0))
        except FileNotFoundError:
            return
        except OSError as error:
            raise InputError(f"signing times {path}: cannot be read: {error.strerror or error}") from None
        except (ValueError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"signing times {path}: not a valid file of signing times; without it, frames of the last minute could be"
                " replayed: repair it, or wait a minute and remove it"
            ) from None
        self._ticks_ours = self._ticks_mark = stamp
        self._last, self._mark = dict(streams), dict(streams)
        self._floor = self._floor_mark = floor

    def _write(self, path: Path) -> None:
        streams = {" ".join(map(str, stream)): ticks for stream, ticks in sorted(self._mark.items())}
        marks = {"own": max(self._ticks_ours, self._ticks_mark), "others": self._floor_mark, "streams": streams}
        text = json.dumps(marks, indent=1)
        try:
            with atomic(path, private=True) as file:
                file.write(f"{text}\n".encode())
        except OSError as error:
            raise InputError(
                f"signing times {path}: cannot be written: {error.strerror or error}; they are kept beside the key"
                " to prevent replay after a restart"
            ) from None

    def _store_marks(self) -> bool:
        assert self._marks is not None
        try:
            self._write(self._marks)
        except InputError:
            self.unstored += 1
            return False
        return True

    def store(self) -> None:
        """Store the exact times at an orderly end, so that no sender has to wait for the marks."""
        if self._marks is not None:
            self._mark = dict(self._last)
            self._ticks_mark, self._floor_mark = self._ticks_ours, self._floor
            self._write(self._marks)


def _stream(name: str) -> Stream:
    link, system, component = (int(part) for part in name.split(" "))
    return link, system, component


def _ticks(value: object) -> int:
    if not isinstance(value, int) or not 0 <= value <= MAX_TICKS:
        raise ValueError
    return value

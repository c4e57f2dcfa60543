"""`check_c`: feed an exported filter that runs elsewhere, behind a port, and compare what it answers, to the bit.

The protocol stands in ``c/port.c``.
"""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Protocol

import numpy as np

from insenv.base.errors import InputError, InsenvError
from insenv.base.installing import need
from insenv.base.output import as_path
from insenv.core.runner import Progress
from insenv.core.tables import Vector
from insenv.export.board.exporter import RUN, SAMPLES_FILE

TIMEOUT_S = 10.0
"""Longest time without an answer."""
STATUSES = 6
"""The last of the statuses of a filter."""
GREETING = 8
"""Bytes that a board sends back, so that it is known where its next answer begins."""
LEFT_OVER = 65_536
"""Most bytes that an earlier check, which was cut, may have left on the line."""
BAUD = 115_200
LAST_TCP_PORT = 65_535
_PORTS = f"allowed is tcp:HOST:PORT with a PORT from 1 to {LAST_TCP_PORT}, or serial:DEVICE[:BAUD]"


@dataclass(frozen=True)
class Checked:
    """samples, compared, differing: numbers of samples, of outputs that were compared, and of those with other bits.

    first: sample, place among the outputs, answer and expected value of the first that differs; None: none.
    """

    samples: int
    compared: int
    differing: int
    first: tuple[int, int, float, float] | None


class Port(Protocol):
    """A line to a board."""

    def read(self, size: int, /) -> bytes | None:
        """At most `size` bytes; after `TIMEOUT_S` none, or TimeoutError."""

    def write(self, data: bytes, /) -> int | None:
        """Send all."""

    def close(self) -> None:
        """Give the line back."""


def check_c(folder: str | Path, port: str, *, samples: int | None = None, progress: Progress | None = None) -> Checked:
    """Feed the filter behind a port with the samples of an export and compare its outputs.

    folder: of `insenv.export.board.export_c`; its whole run is fed if it is there, otherwise its first samples.  port:
    ``tcp:HOST:PORT`` or ``serial:DEVICE[:BAUD]`` (pyserial).  samples: at most so many; None: all.  progress: called with the
    numbers of samples done and in all.

    Raises `InputError` for a folder that is no complete export or a port that cannot be opened, `InsenvError` for a status that
    is not OK and for a board that does not answer or closes the connection.
    """
    export = _Export(as_path("folder", folder))
    total = export.samples if samples is None else min(samples, export.samples)
    compared = differing = done = 0
    first: tuple[int, int, float, float] | None = None
    with closing(_opened(port)) as line:

        def judge(expected: Vector) -> None:
            nonlocal compared, differing, first
            values = np.frombuffer(_read(line, 8 * expected.size), "<f8")
            other = np.flatnonzero(values.view("<i8") != expected.view("<i8"))
            compared, differing = compared + expected.size, differing + other.size
            if other.size and first is None:
                first = done, int(other[0]), float(values[other[0]]), float(expected[other[0]])

        _greet(line, export.inputs.shape[1] * 8)
        _ask(line, b"S", "start")
        judge(export.at_start)
        for given, expected in islice(export.rows(), total):
            _ask(line, b"I" + given, f"sample {done}")
            done += 1
            if expected is not None:
                _ask(line, b"O", f"outputs after {done} samples")
                judge(expected)
            if progress is not None and (done % 100 == 0 or done == total):
                progress(done, total)
    return Checked(done, compared, differing, first)


class _Export:
    """The samples of an exported folder.  at_start: outputs before the first of them."""

    def __init__(self, folder: Path) -> None:
        try:
            text = (folder / SAMPLES_FILE).read_text(encoding="ascii")
        except (OSError, ValueError):
            raise InputError(f"{folder}: not an export of `insenv export c`: it has no {SAMPLES_FILE}") from None
        self.at_start = _numbers(text, "outputs_at_start")[0]
        self.inputs, self.outputs = _numbers(text, "first_inputs"), _numbers(text, "first_outputs")
        self.run = folder / RUN if (folder / RUN).is_file() else None
        name = "EVERY" if self.run is None else "RUN_EVERY"
        self.every = int(re.findall(rf"^#define {name} (\d+)", text, re.MULTILINE)[0])
        self.record = 8 * (self.every * self.inputs.shape[1] + self.at_start.size)
        size = self.record if self.run is None else self.run.stat().st_size
        if size % self.record or not size:
            raise InputError(f"{self.run} has {size} bytes: allowed is a multiple of {self.record}; export the filter again")
        self.samples = len(self.inputs) if self.run is None else size // self.record * self.every

    def rows(self) -> Iterator[tuple[bytes, Vector | None]]:
        """Inputs of each sample, and the outputs after it where they are known."""
        if self.run is None:
            for k, row in enumerate(self.inputs):
                known = (k + 1) % self.every == 0
                yield row.astype("<f8").tobytes(), self.outputs[(k + 1) // self.every - 1] if known else None
            return
        width = 8 * self.inputs.shape[1]
        with self.run.open("rb") as stream:
            while len(record := stream.read(self.record)) == self.record:
                for k in range(self.every):
                    last = k == self.every - 1
                    yield record[k * width : (k + 1) * width], np.frombuffer(record[self.every * width :]) if last else None


def _numbers(text: str, name: str) -> Vector:
    """The rows of an array of samples.h."""
    found = re.search(rf"{name}(?:\[[^\]]*\])*\[(\d+)\] = (.*?);$", text, re.MULTILINE | re.DOTALL)
    if found is None:
        raise InputError(f"{SAMPLES_FILE} has no array {name}: export the filter again")
    return np.array(re.findall(r"[-+.\de]+", found[2]), dtype=np.float64).reshape(-1, int(found[1]))


def _opened(port: str) -> Port:
    kind, _, rest = port.partition(":")
    name, colon, number = rest.rpartition(":")
    try:
        if kind == "tcp" and name and number.isdigit() and 1 <= int(number) <= LAST_TCP_PORT:
            with socket.create_connection((name, int(number)), TIMEOUT_S) as connection:
                return connection.makefile("rwb", buffering=0)  # which keeps the connection
        if kind == "serial" and rest:
            need("a check through a serial port", "serial", package="pyserial", extra="serial")
            import serial

            is_rate = bool(colon) and number.isdigit()
            line: Port = serial.Serial(name if is_rate else rest, int(number) if is_rate else BAUD, timeout=TIMEOUT_S)
            return line
    except (OSError, ValueError) as error:
        raise InputError(f"port {port!r} cannot be opened: {error}") from None
    raise InputError(f"port {port!r}: {_PORTS}")


def _greet(line: Port, size: int) -> None:
    """End a request of `size` bytes that an earlier check may have cut, and read what it may have left."""
    greeting, got = os.urandom(GREETING), b""
    _send(line, bytes(size) + b"H" + greeting, "start")
    while not got.endswith(greeting):
        got += _read(line, 1)
        if len(got) > LEFT_OVER:
            raise InsenvError("another program than test/port.c of this export sends on this port")


def _ask(line: Port, request: bytes, what: str) -> None:
    """Send a request and read its status."""
    _send(line, request, what)
    status = _read(line, 1)[0]
    if status:
        other = "another program than test/port.c answers" if status > STATUSES else "the list is in its header"
        raise InsenvError(f"{what}: the filter answers with status {status} ({other})")


def _send(line: Port, data: bytes, what: str) -> None:
    try:
        line.write(data)
    except OSError as error:
        raise InsenvError(f"{what}: the port is gone: {error}") from None


def _read(line: Port, size: int) -> bytes:
    """Exactly `size` bytes."""
    got = b""
    while len(got) < size:
        try:
            part = line.read(size - len(got))
            is_closed = isinstance(line, socket.SocketIO)
        except OSError as error:
            part, is_closed = None, not isinstance(error, TimeoutError)
        if not part:
            what = "the port was closed" if is_closed else f"no answer within {TIMEOUT_S:g} s"
            raise InsenvError(f"{what}: does test/port.c of this export run on the board?")
        got += part
    return got

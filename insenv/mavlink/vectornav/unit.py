"""A unit: its three binary outputs, when each is due, and the commands that configure it.

A frame is 0xFA, a byte with a bit per group of fields, a mask of 16 bits per group, the fields, and the CRC-16 (polynomial
0x1021, start 0, big-endian) of all but the first byte.  Groups, masks and fields are little-endian, in ascending order.

A command is a line ``$VNWRG,75,3,16,01,0721*XX``: the text between $ and * with its exclusive or in hexadecimal, with a CRC-16
in four digits, or with XX, which is not checked.  The answer repeats it; that to a command which is refused is ``$VNERR,`` and
a code.  The masks may be any that `insenv.mavlink.vectornav.fields.FIELDS` can fill, as versions of ArduPilot ask for different
ones.

Source: as of `insenv.mavlink.vectornav.fields`, sections "Communication Interface" and "Binary Output Register 1 to 3".
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Any

from fastcrc import crc16

from insenv.base.errors import InputError
from insenv.logs.formats.tlog import TlogWriter
from insenv.mavlink.messages.schedule import next_due
from insenv.mavlink.messages.view import View
from insenv.mavlink.stream import Stream
from insenv.mavlink.vectornav.fields import FIELDS, Field, Reading
from insenv.mavlink.vehicle import Vehicle
from insenv.mavlink.wire import Link

SYNC = b"\xfa"
MODEL, ASCII_OUTPUT, OUTPUTS = 1, 6, (75, 76, 77)
"""Registers: the model, the ASCII output, of which there is none, and the three binary outputs."""
BAD_CHECKSUM, BAD_COMMAND, TOO_FEW, BAD_VALUE, BAD_REGISTER, BAUD_TOO_LOW = 3, 4, 5, 7, 8, 12
"""Codes of VNERR."""
COMMANDS = ("VNASY", "VNRRG", "VNWRG")
MAX_LINE, MAX_COMMANDS, MAX_REFUSED = 256, 16, 64
"""Bytes of an unfinished command that are kept, commands that are followed at once (more are dropped), and refused ones that
are counted apart: a host may send anything."""
BITS_A_BYTE = 10
"""Of a serial line: a start and a stop bit with each byte."""


@dataclass(frozen=True)
class Model:
    """A kind of unit.

    title: in answers.  hz: rate of its samples, which an output's divisor divides.  navigates: whether it has position and
    velocity.  outputs: what its registers hold before any command.
    """

    title: str
    hz: float
    navigates: bool
    outputs: Mapping[int, str]


MODELS = {
    "vn300": Model("VN-300", 400.0, True, {75: "3,2,01,0721", 76: "3,8,31,0001,0106,0613", 77: "3,80,49,0003,26B8,0018"}),
    "vn100": Model("VN-100", 800.0, False, {75: "3,4,01,0721", 76: "3,16,11,0001,0106", 77: "0,1,01,0001"}),
}
"""By name: IMU at 200 Hz, attitude and INS at 50 Hz and GNSS at 5 Hz, as the driver of ArduPilot reads them."""


class CommandError(InputError):
    """A command that is answered by VNERR.  code: of the answer."""

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code = code


@dataclass(frozen=True)
class Output:
    """A binary output.  on: whether it is sent; hz: its rate; header: groups and masks; fields: in their order."""

    on: bool
    hz: float
    header: bytes
    fields: tuple[Field, ...]

    @property
    def size(self) -> int:
        """Bytes of a frame."""
        return len(SYNC) + len(self.header) + sum(field.size for field in self.fields) + 2

    def frame(self, reading: Reading) -> bytes:
        """The frame at the present sample."""
        body = self.header + b"".join(field.packed(reading) for field in self.fields)
        return SYNC + body + crc16.xmodem(body).to_bytes(2, "big")


def output_of(text: str, model: Model) -> Output:
    """The output of a register's text: port (0 none, 1, 2, 3 both), divisor, groups and masks in hexadecimal.

    Raises `CommandError`: too few masks, a number out of range, or a field that the model or the simulation does not have.
    """
    try:
        port, divisor, groups, *masks = (int(part, 10 if place < 2 else 16) for place, part in enumerate(text.split(",")))
    except ValueError:
        raise CommandError(TOO_FEW, f"{text!r} is not port, divisor, groups and masks") from None
    numbers = [bit + 1 for bit in range(8) if groups >> bit & 1]
    in_range = 0 <= port <= 3 and 1 <= divisor <= 0xFFFF and 1 <= groups <= 0xFF
    if not in_range or not all(0 <= mask <= 0xFFFF for mask in masks):
        allowed = "a port from 0 to 3, a divisor from 1 to 65535, groups from 01 to FF, masks of 16 bits"
        raise CommandError(BAD_VALUE, f"{text!r}: allowed is {allowed}")
    if len(masks) != len(numbers):
        raise CommandError(TOO_FEW, f"{text!r} has {len(masks)} masks for {len(numbers)} groups")
    fields: list[Field] = []
    for group, mask in zip(numbers, masks, strict=True):
        for bit in (bit for bit in range(16) if mask >> bit & 1):
            known = FIELDS.get(group, {}).get(bit, ())
            if not known or (known[0].navigation and not model.navigates):
                raise CommandError(BAD_VALUE, f"{model.title} has no field for bit {bit} of group {group}")
            fields += known
    header = bytes((groups,)) + b"".join(mask.to_bytes(2, "little") for mask in masks)
    return Output(port > 0, model.hz / divisor, header, tuple(fields))


def line(body: str) -> bytes:
    """A line with its checksum."""
    return f"${body}*{reduce(xor, body.encode('ascii')):02X}\r\n".encode("ascii")


_LINE = re.compile(r".*\$(VN[A-Z]{3}[ -#%-)+-~]*)\*([0-9A-Fa-f]{4}|[0-9A-Fa-f]{2}|[Xx]{2})")


class Unit:
    """A unit and its configuration, which lasts as the stream does, whoever connects.

    model: see `MODELS`.  sample_hz: of the simulation; an output that is asked for more often is sent at each sample.  baud: of
    a serial line; None: any.  registers: texts of the outputs; on: whether they are sent (``VNASY``).  refused: commands that
    were refused, with the reason, by number.  Raises `InputError` if the outputs do not fit into the line.
    """

    def __init__(self, model: Model, sample_hz: float, baud: int | None = None) -> None:
        self.model, self.on = model, True
        self.registers: dict[int, str] = {}
        self.refused: Counter[str] = Counter()
        self._sample_hz, self._baud = sample_hz, baud
        self._outputs: dict[int, Output] = {}
        self._due: dict[int, float] = {}
        self._sample = 0
        self._configure(model.outputs)

    # --- out ----------------------------------------------------------------------------------------

    def frames(self, view: View) -> Iterator[tuple[str, bytes]]:
        """The frames that are due at the present sample, each with the name of its output; call it once for every sample."""
        self._sample = view.simulation.samples
        for register, output in self._outputs.items():
            if output.on and self._due[register] <= self._sample:
                self._schedule(register)
                if self.on:
                    name = f"OUTPUT_{register}"
                    yield name, output.frame(Reading(view, name))

    def _schedule(self, register: int) -> None:
        self._due[register] = next_due(min(self._outputs[register].hz, self._sample_hz), self._sample_hz, self._sample)

    # --- in -----------------------------------------------------------------------------------------

    def take(self, data: bytes) -> tuple[list[tuple[str, bytes]], bytes]:
        """Follow the commands in bytes that a host has sent: for each its kind, such as ``VNWRG``, and the answer.

        Also the end of the bytes, an unfinished command, which belongs before those that the host sends next.
        """
        *lines, rest = re.split(rb"[\r\n]+", data)
        matches = [_LINE.fullmatch(text.decode("ascii", "replace")) for text in lines]
        followed = [(each[1], each[2]) for each in matches if each is not None][:MAX_COMMANDS]
        return [(body[:5], self._answer(body, checksum)) for body, checksum in followed], rest[-MAX_LINE:]

    def _answer(self, body: str, checksum: str) -> bytes:
        try:
            data = body.encode("ascii", "replace")
            right = f"{crc16.xmodem(data):04X}" if len(checksum) == 4 else f"{reduce(xor, data):02X}"
            if checksum.upper() not in (right, "XX"):
                raise CommandError(BAD_CHECKSUM, f"checksum {checksum} is not {right}")
            return line(self._follow(body))
        except CommandError as error:
            text = f"{body}: {error}"
            self.refused[text if text in self.refused or len(self.refused) < MAX_REFUSED else "others"] += 1
            return line(f"VNERR,{error.code:02X}")

    def _follow(self, body: str) -> str:
        """Follow a command, and return the text of the answer.  Raises `CommandError`."""
        kind, *values = body.split(",")
        if kind == "VNASY" and values[:1] in (["0"], ["1"]):
            self.on = values[0] == "1"
            return body
        if kind not in ("VNWRG", "VNRRG"):
            raise CommandError(BAD_COMMAND, f"a unit knows {', '.join(COMMANDS)}")
        if not values or not values[0].isdecimal():
            raise CommandError(TOO_FEW, "there is no register")
        register = int(values[0])
        if kind == "VNRRG" and register == MODEL:
            return f"{body},{self.model.title}"
        if kind == "VNRRG" and register in OUTPUTS:
            return f"{body},{self.registers[register]}"
        if kind == "VNWRG" and register in OUTPUTS:
            self._configure({register: ",".join(values[1:])})
        elif kind == "VNRRG" or register != ASCII_OUTPUT:
            raise CommandError(BAD_REGISTER, "the registers are 1 (read), 6 (write) and 75 to 77")
        return body

    def _configure(self, texts: Mapping[int, str]) -> None:
        outputs = {**self._outputs, **{register: output_of(text, self.model) for register, text in texts.items()}}
        needed = sum(each.size * min(each.hz, self._sample_hz) for each in outputs.values() if each.on) * BITS_A_BYTE
        if self._baud is not None and needed > self._baud:
            raise CommandError(BAUD_TOO_LOW, f"{self._baud} baud: the outputs of the {self.model.title} need {needed:.0f}")
        self._outputs = outputs
        self.registers.update(texts)
        for register in texts:
            self._schedule(register)


# The stream of a unit: its frames on one link, paced as every stream, and MAVLink on others beside it.
#
# The link of the unit is a serial line or TCP, which MAVLink does not share.  On the other links a ground station watches the
# same vehicle and estimator, and disturbs them: it cuts or spoofs GNSS, starts a new alignment, sets errors of a sensor.


class UnitStream(Stream):
    """A vehicle as a unit on `port`, and as a MAVLink vehicle on `links`, which may be none.

    sent, received: number of frames and commands too, by the name of the output (``OUTPUT_75``) and of the command (``VNWRG``).
    Raises `InputError` for an alignment in place where the unit has position and velocity.
    """

    def __init__(
        self, vehicle: Vehicle, unit: Unit, port: Link, links: Sequence[Link] = (), recorder: TlogWriter | None = None
    ) -> None:
        super().__init__(vehicle, links, recorder)
        if unit.model.navigates and not vehicle.simulation.estimator.navigates:
            raise InputError(
                f"estimator {vehicle.simulation.estimator.id!r} aligns in place, and a {unit.model.title} has position and"
                f" velocity: allowed is an estimator that navigates, or a {MODELS['vn100'].title} (vn100)"
            )
        self.unit, self.port = unit, port

    @property
    def all_links(self) -> tuple[Link, ...]:
        """The link of the unit first."""
        return (self.port, *self.links)

    def advance(self) -> int:
        """Advance by one sample and send what is due."""
        sent = super().advance()
        for name, frame in self.unit.frames(self.vehicle.view):
            self.port.send_bytes(frame)
            self.sent[name] += 1
            sent += 1
        return sent

    def serve(self) -> None:
        """Answer the commands to the unit, and serve the MAVLink links.  Does not block."""
        for peer, piece in self.port.receive_bytes():
            answers, peer.rest = self.unit.take(peer.rest + piece)
            for kind, answer in answers:
                self.received[kind if kind in COMMANDS else "unknown command"] += 1
                self.port.statistics.received_messages += 1
                self.port.send_bytes(answer, peer)
        if self.links:
            super().serve()

    def summary(self) -> dict[str, Any]:
        """Counts and timing, with the outputs of the unit and the commands that it refused, by number."""
        return {
            **super().summary(),
            "unit": self.unit.model.title,
            "outputs": {str(register): text for register, text in self.unit.registers.items()},
            "commands_refused": dict(sorted(self.unit.refused.items())),
        }

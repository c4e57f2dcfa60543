"""The stream of a unit: its frames on one link, paced as every stream, and MAVLink on others beside it.

The link of the unit is a serial line or TCP, which MAVLink does not share.  On the other links a ground station watches the
same vehicle and estimator, and disturbs them: it cuts or spoofs GNSS, starts a new alignment, sets errors of a sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from insenv.base.errors import InputError
from insenv.logs.formats.tlog import TlogWriter
from insenv.mavlink.stream import Stream
from insenv.mavlink.vectornav.unit import COMMANDS, MODELS, Unit
from insenv.mavlink.vehicle import Vehicle
from insenv.mavlink.wire import Link


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

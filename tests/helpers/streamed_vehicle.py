"""A streamed vehicle without a link: what a client asks it, what it answers, what it sends."""

import numpy as np
import pytest

from insenv.mavlink import Vehicle
from insenv.mavlink.answers import answers
from insenv.mavlink.messages import DEFAULT_HZ
from insenv.mavlink.parameters import NEVER
from insenv.mavlink.wire.further import DEFINITIONS
from insenv.scenario import load

common = pytest.importorskip("pymavlink.dialects.v20.common")

PROGRAM = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from insenv.cli import main; main()"
"""The command line in a process that hears SIGINT, also where the tests run in the background."""
SILENT = dict.fromkeys(DEFAULT_HZ, 0.0)
UNSUPPORTED, DENIED, ACCEPTED = 3, 2, 0


def quiet(scenario="car-city-drive", **options):
    """A vehicle without streamed messages."""
    return Vehicle(load(scenario), rates=SILENT, **options)


def steps(vehicle, seconds):
    """Simulate `seconds`, and return the messages sent meanwhile."""
    return [message for _ in range(round(seconds / vehicle.simulation.interval)) for message in vehicle.step()]


def sent(name, *values, system=245, component=190):
    """A client's message as the vehicle reads it."""
    message = getattr(common, f"MAVLink_{name.lower()}_message")(*values)
    return common.MAVLink(None).decode(bytearray(message.pack(common.MAVLink(None, system, component))))


def answered(vehicle, message):
    """The answers as the client reads them; those that its pymavlink does not know as they are."""
    reader, sender = common.MAVLink(None), common.MAVLink(None, 1, 1)
    packed = [(m, bytearray(m.pack(sender))) for m in answers(vehicle, message)]
    return [m if m.get_type() in DEFINITIONS else reader.decode(frame) for m, frame in packed]


def command(vehicle, number, *parameters):
    """The result of a command, and the other answers."""
    padded = [*parameters, *[0.0] * (7 - len(parameters))]
    ack, *more = answered(vehicle, sent("COMMAND_LONG", 1, 1, number, 0, *padded))
    assert (ack.get_type(), ack.command, ack.target_system, ack.target_component) == ("COMMAND_ACK", number, 245, 190)
    return ack.result, more


def texts(vehicle):
    return [message.text for message in vehicle.texts()]


def set_parameter(vehicle, name, value, kind=9):
    answer, *wrong = answered(vehicle, sent("PARAM_SET", 1, 1, name.encode(), value, kind))
    parameter = vehicle.parameters.all[vehicle.parameters.find(name)]
    if wrong:
        assert [(m.get_type(), m.param_id, m.error) for m in wrong] == [
            ("PARAM_ERROR", name, 5 if parameter.acts == NEVER else 2)
        ]
    assert bool(wrong) == (answer.param_value != np.float32(value) or kind != 9)
    return answer.param_value

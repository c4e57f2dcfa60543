"""MAVLink messages: what each holds and when it is due."""

from insenv.mavlink.messages.estimate import ESTIMATES
from insenv.mavlink.messages.fields import DEFAULT_HZ, Fields, Message, Schedule, parse_rates
from insenv.mavlink.messages.sensor import SENSORS
from insenv.mavlink.messages.status import ON_REQUEST, STATUS
from insenv.mavlink.messages.view import View

STREAMED = {**STATUS, **SENSORS, **ESTIMATES}
"""The function that makes each streamed message, by name."""
MESSAGES = {**STREAMED, **ON_REQUEST}
"""The same for every message that the vehicle can make."""

__all__ = ["DEFAULT_HZ", "MESSAGES", "STREAMED", "Fields", "Message", "Schedule", "View", "parse_rates"]

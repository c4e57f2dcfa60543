"""MAVLink messages: what each holds and when it is due."""

from insenv.mavlink.messages.fields import Fields, Message
from insenv.mavlink.messages.schedule import DEFAULT_HZ, MESSAGES, SILENT, STREAMED, Schedule, make, parse_rates
from insenv.mavlink.messages.view import View

__all__ = ["DEFAULT_HZ", "MESSAGES", "SILENT", "STREAMED", "Fields", "Message", "Schedule", "View", "make", "parse_rates"]

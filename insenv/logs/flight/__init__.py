"""Flight logs as autopilots and ground tools write them: MAVLink telemetry (.tlog), ArduPilot dataflash (.BIN), PX4 ULog."""

from insenv.logs.flight.build import build_flight
from insenv.logs.flight.description import FlightDescription, is_flight_log

__all__ = ["FlightDescription", "build_flight", "is_flight_log"]

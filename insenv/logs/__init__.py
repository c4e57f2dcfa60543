"""Recorded IMU/GNSS logs: a TOML description and text files, or a flight log, in; increments in body FRD and fixes in
radians out."""

from insenv.logs.bridging import Gaps
from insenv.logs.description import LogDescription
from insenv.logs.loading import load
from insenv.logs.recorded import GnssFixes, RecordedLog, Reference, Source, build
from insenv.logs.toml import parse_description, read_description

__all__ = [
    "Gaps",
    "GnssFixes",
    "LogDescription",
    "RecordedLog",
    "Reference",
    "Source",
    "build",
    "load",
    "parse_description",
    "read_description",
]

"""Recorded IMU/GNSS logs: from text files with a TOML description, or flight logs, to increments and fixes.

Increments are in body axes (FRD), fixes in radians and NED. A format is one file in `insenv.logs.formats`.
"""

from insenv.logs.description import LogDescription
from insenv.logs.inertial import Gaps
from insenv.logs.loading import load
from insenv.logs.recorded import GnssFixes, RecordedLog, Reference, Source
from insenv.logs.text import build

__all__ = ["Gaps", "GnssFixes", "LogDescription", "RecordedLog", "Reference", "Source", "build", "load"]

"""Whether the values of a TOML file are a scenario or describe a recorded log, for the message to whoever mixed them up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def is_scenario(data: Mapping[str, Any]) -> bool:
    """Whether the file has a key that a scenario must have and a description of a log may not."""
    return "vehicle" in data or "duration_s" in data


def is_log(data: Mapping[str, Any]) -> bool:
    """Whether the file names a flight log or the file of the inertial samples, as a scenario may not."""
    imu = data.get("imu")
    return "flight" in data or (isinstance(imu, Mapping) and "file" in imu)

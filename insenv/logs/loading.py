"""`load`: any recorded log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from insenv.files.toml import read_toml, validated
from insenv.logs.build import build
from insenv.logs.description import LogDescription
from insenv.logs.flight import FlightDescription, build_flight, is_flight_log
from insenv.logs.recorded import RecordedLog


def load(path: str | Path) -> RecordedLog:
    """The log at `path`: a flight log itself, or a TOML file that describes a log.

    Relative paths in a TOML file start at its folder. Raises InputError for any wrong input.
    """
    path = Path(path)
    folder = path.resolve().parent
    if is_flight_log(path):
        return build_flight(FlightDescription(flight=path.name), folder)
    data: dict[str, Any] = read_toml(path)
    if "flight" in data:
        return build_flight(validated(FlightDescription, data, str(path)), folder)
    return build(validated(LogDescription, data, str(path)), folder)

"""`load`: a recorded log, whatever it is."""

from __future__ import annotations

from pathlib import Path

from insenv.files.toml import read_toml, validated
from insenv.logs.flight import FlightDescription, build_flight, is_flight_log, load_flight
from insenv.logs.recorded import RecordedLog, build
from insenv.logs.toml import parse_description


def load(path: str | Path) -> RecordedLog:
    """The log at `path`: a flight log itself (.tlog, .BIN, .ulg), or what a TOML file describes, whose paths are relative to
    that file.  Raises InputError on any bad input.
    """
    path = Path(path)
    if is_flight_log(path):
        return load_flight(path)
    data, folder = read_toml(path), path.resolve().parent
    if "flight" in data:
        return build_flight(validated(FlightDescription, data, str(path)), folder)
    return build(parse_description(data, str(path)), folder)

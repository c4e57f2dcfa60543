"""The formats of flight logs. To add one: a file beside this one with its `FlightFormat`, and a line in `FORMATS`."""

from __future__ import annotations

from pathlib import Path

from insenv.logs.flight import dataflash, rosbag, telemetry, ulog
from insenv.logs.flight.series import FlightFormat

FORMATS = (
    telemetry.FORMAT,
    dataflash.FORMAT,
    ulog.FORMAT,
    *rosbag.FORMATS,
)
SUFFIXES = " or ".join((", ".join(f.suffix for f in FORMATS[:-1]), FORMATS[-1].suffix))
"""The ends of their names, for messages."""


def format_of(name: str | Path) -> FlightFormat | None:
    """The format of a flight log by its name, of which .gz or .zip is ignored; None if it is not a flight log."""
    path = Path(str(name).lower())
    suffix = Path(path.stem).suffix if path.suffix in (".gz", ".zip") else path.suffix
    return next((found for found in FORMATS if found.suffix.lower() == suffix), None)


def is_flight_log(name: str | Path) -> bool:
    """Whether a path is that of a flight log: by its name, or a folder that holds a ROS 2 bag."""
    return format_of(name) is not None or is_bag_folder(Path(name))


def is_bag_folder(path: Path) -> bool:
    """Whether a folder holds a ROS 2 bag."""
    return path.is_dir() and (path / "metadata.yaml").is_file()

"""The formats of files, each in one file that reads and writes it.  To add one: its file, and a line in `FORMATS`.

`contract.py` says what a format is.  The sections of a description name the columns of text tables (`csv_table.py`) and of the
other formats in `SECTION_FORMATS`.
"""

from pathlib import Path

from insenv.logs.formats import (
    csv_table,
    dataflash,
    gnss_logger,
    gpx,
    kf_gins,
    kml,
    matlab,
    nmea,
    numpy_arrays,
    rerun_recording,
    rosbag,
    rtklib,
    telemetry,
    text_log,
    ubx,
    ulog,
)
from insenv.logs.formats.contract import Format

FORMATS = (
    telemetry.FORMAT,
    dataflash.FORMAT,
    ulog.FORMAT,
    csv_table.FORMAT,
    gpx.FORMAT,
    kml.FORMAT,
    rosbag.FORMAT,
    rosbag.MCAP,
    rerun_recording.FORMAT,
    nmea.FORMAT,
    text_log.FORMAT,
    kf_gins.FORMAT,
    ubx.FORMAT,
    rtklib.FORMAT,
    gnss_logger.FORMAT,
    numpy_arrays.FORMAT,
    matlab.FORMAT,
)
WRITTEN = {each.name: each for each in FORMATS if each.write is not None}
"""The formats that are written, by name."""
TRACKS = {suffix: each for each in FORMATS if each.read_tracks is not None for suffix in each.suffixes}
"""The formats of tracks, by suffix."""
SECTION_FORMATS = {each.name: each for each in FORMATS if each is csv_table.FORMAT or each.reads_sections}
"""The formats of the files that the sections of a description name, by the value of the key `format`."""
_FLIGHTS = {suffix: each for each in FORMATS if each.read_flight is not None for suffix in each.suffixes}
SUFFIXES = " or ".join((", ".join(list(_FLIGHTS)[:-1]), list(_FLIGHTS)[-1]))
"""The ends of the names of flight logs, for messages."""


def flight_format(path: Path) -> Format | None:
    """The format of a flight log by its name, of which .gz or .zip is ignored, or of a folder that holds a ROS 2 bag.

    None if it is not a flight log.
    """
    if path.is_dir() and (path / "metadata.yaml").is_file():
        return rosbag.FORMAT
    name = Path(path.name.lower())
    suffix = Path(name.stem).suffix if name.suffix in (".gz", ".zip") else name.suffix
    return next((each for end, each in _FLIGHTS.items() if end.lower() == suffix), None)


def is_flight_log(path: Path) -> bool:
    """Whether a path is that of a flight log: by its name, or a folder that holds a ROS 2 bag."""
    return flight_format(path) is not None


__all__ = ["FORMATS", "SECTION_FORMATS", "SUFFIXES", "TRACKS", "WRITTEN", "Format", "flight_format", "is_flight_log"]

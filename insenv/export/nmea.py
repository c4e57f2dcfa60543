"""NMEA 0183 of a receiver's fixes: GGA, GST, and RMC and VTG where they have a velocity.

Sentences follow one another as a receiver sends them, stamped with the time of validity in UTC from
`insenv.export.tracks.EPOCH`.  The geoid separation is 0, so that the altitude of GGA is the height above the ellipsoid.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from functools import reduce
from math import atan2, degrees, hypot

import numpy as np

from insenv.base.errors import InputError
from insenv.export.tracks import date_of
from insenv.logs import GnssFixes, RecordedLog

_KNOT = 1852.0 / 3600.0
_KMH = 1.0 / 3.6
_ERROR_M = 5.0
"""Range error of a single fix, m, by which the horizontal dilution of GGA stands for the stated accuracy."""
_SATELLITES = 10
_MOVING = 0.01
"""Speed (m/s) below which a course means nothing, and its field is empty."""


def nmea_text(log: RecordedLog) -> str:
    """The sentences of all fixes, each line with its checksum and CR LF.  Raises `InputError` for a log without fixes."""
    if log.gnss is None or not len(log.gnss.time):
        raise InputError("format 'nmea': the drive has no GNSS receiver, or no fix came")
    return "".join(f"${body}*{checksum(body):02X}\r\n" for body in _sentences(log.gnss))


def checksum(body: str) -> int:
    """Exclusive or of the characters between $ and *."""
    return reduce(lambda found, character: found ^ ord(character), body, 0)


def _sentences(gnss: GnssFixes) -> Iterator[str]:
    moving = gnss.velocity_n is not None
    for row, time in enumerate(gnss.time):
        date = date_of(round(float(time), 3))
        clock = f"{date:%H%M%S}.{date.microsecond // 1000:03d}"
        place = f"{_angle(float(gnss.latitude[row]), 2, 'NS')},{_angle(float(gnss.longitude[row]), 3, 'EW')}"
        north, east, down = (float(sigma) for sigma in gnss.position_sigma[row])
        dilution = max(hypot(north, east) / _ERROR_M, 0.1) if np.isfinite(north + east) else 99.9
        height = float(gnss.height[row])
        yield f"GPGGA,{clock},{place},1,{_SATELLITES:02d},{dilution:.1f},{height:.3f},M,0.0,M,,"
        if moving and gnss.velocity_n is not None:
            yield from _motion(gnss.velocity_n[row], clock, place, date)
        if np.isfinite(north + east + down):
            major, minor, turned = (north, east, 0.0) if north >= east else (east, north, 90.0)
            rms = hypot(north, east)
            yield f"GPGST,{clock},{rms:.3f},{major:.3f},{minor:.3f},{turned:.1f},{north:.3f},{east:.3f},{down:.3f}"


def _motion(velocity: np.ndarray, clock: str, place: str, date: datetime) -> Iterator[str]:
    """RMC and VTG."""
    speed = hypot(float(velocity[0]), float(velocity[1]))
    course = f"{degrees(atan2(float(velocity[1]), float(velocity[0]))) % 360.0:.2f}" if speed > _MOVING else ""
    yield f"GPRMC,{clock},A,{place},{speed / _KNOT:.3f},{course},{date:%d%m%y},,,A"
    yield f"GPVTG,{course},T,,M,{speed / _KNOT:.3f},N,{speed / _KMH:.3f},K,A"


def _angle(angle: float, digits: int, letters: str) -> str:
    """ddmm.mmmmmmm and the letter of the half; rad."""
    whole = round(abs(degrees(angle)) * 60.0 * 1e7)
    minutes = whole % (60 * 10**7)
    return f"{whole // (60 * 10**7):0{digits}d}{minutes // 10**7:02d}.{minutes % 10**7:07d},{letters[angle < 0]}"

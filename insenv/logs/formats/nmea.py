"""NMEA 0183: the fixes of a receiver.

Read are the sentences GGA, by pynmea2.  Written are GGA, GST, and RMC and VTG where the fixes have a velocity, as a receiver
sends them, stamped with the time of validity in UTC from `EPOCH`.  The geoid separation is 0, so that the altitude of GGA is
the height above the ellipsoid.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from functools import reduce
from math import atan2, degrees, hypot

import numpy as np

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.logs.formats.contract import Drive, Files, Format, NamedTrack, date_of, track_of_points
from insenv.logs.recorded import GnssFixes
from insenv.logs.units import SPEED_UNITS

_HALF_DAY, _DAY = 43200.0, 86400.0
_ERROR_M = 5.0
"""Range error of a single fix, m, by which the horizontal dilution of GGA stands for the stated accuracy."""
_SATELLITES = 10
_MOVING = 0.01
"""Speed (m/s) below which a course means nothing, and its field is empty."""


def read(label: str, data: bytes) -> list[NamedTrack]:
    """The fixes of the sentences GGA, whose heights are above mean sea level and of the geoid; days follow from midnights."""
    need(f"{label}: an NMEA file", "pynmea2", extra="workbench")
    import pynmea2

    points: list[tuple[float, float, float, float]] = []
    fault, day = "", 0.0
    for number, line in enumerate(data.decode("ascii", errors="replace").splitlines(), 1):
        start = line.find("$")
        if start < 0 or line[start + 3 : start + 6] != "GGA":
            continue
        try:
            fix = pynmea2.parse(line[start:], check=True)
        except (pynmea2.ParseError, ValueError) as error:
            fault = fault or f"{label}: line {number}: {error}"
            continue
        if not fix.gps_qual or fix.timestamp is None or not fix.lat or not fix.lon:
            continue
        stamp = fix.timestamp
        time = stamp.hour * 3600.0 + stamp.minute * 60.0 + stamp.second + stamp.microsecond * 1e-6 + day
        if points and time < points[-1][0] - _HALF_DAY:
            day, time = day + _DAY, time + _DAY
        height = (float("nan") if fix.altitude is None else float(fix.altitude)) + float(fix.geo_sep or 0.0)
        points.append((time, fix.latitude, fix.longitude, height))
    if fault:
        raise InputError(fault)
    if not points:
        raise InputError(f"{label}: no sentence GGA with a fix")
    return [track_of_points("", points)]


def write(drive: Drive) -> Files:
    """NAME.nmea: the sentences of all fixes, each line with its checksum and CR LF."""
    gnss = drive.sensors().gnss
    if gnss is None or not len(gnss.time):
        raise InputError("format 'nmea': the drive has no GNSS receiver, or no fix came")
    return {f"{drive.name}.nmea": "".join(f"${body}*{checksum(body):02X}\r\n" for body in _sentences(gnss))}


def checksum(body: str) -> int:
    """Exclusive or of the characters between $ and *."""
    return reduce(lambda total, character: total ^ ord(character), body, 0)


def _sentences(gnss: GnssFixes) -> Iterator[str]:
    for row, time in enumerate(gnss.time):
        date = date_of(round(float(time), 3))
        clock = f"{date:%H%M%S}.{date.microsecond // 1000:03d}"
        place = f"{_angle(float(gnss.latitude[row]), 2, 'NS')},{_angle(float(gnss.longitude[row]), 3, 'EW')}"
        north, east, down = (float(sigma) for sigma in gnss.position_sigma[row])
        dilution = max(hypot(north, east) / _ERROR_M, 0.1) if np.isfinite(north + east) else 99.9
        height = float(gnss.height[row])
        yield f"GPGGA,{clock},{place},1,{_SATELLITES:02d},{dilution:.1f},{height:.3f},M,0.0,M,,"
        if gnss.velocity_n is not None:
            yield from _motion(gnss.velocity_n[row], clock, place, date)
        if np.isfinite(north + east + down):
            major, minor, turned = (north, east, 0.0) if north >= east else (east, north, 90.0)
            rms = hypot(north, east)
            yield f"GPGST,{clock},{rms:.3f},{major:.3f},{minor:.3f},{turned:.1f},{north:.3f},{east:.3f},{down:.3f}"


def _motion(velocity: np.ndarray, clock: str, place: str, date: datetime) -> Iterator[str]:
    """RMC and VTG."""
    speed = hypot(float(velocity[0]), float(velocity[1]))
    course = f"{degrees(atan2(float(velocity[1]), float(velocity[0]))) % 360.0:.2f}" if speed > _MOVING else ""
    knots = f"{speed / SPEED_UNITS['kn']:.3f}"
    yield f"GPRMC,{clock},A,{place},{knots},{course},{date:%d%m%y},,,A"
    yield f"GPVTG,{course},T,,M,{knots},N,{speed / SPEED_UNITS['km/h']:.3f},K,A"


def _angle(angle: float, digits: int, letters: str) -> str:
    """ddmm.mmmmmmm and the letter of the half; rad."""
    whole = round(abs(degrees(angle)) * 60.0 * 1e7)
    minutes = whole % (60 * 10**7)
    return f"{whole // (60 * 10**7):0{digits}d}{minutes // 10**7:02d}.{minutes % 10**7:07d},{letters[angle < 0]}"


FORMAT = Format(name="nmea", suffixes=(".nmea",), read_tracks=read, write=write, needs_log=True)

"""u-blox receivers (.ubx): the navigation solution of UBX-NAV-PVT, by pyubx2.

Where the log has UBX-NAV-HPPOSLLH for the same epoch, position and its accuracy are those: NAV-PVT rounds to 1 cm.
Other messages, NMEA sentences and RTCM corrections between them are passed over.  The accuracies hAcc, vAcc and sAcc
are taken as standard deviations of each axis.

u-blox F9 HPG 1.32 Interface description (UBX-22008968), sec. 3.15.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.base.remarks import Remark, declared
from insenv.logs.formats import log_tables
from insenv.logs.formats.contract import FileColumns, Format
from insenv.logs.formats.series import three_sigmas
from insenv.logs.units import WEEK_S, gps_of_unix

_BEGIN = re.compile(rb"\xb5\x62\x01[\x07\x14]")
"""Sync characters, class and number of UBX-NAV-PVT and UBX-NAV-HPPOSLLH."""
_USED_FIXES = (3, 4)
"""Fix types: three-dimensional, and that with dead reckoning."""
_FIELDS = (
    "year", "month", "day", "hour", "min", "second", "nano", "lat", "lon", "height", "hMSL", "hAcc", "vAcc",
    "velN", "velE", "velD", "sAcc", "fixType", "carrSoln", "numSV",
)  # fmt: skip
_MM = 1e-3
_NO_FIX = declared("solutions-without-fix", "{label}: {count} of {total} UBX-NAV-PVT have no three-dimensional fix: not used")
_DAMAGED = declared("messages-damaged", "{label}: {count} messages with a wrong checksum or length are skipped")
_RECKONED = declared(
    "fixes-reckoned",
    "{label}: {count} fixes contain the receiver's own dead reckoning, whose errors change slowly (keep_where = "
    "{ fix_type = 3 } leaves these fixes out)",
)


def read_columns(label: str, raw: bytes, section: str) -> FileColumns:
    """The fixes: the columns of `log_tables.RECEIVER` and tow_s, height_msl_m, fix_type, carrier_solution, satellites."""
    need(f"{label}: a log of a u-blox receiver", "pyubx2", extra="workbench")
    solutions, precise, damaged = _messages(raw)
    if not solutions:
        raise InputError(
            f"{label}: no message UBX-NAV-PVT with a right checksum: allowed is a log of a u-blox receiver that has it"
        )
    used = [each for each in solutions if each.gnssFixOk and each.fixType in _USED_FIXES and each.fullyResolved]
    if not used:
        raise InputError(f"{label}: none of its {len(solutions)} UBX-NAV-PVT has a three-dimensional fix with a date")
    rows = np.array([[float(getattr(each, name)) for name in _FIELDS] for each in used])
    value = dict(zip(_FIELDS, rows.T, strict=True))
    better = [precise.get(each.iTOW) for each in used]
    for row, message in enumerate(better):
        if message is not None:
            for name in ("lat", "lon", "height", "hMSL", "hAcc", "vAcc"):
                value[name][row] = getattr(message, name)
    days = np.array([f"{each.year:04d}-{each.month:02d}-{each.day:02d}" for each in used], dtype="datetime64[D]")
    unix = (
        days.astype(np.int64) * 86400.0 + value["hour"] * 3600.0 + value["min"] * 60.0 + value["second"] + value["nano"] * 1e-9
    )
    columns = log_tables.receiver_columns(
        unix,
        np.column_stack([value["lat"], value["lon"]]),
        value["height"] * _MM,
        three_sigmas(value["hAcc"] * _MM, value["vAcc"] * _MM),
        np.column_stack([value["velN"], value["velE"], value["velD"]]) * _MM,
        np.column_stack([value["sAcc"]] * 3) * _MM,
    )
    columns |= {
        "tow_s": gps_of_unix(unix) % WEEK_S,
        "height_msl_m": value["hMSL"] * _MM,
        "fix_type": value["fixType"],
        "carrier_solution": value["carrSoln"],
        "satellites": value["numSV"],
    }
    notes: list[Remark] = []
    if len(used) < len(solutions):
        notes.append(_NO_FIX.filled(label=label, count=len(solutions) - len(used), total=len(solutions)))
    if damaged:
        notes.append(_DAMAGED.filled(label=label, count=damaged))
    if np.any(value["fixType"] == 4):
        notes.append(_RECKONED.filled(label=label, count=np.count_nonzero(value["fixType"] == 4)))
    return FileColumns(columns, notes=tuple(notes))


def _messages(raw: bytes) -> tuple[list[Any], dict[int, Any], int]:
    """The solutions in their order, the valid high-precision positions by time of week (ms), and the number of damaged ones."""
    import pyubx2

    solutions, precise, damaged = [], {}, 0
    for mark in _BEGIN.finditer(raw):  # not by the lengths of the messages before it: a damaged one hides what follows
        begin = mark.start()
        message = raw[begin : begin + 8 + int.from_bytes(raw[begin + 4 : begin + 6], "little")]
        try:
            parsed = pyubx2.UBXReader.parse(message, validate=pyubx2.VALCKSUM)
        except (pyubx2.UBXParseError, pyubx2.UBXMessageError, pyubx2.UBXTypeError):
            damaged += 1
            continue
        if parsed.identity == "NAV-PVT":
            solutions.append(parsed)
        elif not parsed.invalidLlh:
            precise[parsed.iTOW] = parsed
    return solutions, precise, damaged


FORMAT = Format(
    name="ubx",
    suffixes=(".ubx",),
    read_columns=read_columns,
    keys={"gnss": log_tables.RECEIVER, "reference": log_tables.RECEIVER_REFERENCE},
    further_keys={"gnss": (log_tables.GNSS_VELOCITY,), "reference": (log_tables.REFERENCE_VELOCITY,)},
)

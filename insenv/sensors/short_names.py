"""Names of at most 16 characters for the elements of parameter rows, and the units in which they are shown.

MAVLink's parameters bear them: the vehicle that sends them and the reader of its logs use the same names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from insenv.core.tables import Row, Table
from insenv.sensors import units

SHOWN: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "rad": ("deg", units.deg_to_rad),
    "rad/s": ("deg/h", units.deg_h_to_rad_s),
    "m/s^2": ("ug", units.ug_to_m_s2),
    "rad/s^0.5": ("deg/sqrt(h)", units.deg_sqrt_h_to_rad_sqrt_s),
    "m/s^1.5": ("ug/sqrt(Hz)", units.ug_sqrt_hz_to_m_s_sqrt_s),
}
"""Unit shown and its conversion to SI, by SI unit."""

MOST_ELEMENTS = 6
"""Rows with more elements (scripts, waves, matrices) are not parameters."""

LONGEST_NAME = 16
"""Characters of a parameter's name in MAVLink."""

_SHORT = {
    "accel": "ACC", "acceleration": "ACCL", "angle": "ANG", "antenna": "ANT", "bandwidth": "BW", "bias": "BIAS",
    "correlation": "COR", "covariance": "COV", "drop": "DROP", "factor": "F", "frequency": "FRQ", "gnss": "GNSS",
    "gyro": "GYR", "heading": "HDG", "height": "HGT", "imu": "IMU", "innovation": "INN", "instability": "INS",
    "interval": "DT", "latitude": "LAT", "lever": "LEV", "longitude": "LON", "misalignment": "MIS", "mounting": "MNT",
    "noise": "N", "outlier": "OUTL", "position": "POS", "probability": "PROB", "random": "R", "range": "RNG", "rate": "RATE",
    "scale": "SC", "sigma": "SIG", "slope": "SLP", "standing": "STND", "start": "ST", "temperature": "TMP", "time": "T",
    "velocity": "VEL", "walk": "W", "wander": "WAN", "error": "ERR", "limit": "LIM", "arm": "ARM", "b": "", "n": "",
}  # fmt: skip


def elements(prefix: str, table: Table, names: tuple[str, ...]) -> Iterator[tuple[Row, int, str]]:
    """Row, index in the vector of the table and short name of each element of the rows `names` that is a parameter."""
    taken: set[str] = set()
    for row in table:
        if row.name not in names or row.size > MOST_ELEMENTS:
            continue
        first = table.slice(row.name).start
        for element in range(row.size):
            name = parameter_name(prefix, row.name, _suffix(row, element), taken)
            taken.add(name)
            yield row, first + element, name


def _suffix(row: Row, element: int) -> str:
    if row.size == 1:
        return ""
    if row.size == 3:
        return ("NED" if row.frame in ("n", "w") else "XYZ")[element]
    return str(element + 1)


def parameter_name(prefix: str, row: str, suffix: str, taken: Iterable[str]) -> str:
    """A name such as ``E_GYR_BIAS_SIG`` or ``S_GNSS_POS_N_D`` that is not among `taken`, with its words shortened to
    fit.

    prefix: of the group; suffix: of the component.  Raises `ValueError` if there is no free name.
    """
    taken = set(taken)
    words = [_SHORT.get(word, word[:6].upper()) for word in row.split("_")]
    words = [word for word in words if word]
    tail = f"_{suffix}" if suffix else ""
    for length in range(6, 0, -1):
        name = f"{prefix}_{'_'.join(word[:length] for word in words)}{tail}"
        if len(name) <= LONGEST_NAME and name not in taken:
            return name
    for number in range(1, 100):
        name = f"{prefix}_{''.join(words)}"[: LONGEST_NAME - len(tail) - 2] + f"{number:02d}{tail}"
        if name not in taken:
            return name
    raise ValueError(f"no parameter name left for {row!r}")

"""Parameter names of MAVLink, 16 characters at most, from the names of tables' rows."""

from __future__ import annotations

from collections.abc import Iterable

LONGEST = 16

_SHORT = {
    "accel": "ACC", "acceleration": "ACCL", "angle": "ANG", "antenna": "ANT", "bandwidth": "BW", "bias": "BIAS",
    "correlation": "COR", "covariance": "COV", "drop": "DROP", "factor": "F", "frequency": "FRQ", "gnss": "GNSS",
    "gyro": "GYR", "heading": "HDG", "height": "HGT", "imu": "IMU", "innovation": "INN", "instability": "INS",
    "interval": "DT", "latitude": "LAT", "lever": "LEV", "longitude": "LON", "misalignment": "MIS", "mounting": "MNT",
    "noise": "N", "outlier": "OUTL", "position": "POS", "probability": "PROB", "random": "R", "range": "RNG", "rate": "RATE",
    "scale": "SC", "sigma": "SIG", "slope": "SLP", "standing": "STND", "start": "ST", "temperature": "TMP", "time": "T",
    "velocity": "VEL", "walk": "W", "wander": "WAN", "error": "ERR", "limit": "LIM", "arm": "ARM", "b": "", "n": "",
}  # fmt: skip


def parameter_name(prefix: str, row: str, suffix: str, taken: Iterable[str]) -> str:
    """A name such as ``E_GYR_BIAS_SIG`` or ``S_GNSS_POS_N_D``: as much of each word as there is room for, and not yet taken.

    prefix: what it belongs to; suffix: the component.  Raises `ValueError` if there is no room.
    """
    taken = set(taken)
    words = [_SHORT.get(word, word[:6].upper()) for word in row.split("_")]
    words = [word for word in words if word]
    tail = f"_{suffix}" if suffix else ""
    for length in range(6, 0, -1):
        name = f"{prefix}_{'_'.join(word[:length] for word in words)}{tail}"
        if len(name) <= LONGEST and name not in taken:
            return name
    for number in range(1, 100):
        name = f"{prefix}_{''.join(words)}"[: LONGEST - len(tail) - 2] + f"{number:02d}{tail}"
        if name not in taken:
            return name
    raise ValueError(f"no parameter name left for {row!r}")

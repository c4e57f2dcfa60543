"""What disturbs a GNSS receiver while the vehicle runs: jamming, spoofing, drift, lost satellites.

It changes the fixes that the receiver of the scenario delivers.  What is random is a pure function of seed and fix
number, as all noise is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Any

import numpy as np

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.core import noise
from insenv.core.tables import Vector
from insenv.mavlink.surroundings import NOISE_STREAM

KINDS = ("none", "jamming", "spoofing", "drift", "satellites lost")
"""By number, as the command has them."""
_LARGEST_M, _LARGEST_M_S, _LARGEST_FACTOR = 1e6, 1e3, 1e3
_STREAM = NOISE_STREAM - 2


@dataclass(frozen=True)
class Interference:
    """One kind of interference, from a time on.

    lost_share: of the fixes (jamming), 0 to 1.  offset_n: displacement of the position (3, m): spoofing.  drift_n: rate of
    a displacement (3, m/s), which the velocity shows too: a spoofer that leads away.  dilution: factor on the stated
    sigmas and on the noise (satellites lost), 1 or more.  since: simulation clock (s).
    """

    name: str
    since: float
    lost_share: float = 0.0
    offset_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    dilution: float = 1.0

    def apply(self, rows: Mapping[str, Any], time: float, seed: int, number: int) -> None:
        """Change a fix in place.  rows: of the plant's outputs; number: of the fix."""
        from scipy.special import ndtri

        drawn = noise.uniforms(seed, np.array([number]), _STREAM, 7)[0]
        if drawn[0] < self.lost_share:
            rows["gnss_valid"][...] = rows["gnss_velocity_valid"][...] = 0.0
            return
        normals = ndtri(drawn[1:]) * sqrt(self.dilution**2 - 1.0)
        drift: Vector = np.array(self.drift_n)
        moved = np.array(self.offset_n) + drift * (time - self.since) + normals[:3] * rows["gnss_position_sigma"]
        place = [float(rows[f"gnss_{name}"]) for name in ("latitude", "longitude", "height")]
        found = geodesy.numeric.geodetic_from_ned_offset(moved, *place)
        for name, value in zip(("latitude", "longitude", "height"), found, strict=True):
            rows[f"gnss_{name}"][...] = float(value)
        rows["gnss_velocity_n"][...] += drift + normals[3:] * rows["gnss_velocity_sigma"]
        rows["gnss_position_sigma"][...] *= self.dilution
        rows["gnss_velocity_sigma"][...] *= self.dilution


def interference(kind: float, values: Sequence[float], now: float) -> Interference | None:
    """The interference of a command.  kind: number in `KINDS`; values (3): see `Interference`.  None: none.

    Raises `InputError` for an unknown kind or a value out of range.
    """
    if kind not in range(len(KINDS)):
        raise InputError(f"param1 = {kind:g}: allowed is 0 to {len(KINDS) - 1}")
    name = KINDS[int(kind)]
    first = values[0]
    if name == "jamming":
        return Interference(name, now, lost_share=_within(name, first, 0.0, 1.0))
    if name == "satellites lost":
        return Interference(name, now, dilution=_within(name, first, 1.0, _LARGEST_FACTOR))
    if name in ("spoofing", "drift"):
        most = _LARGEST_M if name == "spoofing" else _LARGEST_M_S
        north, east, down = (_within(name, value, -most, most) for value in values)
        if name == "spoofing":
            return Interference(name, now, offset_n=(north, east, down))
        return Interference(name, now, drift_n=(north, east, down))
    return None


def _within(name: str, value: float, least: float, most: float) -> float:
    if not isfinite(value) or not least <= value <= most:
        raise InputError(f"{name} = {value:g}: allowed is {least:g} to {most:g}")
    return float(value)

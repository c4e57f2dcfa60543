"""Magnetometer and barometer of the streamed vehicle in the quantities of messages, and the air about it.

Both are instruments of the plant: those of the scenario, or, where it has none, `defaults`, whose numbers change no other
number of the run.  The barometer shows a height; its pressure is that of the ICAO standard atmosphere there.  The dynamic
pressure is the simulated vehicle's own, from its speed over the Earth: there is no wind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import Any

import numpy as np

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.core import noise
from insenv.core.tables import Array, Vector
from insenv.geodesy.magnetic import world_magnetic_years
from insenv.scenario import Scenario
from insenv.sensors import registry

NOISE_STREAM = 0xFFFFFFFD
"""Noise stream of what the streamed vehicle draws beside the plant; those of dynamic pressure and interference follow below."""

GAS_CONSTANT = 287.05287
"""Of dry air in the standard atmosphere, J/(kg K)."""
_AHEAD = 256  # samples whose noise is computed together
_LOWEST, _HIGHEST, _STEP = -5000.0, 81000.0, 10.0  # m, from below the Dead Sea to the upper end of the model

MAGNETOMETER_HZ, BAROMETER_HZ = 50.0, 25.0
"""Rates of the default instruments, or the nearest that inertial samples allow."""
MAGNETIC_NOISE_NT, HEIGHT_NOISE_M, DYNAMIC_NOISE_PA = 50.0, 0.17, 1.0
"""White noise (1 sigma), typical of MEMS sensors: 0.5 mG, 2 Pa of static pressure (17 cm of height), 1 Pa."""


def defaults(scenario: Scenario, year: float) -> dict[str, Any]:
    """The sections of the instruments that a scenario lacks: white noise only, the field of `year`, limited to the model's."""

    def interval(rate_hz: float) -> float:
        return max(1, round(scenario.rate_hz / rate_hz)) / scenario.rate_hz

    first, last = world_magnetic_years()
    keys: dict[str, dict[str, float]] = {
        "magnetometer": {
            "noise_nt": MAGNETIC_NOISE_NT,
            "interval_s": interval(MAGNETOMETER_HZ),
            "year": min(max(year, first), last),
        },
        "barometer": {"noise_m": HEIGHT_NOISE_M, "interval_s": interval(BAROMETER_HZ)},
    }
    lacking = {id: values for id, values in keys.items() if getattr(scenario, id) is None}
    return {id: registry.get(id)(grade="perfect", **values) for id, values in lacking.items()}


@dataclass(frozen=True)
class AirData:
    """What the instruments show, and the air at the vehicle.

    magnetic_b: magnetic field (3, T).  pressure, dynamic_pressure: Pa.  pressure_height: height of `pressure` in the standard
    atmosphere (m).  temperature (K), density (kg/m^3): of the air, true.
    """

    magnetic_b: Vector
    pressure: float
    dynamic_pressure: float
    pressure_height: float
    temperature: float
    density: float


def air_data(truth: Mapping[str, Any], undulation: float, barometer: int, seed: int) -> AirData:
    """From the plant's outputs by row name.  undulation: m.  barometer: number of its measurements so far.  seed: of the run.

    Before the first ones the pressure is that of the true height, and the field is 0.
    """
    heights, log_pressure, temperature = _atmosphere()
    above_sea = float(truth["height"]) - undulation
    kelvin = float(np.interp(above_sea, heights, temperature))
    density = float(np.exp(np.interp(above_sea, heights, log_pressure))) / (GAS_CONSTANT * kelvin)
    height = float(truth["barometer_height"]) - undulation if barometer else above_sea
    pressure = float(np.exp(np.interp(height, heights, log_pressure)))
    squared = float(np.dot(truth["velocity_n"], truth["velocity_n"]))
    dynamic_noise = float(_normals(seed, barometer // _AHEAD)[barometer % _AHEAD])
    dynamic = 0.5 * density * squared + DYNAMIC_NOISE_PA * dynamic_noise
    return AirData(np.array(truth["magnetometer_field_b"]), pressure, dynamic, height, kelvin, density)


@lru_cache(maxsize=8)
def _normals(seed: int, block: int) -> Array:
    """Standard normals of the dynamic pressure, `_AHEAD` of them."""
    from scipy.special import ndtri

    numbers = block * _AHEAD + np.arange(_AHEAD)
    return np.asarray(ndtri(noise.uniforms(seed, numbers, NOISE_STREAM - 1, 1))[:, 0])


@lru_cache(maxsize=1)
def _atmosphere() -> tuple[Array, Array, Array]:
    """Heights above mean sea level (m), natural logarithm of pressure (Pa), temperature (K).

    Between heights 10 m apart the logarithm is linear to 1e-8.
    """
    from ambiance import Atmosphere

    heights = np.arange(_LOWEST, _HIGHEST + _STEP / 2, _STEP)
    air = Atmosphere(heights)
    return heights, np.log(air.pressure), np.asarray(air.temperature)


# What disturbs a GNSS receiver while the vehicle runs: jamming, spoofing, drift, lost satellites.
#
# It changes the fixes that the receiver of the scenario delivers.  What is random is a pure function of seed and fix
# number, as all noise is.

KINDS: tuple[tuple[str, str, float, float, int], ...] = (
    ("jamming", "lost_share", 0.0, 1.0, 1),
    ("spoofing", "offset_n", -1e6, 1e6, 3),
    ("drift", "drift_n", -1e3, 1e3, 3),
    ("satellites lost", "dilution", 1.0, 1e3, 1),
)
"""Name, field of `Interference`, its lowest and highest value and number of elements, by number of the command from 1."""
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
    offset_n: tuple[float, ...] = (0.0, 0.0, 0.0)
    drift_n: tuple[float, ...] = (0.0, 0.0, 0.0)
    dilution: float = 1.0

    def apply(self, rows: Mapping[str, Any], time: float, seed: int, number: int) -> None:
        """Change a fix in place.  rows: of the plant's outputs; number: of the fix."""
        from scipy.special import ndtri

        uniforms = noise.uniforms(seed, np.array([number]), _STREAM, 7)[0]
        if uniforms[0] < self.lost_share:
            rows["gnss_valid"][...] = rows["gnss_velocity_valid"][...] = 0.0
            return
        normals = ndtri(uniforms[1:]) * sqrt(self.dilution**2 - 1.0)
        drift: Vector = np.array(self.drift_n)
        offset = np.array(self.offset_n) + drift * (time - self.since) + normals[:3] * rows["gnss_position_sigma"]
        place = [rows[f"gnss_{name}"] for name in ("latitude", "longitude", "height")]
        moved = geodesy.numeric.geodetic_from_ned_offset(offset, *map(float, place))
        for row, value in zip(place, moved, strict=True):
            row[...] = float(value)
        rows["gnss_velocity_n"][...] += drift + normals[3:] * rows["gnss_velocity_sigma"]
        rows["gnss_position_sigma"][...] *= self.dilution
        rows["gnss_velocity_sigma"][...] *= self.dilution


def interference(kind: float, values: Sequence[float], now: float) -> Interference | None:
    """The interference of a command.  kind: number in `KINDS`, 0 for none; values (3): see `Interference`.

    Raises `InputError` for an unknown kind or a value out of range.
    """
    if kind not in range(len(KINDS) + 1):
        raise InputError(f"param1 = {kind:g}: allowed is 0 to {len(KINDS)}")
    if kind == 0:
        return None
    name, field, lowest, highest, count = KINDS[int(kind) - 1]
    for value in values[:count]:
        if not lowest <= value <= highest:
            raise InputError(f"{name} = {value:g}: allowed is {lowest:g} to {highest:g}")
    numbers = tuple(map(float, values[:count]))
    return Interference(name, now, **{field: numbers if count == 3 else numbers[0]})  # type: ignore[arg-type]

"""Magnetometer and barometer of the streamed vehicle in the quantities of messages, and the air about it.

Both are instruments of the plant: those of the scenario, or, where it has none, `defaults`, whose numbers change no other
number of the run.  The barometer shows a height; its pressure is that of the ICAO standard atmosphere there.  The dynamic
pressure is the simulated vehicle's own, from its speed over the Earth: there is no wind.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.core import noise
from insenv.core.tables import Vector
from insenv.geodesy.magnetic import world_magnetic_years
from insenv.scenario import Scenario
from insenv.sensors.barometer import BarometerSection
from insenv.sensors.magnetometer import MagnetometerSection

NOISE_STREAM = 0xFFFFFFFD
"""Noise stream of what the streamed vehicle draws beside the plant; of the dynamic pressure it is one lower."""

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
    made = {
        "magnetometer": MagnetometerSection(
            grade="perfect", noise_nt=MAGNETIC_NOISE_NT, interval_s=interval(MAGNETOMETER_HZ), year=min(max(year, first), last)
        ),
        "barometer": BarometerSection(grade="perfect", noise_m=HEIGHT_NOISE_M, interval_s=interval(BAROMETER_HZ)),
    }
    return {id: section for id, section in made.items() if getattr(scenario, id) is None}


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


class Surroundings:
    """The instruments in the quantities of messages.  seed: of the run."""

    def __init__(self, seed: int) -> None:
        self._noise = _Noise(seed, NOISE_STREAM - 1)

    def data(self, truth: dict[str, Any], undulation: float, barometer: int) -> AirData:
        """From the plant's outputs by row name.  undulation: m.  barometer: number of its measurements so far.

        Before the first ones the pressure is that of the true height, and the field is 0.
        """
        heights, log_pressure, temperature = _atmosphere()
        above_sea = float(truth["height"]) - undulation
        kelvin = float(np.interp(above_sea, heights, temperature))
        density = float(np.exp(np.interp(above_sea, heights, log_pressure))) / (GAS_CONSTANT * kelvin)
        height = float(truth["barometer_height"]) - undulation if barometer else above_sea
        pressure = float(np.exp(np.interp(height, heights, log_pressure)))
        squared = float(np.dot(truth["velocity_n"], truth["velocity_n"]))
        dynamic = 0.5 * density * squared + DYNAMIC_NOISE_PA * self._noise(barometer)
        field = np.array(truth["magnetometer_field_b"])
        return AirData(field, pressure, dynamic, height, kelvin, density)


class _Noise:
    """Standard normals by sample number, computed in blocks."""

    def __init__(self, seed: int, stream: int) -> None:
        self._seed, self._stream = seed, stream
        self._first = -_AHEAD
        self._block: NDArray[np.float64] = np.zeros(0)

    def __call__(self, sample: int) -> float:
        if not self._first <= sample < self._first + _AHEAD:
            from scipy.special import ndtri

            self._first = sample // _AHEAD * _AHEAD
            steps = np.arange(self._first, self._first + _AHEAD)
            self._block = ndtri(noise.uniforms(self._seed, steps, self._stream, 1))[:, 0]
        return float(self._block[sample - self._first])


@lru_cache(maxsize=1)
def _atmosphere() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Heights above mean sea level (m), natural logarithm of pressure (Pa), temperature (K).

    Between heights 10 m apart the logarithm is linear to 1e-8.
    """
    from ambiance import Atmosphere

    heights = np.arange(_LOWEST, _HIGHEST + _STEP / 2, _STEP)
    air = Atmosphere(heights)
    return heights, np.log(air.pressure), np.asarray(air.temperature)

"""Magnetometer and barometer: the Earth's field by the World Magnetic Model, the air by the ICAO standard atmosphere.

Both sensors show the true value at the vehicle plus white noise, which is a pure function of the run's seed and the
sensor's sample number, as all noise is.  Magnetic disturbances, weather, wind and static port errors are not simulated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import cos, degrees, hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.core import noise
from insenv.core.tables import Vector
from insenv.geodesy import MEAN_RADIUS

NOISE_STREAM = 0xFFFFFFFD
"""Noise stream of the magnetometer; the barometer's is one lower.  The plant uses other streams."""

GAS_CONSTANT = 287.05287
"""Of dry air in the standard atmosphere, J/(kg K)."""
_AHEAD = 256  # samples whose noise is computed together
_LOWEST, _HIGHEST, _STEP = -5000.0, 81000.0, 10.0  # m, from below the Dead Sea to the upper end of the model
_MOVED_M, _TESLA_PER_NT = 500.0, 1e-9


@dataclass(frozen=True)
class AirSensors:
    """Rates (Hz) and white noise (1 sigma) of magnetometer (T), static pressure (Pa) and dynamic pressure (Pa).

    The defaults are typical of MEMS sensors: 0.5 mG, 2 Pa (17 cm of height) and 1 Pa.
    """

    magnetometer_rate: float = 50.0
    barometer_rate: float = 25.0
    magnetic_noise: float = 5e-8
    pressure_noise: float = 2.0
    dynamic_pressure_noise: float = 1.0


@dataclass
class AirData:
    """The latest samples of the two sensors.

    magnetic_b: magnetic field (3, T).  pressure, dynamic_pressure: Pa.  temperature: K.  pressure_height: height of
    `pressure` in the standard atmosphere (m).  magnetometer_samples, barometer_samples: number of each sensor's latest
    sample.
    """

    magnetic_b: Vector
    pressure: float = 0.0
    dynamic_pressure: float = 0.0
    temperature: float = 0.0
    pressure_height: float = 0.0
    magnetometer_samples: int = 0
    barometer_samples: int = 0


class Surroundings:
    """Magnetometer and barometer along a run.

    seed: of their noise.  year: decimal year at the start of the run, limited to the five years of the World Magnetic
    Model.  data: the latest samples.
    """

    def __init__(self, seed: int, year: float, sensors: AirSensors | None = None) -> None:
        self.sensors = sensors or AirSensors()
        self.data = AirData(np.zeros(3))
        self._model, (first, last) = _magnetic_model()
        self._year = min(max(year, first), last - 1e-6)
        self._place: tuple[float, float, float] | None = None
        self._field_n = np.zeros(3)
        self._magnetic_noise = _Noise(seed, 0, 3)
        self._air_noise = _Noise(seed, 1, 2)

    def update(self, time: float, truth: dict[str, Any], height_msl: float) -> None:
        """Take the samples due at `time` (s).  truth: q_nb, velocity_n (m/s), latitude, longitude (rad), height (m)."""
        magnetometer = int(time * self.sensors.magnetometer_rate + 1e-6) + 1
        barometer = int(time * self.sensors.barometer_rate + 1e-6) + 1
        if magnetometer != self.data.magnetometer_samples:
            self.data.magnetometer_samples = magnetometer
            field_n = self._field(float(truth["latitude"]), float(truth["longitude"]), float(truth["height"]))
            field_b = attitude.numeric.rotate_inverse(truth["q_nb"], field_n)
            self.data.magnetic_b = field_b + self.sensors.magnetic_noise * self._magnetic_noise(magnetometer)
        if barometer != self.data.barometer_samples:
            self.data.barometer_samples = barometer
            self._sample_air(truth, height_msl, self._air_noise(barometer))

    def _sample_air(self, truth: dict[str, Any], height_msl: float, normals: Vector) -> None:
        heights, log_pressure, temperature = _atmosphere()
        data = self.data
        data.temperature = float(np.interp(height_msl, heights, temperature))
        exact = float(np.exp(np.interp(height_msl, heights, log_pressure)))
        speed_squared = float(np.dot(truth["velocity_n"], truth["velocity_n"]))
        density = exact / (GAS_CONSTANT * data.temperature)
        data.pressure = exact + self.sensors.pressure_noise * float(normals[0])
        data.dynamic_pressure = 0.5 * density * speed_squared + self.sensors.dynamic_pressure_noise * float(normals[1])
        if data.pressure > 0.0:
            data.pressure_height = float(np.interp(-np.log(data.pressure), -log_pressure, heights))

    def _field(self, latitude: float, longitude: float, height: float) -> Vector:
        """The Earth's field (3, T, n), recomputed every 500 m: it changes by about 10 nT per kilometre."""
        if self._place is not None:
            north = (latitude - self._place[0]) * MEAN_RADIUS
            east = (longitude - self._place[1]) * MEAN_RADIUS * cos(latitude)
            if hypot(north, east, height - self._place[2]) < _MOVED_M:
                return self._field_n
        self._place = latitude, longitude, height
        east_deg = (degrees(longitude) + 180.0) % 360.0 - 180.0
        found = self._model.calculate(degrees(latitude), east_deg, height / 1e3, self._year, allow_date_outside_lifespan=True)
        self._field_n = np.array([found.x, found.y, found.z]) * _TESLA_PER_NT
        return self._field_n


class _Noise:
    """Standard normals of a sensor by sample number, computed in blocks."""

    def __init__(self, seed: int, sensor: int, count: int) -> None:
        self._seed, self._stream, self._count = seed, NOISE_STREAM - sensor, count
        self._first = -_AHEAD
        self._block: NDArray[np.float64] = np.zeros((0, count))

    def __call__(self, sample: int) -> Vector:
        if not self._first <= sample < self._first + _AHEAD:
            from scipy.special import ndtri

            self._first = sample // _AHEAD * _AHEAD
            steps = np.arange(self._first, self._first + _AHEAD)
            self._block = ndtri(noise.uniforms(self._seed, steps, self._stream, self._count))
        return self._block[sample - self._first]


@lru_cache(maxsize=1)
def _magnetic_model() -> tuple[Any, tuple[float, float]]:
    """The World Magnetic Model with the library's newest coefficients, and the years of its validity."""
    from pygeomag import GeoMag

    model = GeoMag()
    first, last = model.life_span
    return model, (float(first), float(last))


@lru_cache(maxsize=1)
def _atmosphere() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Heights above mean sea level (m), natural logarithm of pressure (Pa), temperature (K).

    Between heights 10 m apart the logarithm is linear to 1e-8.
    """
    from ambiance import Atmosphere

    heights = np.arange(_LOWEST, _HIGHEST + _STEP / 2, _STEP)
    air = Atmosphere(heights)
    return heights, np.log(air.pressure), np.asarray(air.temperature)

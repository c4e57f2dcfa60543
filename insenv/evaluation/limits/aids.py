"""The aiding instruments as measurements of the error states.

Each instrument is linear in the errors of navigation and in its own error sources, all estimate minus truth.  Of the epochs
within a step, the white noises are averaged and the measurement is applied at the end of the step, at most 0.1 s later.  The
latency, which only delays what is known, is not counted, nor is rounding beyond its variance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.evaluation.limits.states import Source, source
from insenv.evaluation.limits.steps import DR, DV, PSI, Steps

Array = NDArray[np.float64]

LEAST = {"barometer": 1e-4, "magnetometer": 1e-11, "odometer": 1e-5, "dvl": 1e-5, "heading": 1e-5}
"""Smallest standard deviation of a measurement: that of an instrument without errors, SI."""
_OFF_DIAGONAL = np.array([1, 2, 3, 5, 6, 7])

Linear = Callable[["View"], tuple[Array, dict[str, Array]]]
"""From a block of steps to how the measurement follows the errors of navigation (m, r, 9), and by name of a source its states
(m, r, all components)."""


@dataclass(frozen=True)
class View:
    """A block of m steps as instruments see it, at their ends.

    C_en, C_nb (m, 3, 3); velocity_b, rate_b, force_b (m, 3): velocity (m/s) and angular rate (rad/s) over the Earth, specific
    force (m/s^2).  steps: the block.
    """

    steps: Steps
    C_en: Array
    C_nb: Array
    velocity_b: Array
    rate_b: Array
    force_b: Array

    @property
    def C_be(self) -> Array:
        """(m, 3, 3)."""
        return np.asarray((self.C_en @ self.C_nb).swapaxes(1, 2))

    def turned(self, vector_n: Array) -> Array:
        """Error of C_bn u_n per psi (m, 3, 3), u_n (m, 3) being known: C_be [u_e x]."""
        in_e = (self.C_en @ vector_n[..., None])[..., 0]
        return np.asarray(self.C_be @ attitude.numeric.skew(in_e))


@dataclass(frozen=True)
class Aid:
    """An instrument: its sources, its white noise (r,), when it measures, and its equations.

    interval: inertial samples.  outages (k, 2): begin and end, s.  sample_interval: s.
    """

    id: str
    sources: tuple[Source, ...]
    noise: Array
    linear: Linear
    interval: int
    outages: Array
    sample_interval: float

    def epochs(self, begin: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number of its epochs after sample `begin` up to sample `end`, for each of m steps."""
        found = end // self.interval - begin // self.interval
        for first, last in self.outages:
            if last > first:  # epochs k with first <= k interval < last
                low, high = (int(np.ceil(t / (self.interval * self.sample_interval) - 1e-6)) for t in (first, last))
                lost = np.minimum(end // self.interval, high - 1) - np.maximum(begin // self.interval, low - 1)
                found = found - np.maximum(lost, 0)
        return np.asarray(np.maximum(found, 0))


def view(steps: Steps, C_en: Array) -> View:
    """The block as instruments see it."""
    C_nb = attitude.numeric.to_dcm(steps.q_nb)
    velocity, rate, force = (
        (C_nb.swapaxes(1, 2) @ each[..., None])[..., 0]
        for each in (steps.velocity_n, steps.rate_n, steps.thrust / steps.length[:, None])
    )
    return View(steps, C_en, C_nb, velocity, rate, force)


def aids_of(rows: Mapping[str, Any], sample_interval: float) -> tuple[Aid, ...]:
    """The instruments of a plant's parameters by row name (SI)."""
    return tuple(_aid(id, make, rows, sample_interval) for id, make in _MAKERS.items() if f"{id}_interval" in rows)


def _aid(id: str, make: Any, rows: Mapping[str, Any], sample_interval: float) -> Aid:
    sources, noise, linear = make(_Rows(rows))
    windows = np.stack([np.ravel(rows[f"{id}_outage_{end}"]) for end in ("start", "end")], axis=1).astype(float)
    return Aid(
        id=id,
        sources=tuple(each for each in sources if each is not None),
        noise=np.maximum(noise, LEAST[id]),
        linear=linear,
        interval=round(float(rows[f"{id}_interval"]) / sample_interval),
        outages=windows,
        sample_interval=sample_interval,
    )


@dataclass(frozen=True)
class _Rows:
    rows: Mapping[str, Any]

    def __call__(self, name: str, size: int = 1) -> Array:
        return np.array(np.broadcast_to(np.asarray(self.rows[name], dtype=float).ravel(), size))

    def square(self, *names: str, size: int = 1) -> Array:
        """Sum of the squares of rows: fixed and drawn parts as one variance."""
        return np.asarray(sum(self(name, size) ** 2 for name in names))


def _barometer(row: _Rows) -> tuple[Any, Array, Linear]:
    start = float(row("start_height")[0])
    sources = (
        source("barometer bias", None, row.square("barometer_bias", "barometer_bias_sigma")),
        source("barometer drift", None, row.square("barometer_drift_sigma"), time=row("barometer_drift_time")),
        source("barometer scale", None, row.square("barometer_scale_factor", "barometer_scale_factor_sigma")),
        source("barometer speed", None, row.square("barometer_speed_error")),
    )

    def linear(seen: View) -> tuple[Array, dict[str, Array]]:
        m = len(seen.steps.time)
        nav = np.zeros((m, 1, 9))
        nav[:, 0, DR] = -seen.C_en[:, :, 2]
        speed = np.sum(seen.steps.velocity_n**2, axis=1) / (2.0 * geodesy.STANDARD_GRAVITY)
        one = np.ones((m, 1, 1))
        return nav, {
            "barometer bias": one,
            "barometer drift": one,
            "barometer scale": (seen.steps.height - start)[:, None, None],
            "barometer speed": speed[:, None, None],
        }

    return sources, _white(row, "barometer_noise", "barometer_quantum", 1), linear


def _magnetometer(row: _Rows) -> tuple[Any, Array, Linear]:
    field, gradient = row("magnetic_field_n", 3), row("magnetic_field_gradient", 9).reshape(3, 3)
    place = [float(row(f"start_{name}")[0]) for name in ("latitude", "longitude", "height")]
    fixed = row("magnetometer_soft_iron", 9) ** 2
    soft = fixed + row("magnetometer_coupling_sigma", 9) ** 2
    soft[[0, 4, 8]] = fixed[[0, 4, 8]] + row("magnetometer_soft_iron_sigma", 3) ** 2
    drift = row.square("magnetometer_drift_sigma", size=3)
    sources = (
        source("magnetic anomaly", None, row.square("magnetic_anomaly_n", "magnetic_anomaly_sigma", size=3)),
        source("hard iron", None, row.square("magnetometer_hard_iron", "magnetometer_hard_iron_sigma", size=3)),
        source("soft iron", None, soft),
        source("magnetometer drift", None, drift, time=row("magnetometer_drift_time", 3)),
    )

    def linear(seen: View) -> tuple[Array, dict[str, Array]]:
        steps, m = seen.steps, len(seen.steps.time)
        R_M, R_N = geodesy.numeric.radii(np.sin(steps.latitude))
        east = np.angle(np.exp(1j * (steps.longitude - place[1]))) * (R_N + steps.height) * np.cos(steps.latitude)
        way = np.stack([(steps.latitude - place[0]) * (R_M + steps.height), east, place[2] - steps.height], axis=1)
        field_n = field + way @ gradient.T
        C_bn = seen.C_nb.swapaxes(1, 2)
        field_b = (C_bn @ field_n[..., None])[..., 0]
        nav, eye = np.zeros((m, 3, 9)), np.tile(np.eye(3), (m, 1, 1))
        nav[:, :, PSI] = seen.turned(field_n)
        return nav, {
            "magnetic anomaly": C_bn,
            "hard iron": eye,
            "soft iron": np.einsum("ij,mk->mijk", np.eye(3), field_b).reshape(m, 3, 9),
            "magnetometer drift": eye,
        }

    return sources, _white(row, "magnetometer_noise", "magnetometer_quantum", 3), linear


def _odometer(row: _Rows) -> tuple[Any, Array, Linear]:
    arm = row("odometer_lever_arm_b", 3)
    C_bv = attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(row("odometer_mounting", 3)))
    sources = (
        source("odometer scale", None, row.square("odometer_scale_factor", "odometer_scale_factor_sigma")),
        source("odometer slip", None, row.square("odometer_slip", "odometer_slip_sigma")),
        source("odometer mounting", None, row.square("odometer_mounting_error", "odometer_mounting_error_sigma", size=3)),
    )

    def linear(seen: View) -> tuple[Array, dict[str, Array]]:
        axis = C_bv[:, 0]
        at_wheel = (seen.velocity_b + np.cross(seen.rate_b, arm)) @ C_bv
        nav = np.zeros((len(at_wheel), 1, 9))
        nav[:, 0, DV] = axis @ seen.C_be
        nav[:, 0, PSI] = axis @ seen.turned(seen.steps.velocity_n)
        speed = at_wheel[:, :1]
        return nav, {
            "odometer scale": speed[:, None],
            "odometer slip": (seen.force_b[:, :1] * speed)[:, None],
            "odometer mounting": np.cross([1.0, 0.0, 0.0], at_wheel)[:, None],
        }

    return sources, _white(row, "odometer_noise", "odometer_quantum", 1), linear


def _dvl(row: _Rows) -> tuple[Any, Array, Linear]:
    arm, water = row("dvl_lever_arm_b", 3), float(row("dvl_water_track")[0])
    time = row("dvl_current_time", 2)
    sources = (
        source("dvl scale", None, row.square("dvl_scale_factor", "dvl_scale_factor_sigma")),
        source("dvl misalignment", None, row.square("dvl_misalignment", "dvl_misalignment_sigma", size=3)),
        source("current", None, water * row.square("dvl_current_n", size=3)),
        source("changing current", None, water * row.square("dvl_current_sigma", size=2), time=time),
    )

    def linear(seen: View) -> tuple[Array, dict[str, Array]]:
        shown = seen.velocity_b + np.cross(seen.rate_b, arm)
        nav = np.zeros((len(shown), 3, 9))
        nav[:, :, DV] = seen.C_be
        nav[:, :, PSI] = seen.turned(seen.steps.velocity_n)
        C_bn = seen.C_nb.swapaxes(1, 2)
        return nav, {
            "dvl scale": shown[..., None],
            "dvl misalignment": attitude.numeric.skew(shown),
            "current": -C_bn,
            "changing current": -C_bn[:, :, :2],
        }

    return sources, np.full(3, float(row("dvl_noise")[0])), linear


def _heading(row: _Rows) -> tuple[Any, Array, Linear]:
    baseline, good = row("heading_baseline_b", 3), 1.0 - float(row("heading_outlier_probability")[0])
    error = row.square("heading_baseline_error", "heading_baseline_error_sigma", size=3)
    sources = (
        source("baseline", None, error),
        source("baseline wander", None, row.square("heading_wander_sigma", size=3), time=row("heading_wander_time", 3)),
    )

    def linear(seen: View) -> tuple[Array, dict[str, Array]]:
        m = len(seen.steps.time)
        baseline_e = (seen.C_en @ seen.C_nb @ baseline[:, None])[..., 0]
        nav = np.zeros((m, 3, 9))
        nav[:, :, PSI] = -seen.C_en.swapaxes(1, 2) @ attitude.numeric.skew(baseline_e)
        return nav, {"baseline": seen.C_nb, "baseline wander": np.tile(np.eye(3), (m, 1, 1))}

    # a detected outlier is a measurement that is missing
    return sources, row("heading_baseline_noise", 3) / np.sqrt(max(good, 1e-12)), linear


def _white(row: _Rows, noise: str, quantum: str, size: int) -> Array:
    """Standard deviation (size,) of white noise, rounding included."""
    return np.sqrt(row(noise, size) ** 2 + row(quantum, size) ** 2 / 12.0)


_MAKERS = {
    "barometer": _barometer,
    "magnetometer": _magnetometer,
    "odometer": _odometer,
    "dvl": _dvl,
    "heading": _heading,
}

"""The result of a calibration: the errors of the inertial unit that a filter estimates, beside the true ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.estimators.contract import TURNTABLE
from insenv.geodesy import STANDARD_GRAVITY

Array = NDArray[np.float64]

DEG_H = degrees(1.0) * 3600.0
UNITS = {
    "gyro_bias": ("deg/h", DEG_H),
    "accel_bias": ("ug", 1e6 / STANDARD_GRAVITY),
    "gyro_g_sensitivity": ("deg/h/g", DEG_H * STANDARD_GRAVITY),
    "gyro_scale": ("ppm", 1e6),
    "accel_scale": ("ppm", 1e6),
    "gyro_misalignment": ("urad", 1e6),
    "accel_misalignment": ("urad", 1e6),
}
"""Unit in which an error state is shown, and the factor from SI."""
_COMPONENTS = {3: ("x", "y", "z"), 6: ("xy", "xz", "yx", "yz", "zx", "zy")}


@dataclass(frozen=True)
class UnitError:
    """One component of an error of the unit at the end of a run: estimate, standard deviation and truth, in `unit`.

    name: that of the error state.  component: the body axis ("x" forward, "y" right, "z" down), or which axis couples into
    which.  true: None where it is not known.
    """

    name: str
    component: str
    unit: str
    estimate: float
    sigma: float
    true: float | None = None

    @property
    def error(self) -> float | None:
        """Estimate minus truth."""
        return None if self.true is None else self.estimate - self.true

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "name": self.name,
            "component": self.component,
            "unit": self.unit,
            "estimate": self.estimate,
            "sigma": self.sigma,
            "true": self.true,
            "error": self.error,
        }


def unit_errors(vehicle: str, outputs: Mapping[str, Array], true: Mapping[str, Array] | None = None) -> tuple[UnitError, ...]:
    """The errors of the unit in an estimator's outputs (n, k) by row name, at the last record; none off a turntable.

    vehicle: its kind.  true: `insenv.sensors.imu.true_unit_errors` (k,) by the same names, or None.
    """
    found: list[UnitError] = []
    if vehicle != TURNTABLE:
        return ()
    for name, (unit, factor) in UNITS.items():
        if f"{name}_estimate_sigma" not in outputs:
            continue
        estimates, sigmas = (factor * outputs[row][-1] for row in (name, f"{name}_estimate_sigma"))
        actual = [None] * len(estimates) if true is None else [float(factor * value) for value in true[name]]
        columns = zip(_COMPONENTS[len(estimates)], estimates, sigmas, actual, strict=True)
        found += [UnitError(name, axis, unit, float(estimate), float(sigma), known) for axis, estimate, sigma, known in columns]
    return tuple(found)

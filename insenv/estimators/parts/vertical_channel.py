"""Why free-inertial height diverges: an error of height changes gravity, and gravity the height.

Of an error dh of the height, gravity computed at h + dh lacks 2 g / R dh, so dh'' = 2 g / R dh: a solution grows as
exp(t / TIME) with TIME = sqrt(R / 2 g), and an error at the start by the factor cosh(t / TIME). Britting (1971), chapter 6.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cosh, sqrt
from typing import Any

from insenv.base.remarks import remark
from insenv.geodesy import MEAN_RADIUS, NOMINAL_GRAVITY

TIME = sqrt(MEAN_RADIUS / (2.0 * NOMINAL_GRAVITY))
"""s, 570."""
NOTED = 2.0
"""Growth from which there is a note: after 750 s."""


MIN_ERROR = 5.0
"""m: a smaller error of the height is not noted."""


@remark(
    "height-drifts",
    "none of the aids holds the height of a vehicle that moves: an accelerometer bias of accel_bias_sigma makes an error of "
    "{error:.2g} m in {duration:g} s. Add a barometer, GNSS, a Doppler log or, for wheels, non_holonomic",
)
def by_bias(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """The height of a filter whose aids do not hold it, where its error has begun to count.

    parameters: ``accel_bias_sigma`` (m/s^2) and ``position_sigma`` (3, m) by name.  A bias b makes the error
    b TIME^2 (cosh(t / TIME) - 1).
    """
    growth = cosh(min(duration_s / TIME, 700.0)) - 1.0
    error = float(parameters["accel_bias_sigma"]) * TIME**2 * growth
    if error < max(MIN_ERROR, float(parameters["position_sigma"][2])):
        return None
    return {"error": error, "duration": duration_s}


@remark(
    "height-unaided",
    f"nothing aids the height: its errors grow by a factor e every {TIME:.0f} s, sqrt(R / 2 g), those of the start by "
    "{growth:.2g} in {duration:g} s; use an estimator with GNSS where the height matters",
)
def notes(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """The height of an estimator without aiding, after `duration_s`, where it has begun to count."""
    growth = cosh(min(duration_s / TIME, 700.0))
    return None if growth < NOTED else {"growth": growth, "duration": duration_s}

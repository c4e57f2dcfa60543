"""What a log says of its start while the vehicle stands: attitude, gyro bias, and the errors of both.

The mean specific force levels. The mean rate is the gyro bias plus the Earth's rate in the attitude: with the bias of the
unit's grade as prior knowledge it is a measurement of the heading (gyrocompassing) and of the bias at once. Good gyros find
the heading by it, poor ones their bias; in between both are what the two sources give together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.core.tables import Array
from insenv.estimators import ImuDataSheet
from insenv.logs.rest import Rest

CONFLICT = 3.0
"""Standard deviations by which a stated heading may differ from that of the gyros."""


@dataclass(frozen=True)
class RestStart:
    """Heading (rad) and gyro bias (rad/s, b) of a start at rest, in the terms of `insenv.estimators.Knowledge`.

    heading_sigma: rad. gyro_bias_error, rest_share: see there. conflict: stated heading minus that of the gyros (rad), where
    they disagree by more than `CONFLICT` standard deviations; otherwise 0.
    """

    heading: float
    heading_sigma: float
    gyro_bias: Array
    gyro_bias_error: float
    rest_share: float
    conflict: float = 0.0


def gyrocompass_sigma(rest: Rest, latitude: float, sensors: ImuDataSheet, tilt_sigma: float) -> float:
    """Standard deviation (rad) of the heading that the mean rate alone gives."""
    earth = geodesy.numeric.earth_rate_n(latitude)
    return float(_rate_sigma(rest, sensors, tilt_sigma * earth[2]) / max(earth[0], 1e-9 * geodesy.OMEGA_IE))


def start_at_rest(
    rest: Rest,
    level: tuple[float, float],
    latitude: float,
    heading: float,
    sigma: float,
    sensors: ImuDataSheet,
    tilt_sigma: float,
) -> RestStart:
    """Heading and gyro bias of greatest posterior probability.

    level: roll and pitch (rad). heading, sigma: what is known of the heading besides the gyros (rad); sigma pi: nothing.
    """
    earth = geodesy.numeric.earth_rate_n(latitude)
    rate = attitude.numeric.to_dcm(attitude.numeric.from_euler(*level, 0.0)) @ rest.rate
    variance = _rate_sigma(rest, sensors, tilt_sigma * earth[2]) ** 2
    weight = earth[0] * float(np.hypot(rate[0], rate[1])) / variance  # 1/rad^2: information of the gyros at their heading
    compass = float(np.arctan2(-rate[1], rate[0]))
    conflict = float(wrapped(heading - compass))
    if sigma < np.pi and abs(conflict) > CONFLICT * np.hypot(sigma, weight**-0.5):
        sigma = abs(conflict)  # the stated heading is wrong, or the rest was none
    else:
        conflict = 0.0
    prior = sigma**-2 if sigma < np.pi else 0.0

    turned = np.linspace(-np.pi, np.pi, 7201)
    turn = float(turned[np.argmax(weight * np.cos(heading + turned - compass) - prior * turned**2 / 2)])
    for _ in range(5):
        slope = -weight * np.sin(heading + turn - compass) - prior * turn
        curvature = weight * np.cos(heading + turn - compass) + prior
        turn += float(slope / curvature) if curvature > 0 else 0.0
    best = float(wrapped(heading + turn))
    left = min(float((weight * np.cos(best - compass) + prior) ** -0.5), sigma, np.pi)

    bias, mean = sensors.gyro_bias_sigma, _drifted(rest, sensors)
    share = bias**2 / (bias**2 + mean**2)
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(*level, best))
    # over a wide heading the Earth's rate goes round a circle: what a straight line along the heading leaves of it
    slope = float(np.exp(-(left**2) / 2))
    sine = max((1 - np.exp(-2 * left**2)) / 2 - (slope * left) ** 2, 0.0)
    cosine = max((1 + np.exp(-2 * left**2)) / 2 - 2 * slope + 1, 0.0)
    curved = earth[0] * share * float(np.sqrt(sine + cosine))
    return RestStart(
        heading=best,
        heading_sigma=left,
        gyro_bias=share * (rest.rate - C_nb.T @ earth),
        gyro_bias_error=float(np.hypot(np.sqrt(share) * mean, curved)),
        rest_share=share * slope,
        conflict=conflict,
    )


def _rate_sigma(rest: Rest, sensors: ImuDataSheet, by_tilt: float) -> float:
    """Standard deviation (rad/s) of the mean rate as a measurement of the Earth's, with what a tilt adds."""
    return float(np.sqrt(sensors.gyro_bias_sigma**2 + _drifted(rest, sensors) ** 2 + by_tilt**2))


def _drifted(rest: Rest, sensors: ImuDataSheet) -> float:
    """Standard deviation (rad/s) of the mean rate as a measurement of the bias at the start, which drifts meanwhile."""
    drive = 2 * sensors.gyro_bias_sigma**2 / sensors.gyro_correlation_time
    white = sensors.angle_random_walk**2 / rest.duration
    return float(np.sqrt(max(rest.rate_sigma**2, white) + drive * (rest.duration / 3 + rest.age)))


def wrapped(angle: float | Array) -> Any:
    """An angle (rad), or an array of them, from -pi to pi."""
    return np.angle(np.exp(1j * angle))

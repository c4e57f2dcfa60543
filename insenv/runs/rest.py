"""What a log says of its start while the vehicle stands: attitude, gyro bias, and the errors of both.

The mean specific force levels. The mean rate is the gyro bias plus the Earth's rate in the attitude: with the bias of the
unit's grade as prior knowledge it is a measurement of the heading (gyrocompassing) and of the bias at once. Good gyros find
the heading by it, poor ones their bias; in between both are what the two sources give together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.estimators import ImuDataSheet
from insenv.logs import RecordedLog
from insenv.logs.recorded import Readings
from insenv.logs.rest import Rest
from insenv.sensors import registry
from insenv.sensors.instrument import Instrument
from insenv.sensors.level_equation import Level, equation_at

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


# What instruments read of a vehicle that stands: its heading, and a datum that is not that of the fixes.
#
# Both evaluate the measurement equation of the instrument (`insenv.sensors.instrument`) at a level that is known.
#
# A heading psi minimises r^T R^-1 r, r(psi) the equation without errors minus the mean reading and R its covariance: the
# stated errors, the white noise of the mean, and the error of the level.  Its standard deviation is (h^T R^-1 h)^-1/2 with h
# = dr/dpsi.
#
# A barometer is set to a pressure at sea level, to the height of the field, or to nothing: its readings can differ from the
# height of the fixes by far more than its sensor is wrong.  Where they do at the start, the difference is the standard
# deviation with which its constant error starts.

CONTRADICTED = 5.0
"""Standard deviations of a mean reading beyond which it is that of no heading, or the datum another one."""
DATUM_READINGS = 10
"""Readings at the start that are compared with the fixes."""


@dataclass(frozen=True)
class Heading:
    """A heading at rest (rad), its standard deviation (rad), and the instrument in sentences ("the magnetometer")."""

    heading: float
    sigma: float
    called: str


def heading_at_rest(log: RecordedLog, level: tuple[float, float], tilt_sigma: float, height: float) -> Heading | None:
    """The surest heading that an instrument of a log shows while it stands; None if none does.

    level: roll and pitch (rad), each with the standard deviation `tilt_sigma`.  height: m above the ellipsoid.
    """
    if log.rest is None:
        return None
    shown = []
    for each in log.instruments:
        instrument = registry.instruments()[each.id]
        still = (each.time >= log.rest[0]) & (each.time <= log.rest[1])
        if "heading" in instrument.holds and still.any():
            reported = 0.0
            if instrument.sigma in each.rows:
                reported = float(np.mean(each.columns()[instrument.sigma][still] ** 2))
            read = _rows(instrument, each, still)
            shown.append(_heading(instrument, read, reported, level, tilt_sigma, height, log.stated_errors))
    return min((each for each in shown if each is not None), key=lambda each: each.sigma, default=None)


def _rows(instrument: Instrument, readings: Readings, use: NDArray[np.bool_]) -> Array:
    """The readings (m, k) of the row that filters compare."""
    return readings.columns()[instrument.compared.name][use].reshape(int(use.sum()), -1)


def _heading(
    instrument: Instrument,
    read: Array,
    reported: float,
    level: tuple[float, float],
    tilt_sigma: float,
    height: float,
    stated: Mapping[str, Any],
) -> Heading | None:
    """reported: variance that the readings state of themselves."""
    mean = np.angle(np.mean(np.exp(1j * read), axis=0)) if instrument.angle else read.mean(axis=0)
    psi, tilt = ca.SX.sym("heading"), ca.SX.sym("tilt", 2)
    C_nb = attitude.to_dcm(attitude.from_euler(level[0], level[1], 0.0))
    turn = ca.vertcat(ca.horzcat(ca.cos(psi), -ca.sin(psi), 0), ca.horzcat(ca.sin(psi), ca.cos(psi), 0), ca.SX([[0, 0, 1]]))
    tilted = (ca.SX.eye(3) + skew(ca.vertcat(tilt, 0))) @ C_nb
    value, errors, variances = equation_at(instrument, Level(turn @ tilted, height), stated, len(read))
    outputs = [value, ca.jacobian(value, psi), ca.jacobian(value, ca.vertcat(errors, tilt))]
    at_zero = ca.substitute(outputs, [errors, tilt], [ca.SX.zeros(errors.shape), ca.SX.zeros(2)])
    equation = ca.Function("equation", [psi], [ca.densify(part) for part in at_zero])
    variances = np.append(variances, np.full(2, tilt_sigma**2))
    least = instrument.least_sigma.get(instrument.compared.name, 1e-9) ** 2 + reported

    def linear(heading: float) -> tuple[float, float, float]:
        """Cost, step to the minimum, and information at a heading."""
        shown, h, J = (np.asarray(part) for part in equation(heading))
        r = shown.ravel() - mean
        r = np.angle(np.exp(1j * r)) if instrument.angle else r
        weighted = np.linalg.solve((J * variances) @ J.T + least * np.eye(len(r)), np.column_stack([r, h.ravel()]))
        information = float(h.ravel() @ weighted[:, 1])
        return float(r @ weighted[:, 0]), -float(h.ravel() @ weighted[:, 0]) / max(information, 1e-12), information

    heading = min(np.linspace(-np.pi, np.pi, 360, endpoint=False), key=lambda psi: linear(psi)[0])
    for _ in range(10):
        heading += linear(heading)[1]
    cost, _, information = linear(heading)
    sigma = max(information, 1e-12) ** -0.5
    if not np.isfinite(cost) or cost > CONTRADICTED**2 or sigma > 1.0:
        return None
    return Heading(float(np.angle(np.exp(1j * heading))), sigma, instrument.called)


# The datum of heights.

_DATUM = declared(
    "datum-differs",
    "{called} reads {apart:.4g} m {side} the fixes at the start, and its stated errors allow {allowed:.2g} m (1 sigma): its "
    "constant error starts with a standard deviation of {apart:.4g} m",
)


def with_datum(log: RecordedLog) -> tuple[RecordedLog, tuple[Remark, ...]]:
    """The log with the standard deviation of the constant error of instruments whose heights are not those of the fixes."""
    stated, remarks = dict(log.stated_errors), []
    for each in log.instruments:
        instrument = registry.instruments()[each.id]
        if instrument.holds == ("vertical",) and log.gnss is not None:
            datum = _datum(instrument, each, log)
            if datum is not None:
                row, remark = datum
                stated |= row
                remarks.append(remark)
    return (replace(log, stated_errors=stated) if remarks else log), tuple(remarks)


def _datum(instrument: Instrument, readings: Readings, log: RecordedLog) -> tuple[dict[str, float], Remark] | None:
    gnss = log.gnss
    assert gnss is not None
    use = (readings.time >= gnss.time[0]) & (readings.time <= gnss.time[-1])
    use &= np.cumsum(use) <= DATUM_READINGS
    if not use.any():
        return None
    at = np.interp(readings.time[use], gnss.time, gnss.height)
    value, errors, variances = equation_at(instrument, Level(ca.SX.eye(3), 0.0), log.stated_errors, 1)
    constants = [term for term in instrument.terms if term.kind == "constant" and term.states and not term.shape]
    if value.numel() != 1 or not constants:
        return None
    J = np.asarray(ca.DM(ca.evalf(ca.jacobian(value, errors)))).ravel() if len(variances) else np.zeros(0)
    fix_sigma = float(gnss.position_sigma[np.argmin(np.abs(gnss.time - readings.time[use][0])), 2])
    offset = float(np.median(_rows(instrument, readings, use).ravel() - at))
    allowed = float(np.hypot(np.sqrt(J**2 @ variances), fix_sigma))
    if abs(offset) <= CONTRADICTED * allowed:
        return None
    side = "above" if offset > 0 else "below"
    said = _DATUM.filled(called=instrument.called, apart=abs(offset), side=side, allowed=allowed)
    return {constants[0].stated[0].name: abs(offset)}, said

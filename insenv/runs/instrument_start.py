"""What instruments read of a vehicle where a log starts: its heading, and a datum that is not that of the fixes.

Both evaluate the measurement equation of the instrument (`insenv.sensors.instrument`) at a level that is known.

A heading psi minimises r^T R^-1 r, r(psi) the equation without errors minus the mean reading and R its covariance: the
stated errors, the white noise of the mean, and the error of the level.  Its standard deviation is (h^T R^-1 h)^-1/2 with h
= dr/dpsi.

Of a vehicle under way the level is that of the mean specific force over about a second between two fixes.  That is the
acceleration less gravity: of the acceleration the fixes show how large it is, but without a heading not where it points to, so
the level is off by up to the acceleration over gravity.

A barometer is set to a pressure at sea level, to the height of the field, or to nothing: its readings can differ from the
height of the fixes by far more than its sensor is wrong.  Where they do at the start, the difference is the standard
deviation with which its constant error starts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.attitude import skew
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.estimators.every_heading import KNOWN_LEVEL, LEAST_LEVEL
from insenv.logs import RecordedLog
from insenv.logs.recorded import Readings
from insenv.logs.rest import level_of
from insenv.runs.velocity_changes import velocity_changes
from insenv.sensors import registry
from insenv.sensors.instrument import Instrument
from insenv.sensors.level_equation import Level, equation_at

CONTRADICTED = 5.0
"""Standard deviations of a mean reading beyond which it is that of no heading, or the datum another one."""
DATUM_READINGS = 10
"""Readings at the start that are compared with the fixes."""
SOON_S = 5.0
"""s: after the start, in which a level or a reading of a vehicle under way must come."""


@dataclass(frozen=True)
class Heading:
    """A heading (rad), its standard deviation (rad), and whose in sentences ("the magnetometer while the vehicle stands")."""

    heading: float
    sigma: float
    called: str


def heading_at_rest(log: RecordedLog, level: tuple[float, float], tilt_sigma: float, height: float) -> Heading | None:
    """The surest heading that an instrument of a log shows while it stands; None if none does.

    level: roll and pitch (rad), each with the standard deviation `tilt_sigma`.  height: m above the ellipsoid.
    """
    if log.rest is None:
        return None
    begin, end = log.rest
    uses = ((each, (each.time >= begin) & (each.time <= end)) for each in log.instruments)
    shown = (_shown(each, use, level, tilt_sigma, height, log, "while the vehicle stands") for each, use in uses)
    return min((each for each in shown if each is not None), key=lambda each: each.sigma, default=None)


@dataclass(frozen=True)
class Attitude:
    """Roll and pitch (rad), their standard deviation (rad), and the heading."""

    roll: float
    pitch: float
    tilt_sigma: float
    heading: Heading


def attitude_under_way(log: RecordedLog, first: int, height: float) -> Attitude | None:
    """The attitude where sample `first` begins, by the specific force and an instrument; None if they do not show it.

    height: m above the ellipsoid.
    """
    begin = float(log.imu_time[first] - log.dt[first])
    soon = [(each, (each.time >= begin) & (each.time <= begin + SOON_S)) for each in log.instruments]
    found = _level_under_way(log, first) if any(use.any() for _, use in soon) else None
    if found is None:
        return None
    up, tilt_sigma = found
    shown = []
    for each, use in soon:
        # of one reading: the vehicle turns
        turn = _turned(log, first, float(each.time[use][0])) if use.any() else np.eye(3)
        level = level_of(turn.T @ up)
        heading = _shown(
            each, use & (np.cumsum(use) == 1), level, tilt_sigma, height, log, "where the mean specific force is up"
        )
        shown.append(None if heading is None else _carried(heading, level, turn.T, tilt_sigma))
    return min((each for each in shown if each is not None), key=lambda each: each.heading.sigma, default=None)


def _carried(heading: Heading, level: tuple[float, float], turn: Array, tilt_sigma: float) -> Attitude:
    """The attitude at the start from that at a reading; turn: takes the body axes of the start to those of the reading."""
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(*level, heading.heading)) @ turn
    roll, pitch = level_of(-C_nb[2])
    return Attitude(roll, pitch, tilt_sigma, replace(heading, heading=float(np.arctan2(C_nb[1, 0], C_nb[0, 0]))))


def _level_under_way(log: RecordedLog, first: int) -> tuple[Array, float] | None:
    """The upward direction in the body axes where sample `first` begins, and the standard deviation of its level (rad)."""
    changes, begin = velocity_changes(log), float(log.imu_time[first] - log.dt[first])
    if changes is None:
        return None
    use = (changes.time >= begin) & (changes.time <= begin + SOON_S) & changes.known[:, :2].all(axis=1)
    if not use.any():
        return None
    demanded, sheet = changes.demanded_n[use], log.sensors(in_place=False)
    tilt = np.maximum(np.arctan2(np.hypot(*demanded[:, :2].T), -demanded[:, 2]), LEAST_LEVEL)
    drift = sheet.gyro_bias_sigma * (changes.time[use] - begin)
    bias = sheet.accel_bias_sigma / np.linalg.norm(demanded / changes.duration[use, None], axis=1)
    sigma = np.sqrt(tilt**2 + drift**2 + bias**2)
    best = int(np.argmin(sigma))
    if sigma[best] > KNOWN_LEVEL:
        return None
    return _turned(log, first, float(changes.time[use][best])) @ changes.increment_b[use][best], float(sigma[best])


def _turned(log: RecordedLog, first: int, time: float) -> Array:
    """What takes body axes at a time (s) to those where sample `first` begins, by the gyros (3x3)."""
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for angle in log.delta_angle[first : np.searchsorted(log.imu_time, time)]:
        q = attitude.numeric.multiply(q, attitude.numeric.from_rotation_vector(angle))
    return np.asarray(attitude.numeric.to_dcm(q))


def _shown(
    each: Readings,
    use: NDArray[np.bool_],
    level: tuple[float, float],
    tilt_sigma: float,
    height: float,
    log: RecordedLog,
    when: str,
) -> Heading | None:
    """The heading by those readings of an instrument that `use` selects; None if they show none."""
    instrument = registry.instruments()[each.id]
    if "heading" not in instrument.holds or not use.any():
        return None
    reported = 0.0
    if instrument.sigma in each.rows:
        reported = float(np.mean(each.columns()[instrument.sigma][use] ** 2))
    found = _heading(instrument, _rows(instrument, each, use), reported, level, tilt_sigma, height, log.stated_errors)
    return None if found is None else Heading(*found, f"{instrument.called} {when}")


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
) -> tuple[float, float] | None:
    """Heading and its standard deviation (rad); reported: variance that the readings state of themselves."""
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
    return float(np.angle(np.exp(1j * heading))), sigma


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

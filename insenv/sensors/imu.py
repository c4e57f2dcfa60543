"""Inertial measurement unit: true increments of angle and velocity in, measured increments out.

For each triad, s being the sensor axes, b the body and dt the length of a sample (Groves 2013, section
4.4):

    y_s   = (I + k (T - T_0)) (I + S + M) C(e)^T C_sb d_b + bias_s dt + G C_sb dv_b + N sqrt(dt) w
    y_s   is limited to +-range dt, then quantized: n = floor((residual + y_s) / quantum + 1/2)
    out_b = C_bs n quantum, or 0 if the sample is lost

S scale factor, k its change per kelvin (a diagonal), T temperature, T_0 that of reference, M misalignment, e mounting
error, G g-sensitivity (gyros only), w standard normal.  The remainder below one count is carried to the next sample.
Only w and the loss are drawn on every sample.  The bias is the sum of the turn-on bias, a first-order Gauss-Markov
process, a random walk, flicker noise and a thermal part; the step "drift" advances these by `drift_interval` with their
exact discretisation, and the bias varies linearly between these points.  What of S and M is drawn is constant, or a
first-order Gauss-Markov process that the same step advances.

It is no `Instrument`: it measures on every sample and drives the estimators instead of aiding them, and its errors add up
over a sample, of two triads in one set of axes, with temperature, range, quantization and lost samples.  Rows, figures, keys
and grades stand once in `imu_tables` and `grades`; sections, stated errors, logs and pages follow from `grades.FIGURES`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np
from pydantic import create_model

from insenv import attitude
from insenv.attitude import from_rotation_vector, normalize, to_dcm
from insenv.base.errors import InputError
from insenv.base.keys import rows_of
from insenv.base.toml import LeverArm, Number, Rotation, key
from insenv.core.compose import Part
from insenv.core.elementary import exp, normals, select
from insenv.core.model import Step, Values
from insenv.core.tables import Array, Row, Table
from insenv.sensors.contract import HUGE, ErrorSource, Sensor, SensorSection
from insenv.sensors.grade_file import GradeValue, grade_of
from insenv.sensors.grades import FIGURES, WAYS, WHITE
from insenv.sensors.imu_tables import ACCEL, COUPLINGS, FLICKER_PARTS, GYRO, IMU_PARAMETERS, IMU_STATE, Triad, advanced_flicker

SAMPLE_UNIFORMS = 7
DRIFT_UNIFORMS = 12 + 6 * FLICKER_PARTS + 18
START_UNIFORMS = 34


def imu_part() -> Part:
    """The sensor as a part of a plant.

    Reads the parameter ``sample_interval`` (s) and the state rows ``true_delta_angle`` (3, rad, b) and
    ``true_delta_velocity`` (3, m/s, b), the exact increments that the preceding part computes in the step "sample".
    Steps: "sample" (7 uniforms), "drift" (when ``drift_due``, 60 uniforms); the start uses 34 uniforms.
    """
    return Part(
        parameters=IMU_PARAMETERS,
        state=IMU_STATE,
        steps={
            "sample": Step(_sample, uniforms=SAMPLE_UNIFORMS),
            "drift": Step(_drift, when="drift_due", uniforms=DRIFT_UNIFORMS),
        },
        start=_start,
        start_uniforms=START_UNIFORMS,
    )


def _of(values: Values, triad: Triad, row: str) -> Any:
    """The row of a triad."""
    return getattr(values, f"{triad.name}_{row}")


def _start(p: Values, r: Any) -> dict[str, Any]:
    """Draw what is constant in a run: turn-on bias, Gauss-Markov start, scale factor, misalignment, mounting."""
    n = normals(r)
    C_bs = to_dcm(normalize(p.q_bs))
    C_error = to_dcm(from_rotation_vector(p.mounting_error + p.mounting_error_sigma * n[30:33]))
    warm = p.imu_temperature_initial - p.imu_temperature_reference
    state: dict[str, Any] = {
        "imu_temperature": p.imu_temperature_initial,
        "imu_temperature_target": p.imu_temperature_final,
        "C_bs": C_bs,
        "gyro_g_matrix": p.gyro_g_sensitivity @ C_bs.T,
        "C_sb_true": C_error.T @ C_bs.T,
    }
    for triad, drawn in ((GYRO, n[0:15]), (ACCEL, n[15:30])):
        bias = _of(p, triad, "bias") + _of(p, triad, "bias_sigma") * drawn[0:3]
        instability = _of(p, triad, "instability_sigma") * drawn[3:6]
        scale, coupling = _of(p, triad, "scale_factor_sigma") * drawn[6:9], _of(p, triad, "misalignment_sigma") * drawn[9:15]
        matrix = _matrix(1.0 + (_of(p, triad, "scale_factor") + scale), _of(p, triad, "misalignment") + coupling)
        state[f"{triad.name}_drawn_matrix"] = _matrix(scale, coupling)
        state[f"{triad.name}_bias_turn_on"] = bias
        state[f"{triad.name}_instability"] = instability
        thermal = warm * _of(p, triad, "temperature_slope")
        state[f"{triad.name}_bias_s"] = bias + instability + thermal
        state[f"{triad.name}_bias_true"] = C_bs @ (bias + instability + thermal)
        state[f"{triad.name}_error_matrix"] = matrix @ C_error.T @ C_bs.T
    return state


def _matrix(diagonal: Any, coupling: Any) -> Any:
    """The matrix (3x3) with this diagonal (3) and these `COUPLINGS` (6)."""
    matrix = ca.diag(diagonal)
    for number, place in enumerate(COUPLINGS):
        matrix[place] = coupling[number]
    return matrix


def _sample(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
    """One sample of both triads, and whether an update of the slow errors is due."""
    dt = p.sample_interval
    root_dt = ca.sqrt(dt)
    n = normals(r[0:6])
    arrives = r[6] >= p.imu_drop_probability
    temperature = x.imu_temperature + x.imu_temperature_step
    state: dict[str, Any] = {"imu_valid": arrives}
    for triad, white, output in ((GYRO, n[0:3], "delta_angle"), (ACCEL, n[3:6], "delta_velocity")):
        bias = _of(x, triad, "bias_s") + _of(x, triad, "bias_step_s")
        sensed = _sensed(p, x, triad, bias, temperature) + getattr(p, triad.white) * root_dt * white
        counted, residual = _count(p, x, triad, sensed)
        state[f"{triad.name}_bias_s"] = bias
        state[f"{triad.name}_bias_true"] = _of(x, triad, "bias_true") + _of(x, triad, "bias_step_b")
        state[f"{triad.name}_residual"] = residual
        state[output] = select(arrives, x.C_bs @ counted, 0.0)
    counter = x.drift_counter + 1.0
    return state | {
        "imu_temperature": temperature,
        "drift_counter": counter,
        "drift_due": (counter + 0.5) * dt > p.drift_interval,
    }


def _sensed(p: Values, x: Values, triad: Triad, bias: Any, temperature: Any) -> Any:
    """Increments (3, s) of a triad without noise, from the true increments of the sample, a bias (3, s) and a temperature."""
    true = x.true_delta_angle if triad is GYRO else x.true_delta_velocity
    extra = x.gyro_g_matrix @ x.true_delta_velocity if triad is GYRO else ca.SX.zeros(3)
    thermal = 1.0 + _of(p, triad, "scale_factor_slope") * (temperature - p.imu_temperature_reference)
    return thermal * (_of(x, triad, "error_matrix") @ true) + bias * p.sample_interval + extra


def systematic_error(p: Values, x: Values) -> tuple[Any, Any]:
    """Error of the last delta angle (3, rad, b) and delta velocity (3, m/s, b), without noise and quantization."""
    angle, velocity = (x.C_bs @ _sensed(p, x, triad, _of(x, triad, "bias_s"), x.imu_temperature) for triad in (GYRO, ACCEL))
    return angle - x.true_delta_angle, velocity - x.true_delta_velocity


def _count(p: Values, x: Values, triad: Triad, sensed: Any) -> tuple[Any, Any]:
    """Increments (3, s) limited and rounded to whole counts, and the remainder for the next sample (3, s)."""
    limit = _of(p, triad, "range") * p.sample_interval
    quantum = _of(p, triad, "quantum")
    per_count = 1.0 / (quantum + (quantum == 0.0))
    # subtract the excess beyond either limit, which is exactly 0 in between
    above, below = sensed - limit, sensed + limit
    limited = sensed - ((above > 0.0) * above + (below < 0.0) * below)
    pending = _of(x, triad, "residual") + limited
    counted = quantum * ca.floor(pending * per_count + 0.5) + (quantum == 0.0) * pending
    return counted, pending - counted


def _drift(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
    """Slow errors at the end of the drift interval that begins now, and the linear change per sample towards them.

    Exact discretisation over h = count dt: Gauss-Markov b <- a b + sigma sqrt(1 - a^2) w, a = exp(-h/T)
    (Gelb 1974, chapter 3); random walk b <- b + K sqrt(h) w; flicker noise as Gauss-Markov processes
    (`insenv.sensors.imu_tables`); temperature T <- T_end + r h + (T - T_end) exp(-h/T_w), T_end <- T_end + r h.

    The flicker noise is drawn at the first update, at the end of the first sample, and is in the bias at once.  Scale factor
    and misalignment are Gauss-Markov processes, too, where they have a correlation time; each change is in force at once.
    """
    n = normals(r)
    count = ca.floor(p.drift_interval / p.sample_interval + 0.5)
    count = select(count > 1.0, count, 1.0)
    h = count * p.sample_interval
    warming = exp(-h / p.imu_temperature_time)
    target = x.imu_temperature_target + p.imu_temperature_ramp * h
    temperature = target + (x.imu_temperature - x.imu_temperature_target) * warming
    first = x.drift_counter >= HUGE
    state: dict[str, Any] = {
        "drift_counter": 0.0,
        "imu_temperature_target": target,
        "imu_temperature_step": (temperature - x.imu_temperature) / count,
    }
    flickers, matrices = 12 + 3 * FLICKER_PARTS, 12 + 6 * FLICKER_PARTS
    for triad, drawn, flicker, of_matrix in (
        (GYRO, n[0:6], n[12:flickers], n[matrices : matrices + 9]),
        (ACCEL, n[6:12], n[flickers:matrices], n[matrices + 9 :]),
    ):
        decay = exp(-h / _of(p, triad, "instability_time"))
        drive = _of(p, triad, "instability_sigma") * ca.sqrt((1.0 - decay) * (1.0 + decay))
        instability = decay * _of(x, triad, "instability") + drive * drawn[0:3]
        walk = _of(x, triad, "walk") + _of(p, triad, "rate_random_walk") * ca.sqrt(h) * drawn[3:6]
        thermal = (temperature - p.imu_temperature_reference) * _of(p, triad, "temperature_slope")
        parts = advanced_flicker(_of(x, triad, "flicker_parts"), _of(p, triad, "flicker"), h, flicker, first)
        flickering = ca.sum2(parts)
        bias_s = _of(x, triad, "bias_s") + first * flickering
        bias_true = _of(x, triad, "bias_true") + first * (x.C_bs @ flickering)
        reached = _of(x, triad, "bias_turn_on") + instability + walk + thermal + flickering
        state[f"{triad.name}_instability"] = instability
        state[f"{triad.name}_walk"] = walk
        state[f"{triad.name}_flicker_parts"] = parts
        state[f"{triad.name}_bias_s"] = bias_s
        state[f"{triad.name}_bias_true"] = bias_true
        state[f"{triad.name}_bias_step_s"] = (reached - bias_s) / count
        state[f"{triad.name}_bias_step_b"] = (x.C_bs @ reached - bias_true) / count
        matrix = _drifted_matrix(p, x, triad, h, of_matrix)
        state[f"{triad.name}_drawn_matrix"] = matrix
        change = matrix - _of(x, triad, "drawn_matrix")
        state[f"{triad.name}_error_matrix"] = _of(x, triad, "error_matrix") + change @ x.C_sb_true
    return state


def _drifted_matrix(p: Values, x: Values, triad: Triad, h: Any, normals: Any) -> Any:
    """The drawn parts of scale factor and misalignment (3x3) h seconds later; unchanged without a correlation time."""
    time = _of(p, triad, "scale_factor_time")
    decay = select(time > 0.0, exp(-h / select(time > 0.0, time, 1.0)), 1.0)
    drive = ca.sqrt((1.0 - decay) * (1.0 + decay))
    sigma = _matrix(_of(p, triad, "scale_factor_sigma"), _of(p, triad, "misalignment_sigma"))
    return decay * _of(x, triad, "drawn_matrix") + drive * sigma * _matrix(normals[0:3], normals[3:9])


_DETERMINISTIC = "Error of the {} increment without noise and quantization"
SENSOR_ERROR = Table((
    Row("delta_angle_error", _DETERMINISTIC.format("gyro"), "rad", (3,), "b"),
    Row("delta_velocity_error", _DETERMINISTIC.format("accelerometer"), "m/s", (3,), "b"),
))  # fmt: skip


def _errors_of(triad: Triad) -> tuple[ErrorSource, ...]:
    """The sources of the errors of a triad."""
    name = triad.name
    drifting = ("instability_sigma", "rate_random_walk", "flicker")
    return (
        ErrorSource(f"{name} turn-on bias", (f"{name}_bias", f"{name}_bias_sigma")),
        ErrorSource(f"{name} drifting bias", tuple(f"{name}_{row}" for row in drifting)),
        ErrorSource(f"{name} thermal bias", (f"{name}_temperature_slope",)),
        ErrorSource(f"{name} white noise", (triad.white,)),
        ErrorSource(f"{name} thermal scale factor", (f"{name}_scale_factor_slope",)),
        ErrorSource(f"{name} scale factor", (f"{name}_scale_factor", f"{name}_scale_factor_sigma")),
        ErrorSource(f"{name} misalignment", (f"{name}_misalignment", f"{name}_misalignment_sigma")),
        ErrorSource(f"{name} quantization", (f"{name}_quantum",)),
        ErrorSource(f"{name} range", (f"{name}_range",), off=HUGE),
    )


IMU_ERRORS = (
    *_errors_of(GYRO),
    ErrorSource("gyro g-sensitivity", ("gyro_g_sensitivity",)),
    *_errors_of(ACCEL),
    ErrorSource("mounting error", ("mounting_error", "mounting_error_sigma")),
    ErrorSource("lost samples", ("imu_drop_probability",)),
)

IMU = Sensor(
    "imu",
    lambda instant: imu_part(),
    outputs=("delta_angle", "delta_velocity", "imu_valid", "imu_temperature"),
    derived=SENSOR_ERROR,
    derive=lambda p, x: dict(zip(SENSOR_ERROR.names, systematic_error(p, x), strict=True)),
    truth=("gyro_bias_true", "accel_bias_true"),
    errors=IMU_ERRORS,
)


# The true errors of an inertial unit, as an error model of its increments has them.


def true_unit_errors(state: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, Array]:
    """The errors of a unit in body axes, SI: biases, scale factors and g-sensitivity (3), `COUPLINGS` (6).

    state: that of a plant, by row name.  parameters: its parameters.  With y measured and x true, x = (I - S - M) (y - b dt):
    I - S - M is the inverse of the matrix of `insenv.sensors.imu`.  The g-sensitivity is that of each gyro along its own axis.
    """
    errors: dict[str, Array] = {}
    warm = state["imu_temperature"] - parameters["imu_temperature_reference"]
    for triad in ("gyro", "accel"):
        thermal = 1.0 + np.multiply(parameters[f"{triad}_scale_factor_slope"], warm)
        measured = state["C_bs"] @ np.diag(np.broadcast_to(thermal, 3)) @ state[f"{triad}_error_matrix"]
        left = np.eye(3) - np.linalg.inv(measured)
        errors[f"{triad}_bias"] = np.array(state[f"{triad}_bias_true"])
        errors[f"{triad}_scale"] = np.diag(left).copy()
        errors[f"{triad}_misalignment"] = np.array([left[place] for place in COUPLINGS])
    errors["gyro_g_sensitivity"] = np.diag(state["C_bs"] @ state["gyro_g_matrix"]).copy()
    return errors


# The section [imu] of a scenario: a grade, values that replace its own, and the mounting.


class _ImuSection(SensorSection):
    """The inertial unit: a grade, values that replace those of the grade, and the mounting."""

    sensor: ClassVar[Sensor] = IMU

    grade: GradeValue = key("perfect", "grade of the catalogue (docs/sensors.md), or a grade file (docs/allan.md)")
    lever_arm_m: LeverArm = key(
        (0.0, 0.0, 0.0), "from the vehicle's centre of motion to the unit: forward, right, down", "m", row="imu_lever_arm_b"
    )
    mounting_angles_deg: Rotation = key(
        (0.0, 0.0, 0.0), "known roll, pitch and heading of the unit in the vehicle; its output is in body axes", "deg"
    )
    mounting_error_deg: Rotation = key(
        (0.0, 0.0, 0.0), "rotation from the nominal to the actual sensor axes", "deg", row="mounting_error"
    )
    drop_probability: Number = key(0.0, "probability that a sample is lost", row=IMU_PARAMETERS["imu_drop_probability"])
    temperature_start_degc: Number = key(20.0, "temperature at time 0", "deg C", row="imu_temperature_initial", ge=-100, le=200)
    temperature_end_degc: Number = key(20.0, "temperature after warm-up", "deg C", row="imu_temperature_final", ge=-100, le=200)
    temperature_reference_degc: Number = key(
        20.0, "temperature at which thermal errors are 0", "deg C", row="imu_temperature_reference", ge=-100, le=200
    )
    temperature_ramp_k_h: Number = key(
        0.0, "steady change with the surroundings", "K/h", row="imu_temperature_ramp", ge=-100, le=100
    )
    warm_up_s: Number = key(600.0, "time constant of the warm-up", "s", row="imu_temperature_time", ge=1e-3, le=1e9)

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI).  White noise per sample, if given here, is that of samples at `rate_hz`."""
        grade = grade_of(self.grade)
        stated = {name: getattr(self, name) for name in FIGURES if getattr(self, name) is not None}
        for group in WAYS:
            ways = [name for name in group if name in stated]
            if len(ways) > 1:
                raise InputError(f"imu has {' and '.join(ways)}, which describe the same noise: allowed is one of them")
            if ways:
                stated = dict.fromkeys(group, 0.0) | stated
        for name in WHITE:
            if stated.get(name):
                stated[name] *= float(np.sqrt(grade.white_rate_hz / rate_hz))
        q_bs = attitude.numeric.from_euler(*np.radians(self.mounting_angles_deg))
        return {**replace(grade, **stated).parameters(), **rows_of(self, without=FIGURES), "q_bs": q_bs}


if TYPE_CHECKING:
    ImuSection = _ImuSection
else:
    ImuSection = create_model(
        "ImuSection",
        __base__=_ImuSection,
        __doc__=_ImuSection.__doc__,
        **{name: figure.key(IMU_PARAMETERS, "the grade's") for name, figure in FIGURES.items()},
    )

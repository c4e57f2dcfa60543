"""Magnetometer: the magnetic field in body axes.

At an epoch, with the attitude C_nb:

    y_b = (I + S) C_nb^T (m_n + a_n) + h + drift + noise w,   rounded to the quantum

m_n is the field of the Earth: that of the World Magnetic Model at the start of the run, and its gradient
(`insenv.geodesy.magnetic`). Both are parameters, so that the compiled equations need no package.  a_n is what the model lacks
there: the crust, and the error of the model, constant over a run.  S is the soft-iron matrix, with the scale factors and the
misalignment of the sensor, h the hard iron, a field that turns with the vehicle.  The drift is a field of the vehicle that
changes slowly (currents), a first-order Gauss-Markov process on each axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import casadi as ca
import numpy as np

from insenv.attitude import rotate_inverse
from insenv.base.errors import InputError
from insenv.base.toml import Number, Vector3, key, within
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.geodesy.magnetic import magnetic_field, world_magnetic_model
from insenv.sensors import units
from insenv.sensors.contract import ErrorSource, Place, Sensor
from insenv.sensors.figures import Figure, FiguresSection, Grade, TimedSection, by_name, figures_section
from insenv.sensors.imu import normals
from insenv.sensors.imu_tables import HUGE
from insenv.sensors.instruments import MAGNETOMETER
from insenv.sensors.sampled import QUANTUM_SIGMA, Motion, Sampled, gauss_markov, root_sum, rounded

PARAMETERS = Table((
    MAGNETOMETER.told["magnetic_field_n"],
    MAGNETOMETER.told["magnetic_field_gradient"],
    Row("magnetic_anomaly_n", "Field that the model lacks, fixed part", "T", (3,), "n"),
    Row("magnetic_anomaly_sigma", "Field that the model lacks, 1 sigma of the part drawn at the start", "T", (3,), "n",
        lower=0.0),
    Row("magnetometer_noise", "White noise, standard deviation", "T", lower=0.0),
    Row("magnetometer_hard_iron", "Hard iron, fixed part", "T", (3,), "b"),
    Row("magnetometer_hard_iron_sigma", "Hard iron, 1 sigma of the part drawn at the start", "T", (3,), "b", lower=0.0),
    Row("magnetometer_soft_iron", "Soft iron, fixed part", "1", (3, 3), "b"),
    Row("magnetometer_soft_iron_sigma", "Soft iron, 1 sigma of the part drawn at the start on the diagonal", lower=0.0),
    Row("magnetometer_coupling_sigma", "Soft iron, 1 sigma of the part drawn at the start off the diagonal", lower=0.0),
    Row("magnetometer_drift_sigma", "Slowly changing field of the vehicle (Gauss-Markov), standard deviation", "T", lower=0.0),
    Row("magnetometer_drift_time", "Slowly changing field of the vehicle (Gauss-Markov), correlation time", "s", start=600.0,
        lower=1e-3, upper=HUGE),
    Row("magnetometer_quantum", "Step in which the field is shown, 0 for none", "T", lower=0.0),
))  # fmt: skip

STATE = Table((
    Row("magnetometer_hard_iron_true", "Hard iron and drift together at the latest epoch", "T", (3,), "b"),
    Row("magnetometer_soft_iron_true", "Soft iron", "1", (3, 3), "b"),
    Row("magnetic_anomaly_true", "Field that the model lacks", "T", (3,), "n"),
    Row("magnetometer_turn_on", "Hard iron, fixed and drawn", "T", (3,), "b"),
    Row("magnetometer_drift", "Slowly changing field of the vehicle at the latest epoch", "T", (3,), "b"),
))  # fmt: skip


def _start(p: Values, r: Any) -> dict[str, Any]:
    n = normals(r)
    hard = p.magnetometer_hard_iron + p.magnetometer_hard_iron_sigma * n[0:3]
    drift = p.magnetometer_drift_sigma * n[6:9]
    diagonal, other = p.magnetometer_soft_iron_sigma, p.magnetometer_coupling_sigma
    drawn = ca.vertcat(
        ca.horzcat(diagonal * n[9], other * n[10], other * n[11]),
        ca.horzcat(other * n[12], diagonal * n[13], other * n[14]),
        ca.horzcat(other * n[15], other * n[16], diagonal * n[17]),
    )
    return {
        "magnetometer_turn_on": hard,
        "magnetometer_drift": drift,
        "magnetometer_hard_iron_true": hard + drift,
        "magnetometer_soft_iron_true": p.magnetometer_soft_iron + drawn,
        "magnetic_anomaly_true": p.magnetic_anomaly_n + p.magnetic_anomaly_sigma * n[3:6],
    }


def _measure(p: Values, x: Values, r: Any, motion: Motion) -> dict[str, Any]:
    n = normals(r)
    drift = gauss_markov(
        x.magnetometer_drift, p.magnetometer_drift_sigma, p.magnetometer_drift_time, p.magnetometer_interval, n[0:3]
    )
    hard = x.magnetometer_turn_on + drift
    earth_n = magnetic_field(
        p.magnetic_field_n, p.magnetic_field_gradient, x.latitude, x.longitude, x.height,
        p.start_latitude, p.start_longitude, p.start_height,
    )  # fmt: skip
    field = rotate_inverse(x.q_nb, earth_n + x.magnetic_anomaly_true)
    shown = field + x.magnetometer_soft_iron_true @ field + hard + p.magnetometer_noise * n[3:6]
    return {
        "magnetometer_field_b": rounded(shown, p.magnetometer_quantum),
        "magnetometer_field_true": field,
        "magnetometer_hard_iron_true": hard,
        "magnetometer_drift": drift,
    }


def _told(rows: Mapping[str, Any]) -> dict[str, Any]:
    fixed = np.asarray(rows["magnetometer_soft_iron"])
    anomaly = np.hypot(rows["magnetic_anomaly_n"], rows["magnetic_anomaly_sigma"])
    return {
        "magnetic_field_n": rows["magnetic_field_n"],
        "magnetic_field_gradient": rows["magnetic_field_gradient"],
        "magnetic_field_sigma": anomaly,
        "magnetometer_noise": root_sum(rows["magnetometer_noise"], QUANTUM_SIGMA * rows["magnetometer_quantum"]),
        "magnetometer_hard_iron_sigma": root_sum(rows["magnetometer_hard_iron"], rows["magnetometer_hard_iron_sigma"]),
        "magnetometer_soft_iron_sigma": root_sum(np.diag(fixed), rows["magnetometer_soft_iron_sigma"]),
        "magnetometer_coupling_sigma": root_sum(fixed - np.diag(np.diag(fixed)), rows["magnetometer_coupling_sigma"]),
        "magnetometer_drift_sigma": rows["magnetometer_drift_sigma"],
        "magnetometer_drift_time": rows["magnetometer_drift_time"],
    }


ERRORS = (
    ErrorSource("magnetometer noise", ("magnetometer_noise",)),
    ErrorSource("magnetic anomaly", ("magnetic_anomaly_n", "magnetic_anomaly_sigma")),
    ErrorSource("magnetometer hard iron", ("magnetometer_hard_iron", "magnetometer_hard_iron_sigma")),
    ErrorSource(
        "magnetometer soft iron", ("magnetometer_soft_iron", "magnetometer_soft_iron_sigma", "magnetometer_coupling_sigma")
    ),
    ErrorSource("magnetometer drift", ("magnetometer_drift_sigma",)),
    ErrorSource("magnetometer rounding", ("magnetometer_quantum",)),
)

EQUATIONS = Sampled(
    MAGNETOMETER,
    parameters=PARAMETERS,
    state=STATE,
    exact=Table((Row("magnetometer_field_true", "True field without the vehicle's own at that epoch", "T", (3,), "b"),)),
    measure=_measure,
    uniforms=6,
    truth=("magnetometer_hard_iron_true", "magnetometer_soft_iron_true", "magnetic_anomaly_true"),
    told=_told,
    errors=ERRORS,
    start=_start,
    start_uniforms=18,
)

FIGURES: dict[str, Figure] = {
    "noise_nt": Figure("magnetometer_noise", "nT", units.nt_to_t),
    "hard_iron_nt": Figure("magnetometer_hard_iron", "nT", units.nt_to_t, vector=True),
    "hard_iron_sigma_nt": Figure("magnetometer_hard_iron_sigma", "nT", units.nt_to_t, vector=True),
    "soft_iron_sigma_percent": Figure("magnetometer_soft_iron_sigma", "%", units.percent_to_one),
    "coupling_sigma_percent": Figure("magnetometer_coupling_sigma", "%", units.percent_to_one),
    "drift_sigma_nt": Figure("magnetometer_drift_sigma", "nT", units.nt_to_t),
    "drift_time_s": Figure("magnetometer_drift_time", "s"),
    "anomaly_nt": Figure("magnetic_anomaly_n", "nT", units.nt_to_t, vector=True),
    "anomaly_sigma_nt": Figure("magnetic_anomaly_sigma", "nT", units.nt_to_t, vector=True),
    "quantum_nt": Figure("magnetometer_quantum", "nT", units.nt_to_t),
}

_MODEL = "WMM2025 error model, global averages north, east, down: 137, 89, 141 nT"
_CALIBRATED = "insenv's choice: what a calibration in flight or by turning leaves"
_CURRENTS = "insenv's choice: currents of a small vehicle, a tenth of the hard iron left"


def _grade(name: str, title: str, noise: float, noise_source: str, hard: float, soft: float, coupling: float) -> Grade:
    return Grade(
        name,
        title,
        {"": _CALIBRATED, "noise_nt": noise_source, "anomaly_sigma_nt": _MODEL, "drift_sigma_nt": _CURRENTS,
         "drift_time_s": _CURRENTS},
        {"noise_nt": noise, "hard_iron_sigma_nt": hard, "soft_iron_sigma_percent": soft, "coupling_sigma_percent": coupling,
         "drift_sigma_nt": hard / 10.0, "drift_time_s": 600.0, "anomaly_sigma_nt": (137.0, 89.0, 141.0)},
    )  # fmt: skip


GRADES = by_name(
    Grade("perfect", "No errors"),
    _grade("rm3100", "RM3100, magneto-inductive, calibrated on the vehicle", 15.0, "PNI RM3100 data sheet: noise 15 nT", 150.0,
           0.3, 0.2),
    _grade("autopilot", "MEMS magnetometer of autopilots (IST8310, BMM150 class), calibrated on the vehicle", 300.0,
           "Bosch BMM150 data sheet: 0.3 uT; IST8310: 0.3 uT a count", 500.0, 1.0, 0.5),
    Grade(
        "uncalibrated",
        "MEMS magnetometer of autopilots, without calibration on the vehicle",
        {"": "insenv's choice: a field of the vehicle of a fifth of the Earth's, 5 % of soft iron",
         "noise_nt": "Bosch BMM150 data sheet: 0.3 uT", "anomaly_sigma_nt": _MODEL},
        {"noise_nt": 300.0, "hard_iron_sigma_nt": 10000.0, "soft_iron_sigma_percent": 5.0, "coupling_sigma_percent": 2.0,
         "drift_sigma_nt": 500.0, "drift_time_s": 600.0, "anomaly_sigma_nt": (137.0, 89.0, 141.0)},
    ),
)  # fmt: skip

if TYPE_CHECKING:
    MagnetometerFigures = FiguresSection
else:
    MagnetometerFigures = figures_section("MagnetometerFigures", PARAMETERS, GRADES, FIGURES, "autopilot")


class MagnetometerSection(MagnetometerFigures, TimedSection):
    """The magnetometer."""

    sensor: ClassVar[Sensor] = EQUATIONS.sensor()

    interval_s: Number = key(0.05, "interval between measurements, a whole number of samples", "s", gt=0, le=3600)
    year: Number = key(2026.0, "decimal year at which the World Magnetic Model is evaluated", "year")
    field_nt: Annotated[Vector3, within(-1e5, 1e5)] | None = key(
        None, "field of the Earth north, east, down, the same everywhere; that of the World Magnetic Model if absent", "nT"
    )

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`, without the field.  Raises `InputError` for wrong times."""
        return {**self.timing(rate_hz), **self.error_rows()}

    def rows_at(self, rate_hz: float, place: Place) -> dict[str, Any]:
        """Parameter rows (SI) with the field at `place`.  Raises `InputError` for a year that the model does not cover."""
        return {**self.rows(rate_hz), **field_rows(self.year, self.field_nt, place)}


def field_rows(year: float, field_nt: Any, place: Place) -> dict[str, Any]:
    """The rows of the Earth's field: `field_nt` (3, nT) everywhere or, if None, the World Magnetic Model at a place.

    Raises `InputError` that names the key.
    """
    if field_nt is not None:
        return {"magnetic_field_n": units.nt_to_t(np.asarray(field_nt)), "magnetic_field_gradient": np.zeros((3, 3))}
    try:
        field, gradient = world_magnetic_model(place.latitude, place.longitude, place.height, year)
    except InputError as error:
        raise InputError(f"magnetometer.{error}") from None
    return {"magnetic_field_n": field, "magnetic_field_gradient": gradient}

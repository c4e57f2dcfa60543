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

from typing import Annotated, Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.toml import Number, Vector3, within
from insenv.core.model import Values
from insenv.core.tables import Row
from insenv.geodesy.magnetic import world_magnetic_model, world_magnetic_years
from insenv.sensors import units
from insenv.sensors.contract import Place
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.instrument import Column, Estimated, Instrument, Setting, Term, constant, drift, sigma_row, white

FIELD = Row("magnetic_field_n", "Field of the Earth at the reported start", "T", (3,), "n", lower=-1e-3, upper=1e-3)
GRADIENT = Row(
    "magnetic_field_gradient", "Its change per metre north, east, down (columns), components in the local n", "T/m", (3, 3),
    "n", lower=-1e-6, upper=1e-6,
)  # fmt: skip
TERMS = (
    white("magnetometer_noise", "magnetometer noise", "White noise of each axis", "T", (3,), "b", normals=(3,)),
    constant(
        "magnetometer_hard_iron", "hard_iron", "magnetometer hard iron", "Hard iron: constant field of the vehicle", "T", (3,),
        "b", value="magnetometer_turn_on",
        states=(Estimated("hard_iron", "hard iron: constant magnetic field of the vehicle"),), normals=(0,),
    ),
    drift(
        "magnetometer_drift", "drift", "magnetometer drift", "Slowly changing field of the vehicle", "T", (3,), "b",
        states=(Estimated("magnetometer_drift", "slowly varying magnetic field of the vehicle"),), normals=(6, 0),
    ),
    Term(
        "soft_iron", "magnetometer soft iron", "constant", (3, 3), "1", "b",
        fixed=Row("magnetometer_soft_iron", "Soft iron, fixed part", "1", (3, 3), "b"),
        sigma=Row("magnetometer_soft_iron_sigma", "Soft iron, 1 sigma of the part drawn at the start on the diagonal",
                  lower=0.0),
        coupling=Row("magnetometer_coupling_sigma", "Soft iron, 1 sigma of the part drawn at the start off the diagonal",
                     lower=0.0),
        value=Row("magnetometer_soft_iron_true", "Soft iron", "1", (3, 3), "b"),
        stated=(
            sigma_row("magnetometer_soft_iron_sigma", "Diagonal of the soft-iron matrix, scale factors included"),
            sigma_row("magnetometer_coupling_sigma", "Other elements of the soft-iron matrix, misalignment included"),
        ),
        states=(
            Estimated("soft_iron", "soft iron: diagonal of the matrix"),
            Estimated("soft_iron_coupling", "soft iron: other elements of the matrix, xy, xz, yx, yz, zx, zy"),
        ),
        normals=(9,),
    ),
    constant(
        "magnetic_anomaly_n", "anomaly", "magnetic anomaly", "Field that the model of the Earth lacks: model and crust", "T",
        (3,), "n", value="magnetic_anomaly_true", sigma="magnetic_anomaly_sigma", stated="magnetic_field_sigma",
        stated_shape=(3,),
        states=(Estimated("magnetic_field_error", "error of the model of the Earth's magnetic field"),), normals=(3,),
    ),
)  # fmt: skip


def _field_b(motion: Any, e: Values, p: Values) -> Any:
    """The field without that of the vehicle (3, T, b)."""
    return motion.to_body(p.magnetic_field_n + p.magnetic_field_gradient @ motion.displacement_n + e.anomaly)


def _measure(motion: Any, e: Values, p: Values) -> dict[str, Any]:
    field_b = _field_b(motion, e, p)
    return {"magnetometer_field_b": field_b + e.soft_iron @ field_b + (e.hard_iron + e.drift) + e.noise}


FIGURES: dict[str, Figure] = {
    "noise_nt": Figure("magnetometer_noise", "nT"),
    "hard_iron_nt": Figure("magnetometer_hard_iron", "nT", vector=True),
    "hard_iron_sigma_nt": Figure("magnetometer_hard_iron_sigma", "nT", vector=True),
    "soft_iron_sigma_percent": Figure("magnetometer_soft_iron_sigma", "%"),
    "coupling_sigma_percent": Figure("magnetometer_coupling_sigma", "%"),
    "drift_sigma_nt": Figure("magnetometer_drift_sigma", "nT"),
    "drift_time_s": Figure("magnetometer_drift_time", "s"),
    "anomaly_nt": Figure("magnetic_anomaly_n", "nT", vector=True),
    "anomaly_sigma_nt": Figure("magnetic_anomaly_sigma", "nT", vector=True),
    "quantum_nt": Figure("magnetometer_quantum", "nT"),
}

_MODEL = "WMM2025 error model, global averages north, east, down: 137, 89, 141 nT"
_CALIBRATED = "insenv's choice: what a calibration in flight or by turning leaves"
_CURRENTS = "insenv's choice: currents of a small vehicle, a tenth of the hard iron left"


def _grade(name: str, title: str, noise: float, noise_source: str, hard: float, soft: float, coupling: float) -> Grade:
    return Grade.of(
        name, title, _CALIBRATED, noise_nt=(noise, noise_source), hard_iron_sigma_nt=hard, soft_iron_sigma_percent=soft,
        coupling_sigma_percent=coupling, drift_sigma_nt=(hard / 10.0, _CURRENTS), drift_time_s=(600.0, _CURRENTS),
        anomaly_sigma_nt=((137.0, 89.0, 141.0), _MODEL),
    )  # fmt: skip


GRADES = by_name(
    Grade("perfect", "No errors"),
    _grade("rm3100", "RM3100, magneto-inductive, calibrated on the vehicle", 15.0, "PNI RM3100 data sheet: noise 15 nT", 150.0,
           0.3, 0.2),
    _grade("autopilot", "MEMS magnetometer of autopilots (IST8310, BMM150 class), calibrated on the vehicle", 300.0,
           "Bosch BMM150 data sheet: 0.3 uT; IST8310: 0.3 uT a count", 500.0, 1.0, 0.5),
    Grade.of(
        "uncalibrated", "MEMS magnetometer of autopilots, without calibration on the vehicle",
        "insenv's choice: a field of the vehicle of a fifth of the Earth's, 5 % of soft iron, mounted within 3 deg",
        noise_nt=(300.0, "Bosch BMM150 data sheet: 0.3 uT"), hard_iron_sigma_nt=10000.0, soft_iron_sigma_percent=5.0,
        coupling_sigma_percent=5.0, drift_sigma_nt=500.0, drift_time_s=600.0, anomaly_sigma_nt=((137.0, 89.0, 141.0), _MODEL),
    ),
)  # fmt: skip


def _surroundings(section: Any, place: Place | None) -> dict[str, Any]:
    """The rows of the Earth's field: that of the section everywhere or, if it has none, the World Magnetic Model at a place.

    Its year is that of the section or, if that states none, of the place, as far as there are coefficients for it.

    Raises `InputError` that names the key.
    """
    year, field_nt = getattr(section, "year", 2026.0), getattr(section, "field_nt", None)
    if place is not None and place.year is not None and "year" not in getattr(section, "model_fields_set", ()):
        first, last = world_magnetic_years()
        year = min(max(place.year, first), last)
    if field_nt is not None:
        return {FIELD.name: units.nt_to_t(np.asarray(field_nt)), GRADIENT.name: np.zeros((3, 3))}
    if place is None:
        raise InputError("magnetometer: the field of the Earth needs a place: [gnss], [initial] latitude_deg, or field_nt")
    try:
        field, gradient = world_magnetic_model(place.latitude, place.longitude, place.height, year)
    except InputError as error:
        raise InputError(f"magnetometer.{error}") from None
    return {FIELD.name: field, GRADIENT.name: gradient}


MAGNETOMETER = Instrument(
    "magnetometer",
    title="Magnetometer",
    called="the magnetometer",
    what="field in body axes",
    causes="iron and currents near it (hard and soft iron sigmas), the date of the field model, and its axes",
    values=(Row("magnetometer_field_b", "Magnetic flux density", "T", (3,), "b", lower=-1.0, upper=1.0),),
    terms=TERMS,
    measure=_measure,
    holds=("heading",),
    parameters=(FIELD, GRADIENT),
    stated=(FIELD, GRADIENT),
    exact=lambda motion, e, p: {"magnetometer_field_true": _field_b(motion, e, p)},
    exact_rows=(Row("magnetometer_field_true", "True field without the vehicle's own at that epoch", "T", (3,), "b"),),
    totals=(
        (Row("magnetometer_hard_iron_true", "Hard iron and drift together at the latest epoch", "T", (3,), "b"),
         lambda e, p: e.hard_iron + e.drift),
    ),
    quantum=Row("magnetometer_quantum", "Step in which the field is shown, 0 for none", "T", lower=0.0),
    aid_parameters=("magnetic_field_n", "magnetic_field_gradient", "magnetometer_noise"),
    least_sigma={"magnetometer_field_b": 1e-8},  # what an iterated filter leaves of an attitude that was degrees off
    shows_heading=True,
    columns=(
        Column("field", "magnetometer_field_b", "field's x, y, z", {"T": 1.0, "uT": 1e-6, "nT": 1e-9, "G": 1e-4, "mG": 1e-7},
               axes=True),
    ),
    settings=(
        Setting("year", Number, 2026.0, "decimal year at which the World Magnetic Model is evaluated", "year"),
        Setting("field_nt", Annotated[Vector3, within(-1e5, 1e5)] | None, None,
                "field of the Earth north, east, down, the same everywhere; that of the World Magnetic Model if absent", "nT"),
    ),
    surroundings=_surroundings,
    figures=FIGURES,
    grades=GRADES,
    grade="autopilot",
    interval_s=0.05,
)  # fmt: skip

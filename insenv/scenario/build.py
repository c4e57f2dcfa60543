"""Build a scenario: the plant's model and parameters, and the initial knowledge of the estimators."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache, partial
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from insenv import attitude, geodesy
from insenv.base.errors import InputError, naming
from insenv.base.keys import rows_of
from insenv.core import noise
from insenv.core.model import Model
from insenv.core.tables import Table, Vector, check_rows
from insenv.estimators import Knowledge
from insenv.scenario.description import MAX_SEED, KnowledgeSection, Scenario
from insenv.scenario.inputs import DRIVEN, commanded
from insenv.scenario.plant import Plant, plant_model
from insenv.scenario.poles import check_course
from insenv.sensors import IMU, Sensor
from insenv.sensors.contract import Place
from insenv.sensors.data_sheet import imu_data_sheet, motion_errors
from insenv.sensors.registry import stated_rows
from insenv.vehicles import Vehicle
from insenv.vehicles.section import MAX_DURATION_S, check_section
from insenv.vehicles.ship import ANGLES

KNOWLEDGE_STREAM = 0xFFFFFFFE
"""Random stream of the initial errors: one uniform each for roll, pitch, heading, position and velocity (north, east,
down), at step 0 of the run's seed.  The plant has other streams, so these draws change nothing else."""

_NORMAL = NormalDist()

SMALLEST_AMPLITUDE = 1e-30
"""Smaller amplitudes (rad, m) are set to 0."""


def build(scenario: Scenario, seed: int | None = None, duration_s: float | None = None, *, driven: bool = False) -> Plant:
    """The plant of a scenario; `seed` and `duration_s` (None: the scenario's) are checked.

    driven: whether the caller feeds `Plant.inputs`.  Raises `InputError`, also for commands that the caller would not feed.
    """
    seed, duration = seed_and_duration(scenario, seed, duration_s)
    if scenario.commands and not driven:
        raise InputError(f"scenario {scenario.name!r} {DRIVEN}")
    model, parameters = plant_of(scenario)
    return _plant(scenario, model, parameters, model.parameters.pack({**parameters, "seed": seed}), seed, duration)


def reseeded(plant: Plant, seeds: Iterable[int]) -> list[Plant]:
    """The plants that `build` gives for the same scenario and duration with other seeds, in less time."""
    vector, place = plant.model.parameters.pack(plant.parameters), plant.model.parameters.slice("seed").start
    plants = []
    for number in seeds:
        vector[place] = seed = seed_and_duration(plant.scenario, number, plant.duration_s)[0]
        plants.append(_plant(plant.scenario, plant.model, plant.parameters, vector, seed, plant.duration_s))
    return plants


def _plant(scenario: Scenario, model: Model, rows: Mapping[str, Any], vector: Vector, seed: int, duration: float) -> Plant:
    """The plant with the parameters `rows` and the seed; `vector` is both packed."""
    parameters = {**rows, "seed": float(seed)}
    stated = stated_errors(scenario, model.parameters.unpack(vector.copy()))
    plant = Plant(
        scenario=scenario,
        model=model,
        parameters=parameters,
        sample_interval=1.0 / scenario.rate_hz,
        samples=round(duration * scenario.rate_hz),
        duration_s=duration,
        seed=seed,
        knowledge=_knowledge(scenario, _true_start(model, vector, seed), parameters, stated, seed),
        commands=commanded(model, scenario.commands, scenario.rate_hz),
    )
    check_course(plant)
    return plant


def plant_of(scenario: Scenario) -> tuple[Model, dict[str, Any]]:
    """The plant's model and its parameter rows (SI) except the seed.  Raises `InputError` for values that conflict."""
    interval, start = 1.0 / scenario.rate_hz, scenario.start
    this = f"vehicle kind {scenario.vehicle.kind!r}"
    with naming(f"{this}, vehicle", prefixed=False):
        vehicle = scenario.vehicle.vehicle()
    with naming(this):
        check_section(scenario.vehicle, vehicle)
    model = model_of(vehicle, (IMU, *(section.sensor for section in scenario.sensors.values())))
    rows = {
        "sample_interval": interval,
        **rows_of(start),
        **_checked(this, partial(scenario.vehicle.rows, start), model.parameters),
        **scenario.imu.rows(scenario.rate_hz),
        **scenario.gravity.rows(start),
    }
    place = Place(rows["start_latitude"], rows["start_longitude"], rows["start_height"])
    for id in scenario.sensors:
        try:
            rows |= sensor_rows(scenario, id, place, model.parameters)
        except InputError as error:
            raise InputError(f"{error}{_fitting_rate(scenario, rows)}") from None
    for row in vehicle.parameters:
        if row.name not in rows and not row.flat_start().any():
            raise InputError(
                f"{this}, rows: {row.name!r} is missing: allowed is a value for every parameter row whose start value is 0"
            )
    for name in rows:
        if name.endswith("_amplitude"):  # the square of an amplitude other than 0 is a divisor and must not underflow
            rows[name] = np.where(np.abs(rows[name]) < SMALLEST_AMPLITUDE, 0.0, rows[name])
    check_speed_of_sinusoids(rows, interval)
    scenario.vehicle.check_interval(interval)
    model.parameters.pack(rows)
    commanded(model, scenario.commands, scenario.rate_hz)
    return model, rows


def sensor_rows(scenario: Scenario, id: str, place: Place, table: Table) -> Mapping[str, Any]:
    """The parameter rows (SI) that the section of a sensor other than the inertial unit sets, in a table that has them.

    place: where the vehicle starts.  Raises `InputError` for values that conflict.
    """
    return _checked(f"sensor {id!r}", partial(scenario.sensors[id].rows_at, scenario.rate_hz, place), table)


SEARCHED_HZ = 1000


def _fitting_rate(scenario: Scenario, rows: Mapping[str, Any]) -> str:
    """What a message adds: the nearest rate, in whole Hz, that the times of all sensors and the vehicle's vibrations fit; empty
    if the rate is not what is wrong, or none is near.
    """

    def fits(rate: float) -> bool:
        try:
            check_speed_of_sinusoids(rows, 1.0 / rate)
            scenario.vehicle.check_interval(1.0 / rate)
            for section in scenario.sensors.values():
                section.rows(rate)
        except InputError:
            return False
        return True

    if fits(scenario.rate_hz):
        return ""
    asked = round(scenario.rate_hz)
    for apart in range(1, SEARCHED_HZ):
        for rate in (asked + apart, asked - apart):
            if rate >= 1 and fits(rate):
                return f"; the nearest rate_hz that the times of all sensors and the vibrations fit is {rate}"
    return ""


def _checked(where: str, rows: Callable[[], Any], table: Table) -> Mapping[str, Any]:
    """What `rows` of a section gives.  Raises `InputError` if it fails or gives no mapping of rows of the table."""
    with naming(f"{where}, rows", prefixed=False):
        result = rows()
    with naming(f"{where}, rows"):
        return check_rows(result, table)


@lru_cache(maxsize=64)
def model_of(vehicle: Vehicle, sensors: tuple[Sensor, ...]) -> Model:
    """The plant of a vehicle with these sensors, built once; their order decides which random streams they draw from."""
    return plant_model(vehicle, sensors)


def seed_and_duration(scenario: Scenario, seed: int | None, duration_s: float | None) -> tuple[int, float]:
    """Checked seed and duration (s) of a run."""
    seed = scenario.seed if seed is None else seed
    duration = scenario.duration_s if duration_s is None else duration_s
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed <= MAX_SEED:
        raise InputError(f"seed = {seed!r}: allowed is a whole number from 0 to 2^53")
    if isinstance(duration, bool) or not isinstance(duration, (int, float, np.number)):
        raise InputError(f"duration_s = {duration!r}: allowed is a number of seconds")
    if not 0.0 < duration <= MAX_DURATION_S or round(duration * scenario.rate_hz) < 1:
        least = 1.0 / scenario.rate_hz
        raise InputError(f"duration_s = {duration:g} s: allowed is from one sample, {least:g} s, to {MAX_DURATION_S:g} s")
    lasts = scenario.vehicle.lasts_s
    if lasts is not None and duration > lasts + 1e-6:
        raise InputError(f"duration_s = {duration:g} s: allowed is up to {lasts:.6g} s, the duration of the track")
    return int(seed), float(duration)


def check_speed_of_sinusoids(rows: Mapping[str, Any], interval: float) -> None:
    """Raise `InputError` for sinusoids with less than two samples per period, or with large rotations per sample.

    rows: parameter rows by name.  interval: between samples, s.
    """
    turned = 0.0  # upper bound of the rotation in half a sample, rad
    for name, value in rows.items():
        prefix = name.removesuffix("_angular_frequency")
        if prefix == name:
            continue
        omega = np.asarray(value)
        if np.any(omega * interval > np.pi):
            raise InputError(
                f"vehicle: a sinusoid of {np.max(omega) / (2 * np.pi):g} Hz in {prefix}: allowed is up to half of rate_hz, "
                f"{0.5 / interval:g} Hz"
            )
        angles = (prefix,) if prefix in ANGLES else tuple(f"{prefix}_{angle}" for angle in ANGLES)
        for angle in angles:
            turned += float(np.sum(np.asarray(rows.get(f"{angle}_amplitude", 0.0)) * omega)) * interval / 2.0
    if turned > 0.25:
        raise InputError(f"vehicle: rotation of {2 * turned:.2g} rad in a sample: allowed is 0.5 rad; use a higher rate_hz")


def _true_start(model: Model, vector: Vector, seed: int) -> dict[str, Any]:
    """State rows at time 0."""
    drawn = noise.uniforms(seed, 0, noise.START_STREAM, model.start_uniforms)
    return model.state.unpack(np.asarray(model.kernels["start"].function(vector, drawn)).ravel())


def _knowledge(
    scenario: Scenario, true: Mapping[str, Any], parameters: Mapping[str, Any], stated: Mapping[str, Any], seed: int
) -> Knowledge:
    known, sheet = scenario.knowledge, imu_data_sheet(parameters, scenario.vehicle.in_place)
    error = start_errors(known, seed)
    roll, pitch, heading = reported_attitude(np.array(attitude.numeric.to_euler(true["q_nb"])), error[0:3])
    latitude, longitude, height = geodesy.numeric.geodetic_from_ned_offset(
        error[3:6], true["latitude"], true["longitude"], true["height"]
    )
    return Knowledge(
        latitude=float(latitude),
        longitude=float(longitude),
        height=float(height),
        sample_interval=1.0 / scenario.rate_hz,
        velocity_n=true["velocity_n"] + error[6:9],
        roll=float(roll),
        pitch=float(pitch),
        heading=float(heading),
        **known.sigmas,
        **motion_errors(vars(sheet)),
        sensors=sheet,
        instruments=stated,
    )


def stated_errors(scenario: Scenario, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Stated errors of a scenario's sensors with these parameter rows (SI), by row of `stated_rows`."""
    rows: dict[str, Any] = {}
    for id, section in scenario.sensors.items():
        if section.sensor.stated_errors is not None:
            with naming(f"sensor {id!r}, stated errors"):
                rows |= check_rows(section.sensor.stated_errors(parameters), stated_rows())
    return {name: np.array(value, dtype=float) if np.ndim(value) else float(value) for name, value in rows.items()}


def reported_attitude(true: Vector, error: Vector) -> Vector:
    """Reported roll, pitch and heading (..., 3), rad; angles beyond a full turn, which no estimator takes, are wrapped."""
    angles = true + error
    return np.where(np.abs(angles) > 2.0 * np.pi, np.arctan2(np.sin(angles), np.cos(angles)), angles)


def start_errors(known: KnowledgeSection, seed: ArrayLike) -> Vector:
    """Initial errors (..., 9) for seeds (...), reported minus true: roll, pitch, heading (rad); position (m), velocity (m/s)
    in n.
    """
    errors = start_sigmas(known) * start_normals(known, seed)
    for place, error in enumerate(stated_start_errors(known)):
        if error is not None:
            errors[..., place] = error
    return errors


def start_normals(known: KnowledgeSection, seed: ArrayLike) -> Vector:
    """The standard normals (..., 9) behind `start_errors`; 0 if errors are not drawn."""
    uniforms = noise.uniforms(seed, 0, KNOWLEDGE_STREAM, 9)
    drawn = list(map(_NORMAL.inv_cdf, uniforms.ravel().tolist()))
    return np.reshape(drawn, uniforms.shape) * known.draw_errors


@lru_cache(maxsize=64)
def start_sigmas(known: KnowledgeSection) -> Vector:
    """Reported standard deviations (9,) of the errors, in the order and units of `start_errors`."""
    sigma = known.sigmas
    tilts = [sigma["tilt_sigma"]] * 2
    return np.array([*tilts, sigma["heading_sigma"], *sigma["position_sigma"], *sigma["velocity_sigma"]])


@lru_cache(maxsize=64)
def stated_start_errors(known: KnowledgeSection) -> tuple[float | None, ...]:
    """The errors that the scenario states (9), in the order and units of `start_errors`; None for one that is drawn."""
    errors, none = rows_of(known), (None,) * 3
    angles = [errors.get(f"{angle}_error") for angle in ("roll", "pitch", "heading")]
    return (*angles, *errors.get("position_error", none), *errors.get("velocity_error", none))

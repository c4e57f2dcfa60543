"""The TOML file of a scenario: its sections, keys, units and limits (pydantic)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from math import radians, sin
from typing import Annotated, Any, Literal, Union

import numpy as np
from pydantic import Field, PrivateAttr, Strict, ValidationError, create_model, model_validator

from insenv.base.keys import rows_of
from insenv.base.remarks import Remark, coded, declared
from insenv.base.toml import Number, Parameter, Section, Sigmas, Vector3, key, summary, within
from insenv.estimators import Drive, Estimator, get
from insenv.estimators.settings import choices_in, tuning
from insenv.geodesy import numeric
from insenv.sensors import GnssSection, ImuSection, SensorSection, units
from insenv.sensors import registry as sensor_registry
from insenv.sensors.grades import FIGURES
from insenv.vehicles import StartSection, VehicleSection
from insenv.vehicles import registry as vehicle_registry
from insenv.vehicles.section import MAX_DURATION_S

# The section [gravity] of a scenario: the difference between true gravity and the normal gravity of the estimators.


class GravitySection(Section):
    """True gravity minus normal gravity, constant along the trajectory; no estimator knows it."""

    deflection_north_arcsec: Number = key(
        0.0,
        "deflection of the vertical: true zenith north of that of normal gravity",
        "arcsec",
        ge=-300,
        le=300,
    )
    deflection_east_arcsec: Number = key(0.0, "deflection of the vertical: the same to the east", "arcsec", ge=-300, le=300)
    disturbance_mgal: Number = key(0.0, "gravity disturbance: true minus normal gravity, downward", "mGal", ge=-1000, le=1000)

    def rows(self, start: StartSection) -> dict[str, Any]:
        """The row `gravity_disturbance_n` of the truth (m/s^2, NED): (-g xi, -g eta, dg) for deflections xi, eta.

        Heiskanen and Moritz 1967, section 2-19; g is normal gravity at the start.
        """
        g = float(numeric.normal_gravity(sin(radians(start.latitude_deg)), start.height_m))
        north, east = (-g * units.arcsec_to_rad(each) for each in (self.deflection_north_arcsec, self.deflection_east_arcsec))
        return {"gravity_disturbance_n": np.array([north, east, units.mgal_to_m_s2(self.disturbance_mgal)])}


class CaptionSection(Section):
    """A sentence that a page shows while it runs."""

    after: Literal["start", "cut", "return"] = key(
        "start", "what its time counts from: the start, or each time GNSS is cut, or returns (shown until that changes)"
    )
    at_s: Number = key(0.0, "time from there on", "s", ge=0, le=MAX_DURATION_S)
    text: str = key(..., "the sentence", min_length=1, max_length=160)


MAX_CAPTIONS = 12
MAX_SEED = 2**53


class KnowledgeSection(Section):
    """Initial conditions as known to the estimators: the truth plus the errors given here or drawn from the sigmas."""

    draw_errors: bool = key(True, "draw from the seed the errors that are not given; false: they are 0", strict=True)
    roll_error_deg: Number | None = key(None, "roll error: reported minus true", "deg", row="roll_error", ge=-360, le=360)
    pitch_error_deg: Number | None = key(None, "pitch error: reported minus true", "deg", row="pitch_error", ge=-360, le=360)
    heading_error_deg: Number | None = key(
        None, "heading error: reported minus true", "deg", row="heading_error", ge=-360, le=360
    )
    position_error_m: Annotated[Vector3, within(-1e5, 1e5)] | None = key(
        None, "position error: reported minus true, north, east, down", "m", row="position_error"
    )
    velocity_error_mps: Annotated[Vector3, within(-1e3, 1e3)] | None = key(
        None, "velocity error: reported minus true, north, east, down", "m/s", row="velocity_error"
    )
    tilt_sigma_deg: Number = key(0.5, "reported standard deviation of roll and pitch", "deg", row="tilt_sigma", gt=0, le=180)
    heading_sigma_deg: Number = key(2.0, "reported standard deviation of the heading", "deg", row="heading_sigma", gt=0, le=360)
    position_sigma_m: Sigmas = key(
        (1.0, 1.0, 1.0), "reported standard deviation of the position, north, east, down", "m", row="position_sigma"
    )
    velocity_sigma_mps: Sigmas = key(
        (0.1, 0.1, 0.1), "reported standard deviation of the velocity, north, east, down", "m/s", row="velocity_sigma"
    )

    @property
    def sigmas(self) -> dict[str, Any]:
        """The reported standard deviations (SI) by field of `insenv.Knowledge`."""
        return {row: value for row, value in rows_of(self).items() if row.endswith("_sigma")}


_PERFECT = declared("unit-perfect", "the inertial unit is perfect, because [imu] is missing or states no errors")


class Scenario(Section):
    """A scenario file: a vehicle, its sensors and the initial conditions.

    `insenv.load` makes one from a name, a file or a dict of values.  `scenario_class` adds the registered kinds of
    vehicle and sensors.
    """

    title: str = key(..., "one line for lists, tables and figures", min_length=1, max_length=120)
    description: str = key("", "its purpose and the sources of its numbers")
    duration_s: Number = key(..., "duration", "s", gt=0, le=MAX_DURATION_S)
    rate_hz: Number = key(200.0, "inertial samples per second", "Hz", ge=1, le=1e4)
    seed: Annotated[int, Strict()] = key(0, "seed of all random numbers", "", ge=0, le=MAX_SEED)
    estimators: tuple[str, ...] = key((), "ids of the estimators that run by default")
    start: StartSection = key(..., "initial position and attitude")
    vehicle: VehicleSection = key(..., "the vehicle")
    imu: ImuSection = key(ImuSection(), "the inertial unit; a perfect one if absent")
    gnss: GnssSection | None = key(None, "the GNSS receiver; none if absent")
    gravity: GravitySection = key(GravitySection(), "true gravity minus normal gravity; none if absent")
    knowledge: KnowledgeSection = key(KnowledgeSection(), "initial conditions as known to the estimators")
    commands: tuple[dict[str, Number], ...] = key(
        (), "commands by time that replace the vehicle's legs, as a page that is driven writes them: at_s, and values in SI"
    )
    estimator: dict[str, dict[str, Parameter]] = key(
        {}, 'parameters by estimator id, e.g. [estimator."loosely-coupled"] arw_deg_sqrt_h = 0.3; see below'
    )
    story: tuple[CaptionSection, ...] = key((), "sentences that a page shows while it runs", max_length=MAX_CAPTIONS)
    _name: str = PrivateAttr("")
    _changes: tuple[Remark, ...] = PrivateAttr(())

    @property
    def name(self) -> str:
        """Name of the file without ``.toml``; empty if the scenario is not from a file."""
        return self._name

    @property
    def notes(self) -> tuple[Remark, ...]:
        """Sentences on what the scenario leaves open, for a reader of its results."""
        said = (*self._changes, *coded(self.vehicle.notes, "vehicle"))
        for id, section in self.sensors.items():
            said += coded(section.notes(self.rate_hz), id)
        perfect = self.imu.grade == "perfect" and all(getattr(self.imu, name) is None for name in FIGURES)
        return (*said, _PERFECT) if perfect else said

    def stated(self) -> dict[str, Any]:
        """The values as in a TOML file, less the start and the duration of a vehicle whose motion has its own."""
        values, place = self.model_dump(mode="json", warnings=False), self.vehicle.start_values()
        if place is not None:
            values["start"] = {name: value for name, value in values["start"].items() if name not in place}
        if place is not None and self.duration_s == self.vehicle.lasts_s:
            del values["duration_s"]
        return values

    @property
    def sensors(self) -> dict[str, SensorSection]:
        """Sections of the sensors other than the inertial unit, by id, in the order of registration."""
        sections = {id: getattr(self, id, None) for id in sensor_registry.registered()}
        return {id: section for id, section in sections.items() if section is not None}

    @property
    def tunings(self) -> dict[str, dict[str, Any]]:
        """Parameter rows (SI) by estimator id."""
        return {id: tuning(id, table) for id, table in self.estimator.items()}

    def choices_of(self, estimator: str | Estimator) -> dict[str, tuple[str, ...]]:
        """The lists of names in an estimator's section, by key."""
        chosen = get(estimator)
        tables = [self.estimator.get(id, {}) for id in (chosen.smooths, chosen.id)]
        return {key: names for table in tables for key, names in choices_in(chosen, table).items()}

    def drive(self, offline: bool = True) -> Drive:
        """The conditions that estimators check.  offline: whether a smoother can run backward over the whole run."""
        where = f"scenario {self.name!r}" if self.name else "the scenario"
        measured = self.gnss is None or self.gnss.velocity
        ages = {id: section.max_age_s for id, section in self.sensors.items()}
        return Drive(
            where, frozenset(ages), self.vehicle.in_place, offline, self.vehicle.kind, fix_velocity=measured, ages=ages
        )

    @model_validator(mode="before")
    @classmethod
    def _loaded(cls, data: Any) -> Any:
        if isinstance(data, Mapping):
            for id in set(data) - set(cls.model_fields):
                sensor_registry.check_loaded(id)
            vehicle = data.get("vehicle")
            vehicle_registry.check_loaded(str(vehicle.get("kind")) if isinstance(vehicle, Mapping) else "")
            return _with_its_place(data)
        return data

    @model_validator(mode="after")
    def _a_sample(self) -> Scenario:
        if (lasts := self.vehicle.lasts_s) is not None and self.duration_s > lasts + 1e-6:
            raise ValueError(f"duration_s = {self.duration_s:g} s: the track lasts {lasts:.6g} s")
        if round(self.duration_s * self.rate_hz) < 1:
            raise ValueError(f"duration_s = {self.duration_s:g} s is shorter than one sample of {1 / self.rate_hz:g} s")
        return self

    def __reduce__(self) -> tuple[Callable[..., Scenario], tuple[Any, ...]]:
        """Pickle the values: unpickling makes the class again, from what is registered there."""
        return _restored, (self.model_dump(mode="json"), self.name)


def _with_its_place(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """The values with [start] and the duration of a vehicle whose motion has its own, where they are not stated."""
    values = data.get("vehicle")
    if isinstance(values, VehicleSection):
        section: VehicleSection | None = values
    elif not isinstance(values, Mapping):
        return data
    else:
        known = vehicle_registry.registered().get(str(values.get("kind")))
        if known is not None and known.start_values is VehicleSection.start_values:
            return data
        try:
            section = None if known is None else known.model_validate(values)
        except ValidationError:
            section = None
    if section is None:  # the check of [vehicle] says why: whether it has a place of its own is not known
        return {"duration_s": 1.0, "start": {"latitude_deg": 0.0, "longitude_deg": 0.0}, **data}
    place = section.start_values()
    if place is None:
        return data
    start = data.get("start")
    stated = start if isinstance(start, Mapping) else {}
    return {
        "duration_s": section.lasts_s,
        **data,
        "vehicle": section,
        "start": start if start and not stated else {**place, **stated},
    }


def scenario_class() -> type[Scenario]:
    """`Scenario` with the kinds of vehicle and the sensors that are registered."""
    return _with(tuple(vehicle_registry.registered().values()), tuple(sensor_registry.registered().items()))


@lru_cache(maxsize=8)
def _with(vehicles: tuple[type[VehicleSection], ...], sensors: tuple[tuple[str, type[SensorSection]], ...]) -> type[Scenario]:
    fields: dict[str, Any] = {
        "vehicle": (Annotated[Union[vehicles], Field(discriminator="kind")], key(..., "the vehicle")),  # noqa: UP007
    }
    for id, section in sensors:
        if id not in Scenario.model_fields:
            what = summary(section)
            fields[id] = (section | None, key(None, f"{what[0].lower()}{what[1:]}; none if absent"))
    return create_model("Scenario", __base__=Scenario, __doc__=Scenario.__doc__, **fields)


def _restored(values: dict[str, Any], name: str) -> Scenario:
    scenario = scenario_class().model_validate(values)
    scenario._name = name
    return scenario

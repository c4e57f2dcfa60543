"""What insenv promises of every sensor and every kind of vehicle: its section of a scenario, its equations, its truth."""

from __future__ import annotations

from typing import Any

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from insenv.base.errors import InputError
from insenv.base.toml import Section
from insenv.core.runner import make_runner
from insenv.runs.simulated import run
from insenv.scenario import Plant, build, load
from insenv.sensors import SensorSection
from insenv.sensors import registry as sensors
from insenv.sensors.instrument import Instrument
from insenv.testing.models import check_backends, check_snapshots, check_tables, promised
from insenv.vehicles import VehicleSection

DRIFT = {"deg": 1e-5, "mps": 1e-4, "m": 1e-3}
"""Largest error of navigation with a perfect unit and a perfect start over 10 s: the truth agrees with its own samples."""
_PLACE = {"title": "Conformance", "rate_hz": 100, "start": {"latitude_deg": 50, "longitude_deg": 8, "heading_deg": 30}}
_CAR = {"kind": "car", "legs": [{"wait_s": 1}, {"accelerate_to_mps": 5}, {"turn_deg": 90, "radius_m": 10}]}


def _class(thing: object, base: type[Section], what: str) -> None:
    """Raise `AssertionError` if `thing` is not a class of sections."""
    assert isinstance(thing, type) and issubclass(thing, base), f"{thing!r}: allowed is {what}"


def check_keys(section: type[Section], **values: Any) -> None:
    """Check that each key of a section has a meaning and a unit, and that wrong values are refused by the name of the key.

    values: a section that is right.
    """
    _class(section, Section, "the class of a section")
    this = section.__name__
    _made(section, values)
    _refused(section, {**values, "no_such_key": 1.0}, "no_such_key")
    for name, field in section.model_fields.items():
        extra = field.json_schema_extra
        assert (field.description or "").strip(), f"{this}.{name} has no meaning: declare it by key()"
        assert isinstance(extra, dict) and isinstance(extra.get("unit"), str), f"{this}.{name} has no unit: declare it by key()"
        for bound in field.metadata:
            if isinstance(bound, (Gt, Ge)):
                limit: Any = bound.gt if isinstance(bound, Gt) else bound.ge
                _refused(section, {**values, name: limit - 1}, name)
            elif isinstance(bound, (Lt, Le)):
                limit = bound.lt if isinstance(bound, Lt) else bound.le
                _refused(section, {**values, name: limit * 2 + 1}, name)
        _refused(section, {**values, name: object()}, name)


def _made(section: type[Section], values: dict[str, Any]) -> Section:
    try:
        return section(**values)
    except InputError as error:
        raise AssertionError(f"{section.__name__}: {values} is refused: {error}") from None


def _refused(section: type[Section], values: dict[str, Any], name: str) -> None:
    try:
        section(**values)
    except InputError as error:
        assert name in str(error), f"{section.__name__}: the message about {name} = {values[name]!r} does not name it: {error}"
    else:
        raise AssertionError(f"{section.__name__}: {name} = {values[name]!r} is not refused")


def check_sensor(section: type[SensorSection] | Instrument | str, *, compiled: bool = True, **values: Any) -> None:
    """Check a sensor: its keys, what it tells estimators, its outputs on a driving car, its bits on every backend.

    section: its section, the instrument or its id; one that is not registered is known for the check alone.  values: its keys
    in a scenario.  compiled: whether native code and batches are compared.  Raises `AssertionError`, and `InputError` for an
    id that is not registered.
    """
    if isinstance(section, str):
        section = sensors.get(section)
    thing: Any = getattr(section, "instrument", section)  # of the section of an instrument, that
    if isinstance(thing, Instrument):
        try:
            sensors.check(thing)
        except InputError as error:
            raise AssertionError(str(error)) from error
    made: Any = sensors.section_of(thing) if isinstance(thing, Instrument) else thing
    _class(made, SensorSection, "the class of a sensor's section, an instrument or its id")
    id = made.sensor.id
    with sensors.passed([thing]):
        assert sensors.get(id) is made, f"sensor {id!r}: another one is registered by this id: choose another"
        _check_sensor(made, compiled, values)


def _check_sensor(section: type[SensorSection], compiled: bool, values: dict[str, Any]) -> None:
    sensor = section.sensor
    this = f"sensor {sensor.id!r}"
    check_keys(section, **values)
    scenario = {**_PLACE, "duration_s": 4, "vehicle": _CAR, "imu": {"grade": "tactical"}, sensor.id: values}
    with promised(this):
        plants = [build(load(scenario), seed=seed) for seed in (1, 1, 2)]
        table = plants[0].model.parameters
        if sensor.stated_errors is not None:
            stated = sensor.stated_errors(table.unpack(table.pack(plants[0].parameters)))
            unknown = set(stated) - set(sensors.stated_rows().names)
            assert not unknown, f"{this} states {sorted(unknown)}: allowed are rows of insenv.sensors.registry.stated_rows()"
        runs = [make_runner(plant.model, plant.parameters, "interpreter").run(plant.samples) for plant in plants]
        outputs = [plant.model.outputs.unpack(rows) for plant, rows in zip(plants, runs, strict=True)]
        assert runs[0].tobytes() == runs[1].tobytes(), f"{this}: a seed gives two different runs"
        for name in sensor.outputs:
            bad = outputs[0][name][~np.isfinite(outputs[0][name])]
            assert not bad.size, f"{this}: output {name!r} = {bad[0]}: allowed is a finite number"
        varied = any(not np.array_equal(outputs[0][name], outputs[2][name]) for name in sensor.outputs)
        assert varied or not sensor.errors, f"{this} declares errors, but seeds 1 and 2 measure the same"
        _check_plant(plants[0], compiled)


def check_vehicle(section: type[VehicleSection], *, compiled: bool = True, **values: Any) -> None:
    """Check a registered kind of vehicle: its keys, its equations on every backend, and that its truth agrees with its samples.

    The last is free-inertial navigation by an estimator with a perfect unit from the true start, over 10 s.  values: its keys
    in a scenario.  compiled: whether native code and batches are compared.  Raises `AssertionError`.
    """
    _class(section, VehicleSection, "the class of a vehicle's section")
    kind = str(values.get("kind"))
    this = f"vehicle kind {kind!r}"
    check_keys(section, **values)
    scenario = {
        **_PLACE,
        "duration_s": 10,
        "vehicle": values,
        "imu": {"grade": "perfect"},
        "knowledge": {"draw_errors": False},
    }
    with promised(this):
        if _made(section, values).start_values() is not None:  # type: ignore[attr-defined]
            del scenario["start"]
        plant = build(load(scenario), driven=True)
        assert isinstance(plant.in_place, bool), f"{this}: in_place = {plant.in_place!r}: allowed is True or False"
        result = run(load(scenario), "wander-sins").results[0]
        for channel, errors in result.errors.items():
            worst, allowed = float(np.max(np.abs(errors))), DRIFT[channel.rpartition("_")[2]]
            assert worst <= allowed, f"{this}: with a perfect unit {channel} is {worst:.3g} off after 10 s: allowed {allowed:g}"
        _check_plant(plant, compiled)


def _check_plant(plant: Plant, compiled: bool) -> None:
    check_tables(plant.model)
    parameters = plant.model.parameters.pack(plant.parameters)
    inputs = np.tile(plant.model.inputs.start_vector(), (100, 1))
    check_snapshots(plant.model, parameters, inputs)
    if compiled:
        check_backends(plant.model, parameters, inputs)

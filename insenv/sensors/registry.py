"""The sensors by id: those that insenv ships, those of installed packages, those registered by a script."""

from __future__ import annotations

from typing import TypeVar

from insenv.base.errors import InputError
from insenv.base.plugins import Plugins, check_section_name, overrides
from insenv.base.shipped import SENSORS
from insenv.base.toml import shown
from insenv.core.tables import Table
from insenv.sensors.contract import Sensor, SensorSection
from insenv.sensors.gnss import GNSS_STATED
from insenv.sensors.instrument import Instrument
from insenv.sensors.instrument_section import section_of

TAKEN = frozenset(dir(SensorSection)) | {
    "title", "description", "duration_s", "rate_hz", "seed", "estimators", "start", "vehicle", "imu", "gnss", "knowledge",
    "estimator", "name", "sensors", "tunings", "drive", "gravity", "notes", "choices_of", "commands", "stated", "story",
}  # fmt: skip
"""Names of the keys and attributes of a scenario, which no section of a sensor can have."""


Registered = type[SensorSection] | Instrument
"""What may be registered: a section with equations of its own, or an instrument, of which the section follows."""


def _id(thing: Registered) -> str:
    if isinstance(thing, Instrument):
        return check_section_name("Instrument: id", thing.id)
    sensor = getattr(thing, "sensor", None)
    if isinstance(thing, type) and issubclass(thing, SensorSection) and isinstance(sensor, Sensor):
        overrides(thing, SensorSection, ("rows",))
        return check_section_name(f"{thing.__name__}: sensor id", sensor.id)
    raise InputError(
        f"{shown(thing)}: a sensor is registered by an Instrument or a subclass of SensorSection whose `sensor` is a Sensor"
    )


_PLUGINS: Plugins[Registered] = Plugins(
    "sensor", "insenv.sensors", _id, SENSORS, ("a key or attribute of a scenario", lambda: TAKEN)
)

names, check_loaded = _PLUGINS.names, _PLUGINS.check_loaded
"""As `Plugins` gives them: ids of the sensors beside the inertial unit."""


def _section(thing: Registered) -> type[SensorSection]:
    return section_of(thing) if isinstance(thing, Instrument) else thing


def get(id: str) -> type[SensorSection]:
    """The section of the sensor of that id.  Raises `InputError` with the nearest id."""
    return _section(_PLUGINS.get(id))


def registered() -> dict[str, type[SensorSection]]:
    """The sections of all sensors beside the inertial unit, by id."""
    return {id: _section(thing) for id, thing in _PLUGINS.all().items()}


def instruments() -> dict[str, Instrument]:
    """All aiding instruments by id, in the order of registration."""
    return {id: thing for id, thing in _PLUGINS.all().items() if isinstance(thing, Instrument)}


def instrument(id: str) -> Instrument | None:
    """The aiding instrument of that id; None for a sensor that has equations of its own."""
    thing = _PLUGINS.get(id)
    return thing if isinstance(thing, Instrument) else None


def stated_rows() -> Table:
    """The rows stated to estimators of the receiver and of all instruments.  Start values, mostly 0, mean "no such error"."""
    return sum((each.stated_errors for each in instruments().values()), GNSS_STATED)


Thing = TypeVar("Thing", type[SensorSection], Instrument)


def register(thing: Thing) -> Thing:
    """Make a sensor known.  Raises `InputError` if another one has its id."""
    _PLUGINS.register(thing)
    return thing

"""The sensors by id: those that insenv ships, those of installed packages, those registered by a script."""

from __future__ import annotations

from insenv.base.errors import InputError
from insenv.base.plugins import Plugins, check_section_name, overrides
from insenv.base.shipped import SENSORS
from insenv.base.toml import shown
from insenv.sensors.contract import Sensor, SensorSection

TAKEN = frozenset(dir(SensorSection)) | {
    "title", "description", "duration_s", "rate_hz", "seed", "estimators", "start", "vehicle", "imu", "gnss", "knowledge",
    "estimator", "name", "sensors", "tunings", "drive", "gravity", "notes", "choices_of", "commands", "stated",
}  # fmt: skip
"""Names of the keys and attributes of a scenario, which no section of a sensor can have."""


def _id(section: type[SensorSection]) -> str:
    sensor = getattr(section, "sensor", None)
    if isinstance(section, type) and issubclass(section, SensorSection) and isinstance(sensor, Sensor):
        overrides(section, SensorSection, ("rows",))
        return check_section_name(f"{section.__name__}: sensor id", sensor.id)
    raise InputError(f"{shown(section)}: a sensor is registered by a subclass of SensorSection whose `sensor` is a Sensor")


_PLUGINS: Plugins[type[SensorSection]] = Plugins(
    "sensor", "insenv.sensors", _id, SENSORS, ("a key or attribute of a scenario", lambda: TAKEN)
)


def names() -> list[str]:
    """The ids of all sensors beside the inertial unit; none of insenv's is imported."""
    return _PLUGINS.names()


def get(id: str) -> type[SensorSection]:
    """The section of the sensor of that id.  Raises `InputError` with the nearest id."""
    return _PLUGINS.get(id)


def registered() -> dict[str, type[SensorSection]]:
    """The sections of all sensors beside the inertial unit, by id."""
    return _PLUGINS.all()


def register(section: type[SensorSection]) -> type[SensorSection]:
    """Make a sensor known.  Raises `InputError` if another one has its id."""
    return _PLUGINS.register(section)


def check_loaded(name: str) -> None:
    """Raise `InsenvError` if an installed package declares this sensor, but cannot be loaded."""
    _PLUGINS.check_loaded(name)

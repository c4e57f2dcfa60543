"""The sensors by id: those that insenv ships, those of installed packages, those registered by a script."""

from __future__ import annotations

from collections.abc import Iterator

from insenv.errors import InputError
from insenv.plugins import Plugins
from insenv.sensors.contract import Sensor, SensorSection


def _shipped() -> Iterator[type[SensorSection]]:
    from insenv.sensors.gnss_section import GnssSection

    yield GnssSection


def _id(section: type[SensorSection]) -> str:
    sensor = getattr(section, "sensor", None)
    if isinstance(section, type) and issubclass(section, SensorSection) and isinstance(sensor, Sensor):
        return sensor.id
    raise InputError(f"{section!r}: a sensor is registered by a subclass of SensorSection whose `sensor` is a Sensor")


_PLUGINS: Plugins[type[SensorSection]] = Plugins("sensor", "insenv.sensors", _id, _shipped)


def registered() -> dict[str, type[SensorSection]]:
    """The sections of all sensors beside the inertial unit, by id."""
    return _PLUGINS.all()


def register(section: type[SensorSection]) -> type[SensorSection]:
    """Make a sensor known.  Raises `InputError` if another one has its id."""
    return _PLUGINS.register(section)

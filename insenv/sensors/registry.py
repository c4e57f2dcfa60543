"""The sensors by id: those that insenv ships, those of installed packages, those registered by a script; their sections."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar, TypeVar

from pydantic import create_model

from insenv.base.errors import InputError
from insenv.base.plugins import Plugins, check_section_name, overrides
from insenv.base.shipped import SENSORS
from insenv.base.toml import Number, key, shown
from insenv.core.tables import Table
from insenv.sensors.contract import Place, Sensor, SensorSection
from insenv.sensors.definition import check_beside, check_instrument
from insenv.sensors.figures import FiguresSection, TimedSection, figures_section
from insenv.sensors.gnss import GNSS_STATED
from insenv.sensors.imu import IMU
from insenv.sensors.instrument import Instrument, Setting
from insenv.sensors.sampled import Sampled

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


def check(thing: Registered, others: Mapping[str, Registered] | None = None) -> None:
    """Raise `InputError` for an instrument that is wrong, alone or beside the others; None: those that are registered."""
    if isinstance(thing, Instrument):
        beside = [other for other in (_PLUGINS.all() if others is None else others).values() if _id(other) != thing.id]
        sensors = [IMU, *(other.sensor for other in beside if not isinstance(other, Instrument))]
        check_instrument(thing)
        check_beside(thing, [other for other in beside if isinstance(other, Instrument)], sensors)


_PLUGINS: Plugins[Registered] = Plugins(
    "sensor", "insenv.sensors", _id, SENSORS, ("a key or attribute of a scenario", lambda: TAKEN), check
)

names, check_loaded, passed = _PLUGINS.names, _PLUGINS.check_loaded, _PLUGINS.passed
"""As `Plugins` gives them: ids of the sensors beside the inertial unit; those that are known in a block."""


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
    """Make a sensor known.  Raises `InputError` if another one has its id, and for an instrument that is wrong."""
    _PLUGINS.register(thing)
    return thing


# The keys of an instrument in files, made from its declaration: its errors, its timing and its further keys.


class InstrumentSection(TimedSection):
    """The section of a scenario that puts an instrument on the vehicle."""

    instrument: ClassVar[Instrument]

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`.  Raises `InputError` for times that do not fit the samples."""
        assert isinstance(self, FiguresSection)
        return {**self.timing(rate_hz), **self.error_rows()}

    def rows_at(self, rate_hz: float, place: Place) -> dict[str, Any]:
        """Parameter rows (SI) with those of the surroundings at `place`.  Raises `InputError`."""
        surroundings = self.instrument.surroundings
        return {**self.rows(rate_hz), **({} if surroundings is None else surroundings(self, place))}


def setting_key(setting: Setting, default: Any) -> tuple[Any, Any]:
    """Type and field of a further key of an instrument."""
    return setting.kind, key(default, setting.meaning, setting.unit, row=setting.row)


@cache
def figures_of(instrument: Instrument) -> type[FiguresSection]:
    """The keys of the errors of an instrument, the same in scenarios and logs."""
    name = f"{instrument.id.title()}Figures"
    return figures_section(name, instrument.all_parameters, instrument.grades, instrument.figures, instrument.grade)


@cache
def section_of(instrument: Instrument) -> type[SensorSection]:
    """The section of a scenario with the keys of an instrument."""
    interval = key(instrument.interval_s, "interval between measurements, a whole number of samples", "s", gt=0, le=3600)
    keys: dict[str, Any] = {"interval_s": (Number, interval)}
    for setting in instrument.settings:
        keys[setting.key] = setting_key(setting, setting.default)
    bases: Any = (figures_of(instrument), InstrumentSection)
    title = f"{instrument.called[0].upper()}{instrument.called[1:]}."
    made = create_model(f"{instrument.id.title()}Section", __base__=bases, __doc__=title, **keys)
    made.sensor, made.instrument = Sampled(instrument).sensor(), instrument
    return made

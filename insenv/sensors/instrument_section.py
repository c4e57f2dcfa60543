"""The keys of an instrument in files, made from its declaration: its errors, its timing and its further keys."""

from __future__ import annotations

from functools import cache
from typing import Any, ClassVar

from pydantic import create_model

from insenv.base.toml import Number, key
from insenv.sensors.contract import Place, SensorSection
from insenv.sensors.figures import FiguresSection, TimedSection, figures_section
from insenv.sensors.instrument import Instrument, Setting
from insenv.sensors.sampled import Sampled


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

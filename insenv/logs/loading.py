"""`load`: any recorded log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeGuard

from insenv.base.changes import Changes, changed, sentence
from insenv.base.errors import InputError
from insenv.base.resources import scenario_names
from insenv.base.toml import BINARY, GPX, KML, NMEA, OTHER, TABLE, is_scenario, read_toml, validated
from insenv.base.toml import is_log as describes_log
from insenv.estimators.settings import tuning
from insenv.logs.assemble import check_columns
from insenv.logs.description import GnssSection, ImuSection, ReferenceSection
from insenv.logs.files import Faults
from insenv.logs.flight_log import FlightDescription, build_flight
from insenv.logs.formats import SECTION_FORMATS, SUFFIXES, is_flight_log
from insenv.logs.instruments import description_class
from insenv.logs.recorded import RecordedLog
from insenv.logs.section_files import completed
from insenv.logs.text import build
from insenv.sensors.grade_file import beside, refuse_grade

_TRACK = (
    'a track has no inertial samples to replay; a scenario whose [vehicle] has kind = "recorded" simulates them along it '
    "(docs/trajectories.md)"
)
_DESCRIBED = "a section of a description in TOML names it: `insenv new log FILE` writes one to start from (docs/logs.md)"
_HINTS = {
    TABLE: "a description in TOML names its columns and units: `insenv new log FILE` writes one to start from (docs/logs.md)",
    BINARY: f"the name of a flight log ends in {SUFFIXES}",
    OTHER: f"allowed is a .toml file that describes a log, or a flight log, whose name ends in {SUFFIXES}",
    **dict.fromkeys((NMEA, GPX, KML), _TRACK),
}
"""What a file needs that is not a description of a log."""


def keys() -> tuple[str, ...]:
    """The keys at the top of a description, of text files or of a flight log."""
    return tuple(dict.fromkeys([*description_class().model_fields, *FlightDescription.model_fields]))


def load(path: str | Path, changes: Changes | None = None) -> RecordedLog:
    """The log at `path`: a flight log itself, or a TOML file that describes a log.

    changes: other values of single keys of the description, by their dotted names, as in ``{"gnss.delay_s": 0.1}``.

    Relative paths in a TOML file start at its folder. Raises InputError for any wrong input; it lists all faults of a
    description, its files included.
    """
    path = Path(path)
    if str(path) in scenario_names() and not path.exists():
        raise InputError(f"{path}: a scenario, not a recorded log: `insenv run {path}` simulates it")
    folder = path.resolve().parent
    if is_flight_log(path) and not changes:
        return build_flight(FlightDescription(flight=path.name), folder)
    form = next((each for each in SECTION_FORMATS.values() if each.named_like(path.name)), None)
    if form is not None and path.is_file():
        raise InputError(f"{path}: a file of the format {form.name!r}, not a description of a log: {_DESCRIBED}")
    data: dict[str, Any] = {"flight": path.name} if is_flight_log(path) else read_toml(path, _HINTS)
    if is_scenario(data) and not describes_log(data):
        raise InputError(f"{path}: a scenario, not the description of a recorded log: `insenv run {path}` simulates it")
    refuse_grade(data, path, "the description of a recorded log")
    label = f"{path} with --set" if changes else str(path)
    data = changed(data, changes or {})
    log = load_data(beside(data, path.parent, *(() if "flight" in data else ("imu",))), folder, label)
    return replace(log, notes=(*sentence(changes), *log.notes)) if changes else log


def load_data(data: dict[str, Any], folder: Path, label: str) -> RecordedLog:
    """The log of a description that is not in a file: its values by section, as in TOML.

    folder: where its relative paths start.  label: what messages call the description.  Raises `InputError` with all faults
    of the description, its files included.
    """
    faults = Faults()
    if "flight" in data:
        flight = faults.attempt(lambda: validated(FlightDescription, data, label))
        _check_settings(data, label, faults)
        log = None if flight is None else faults.attempt(lambda: build_flight(flight, folder))
    else:
        data = completed(data, folder, faults)
        text = faults.attempt(lambda: validated(description_class(), data, label))
        _check_settings(data, label, faults)
        log = None if text is None else faults.attempt(lambda: build(text, folder))
        if text is None:
            _check_columns(data, folder, faults)
    faults.check()
    assert log is not None
    return log


def _check_columns(data: Mapping[str, Any], folder: Path, faults: Faults) -> None:
    """Columns that the files of a wrong description do not have: what can be read of it says which they are."""
    for name, model in (("imu", ImuSection), ("gnss", GnssSection), ("reference", ReferenceSection)):
        section = data.get(name)
        if isinstance(section, dict):
            faults.attempt(lambda name=name, section=section, model=model: check_columns(name, section, model, folder))  # type: ignore[misc]


def _check_settings(data: Mapping[str, Any], label: str, faults: Faults) -> None:
    """Check the settings of estimators, key by key, as the run does that uses them."""
    tables = data.get("estimator")
    for id, table in tables.items() if isinstance(tables, dict) else ():
        for key, value in table.items() if isinstance(table, dict) else ():
            of_key = Faults()
            of_key.attempt(lambda id=id, key=key, value=value: tuning(id, {key: value}))  # type: ignore[misc]
            lines = [f"{label}: {line}" for line in of_key.messages]
            faults.messages += [line for line in lines if line not in faults.messages]


def is_log(source: object) -> TypeGuard[str | Path | RecordedLog]:
    """Whether `source` is a recorded log, or the path of one."""
    if isinstance(source, RecordedLog):
        return True
    if not isinstance(source, (str, Path)) or str(source) in scenario_names() or not Path(source).is_file():
        return False
    path = Path(source)
    # a scenario is a name or a .toml file; of another file the reader of logs says what it is
    return is_flight_log(path) or path.suffix.lower() != ".toml" or describes_log(read_toml(path))

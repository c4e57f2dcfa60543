"""A recorded log as CSV files and the TOML file that describes them, which `insenv.replay` reads back."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from insenv.base.errors import InputError
from insenv.logs.columns import MeasurementSection
from insenv.logs.description import SLOPES, LogDescription
from insenv.logs.formats import log_tables
from insenv.logs.formats.contract import Drive, Files, Format
from insenv.logs.formats.csv_table import csv_text
from insenv.logs.recorded import RecordedLog
from insenv.sensors import registry

# Values of a TOML file as text.

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(values: Mapping[str, Any]) -> str:
    """TOML of numbers, truth values, texts, lists of these, and tables of all of them; None is left out.

    A float is written in the fewest digits from which it is read back to the bit.
    """
    lines: list[str] = []
    _table(values, (), lines)
    return "\n".join(lines).strip("\n") + "\n"


def _table(values: Mapping[str, Any], path: tuple[str, ...], lines: list[str]) -> None:
    plain = {name: value for name, value in values.items() if value is not None and not _is_tables(value)}
    if path and (plain or not values):
        lines += ["", f"[{'.'.join(map(_key, path))}]"]
    lines += [f"{_key(name)} = {_value(value)}" for name, value in plain.items()]
    for name, value in values.items():
        if isinstance(value, Mapping):
            _table(value, (*path, name), lines)
        elif _is_tables(value):
            for each in value:
                lines += ["", f"[[{'.'.join(map(_key, (*path, name)))}]]"]
                _table(each, (), lines)


def _is_tables(value: Any) -> bool:
    listed = isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 0
    return isinstance(value, Mapping) or (listed and all(isinstance(each, Mapping) for each in value))


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (int, float)):
        return repr(value)
    return f"[{', '.join(map(_value, value))}]"


_AS_READ = {
    *MeasurementSection.model_fields,
    *SLOPES,
    "temperature_reference_degc",  # the samples are without these errors
    *("gyro_unit", "accel_unit", "kind", "stamp", "axes", "accel_axes", "gyro_scale", "accel_scale"),
    *("position_unit", "height_offset_m", "velocity_vertical", "position_sigma_m", "velocity_sigma_mps", "speed_unit"),
    *("course_unit", "speed_sigma_mps", "attitude_unit", "field_unit", "azimuth_unit", "azimuth_sigma_deg"),
}
"""Keys of a description that say how its files are to be read: those written here need others."""


def file_of(section: str, name: str = "log") -> str:
    """The name of a section's CSV file beside the description NAME.toml."""
    return f"{name}-{section}.csv"


def texts(log: RecordedLog, name: str) -> dict[str, str]:
    """The files of a log by name: NAME.toml and a CSV file for the unit, the fixes, each instrument, the reference.

    Raises `InputError` for a log without samples of its own.
    """
    tables = log_tables.tables(log)
    if len(tables["imu"]["time_s"]) < 3:
        raise InputError(f"{log.description.title}: {len(tables['imu']['time_s'])} samples: a log has 3 or more")
    keys: dict[str, dict[str, Any]] = {"imu": log_tables.imu_keys(log)}
    if log.gnss is not None:
        keys["gnss"] = log_tables.gnss_keys(log.gnss)
    for each in log.instruments:
        keys[each.id] = log_tables.instrument_keys(each)
    if log.reference is not None and len(tables["reference"]["time_s"]):
        keys["reference"] = log_tables.reference_keys(log.reference)
    sections = {
        id: {"file": file_of(id, name), **keys[id], **{each: v for each, v in _stated(log, id).items() if each not in keys[id]}}
        for id in keys
    }
    text = _HEAD.format(name=name) + toml_text({**_common(log.description), **sections})
    return {f"{name}.toml": text, **{file_of(id, name): csv_text(tables[id]) for id in keys}}


_HEAD = """# A recorded log: insenv replay {name}.toml -e ID --start stated starts from [initial].
# Keys: docs/logs.md.

"""


def _common(description: LogDescription) -> dict[str, Any]:
    """The keys that do not belong to a table; start_s and stop_s have had their effect."""
    sections = {"imu", "gnss", "reference", *registry.instruments()}
    data = description.model_dump(mode="json", exclude_none=True, exclude_unset=True, exclude={"start_s", "stop_s", *sections})
    return {name: value for name, value in data.items() if value not in ({}, "")}


def _stated(log: RecordedLog, id: str) -> dict[str, Any]:
    """What a section says beside how its files are read: grades, errors, lever arms."""
    section = getattr(log.description, id)
    if section is None:  # of a flight log, whose description has no instruments
        return {}
    drop = _AS_READ | set(section.column_keys())
    if id == "reference":  # its columns are written in the axes of insenv, and at the IMU if it has an attitude
        at_point = log.reference is not None and log.reference.lever_arm_b is not None
        drop |= set(type(section).model_fields) - ({"lever_arm_m"} if at_point else set())
    data = section.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    return {name: value for name, value in data.items() if name not in drop}


def write(drive: Drive) -> Files:
    """NAME-log.toml and its CSV files."""
    return texts(drive.sensors(), f"{drive.name}-log")


FORMAT = Format(name="log", write=write, needs_log=True)

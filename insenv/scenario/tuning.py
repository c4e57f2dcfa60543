"""Tuning of an estimator: keys in data-sheet units, the same in scenarios and in descriptions of recorded logs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from insenv.core.tables import Row, Table
from insenv.errors import InputError, nearest
from insenv.estimators import Estimator, get
from insenv.files.toml import shown
from insenv.sensors import units

_UNITS: dict[str, dict[str, Callable[[Any], Any]]] = {
    "rad": {"deg": units.deg_to_rad},
    "rad/s": {"deg_h": units.deg_h_to_rad_s},
    "m/s^2": {"ug": units.ug_to_m_s2, "mgal": units.mgal_to_m_s2},
    "rad/s^0.5": {"deg_sqrt_h": units.deg_sqrt_h_to_rad_sqrt_s},
    "m/s^1.5": {"ug_sqrt_hz": units.ug_sqrt_hz_to_m_s_sqrt_s, "mps_sqrt_h": units.m_s_sqrt_h_to_m_s_sqrt_s},
    "m": {"m": np.asarray},
    "s": {"s": np.asarray},
    "m/s": {"mps": np.asarray},
    "1": {"": np.asarray},
}
"""Endings of a key by the SI unit of its row; a row with another unit is set in SI, by its own name."""
_SHORT = {
    "arw": ("angle_random_walk",),
    "vrw": ("velocity_random_walk",),
    "gyro_bias": ("gyro_bias_sigma",),
    "accel_bias": ("accel_bias_sigma",),
    "correlation_time": ("gyro_correlation_time", "accel_correlation_time"),
}
"""Short names of rows."""
FILE = "file"
"""Key of a file with parameter rows, for estimators that read one; a relative path starts at the current folder."""
_KNOWN = ("latitude", "longitude", "height", "antenna_lever_arm", "sample_interval", "seed")

Settings = Mapping[str, Mapping[str, Any]]
"""Parameters by estimator id, with the keys of [estimator.ID]."""


def parsed_settings(texts: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Settings from texts ``ESTIMATOR.KEY=VALUE``; a value is a number, a list of numbers, or the path of a file.

    Raises `InputError` for a text of another form, or a key that is given twice.
    """
    found: dict[str, dict[str, Any]] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        id, dot, setting = name.strip().partition(".")
        if not (id and dot and setting and equals and value.strip()):
            raise InputError(f"--set {text!r}: allowed is ESTIMATOR.KEY=VALUE, such as loosely-coupled.arw_deg_sqrt_h=0.3")
        table = found.setdefault(id, {})
        if setting in table:
            raise InputError(f"--set {text!r}: {id}.{setting} is given twice")
        try:
            table[setting] = json.loads(value)
        except ValueError:
            table[setting] = value.strip()
    return found


def setting_rows(settings: Settings | None, chosen: Sequence[Estimator]) -> dict[str, dict[str, Any]]:
    """Parameter rows (SI) that `settings` give each of the estimators `chosen`, by id.

    Settings for the filter under a smoother are the smoother's too. Raises `InputError` for an estimator that is not among
    those, and as `tuning` does.
    """
    if not isinstance(settings, (Mapping, type(None))):
        raise InputError(f"settings = {shown(settings)}: allowed is a dict of parameters by estimator id")
    given: dict[str, dict[str, Any]] = {}
    for id, table in (settings or {}).items():
        allowed = dict.fromkeys(name for e in chosen for name in (e.id, e.smooths) if name)
        if id not in allowed:
            raise InputError(f"settings: {shown(id)} is not an estimator of this run{nearest(str(id), allowed)}")
        if not isinstance(table, Mapping):
            raise InputError(f"settings[{id!r}] = {shown(table)}: allowed is a dict of values by key")
        given[id] = tuning(next((e for e in chosen if e.id == id), id), table)
    return {e.id: {**given.get(e.smooths, {}), **given.get(e.id, {})} for e in chosen}


def tuning(estimator: str | Estimator, table: Mapping[str, Any]) -> dict[str, Any]:
    """Parameter rows (SI) of an estimator from `table`, such as ``{"arw_deg_sqrt_h": 0.3, "innovation_gate": 5}``.

    A key is the row's name, or a short name, followed by the unit of its value; or `file`, if the estimator reads
    one. Raises `InputError` for an unknown estimator or key, a value of the wrong type or shape or out of bounds, or
    a file that cannot be read.
    """
    estimator = get(estimator)
    parameters = estimator.model.parameters
    known = _keys(parameters)
    rows: dict[str, Any] = {}
    for key, value in table.items():
        where = f"estimator.{estimator.id!r}.{key}"
        if key == FILE and estimator.read_file is not None:
            rows |= _from_file(where, estimator.read_file, value)
            continue
        if key not in known:
            allowed = [*known, *([FILE] if estimator.read_file is not None else [])]
            raise InputError(f"{where}: unknown key{nearest(key, sorted(allowed))}")
        for row, convert in known[key]:
            if row.name in rows:
                raise InputError(f"{where}: another key has set {row.name} already")
            try:
                number = convert(np.asarray(value, dtype=np.float64))
                parameters.pack({row.name: number})
            except (TypeError, ValueError, OverflowError):
                scale, several = float(convert(1.0)), f", or a list of {row.size}," if row.shape else ""
                raise InputError(
                    f"{where} = {shown(value)}: allowed is a finite number{several} from {row.lower / scale:g} to "
                    f"{row.upper / scale:g} ({row.meaning})"
                ) from None
            rows[row.name] = number
    return rows


def _from_file(where: str, read: Callable[[str], Mapping[str, Any]], value: Any) -> Mapping[str, Any]:
    if not isinstance(value, str) or not value:
        raise InputError(f"{where} = {shown(value)}: allowed is the path of a file")
    try:
        return read(value)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def keys_by_row(parameters: Table) -> dict[str, list[str]]:
    """By parameter row, the keys that set it; rows that cannot be set are left out."""
    found: dict[str, list[str]] = {}
    for key, rows in _keys(parameters).items():
        for row, _ in rows:
            found.setdefault(row.name, []).append(key)
    return found


def _keys(parameters: Table) -> dict[str, list[tuple[Row, Callable[[Any], Any]]]]:
    """Allowed keys: the rows that each sets, and the conversions to SI.  Rows that `Knowledge` gives cannot be set."""
    keys: dict[str, list[tuple[Row, Callable[[Any], Any]]]] = {}
    for row in parameters:
        if not row.name.startswith("start_") and row.name not in _KNOWN:
            for ending, convert in _UNITS.get(row.unit, {"": np.asarray}).items():
                for name in (row.name, *(short for short, names in _SHORT.items() if row.name in names)):
                    keys.setdefault(f"{name}_{ending}".rstrip("_"), []).append((row, convert))
    return keys

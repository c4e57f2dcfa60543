"""Tuning of an estimator: keys in data-sheet units, the same in scenarios and in descriptions of recorded logs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np

from insenv.base.changes import parsed
from insenv.base.errors import InputError, nearest
from insenv.base.toml import shown
from insenv.base.units import SAME, Conversion
from insenv.core.tables import Row, Table
from insenv.estimators import Estimator, get, registry
from insenv.sensors.units import UNITS

_UNITS: dict[str, dict[str, Conversion]] = {}
"""Endings of a key by the SI unit of its row; a row with another unit is set in SI, by its own name."""
for _unit in UNITS.values():
    if _unit.ending is not None:
        _UNITS.setdefault(_unit.si, {})[_unit.ending] = _unit.convert
_SHORT = {
    "arw": ("angle_random_walk",),
    "vrw": ("velocity_random_walk",),
    "gyro_bias": ("gyro_bias_sigma",),
    "accel_bias": ("accel_bias_sigma",),
    "correlation_time": ("gyro_correlation_time", "accel_correlation_time"),
}
"""Short names of rows."""
DOCUMENTED = "the table of parameters on the estimator's page"
"""Where the keys of an estimator are listed."""
_LISTED = "docs/scenario-keys.md, docs/log-keys.md and `insenv list`"
"""Where the keys of files and the estimators are listed."""
FILE = "file"
"""Key of a file with parameter rows, for estimators that read one; a relative path starts at the current folder."""
_KNOWN = ("latitude", "longitude", "height", "antenna_lever_arm", "sample_interval", "seed")

Settings = Mapping[str, Mapping[str, Any]]
"""Parameters by estimator id, with the keys of [estimator.ID]."""


def parsed_changes(texts: Iterable[str], keys: Iterable[str]) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """Parameters by estimator id, and changes of the scenario or the description of the log, from texts ``KEY=VALUE``.

    The key of a parameter is ``ID.KEY`` or ``estimator.ID.KEY``; each other key is a dotted key of the file.  keys: those at
    the top of the file.  Raises `InputError` for a text of another form, a key that is given twice, or one that is neither.
    """
    tables: dict[str, dict[str, Any]] = {}
    changes: dict[str, Any] = {}
    faults: list[str] = []
    ids = registry.names()
    for name, value in parsed(texts).items():
        id, _, setting = name.removeprefix("estimator.").partition(".")
        first = name.partition(".")[0]
        if (id in ids or name.startswith("estimator.")) and setting:
            table = tables.setdefault(id, {})
            if setting in table:
                faults.append(f"--set: {id}.{setting} is given twice")
            table[setting] = value
        elif first in ids:
            faults.append(f"--set {name}: allowed is {first}.KEY=VALUE, a key of [estimator.{first}]")
        elif first not in keys:
            faults.append(f"--set {name}: no key or estimator {first!r}{nearest(first, [*keys, *ids], _LISTED)}")
        else:
            changes[name] = value
    _raise(faults)
    return tables, changes


def _raise(faults: Sequence[str]) -> None:
    """Raise one `InputError` with all faults, if there are any."""
    if faults:
        raise InputError("\n".join(faults))


def setting_rows(settings: Settings | None, chosen: Sequence[Estimator]) -> dict[str, dict[str, Any]]:
    """Parameter rows (SI) that `settings` give each of the estimators `chosen`, by id.

    Settings for the filter under a smoother are the smoother's too. Raises `InputError` for an estimator that is not among
    those, and as `tuning` does.
    """
    if not isinstance(settings, (Mapping, type(None))):
        raise InputError(f"settings = {shown(settings)}: allowed is a dict of parameters by estimator id")
    rows: dict[str, dict[str, Any]] = {}
    faults: list[str] = []
    for id, table in (settings or {}).items():
        allowed = dict.fromkeys(name for e in chosen for name in (e.id, e.smooths) if name)
        if id not in allowed:
            faults.append(f"settings: {shown(id)} is not an estimator of this run{nearest(str(id), allowed)}")
        elif not isinstance(table, Mapping):
            faults.append(f"settings[{id!r}] = {shown(table)}: allowed is a dict of values by key")
        else:
            try:
                rows[id] = tuning(next((e for e in chosen if e.id == id), id), table)
            except InputError as error:
                faults.append(str(error))
    _raise(faults)
    return {e.id: {**rows.get(e.smooths, {}), **rows.get(e.id, {})} for e in chosen}


def tuning(estimator: str | Estimator, table: Mapping[str, Any]) -> dict[str, Any]:
    """Parameter rows (SI) of an estimator from `table`, such as ``{"arw_deg_sqrt_h": 0.3, "innovation_gate": 5}``.

    A key is the row's name, or a short name, followed by the unit of its value; or `file`, if the estimator reads
    one. Raises `InputError` for an unknown estimator or key, a value of the wrong type or shape or out of bounds, or
    a file that cannot be read.
    """
    estimator = get(estimator)
    known = _keys(estimator.settable_rows)
    rows: dict[str, Any] = {}
    faults: list[str] = []
    try:
        choices_in(estimator, table)
    except InputError as error:
        faults.append(str(error))
    for key, value in table.items():
        if key in estimator.lists_of_names:
            continue
        where = f"estimator.{estimator.id}.{key}"
        try:
            rows |= _rows_of(estimator, known, rows, where, key, value)
        except InputError as error:
            faults.append(str(error))
    _raise(faults)
    return rows


def _rows_of(
    estimator: Estimator,
    known: Mapping[str, list[tuple[Row, Conversion]]],
    before: Mapping[str, Any],
    where: str,
    key: str,
    value: Any,
) -> dict[str, Any]:
    """The rows that one key sets; `before`: those set by others."""
    parameters = estimator.settable_rows
    rows: dict[str, Any] = {}
    if key == FILE and estimator.read_file is not None:
        return dict(_from_file(where, estimator.read_file, value))
    if key not in known:
        allowed = [*known, *estimator.lists_of_names, *([FILE] if estimator.read_file is not None else [])]
        raise InputError(f"{where}: unknown key{nearest(key, sorted(allowed), DOCUMENTED)}")
    for row, convert in known[key]:
        if row.name in before or row.name in rows:
            raise InputError(f"{where}: another key has set {row.name} already")
        try:
            number = convert(_numbers(value, row.flag))
            parameters.pack({row.name: number})
        except (TypeError, ValueError, OverflowError):
            scale, several = float(convert(1.0)), f", or a list of {row.size}," if row.shape else ""
            raise InputError(
                f"{where} = {shown(value)}: allowed is a finite number{several} from {row.lower / scale:g} to "
                f"{row.upper / scale:g} ({row.meaning})"
            ) from None
        rows[row.name] = number
    return rows


def _numbers(value: Any, flag: bool) -> np.ndarray:
    """A number or a list of numbers as an array.  flag: true is 1, false 0.  Raises TypeError for anything else."""
    for one in np.ravel(np.asarray(value, dtype=object)):
        if not isinstance(one, (Real, np.bool_)) or (isinstance(one, (bool, np.bool_)) and not flag):
            raise TypeError(f"{one!r} is not a number")
    return np.asarray(value, dtype=np.float64)


def settings_of(estimator: Estimator, settings: Settings | None) -> dict[str, Any]:
    """The settings of an estimator, over those of the filter under it."""
    tables = settings or {}
    return {**tables.get(estimator.smooths, {}), **tables.get(estimator.id, {})}


def choices_in(estimator: str | Estimator, table: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """The lists of names in `table` by the keys `Estimator.choices`.  Raises `InputError` for another value or name."""
    estimator = get(estimator)
    choices: dict[str, tuple[str, ...]] = {}
    for key, allowed in estimator.lists_of_names.items():
        if key not in table:
            continue
        where, names = f"estimator.{estimator.id}.{key}", table[key]
        if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
            raise InputError(f"{where} = {shown(names)}: allowed is a list of names from {', '.join(allowed)}")
        for name in names:
            if name not in allowed:
                raise InputError(f"{where}: unknown name {name!r}{nearest(name, allowed)}")
            if list(names).count(name) > 1:
                raise InputError(f"{where}: {name!r} is given twice")
        choices[key] = tuple(names)
    return choices


def _from_file(where: str, read: Callable[[str], Mapping[str, Any]], value: Any) -> Mapping[str, Any]:
    if not isinstance(value, str) or not value:
        raise InputError(f"{where} = {shown(value)}: allowed is the path of a file")
    try:
        return read(value)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def keys_by_row(parameters: Table) -> dict[str, list[str]]:
    """By parameter row, the keys that set it; rows that cannot be set are left out."""
    by_row: dict[str, list[str]] = {}
    for key, rows in _keys(parameters).items():
        for row, _ in rows:
            by_row.setdefault(row.name, []).append(key)
    return by_row


def _keys(parameters: Table) -> dict[str, list[tuple[Row, Conversion]]]:
    """Allowed keys: the rows that each sets, and the conversions to SI.  Rows that `Knowledge` gives cannot be set."""
    keys: dict[str, list[tuple[Row, Conversion]]] = {}
    for row in parameters:
        if not row.name.startswith("start_") and row.name not in _KNOWN:
            for ending, convert in _UNITS.get(row.unit, {"": SAME}).items():
                for name in (row.name, *(short for short, names in _SHORT.items() if row.name in names)):
                    keys.setdefault(f"{name}_{ending}".rstrip("_"), []).append((row, convert))
    return keys

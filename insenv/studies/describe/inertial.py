"""The inertial side of a log: which columns are gyros and accelerometers, their units, whether they are rates or increments,
and how the unit is mounted.

Gravity shows the unit of the accelerometers and, with the time stamps, rates or increments.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from insenv.core.tables import Array
from insenv.logs.noise import REST_RATE
from insenv.logs.units import ACCEL_UNITS, GYRO_UNITS
from insenv.studies.describe.agreement import Motion, Track
from insenv.studies.describe.tables import LogTable

GRAVITY = 9.80665
NEAR = 0.12
"""Part by which the median specific force of a vehicle may differ from gravity."""
GYRO_LIMIT = np.radians(600.0)
"""Rate (rad/s) that 99 of 100 samples of a vehicle do not exceed."""
GYRO_FLOOR = np.radians(1.0 / 3600.0)
"""Rate (rad/s) that the largest samples exceed."""

_AXES = {"x": 0, "y": 1, "z": 2, "0": 0, "1": 1, "2": 2}
_GYRO_NAME = re.compile(
    r"gyr|omega|ang(ular)?[_ .]?(rate|vel)|delta[_ ]?angle|d(elta)?[_ ]?theta|dang|(^|[^a-z])(g|w|om|rate|dtheta)[_. \[(]*$",
    re.IGNORECASE,
)
_ACCEL_NAME = re.compile(r"acc|specific[_ ]?force|delta[_ ]?vel|dvel|(^|[^a-z])(a|f|sf|dv)[_. \[(]*$", re.IGNORECASE)
_OTHER_NAME = re.compile(
    r"mag|(^|[^a-z])(m|b|q|quat|pos|vel|v|orientation|euler|p|r|cov)[_. \[(]*$|field|baro|temp|covariance", re.IGNORECASE
)
GYRO_NAMES = {
    "deg/s": r"deg[_ ]*(/|per|p)?[_ ]*s|°/s|dps",
    "rad/s": r"rad[_ ]*(/|per|p)?[_ ]*s",
    "deg/h": r"deg[_ ]*(/|per)[_ ]*h",
    "rad": r"rad\W*$",
    "deg": r"deg\W*$",
}
ACCEL_NAMES = {
    "mg": r"[\[(_ /]mg\W*$",
    "g": r"[\[(_ /]g\W*$",
    "m/s2": r"m[_ ]*(/|per|p)?[_ ]*s[_ ]*(\^|\*\*)?[_ ]*(2|²)|m/s/s|mps2",
    "m/s": r"m/s\W*$|mps\W*$",
}


@dataclass(frozen=True)
class Triads:
    """Columns of gyros and accelerometers in the order x, y, z of their names, or, without names, of the file."""

    gyro: tuple[int, int, int]
    accel: tuple[int, int, int]
    named: bool


def named_triads(table: LogTable, taken: Sequence[int]) -> dict[tuple[int, int, int], str]:
    """Columns whose names differ by x, y, z alone, and what is common to them."""
    groups: dict[str, dict[int, int]] = {}
    for column, name in enumerate(table.names):
        if column in taken or not name:
            continue
        for letter_match in re.finditer(r"(?<![a-z])([xyz012])(?![a-z0-9])|([xyzXYZ])(?![a-z])", name):
            letter = letter_match[0].lower()
            common = f"{name[: letter_match.start()]}\0{name[letter_match.end() :]}"
            groups.setdefault(common, {}).setdefault(_AXES[letter], column)
        rates = re.fullmatch(r"(?i)([pqr])((?:[_ \[(].*)?)", name)
        if rates:
            groups.setdefault(f"gyro\0{rates[2]}", {}).setdefault("pqr".index(rates[1].lower()), column)
        spoken = re.fullmatch(r"(?i)(roll|pitch|yaw)([_ ]?(rate|speed|vel).*)", name)
        if spoken:
            groups.setdefault(f"gyro\0{spoken[2]}", {}).setdefault(("roll", "pitch", "yaw").index(spoken[1].lower()), column)
    return {
        (g[0], g[1], g[2]): common.replace("\0", "")
        for common, g in groups.items()
        if len(g) == 3 and len(set(g.values())) == 3
    }


def kind_of_name(common: str) -> str:
    """ "gyro", "accel", "other" or "" by what is common to the names of three columns."""
    bare = re.sub(r"[\[(].*?[\])]|_?(rad|deg|m)[_/]?(s2?|ps2?)?\W*$", "", common).strip()
    if _ACCEL_NAME.search(bare):
        return "accel"
    if _GYRO_NAME.search(bare):
        return "gyro"
    return "other" if _OTHER_NAME.search(bare) else ""


def triads_of(table: LogTable, taken: Sequence[int], interval: float) -> list[Triads]:
    """What may be the gyros and accelerometers of a table: by names, or any two blocks of three columns; empty if none."""
    named = named_triads(table, taken)
    kinds = {columns: kind_of_name(common) for columns, common in named.items()}
    usable = {columns: kind for columns, kind in kinds.items() if kind != "other" and _filled(table, columns)}
    accel = [c for c, kind in usable.items() if kind == "accel" and accel_units(table.values[:, c], interval)]
    accel = accel or [c for c, kind in usable.items() if kind == "" and accel_units(table.values[:, c], interval)]
    gyro = [c for c, kind in usable.items() if kind == "gyro"] or [
        c for c, kind in usable.items() if kind == "" and c not in accel
    ]
    pairs = [Triads(g, a, True) for a in accel for g in gyro if g != a]
    if pairs or any(kind in ("gyro", "accel") for kind in kinds.values()):
        return pairs
    free = [
        c for c in range(table.values.shape[1]) if c not in taken and _filled(table, (c,)) and np.ptp(table.values[:, c]) > 0
    ]
    blocks = [(c, c + 1, c + 2) for c in free if c + 1 in free and c + 2 in free]
    return [
        Triads(g, a, False)
        for a in blocks
        for g in blocks
        if not set(a) & set(g)
        and accel_units(table.values[:, a], interval)
        and np.abs(np.median(table.values[:, g], axis=0)).max() > 0
    ]


def _filled(table: LogTable, columns: Sequence[int]) -> bool:
    return bool(np.isfinite(table.values[:, columns]).all(axis=1).mean() > 0.9)


def accel_units(values: Array, interval: float) -> list[tuple[str, str, float]]:
    """Kind, unit and SI size of the columns (n, 3) for which their median size is about gravity."""
    size = float(np.nanmedian(np.linalg.norm(values, axis=1)))
    choices = [("rate", unit, scale) for unit, scale in ACCEL_UNITS["rate"].items()]
    choices += [("increment", unit, scale / interval) for unit, scale in ACCEL_UNITS["increment"].items()]
    return [(kind, unit, scale) for kind, unit, scale in choices if abs(size * scale / GRAVITY - 1.0) < NEAR]


def gyro_units(values: Array, kind: str, interval: float) -> list[tuple[str, float]]:
    """Unit and SI size of the columns (n, 3) for which the rates are those of a vehicle."""
    top = float(np.nanquantile(np.abs(values - np.nanmedian(values, axis=0)).max(axis=1), 0.99))
    span = interval if kind == "increment" else 1.0
    fitting = [(unit, scale / span) for unit, scale in GYRO_UNITS[kind].items() if GYRO_FLOOR < top * scale / span < GYRO_LIMIT]
    return [each for each in fitting if not each[0].endswith("/h")] or fitting


@dataclass(frozen=True, eq=False)
class Choice:
    """One assumption: columns, kind, units with their SI sizes, order of the gyros (3, 3) among the accelerometers' axes,
    sign of the accelerometers."""

    triads: Triads
    kind: str
    gyro_unit: str
    gyro_scale: float
    accel_unit: str
    accel_scale: float
    order: Array
    sign: float = 1.0

    def motion(self, table: LogTable, track: Track) -> tuple[Motion, Array | None]:
        """The samples in SI, gyros in their own columns, and their mean at rest."""
        rows = np.asarray(np.isfinite(table.values[:, [*self.triads.gyro, *self.triads.accel]]).all(axis=1))
        rows[1:] &= np.diff(table.seconds) > 0
        values, time = table.values[rows], table.seconds[rows]
        gyro, accel = values[:, self.triads.gyro] * self.gyro_scale, values[:, self.triads.accel] * self.accel_scale
        return Motion(time, gyro, accel), _at_rest(time, gyro, track)

    @property
    def plain(self) -> bool:
        """Whether gyros and accelerometers have the same axes."""
        return self.sign > 0 and bool(np.array_equal(self.order, np.eye(3)))

    @property
    def same_axes(self) -> bool:
        """Whether they have the same axes but for the sign of the force."""
        return bool(np.array_equal(self.order, np.eye(3)))

    @property
    def units(self) -> tuple[object, ...]:
        """All but the axes."""
        return self.triads, self.kind, self.gyro_unit, self.accel_unit


REST_SPEED, REST_S, LEAST_REST_S = 0.3, 10.0, 3.0
"""Mean speed (m/s) over this time (s) up to which a vehicle is at rest, and the shortest rest (s) whose mean rate counts."""


def _at_rest(time: Array, rate: Array, track: Track) -> Array | None:
    """The mean rate (3,) rad/s while fixes and gyros show no motion; None if there is no such time."""
    at, velocity = track.speeds
    if len(at) < 10:
        return None
    width = max(round(REST_S / float(np.median(np.diff(at)))), 1)
    smooth = np.column_stack([np.convolve(column, np.ones(width) / width, "same") for column in velocity.T])
    slow = np.interp(time, at, np.hypot(smooth[:, 0], smooth[:, 1])) < REST_SPEED
    slow &= (time >= at[0]) & (time <= at[-1])
    per = max(round(1.0 / float(np.median(np.diff(time)))), 2)
    count = len(time) // per
    parts, still = rate[: count * per].reshape(count, per, 3), slow[: count * per].reshape(count, per).all(axis=1)
    still &= parts.std(axis=1).max(axis=1) < np.maximum(REST_RATE, 3 * np.quantile(parts.std(axis=1).max(axis=1), 0.02))
    if np.count_nonzero(still) < LEAST_REST_S:
        return None
    return np.asarray(np.median(parts[still].mean(axis=1), axis=0))


def choices_of(table: LogTable, triads: Sequence[Triads], interval: float) -> Iterator[Choice]:
    """What units and kinds are plausible, in the order in which the columns are."""
    for each in triads:
        for kind, accel_unit, accel_scale in accel_units(table.values[:, each.accel], interval):
            for gyro_unit, gyro_scale in gyro_units(table.values[:, each.gyro], kind, interval):
                yield Choice(each, kind, gyro_unit, gyro_scale, accel_unit, accel_scale, np.eye(3))

"""Whether the units and columns that a description declares are those of the log, by the log's own data.

A wrong unit is wrong by a factor that is known.  A log is refused where its data fit another unit of the same key, or another
order of the same columns, and not the declared one:

- the specific force is that of gravity: at rest within what the grade allows, under way in the median;
- gyros turn as the course of the fixes does, or as the specific force of a vehicle that sways;
- gyros at rest have the noise and the bias of their grade;
- positions move by the integral of the velocities;
- an instrument reads what its equation says at the velocity and the place of the log, within its stated errors.

What contradicts the declared unit and fits no other is a note, of those here and in `insenv.logs.rest`, or left to the health
of the filter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.geodesy import OMEGA_IE, STANDARD_GRAVITY
from insenv.logs.description import ImuSection
from insenv.logs.files import all_of
from insenv.logs.noise import noise_at_rest
from insenv.logs.recorded import NO_INFORMATION, Readings, RecordedLog
from insenv.logs.rest import (
    BLOCKS,
    RATE_SIGMAS,
    REST_SAMPLES,
    REST_TURN,
    STEADY_S,
    WRONG_RATIO,
    rest_of,
    rest_rows,
    rest_until,
    turn_ratio,
)
from insenv.logs.units import ACCEL_UNITS, GYRO_UNITS
from insenv.sensors import registry
from insenv.sensors.instrument import Column
from insenv.sensors.level_equation import Level, equation_at
from insenv.vehicles import registry as vehicles

SIGMAS = 5.0
"""Standard deviations of the grade, or of the stated errors of an instrument, that a right unit may be off."""
GRAVITY = 9.7, 9.9
"""Specific force at rest anywhere on the Earth, with a margin of 10 mg (m/s^2)."""
FITS = float(np.log(1.4))
"""Logarithm of the factor by which data may differ from those in another unit that fits them: no two units are so close."""
LONGER_THAN_WAVES_S = 20.0
"""Shortest rest (s) whose force is that of gravity: a ship that heaves looks steady for a shorter time."""
UNDER_WAY = 2.0, 0.5
"""Factors of gravity above and below which 95 % of the specific force must be, besides the median, for a wrong unit."""


def check_units(log: RecordedLog) -> None:
    """Raise one `InputError` for all units and columns of a log in text files that its data contradict."""
    all_of(lambda rule: rule(log), (_force, _gyros, _positions, _place, _readings))


def _others(units: Mapping[str, Mapping[str, float]], triad: str, section: ImuSection, interval: float) -> dict[str, float]:
    """What else the columns of a triad may hold, as keys of the description, and the factor by which they are read too large.

    interval: between samples (s).
    """
    declared, kind = getattr(section, f"{triad}_unit"), section.kind
    length = {"rate": 1.0, "increment": interval}
    read = units[kind][declared] / length[kind]
    return {
        f"{triad}_unit = {unit!r}" + f" with kind = {of!r}" * (of != kind): read * length[of] / si
        for of, names in units.items()
        for unit, si in names.items()
        if (of, unit) != (kind, declared)
    }


def _nearest(others: Mapping[str, float], ratio: float, fits: float = FITS) -> str:
    """The one of `others` whose factor is `ratio`, within exp(fits); empty if there is none."""
    name = min(others, key=lambda each: abs(np.log(ratio / others[each])))
    return name if abs(np.log(ratio / others[name])) < fits else ""


def _force(log: RecordedLog) -> None:
    section, interval = log.description.imu, float(np.median(log.dt))
    others, rows = _others(ACCEL_UNITS, "accel", section, interval), rest_rows(log)
    if (
        len(rows) >= REST_SAMPLES
        and log.dt[rows].sum() >= LONGER_THAN_WAVES_S
        and float(np.linalg.norm(rest_of(log, rows, 0).rate)) < REST_TURN
    ):
        parts = np.array_split(rows, BLOCKS)
        size = float(np.median([np.linalg.norm(log.delta_velocity[part].sum(axis=0)) / log.dt[part].sum() for part in parts]))
        allowed = SIGMAS * log.sensors(in_place=False).accel_bias_sigma
        low, high, where, by = (
            GRAVITY[0] - allowed,
            GRAVITY[1] + allowed,
            "at rest",
            f", by the {'grade of' if log.states_unit else 'class assumed of'} the unit",
        )
        wrong = not low <= size <= high
    else:  # a turn, a climb and a catapult are more than gravity for a while, an aircraft that circles for a whole log
        sizes = np.linalg.norm(log.delta_velocity, axis=1) / log.dt
        least, size, most = (float(np.quantile(sizes, part)) for part in (0.05, 0.5, 0.95))
        low, high, where, by = UNDER_WAY[1] * STANDARD_GRAVITY, UNDER_WAY[0] * STANDARD_GRAVITY, "in the median", ""
        wrong = size > 0.0 and (least > high or most < low) and bool(_nearest(others, size / STANDARD_GRAVITY))
    if not wrong:
        return
    ratio = size / STANDARD_GRAVITY
    name = _nearest(others, ratio) if ratio > 0.0 else ""
    raise InputError(
        f"imu.accel_unit = {section.accel_unit!r}: {where} the specific force is {size:.4g} m/s2, {ratio:.3g} times that of "
        f"gravity; allowed is {low:.3g} to {high:.3g} m/s2{by}; {_fit(name, 'see accel_unit, accel_scale, kind and grade')}"
    )


def _fit(name: str, otherwise: str) -> str:
    return f"the columns fit {name}" if name else otherwise


def _gyros(log: RecordedLog) -> None:
    """Raise the first `InputError` of the rules for gyros: they say the same."""
    for rule in (_turns, _stillness, _earth):
        rule(log)


def _turns(log: RecordedLog) -> None:
    section, interval = log.description.imu, float(np.median(log.dt))
    others = _others(GYRO_UNITS, "gyro", section, interval)
    ratio, like, fits, differs = turn_ratio(log, log.gnss), "the course of the fixes", FITS, float(np.log(WRONG_RATIO))
    if ratio is None:
        ratio, like, fits, differs = swing_ratio(log), "the direction of the specific force", SWING_FITS, SWING_DIFFERS
    name = "" if ratio is None else _nearest(others, ratio, fits)
    if ratio is not None and name and abs(np.log(ratio)) > differs:
        raise InputError(
            f"imu.gyro_unit = {section.gyro_unit!r}: the gyros turn {ratio:.3g} times as far as {like}; the columns fit {name}"
        )


SWING_S = 0.2
"""Time over which means of the specific force are compared (s)."""
SWING_CORRELATION, SWING_FITS, SWING_DIFFERS = 0.85, float(np.log(3.0)), float(np.log(10.0))
"""Correlation from which force and gyros turn together; logarithms of the factors up to which they turn as far, because a ship
that pitches also surges (its force turns 0.9 to 2.3 times as far), and from which they do not."""


def swing_ratio(log: RecordedLog) -> float | None:
    """How many times as far the gyros turn as the direction of the specific force; None where both are not proportional.

    A force that does not change over the Earth turns by -omega x f in the body: of a ship that sways, of a unit on a turntable
    or in the hand.  In the curves of a car it turns further by far, because of the acceleration: a ratio below 1 counts only
    of a vehicle that is said to float.
    """
    per = max(round(SWING_S / float(np.median(log.dt))), 1)
    count = len(log.dt) // per
    if count < REST_SAMPLES:
        return None
    angle, velocity = (each[: count * per].reshape(count, per, 3).sum(axis=1) for each in (log.delta_angle, log.delta_velocity))
    force = velocity / log.dt[: count * per].reshape(count, per).sum(axis=1)[:, None]
    change = np.diff(force, axis=0)
    turned = -np.cross(0.5 * (angle[1:] + angle[:-1]), 0.5 * (force[1:] + force[:-1]))
    both, of_turns, of_changes = (np.sum(a * b, axis=0) for a, b in ((turned, change), (turned, turned), (change, change)))
    correlation = both / np.maximum(np.sqrt(of_turns * of_changes), 1e-300)
    axis = int(np.argmax(correlation))
    if correlation[axis] <= SWING_CORRELATION:
        return None
    kind, ratio = log.description.vehicle_kind, float(of_turns[axis] / both[axis])
    return ratio if ratio > 1.0 or (kind and vehicles.traits_of(kind).floats) else None


def rest_by_other_unit(log: RecordedLog) -> tuple[str, float, float] | None:
    """The unit of the gyros with which a log would begin at rest, its factor and the end of the rest (s); None if it begins so
    anyway, or with no unit."""
    section, interval = log.description.imu, float(np.median(log.dt))
    others = _others(GYRO_UNITS, "gyro", section, interval)
    others = {name: factor for name, factor in others.items() if np.log(factor) > SWING_DIFFERS}
    dt = log.dt[:, None]
    if log.rest is not None or log.is_flight:
        return None
    for name, factor in sorted(others.items(), key=lambda each: each[1]):
        rates, forces = log.delta_angle / (dt * factor), log.delta_velocity / dt
        until = rest_until(log.imu_time, rates, forces, log.gnss, log.description.initial.static_from_s)
        if until is not None and until - log.imu_time[0] >= STEADY_S:
            return name, factor, until
    return None


def rest_hint(log: RecordedLog) -> str:
    """End of a message that a log does not begin at rest: the unit of the gyros with which it would; empty if there is none."""
    other = rest_by_other_unit(log)
    return "" if other is None else f"; it would begin at rest if the columns of the gyros were {other[0]}"


NOISE_FITS, NOISE_CONTRADICTS = 4.0, 10.0
"""Factors of the white noise of the grade within which a unit has it, and beyond which it has not."""
KNOWN = 0.5
"""Part of the Earth's rate up to which a rate at rest must be known to show it."""


def _stillness(log: RecordedLog) -> None:
    """In another unit the gyros at rest have the noise and the rate that the grade allows, and in the declared one neither."""
    if not log.states_unit:
        return
    rest_seen, rows = rest_by_other_unit(log), rest_rows(log)
    if rest_seen is not None:
        rows = np.flatnonzero(log.imu_time <= rest_seen[2])
    elif len(rows) < REST_SAMPLES or log.dt[rows].sum() < STEADY_S:
        return
    rest, sheet, interval = rest_of(log, rows, 0), log.sensors(in_place=True), float(np.median(log.dt))
    noise = noise_at_rest(log.delta_angle[rows], interval) / sheet.angle_random_walk
    rate, scatter = float(np.linalg.norm(rest.rate)), RATE_SIGMAS * np.sqrt(3.0) * rest.rate_sigma
    bias = SIGMAS * np.sqrt(3.0) * sheet.gyro_bias_sigma
    if noise <= NOISE_CONTRADICTS or (rest_seen is None and rate <= OMEGA_IE + bias + scatter):
        return
    section = log.description.imu
    for name, factor in _others(GYRO_UNITS, "gyro", section, interval).items():
        noisy = 1.0 / NOISE_FITS < noise / factor < NOISE_FITS and abs(rate / factor - OMEGA_IE) < bias + scatter / factor
        turning = rest_seen is not None and bias < KNOWN * OMEGA_IE and abs(np.log(rate / factor / OMEGA_IE)) < FITS
        if noisy or turning:
            raise InputError(
                f"imu.gyro_unit = {section.gyro_unit!r}: for {rest.duration:.3g} s the accelerometers are at rest, the gyros "
                f"not, with {noise:.3g} times the noise of their grade; the columns fit {name}"
            )


def _earth(log: RecordedLog) -> None:
    """The rate at rest is that of the Earth in another unit, and cannot be in the declared one."""
    rows = rest_rows(log)
    if not log.states_unit or len(rows) < REST_SAMPLES or log.dt[rows].sum() < LONGER_THAN_WAVES_S:
        return
    rest, section = rest_of(log, rows, 0), log.description.imu
    rate = float(np.linalg.norm(rest.rate))
    allowed = SIGMAS * np.sqrt(3.0) * float(np.hypot(log.sensors(in_place=True).gyro_bias_sigma, rest.rate_sigma))
    if allowed > KNOWN * OMEGA_IE or abs(rate - OMEGA_IE) <= allowed or rate == 0.0:
        return
    name = _nearest(_others(GYRO_UNITS, "gyro", section, float(np.median(log.dt))), rate / OMEGA_IE)
    if name:
        raise InputError(
            f"imu.gyro_unit = {section.gyro_unit!r}: at rest the gyros measure {np.degrees(rate) * 3600:.3g} deg/h, and the "
            f"Earth turns with 15 deg/h; the columns fit {name}"
        )


# Positions and velocities.

STEP_S, LONGEST_S = 5.0, 3.0
"""Positions are compared over at least this time, with velocities at most so far apart (s)."""
CONTRADICTED, AGREE = 0.3, 0.1
"""Squared difference of way and integrated velocity over the larger square: above they differ, and up to which they agree."""
WAY_SIGMAS = 10.0
"""Standard deviations of the fixes that the way is long, rms."""
_SPEEDS = {"km/h": 3.6, "kn": 1.0 / 0.514444, "cm/s": 100.0, "mm/s": 1000.0}
"""Other units of a speed in m/s."""


def _positions(log: RecordedLog) -> None:
    all_of(lambda name: _moves(log, name), ("gnss", "reference"))


def _moves(log: RecordedLog, name: str) -> None:
    series, section = getattr(log, name), getattr(log.description, name)
    if series is None or series.latitude is None or series.velocity_n is None or section is None:
        return
    sigma = np.zeros((len(series.time), 3)) if name == "reference" else series.position_sigma
    time, speeds = series.time, series.velocity_n[:, :2]
    known = np.isfinite(speeds).all(axis=1)
    if getattr(series, "velocity_sigma", None) is not None:
        known &= series.velocity_sigma[:, :2].max(axis=1) < NO_INFORMATION
    steps = np.diff(time)
    ways = np.vstack([np.zeros(2), np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * steps[:, None], axis=0)])
    broken = np.concatenate([[0], np.cumsum((steps > LONGEST_S) | ~known[1:] | ~known[:-1])])
    ends = np.searchsorted(time, time + STEP_S)
    begins = np.flatnonzero(ends < len(time))
    ends = ends[begins]
    whole = broken[begins] == broken[ends]
    begins, ends = begins[whole], ends[whole]
    if not len(begins):
        return
    way = ways[ends] - ways[begins]
    noise = WAY_SIGMAS**2 * float(np.sum(sigma[begins, :2] ** 2 + sigma[ends, :2] ** 2))
    height = np.zeros(len(time))

    def moved(latitude: Array, longitude: Array) -> Array:
        places = latitude[ends], longitude[ends], height[ends], latitude[begins], longitude[begins], height[begins]
        return np.asarray(geodesy.numeric.ned_offset(*places))[:, :2]

    def differ(moved: Array, way: Array) -> float:
        size = max(float(np.sum(moved**2)), float(np.sum(way**2)))
        return float(np.sum((moved - way) ** 2)) / size if size > noise else np.inf

    declared = moved(series.latitude, series.longitude)
    if differ(declared, way) <= CONTRADICTED:
        return
    of_speed = f"{name}.{'speed_unit' if getattr(section, 'speed', None) is not None else 'velocity'}"
    unit = section.position_unit or "rad"
    factor = float(np.degrees(1.0))
    others: dict[str, Callable[[], float]] = {
        f"{name}.latitude and longitude: they are the other's columns": lambda: differ(
            moved(np.clip(series.longitude, -0.5 * np.pi, 0.5 * np.pi), series.latitude), way
        ),
        f"{name}.velocity: its first two columns are east and north": lambda: differ(declared, way[:, ::-1]),
        f"{name}.position_unit = {unit!r}: it is {'rad' if unit == 'deg' else 'deg'}": lambda: differ(
            declared * (factor if unit == "deg" else 1.0 / factor), way
        ),
        **{
            f"{of_speed}: it is in {speed}": lambda ratio=ratio: differ(declared, way / ratio)  # type: ignore[misc]
            for speed, ratio in _SPEEDS.items()
        },
    }
    best, text = min((each(), text) for text, each in others.items())
    if best <= AGREE:
        raise InputError(f"{text}, by the distance between positions {STEP_S:g} s apart and the velocities over it")


NEAR, FAR = 2e4, 2e5
"""Distances (m) of two places that are the same, and of two that are not."""


def _place(log: RecordedLog) -> None:
    """The fixes are near the place of [initial] or of the reference if latitude and longitude are exchanged, and only then."""
    gnss, initial, reference = log.gnss, log.description.initial, log.reference
    if gnss is None or abs(gnss.longitude[0]) > 0.5 * np.pi:
        return
    others: list[tuple[str, float, float]] = []
    if initial.latitude_deg is not None and initial.longitude_deg is not None:
        others.append(("[initial]", *np.radians([initial.latitude_deg, initial.longitude_deg])))
    if reference is not None and reference.latitude is not None and reference.longitude is not None:
        others.append(("[reference]", float(reference.latitude[0]), float(reference.longitude[0])))

    def apart(latitude: float, longitude: float, other: tuple[str, float, float]) -> float:
        return float(np.hypot(*np.ravel(geodesy.numeric.ned_offset(latitude, longitude, 0.0, *other[1:], 0.0))[:2]))

    latitude, longitude = float(gnss.latitude[0]), float(gnss.longitude[0])
    for other in others:
        if apart(latitude, longitude, other) > FAR and apart(longitude, latitude, other) < NEAR:
            far = apart(latitude, longitude, other) / 1000
            raise InputError(
                f"gnss.latitude and longitude: the fixes are {far:.3g} km from the place in {other[0]}, and near it if both "
                "are exchanged: one of the two has the other's columns"
            )


# Instruments.

LEAST_SPEED, FIX_SIGMAS = 3.0, 10.0
"""Speed over ground (m/s), also in standard deviations of the fixes, from which a measured speed is compared."""
LIKE, UNLIKE = 0.12, 0.25
"""Relative difference of a reading and its equation up to which a unit fits, and beyond which it does not."""
WIDEST = 0.75
"""Relative difference up to which a unit fits at most, however large the stated errors are."""
READINGS = 500
"""Readings that are compared, over the whole log."""
NOTHING = 0.05
"""Part of what an instrument should read that no error leaves: iron that outweighs the Earth's field does not cancel it."""


def _readings(log: RecordedLog) -> None:
    all_of(lambda each: _reading(log, *each), _columns_with_units(log))


def _columns_with_units(log: RecordedLog) -> Iterator[tuple[Readings, Column]]:
    for each in log.instruments:
        instrument = registry.instruments()[each.id]
        for column in instrument.columns:
            if column.units and column.row == instrument.compared.name and not instrument.angle:
                yield each, column


def _reading(log: RecordedLog, readings: Readings, column: Column) -> None:
    """The size of a reading in another unit is that of the instrument's equation, and in the declared one it is not."""
    section = getattr(log.description, readings.id, None)
    if section is None:
        return
    chosen = np.unique(np.linspace(0, len(readings.time) - 1, READINGS).astype(int))
    velocity_n, least = _ground(log, readings.time[chosen])
    instrument, v = registry.instruments()[readings.id], ca.SX.sym("velocity_n", 3)
    course = ca.atan2(v[1], v[0] + 1e-9)
    C_nb = ca.vertcat(
        ca.horzcat(ca.cos(course), -ca.sin(course), 0), ca.horzcat(ca.sin(course), ca.cos(course), 0), ca.SX([[0, 0, 1]])
    )
    height = 0.0 if log.gnss is None else float(np.median(log.gnss.height))
    value, errors, variances = equation_at(instrument, Level(C_nb, height, v), log.stated_errors, 1)
    outputs = [value, ca.jacobian(value, errors)]
    at = ca.Function("at", [v], [ca.densify(each) for each in ca.substitute(outputs, [errors], [ca.SX.zeros(errors.shape)])])
    read = np.linalg.norm(readings.columns()[column.row][chosen].reshape(len(chosen), -1), axis=1)
    should = np.array([float(np.linalg.norm(np.asarray(at(each)[0]))) for each in velocity_n])
    standing = float(np.linalg.norm(np.asarray(at(np.zeros(3))[0])))
    speed = np.hypot(velocity_n[:, 0], velocity_n[:, 1])
    use = (should >= 0.5 * should.max()) & ((standing > 0.5 * should.max()) | (speed > least))
    if np.count_nonzero(use) < BLOCKS:
        return
    middle = velocity_n[use][int(np.argmin(np.abs(should[use] - np.median(should[use]))))]
    J = np.asarray(at(middle)[1]).reshape(-1, len(variances))
    usual = float(np.median(should[use]))
    stated = SIGMAS * float(np.sqrt(np.sum(J**2 @ variances))) / usual
    ratio = float(np.median(read[use] / should[use]))
    key = column.unit_key or f"{column.key}_unit"
    declared = getattr(section, key)
    if abs(ratio - 1.0) <= UNLIKE + stated and ratio > NOTHING:
        return
    of_unit = {unit: column.units[declared] / si for unit, si in column.units.items() if unit != declared}
    unit = min(of_unit, key=lambda each: abs(ratio / of_unit[each] - 1.0))
    if abs(ratio / of_unit[unit] - 1.0) <= min(LIKE + stated, WIDEST):
        raise InputError(
            f"{readings.id}.{key} = {declared!r}: {instrument.called} reads {ratio:.3g} times what it should where the log is, "
            f"and its stated errors do not explain that; the column fits {key} = {unit!r}"
        )


def _ground(log: RecordedLog, time: Array) -> tuple[Array, float]:
    """Velocity (n, 3) m/s, n, at times (n,) s by the fixes or the reference, and the speed (m/s) from which it counts.

    Zero and no speed where the log has none, which an instrument that measures a field does not ask for.
    """
    gnss, reference = log.gnss, log.reference
    if gnss is not None and gnss.velocity_n is not None and gnss.velocity_sigma is not None:
        known = gnss.velocity_sigma[:, :2].max(axis=1) < NO_INFORMATION
        of, velocity = gnss.time[known], gnss.velocity_n[known]
        sigma = float(np.median(gnss.velocity_sigma[known, :2])) if known.any() else np.inf
    elif reference is not None and reference.velocity_n is not None:
        of, velocity, sigma = reference.time, reference.velocity_n, 0.0
    else:
        return np.zeros((len(time), 3)), np.inf
    if not len(of):
        return np.zeros((len(time), 3)), np.inf
    level: list[Any] = [np.interp(time, of, velocity[:, axis]) for axis in (0, 1)]
    return np.column_stack([*level, np.zeros(len(time))]), max(LEAST_SPEED, FIX_SIGMAS * sigma)

"""Rows that several estimators share: places, start, sensor errors, inertial samples, fixes, outputs.

An estimator takes whole tables, or some of their rows with its own start values by `chosen`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from insenv.core.elementary import select
from insenv.core.tables import Row, Table
from insenv.geodesy import bounded_place_rows, place_rows
from insenv.sensors.gnss import ARM, COMMON, FIX, WANDER

_TURN = 2 * math.pi
_LARGEST = 1e12


def chosen(table: Table, *names: str, **start: Any) -> Table:
    """The rows of `table` with these names, in this order (all without names), with start values by name."""
    rows = [table[name] for name in names] if names else list(table)
    return Table(tuple(replace(row, start=start.get(row.name, row.start)) for row in rows))


def at_start(table: Table) -> dict[str, Any]:
    """State rows at their start values: sums over an interval begin anew."""
    return vars(table.symbols(ca.SX(ca.DM(table.start_vector()))))


def values_of(x: Any, names: Iterable[str]) -> dict[str, Any]:
    """Those values of `x` by name."""
    return {name: getattr(x, name) for name in names}


PLACE = Table(bounded_place_rows())
"""Parameters: the place of a vehicle that stays in place."""

START_ATTITUDE = Table((
    Row("start_roll", "Roll at the start", "rad", lower=-_TURN, upper=_TURN),
    Row("start_pitch", "Pitch at the start", "rad", lower=-_TURN, upper=_TURN),
    Row("start_heading", "Heading at the start", "rad", lower=-_TURN, upper=_TURN),
))  # fmt: skip
START_VELOCITY = Table((Row("start_velocity_n", "Velocity at the start", "m/s", (3,), "n", lower=-1e4, upper=1e4),))
START = Table(bounded_place_rows("start_", " at the start")) + START_VELOCITY + START_ATTITUDE
"""Parameters: the navigation state at the start."""

START_SIGMAS = Table((
    Row("position_sigma", "Standard deviation of the start position, north, east, down", "m", (3,), "n", 10.0, 0, _LARGEST),
    Row("velocity_sigma", "Standard deviation of the start velocity", "m/s", (3,), "n", 1.0, 0, _LARGEST),
    Row("tilt_sigma", "Standard deviation of the start roll and pitch", "rad", start=math.pi / 180, lower=0, upper=_LARGEST),
    Row("heading_sigma", "Standard deviation of the start heading", "rad", start=5 * (math.pi / 180), lower=0, upper=_LARGEST),
))  # fmt: skip
"""Parameters: errors of the start."""

START_BIASES = Table((
    Row("start_gyro_bias", "Gyro bias at the start", "rad/s", (3,), "b", lower=-1, upper=1),
    Row("start_accel_bias", "Accelerometer bias at the start", "m/s^2", (3,), "b", lower=-100, upper=100),
    Row("start_gyro_bias_error", "Standard deviation of the start gyro bias if the start attitude is right; 0: gyro_bias_sigma",
        "rad/s", lower=0, upper=1),
    Row("start_rest_share", "Part of the start gyro bias that is the rate at rest minus the Earth's rate in the start attitude",
        "1", lower=0, upper=1),
))  # fmt: skip

SENSORS = Table((
    Row("gyro_bias_sigma", "Standard deviation of the gyro bias", "rad/s", lower=0, upper=_LARGEST),
    Row("accel_bias_sigma", "Standard deviation of the accelerometer bias", "m/s^2", lower=0, upper=_LARGEST),
    Row("gyro_correlation_time", "Correlation time of the gyro bias", "s", start=3600.0, lower=1e-3, upper=_LARGEST),
    Row("accel_correlation_time", "Correlation time of the accelerometer bias", "s", start=3600.0, lower=1e-3, upper=_LARGEST),
    Row("angle_random_walk", "White noise density of the gyros", "rad/s^0.5", lower=0, upper=_LARGEST),
    Row("velocity_random_walk", "White noise density of the accelerometers", "m/s^1.5", lower=0, upper=_LARGEST),
))  # fmt: skip
"""Parameters: errors of the inertial unit, as on its data sheet."""

NOISES = chosen(SENSORS, "gyro_bias_sigma", "accel_bias_sigma", "angle_random_walk", "velocity_random_walk")
"""Those of `SENSORS` that an alignment states its accuracy from."""

LEVER_ARM = Table((ARM,))

SAMPLE_INPUTS = Table((
    Row("delta_angle", "Integral of the measured angular rate over the sample", "rad", (3,), "b", lower=-1e3, upper=1e3),
    Row("delta_velocity", "Integral of the measured specific force over the sample", "m/s", (3,), "b", lower=-1e5, upper=1e5),
    Row("dt", "Sample interval", "s", start=0.005, lower=1e-6, upper=10.0),
))  # fmt: skip
"""Inputs: one inertial sample, which every estimator takes."""

FIX_INPUTS = FIX
"""Inputs: one GNSS fix."""

STANDING_INPUT = Table((Row("standing", "1 when the vehicle is known to be at rest", lower=0, upper=1, flag=True),))
"""Input: what a log or a stream says of the vehicle."""

SMOOTHED_INPUT = Table((
    Row("smoothed", "1 when the smoothed state is wanted at this sample's end", lower=0, upper=1, flag=True),
))  # fmt: skip
"""Input: what the backward pass of a smoother is asked for."""

ALIGNMENT = Table((
    Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),
    Row("attitude_sigma", "Standard deviation of the attitude error about north, east, down", "rad", (3,), "n"),
))  # fmt: skip
"""Outputs of an alignment."""

NAVIGATION = chosen(ALIGNMENT, "q_nb") + Table((
    Row("velocity_n", "Velocity over the Earth", "m/s", (3,), "n"),
    *place_rows(),
))  # fmt: skip
"""Outputs of a navigation."""

BIASES = Table((
    Row("gyro_bias", "Estimated gyro bias", "rad/s", (3,), "b"),
    Row("accel_bias", "Estimated accelerometer bias", "m/s^2", (3,), "b"),
))  # fmt: skip

COUNTED = ("count", "refused_count", "nis_used", "nis_used_count", "nis_refused", "nis_refused_count")
"""Ends of the names of what a filter counts of the measurements of an instrument."""
REPORTED = ("innovation", "test_ratio", *COUNTED)
"""Ends of the names of what it reports of them."""


def reported(names: Sequence[str], title: str, what: str, unit: str, size: int, frame: str, parts: int) -> tuple[Row, ...]:
    """The rows `REPORTED` of measurements of `size` components, of which `parts` groups are summed apart."""
    rows: tuple[tuple[Any, ...], ...] = (
        (f"Last innovation of {title}: {what}", unit, (size,), frame),
        ("Innovation over its standard deviation, in the same order", "1", (size,), frame),
        (f"Measurements of {title} so far", "1"),
        ("Those of which the gate refused a component", "1"),
        ("Sum of the squared test ratios of the components used", "1", (parts,)),
        ("Number of these components", "1", (parts,)),
        ("Sum of the squared test ratios of the components refused", "1", (parts,)),
        ("Number of these components", "1", (parts,)),
    )
    return tuple(Row(name, *row) for name, row in zip(names, rows, strict=True))


FIX_REPORTED = Table(reported(
    ("innovation", "test_ratio", "fix_count", "fix_refused_count", *COUNTED[2:]),
    "GNSS", "position, then velocity", "m, m/s", 6, "n", 2,
))  # fmt: skip
FIX_HEALTH = Table(FIX_REPORTED.rows[2:])
"""Outputs, and state, of a filter that reports its health (`insenv.evaluation.health`): sums over all fixes so far."""


def aid_health(id: str) -> tuple[str, ...]:
    """Names of the outputs that say the same of an aid other than GNSS, in the order of `FIX_HEALTH`."""
    return tuple(f"{id}_{name}" for name in COUNTED)


def reported_aids(outputs: Iterable[str]) -> tuple[str, ...]:
    """Ids of the aids of which these outputs, by name, tell the health: all of `aid_health` are there."""
    names = tuple(outputs)
    ids = (name.removesuffix("_refused_count") for name in names if name.endswith("_refused_count"))
    return tuple(id for id in ids if set(aid_health(id)) <= set(names))


# GNSS/INS filters: `aqe-ekf`, `aqe-sukf`, and in part those of `fusion`

FIX_WANDER = Table((*WANDER.stated, COMMON))
MOTION_ERRORS = Table((
    Row("rotation_error", "Gyro scale factor and misalignment: tilt per radian of rotation", "1", lower=0, upper=1.0),
    Row("thrust_error", "Accelerometer scale factor and misalignment: velocity error per change of velocity", "1",
        lower=0, upper=1.0),
))  # fmt: skip
AIDED_OUTPUTS = NAVIGATION + BIASES + Table((
    Row("position_sigma", "Standard deviation of the position", "m", (3,), "n"),
    Row("velocity_sigma", "Standard deviation of the velocity", "m/s", (3,), "n"),
    ALIGNMENT["attitude_sigma"],
)) + FIX_REPORTED  # fmt: skip
STANDING_SIGMA = Table((
    Row("standing_sigma", "Standard deviation of the velocity of a vehicle at rest", "m/s", start=0.02, lower=1e-9, upper=1e3),
))  # fmt: skip


# What a filter counts of the measurements of an instrument: how many there were, how many were refused, and sums of their NIS.
#
# `insenv.evaluation.health` judges the instrument by these rows.


def counted(x: Any, names: Iterable[str], groups: Iterable[slice], present: Any, accept: Any, ratio: Any) -> dict[str, Any]:
    """The rows that count, after a measurement of m components.

    names: of the rows, in the order of `insenv.estimators.parts.rows.FIX_HEALTH`.  groups: components that are summed apart.
    present, accept (m each): 1 for a component that is there, and for one that was used.  ratio (m): innovations over their
    standard deviations, 0 for a component that is not there.
    """
    square, refused = ratio * ratio, present - accept

    def sums(values: Any) -> Any:
        return ca.vertcat(*[ca.sum1(values[group]) for group in groups])

    added = (
        1,
        select(ca.sum1(refused) > 0, 1.0, 0.0),
        sums(accept * square),
        sums(accept),
        sums(refused * square),
        sums(refused),
    )
    return {name: getattr(x, name) + more for name, more in zip(names, added, strict=True)}

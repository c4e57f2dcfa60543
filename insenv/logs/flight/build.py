"""Build a `RecordedLog` from a flight log: unit and receiver selected, one continuous segment, notes on what is missing."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields, replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.base.toml import validated
from insenv.logs.columns import window_words
from insenv.logs.description import LogDescription
from insenv.logs.flight import rosbag
from insenv.logs.flight.description import SUFFIXES, FlightDescription, format_of, is_bag_folder
from insenv.logs.flight.series import (
    AnySeries,
    FixSeries,
    Flight,
    FlightFormat,
    ImuSeries,
    SolutionSeries,
    lever_arm,
    longest,
    only,
    rows_of,
    settings,
    unit_rows,
)
from insenv.logs.inertial import implausible, increments, sampling
from insenv.logs.instruments import description_class, stated_errors
from insenv.logs.readers import read_bytes
from insenv.logs.recorded import GnssFixes, Readings, RecordedLog, Reference, Source
from insenv.logs.rest import rest_until
from insenv.logs.units import Array, wrap
from insenv.sensors.contract import Place

USABLE_HZ = 20.0
"""Lowest rate at which the attitude can be propagated through a vehicle's turns."""
SLOW_HZ = 90.0
POSITION_SIGMA = (2.5, 2.5, 5.0)
"""Assumed if a log states no accuracy: a single-frequency receiver under open sky (m)."""
VELOCITY_SIGMA = (0.3, 0.3, 0.5)
_NONE = "none"


def build_flight(description: FlightDescription, folder: Path) -> RecordedLog:
    """The log of a description; a relative path starts at `folder`. Raises InputError for any wrong input."""
    form = rosbag.FORMATS[0] if is_bag_folder(folder / description.flight) else format_of(description.flight)
    if form is None:
        raise InputError(
            f"flight = {description.flight!r}: its name must end in {SUFFIXES} (or that and .gz, .zip), or it is"
            " the folder of a ROS 2 bag"
        )
    label, data = read_bytes(description.flight, folder)
    flight = _read(form, label, data)
    notes = list(flight.notes)
    imu, part = _imu(label, form, flight, description, notes)
    sampled = sampling(imu.time, None, imu.name)
    notes += sampled.notes
    samples = np.hstack([imu.rate_ib_b, imu.specific_force_b])
    inertial = increments(imu.time, samples, sampled, "rate", imu.stamp, description.max_gap_s, imu.name)
    notes += implausible(inertial)

    fixes = _chosen(label, "gnss", flight.fixes, description.gnss)
    if fixes is not None:
        fixes = only(fixes, part, "gnss", notes)
    if fixes is None:
        notes.append("no GNSS: the log has no fixes" if not flight.fixes else "no GNSS: the log's fixes are not used")
    undulation = description.undulation_m
    if undulation is None and fixes is not None:
        undulation = fixes.undulation
    gnss = None if fixes is None else _gnss(fixes, description, undulation, notes)
    solution = _chosen(label, "reference", sorted(flight.solutions, key=lambda s: not s.true), description.reference)
    solution = None if solution is None else only(solution, part, "reference", notes)
    end, dt = inertial.imu_time, inertial.dt
    span = float(end[0]), float(end[-1])
    if gnss is not None and (gnss.time[-1] < span[0] or gnss.time[0] > span[1]):
        notes.append(f"no GNSS: its times do not overlap those of the inertial unit, {span[0]:.3f} to {span[1]:.3f} s")
        gnss = None
    reference = None if solution is None else _reference(solution, span, undulation or 0.0, notes)
    readings = _readings(flight, part, span, undulation or 0.0)
    arm, description = _lever_arm(flight, description, gnss is not None, notes)
    description = _placed(flight, description, gnss, notes)
    place = _place(gnss, description)
    if place is None:  # nothing tells the field of the Earth
        readings = tuple(each for each in readings if each.id != "magnetometer")
    unit = None if description.grade else unit_rows(flight.parameters)
    tuned = settings(flight.parameters)
    if unit is not None:
        notes.append("the data sheet of the inertial unit is that of the simulated one, by the parameters in the log")
    if tuned:
        notes.append(f"settings of {', '.join(tuned)} by the parameters in the log")
    rest = rest_until(
        end, inertial.delta_angle / dt[:, None], inertial.delta_velocity / dt[:, None], gnss, description.initial.static_from_s
    )
    return RecordedLog(
        **vars(inertial),
        gnss=gnss,
        lever_arm_b=arm,
        reference=reference,
        sources=(Source("flight", label, flight.rows, len(imu.time), hashlib.sha256(data).hexdigest()),),
        notes=tuple(notes),
        description=_as_log_description(description, label, form, imu, fixes, rest),
        unit=unit,
        settings=tuned,
        instruments=readings,
        told={name: value for each in readings for name, value in stated_errors(each.id, None, place).items()},
    )


def _readings(flight: Flight, part: int, span: tuple[float, float], undulation: float) -> tuple[Readings, ...]:
    """The readings of the segment that is used, heights above the ellipsoid."""
    found = []
    for each in flight.readings:
        own = only(each, part, each.id, [])
        if own is None or own.time[-1] < span[0] or own.time[0] > span[1]:
            continue
        found.append(replace(own, values=own.values + undulation) if own.id == "barometer" else own)
    return tuple(found)


def _place(gnss: GnssFixes | None, description: FlightDescription) -> Place | None:
    """The first fix, or the stated place; None if neither is there."""
    initial = description.initial
    if gnss is not None:
        return Place(float(gnss.latitude[0]), float(gnss.longitude[0]), float(gnss.height[0]))
    if initial.latitude_deg is not None and initial.longitude_deg is not None:
        return Place(radians(initial.latitude_deg), radians(initial.longitude_deg), initial.height_m or 0.0)
    return None


def _read(form: FlightFormat, label: str, data: bytes) -> Flight:
    try:
        return form.read(label, data)
    except InputError:
        raise
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:  # wrong names or sizes of columns in a damaged file
        raise InputError(f"{label}: the log is damaged, or of an unknown kind: {type(error).__name__}: {error}") from None


def _chosen(label: str, key: str, series: Sequence[AnySeries], wanted: str) -> AnySeries | None:
    if wanted == _NONE:
        return None
    if not wanted:
        return series[0] if series else None
    found = next((one for one in series if one.name == wanted), None)
    if found is None:
        raise InputError(f"{label}: no {key} {wanted!r} in the log{nearest(wanted, [one.name for one in series])}")
    return found


def _imu(
    label: str, form: FlightFormat, flight: Flight, description: FlightDescription, notes: list[str]
) -> tuple[ImuSeries, int]:
    """The unit's samples of one segment, and the number of restarts of the clock before them."""
    found = ", ".join([f"{imu.name} at {imu.rate_hz:.3g} Hz" for imu in flight.imus] + list(flight.others)) or "none at all"
    imu = _chosen(label, "imu", flight.imus, description.imu)
    if imu is None or imu.rate_hz < USABLE_HZ:
        raise InputError(
            f"{label}: this {form.kind} has no inertial unit at a usable rate, {USABLE_HZ:g} Hz or more: found {found};"
            f" {form.hint}"
        )
    notes.append(f"inertial unit: {imu.name} at {imu.rate_hz:.4g} Hz (in the log: {found})")
    if imu.rate_hz < SLOW_HZ:
        notes.append(f"{imu.rate_hz:.3g} Hz is a low rate: motion between the samples, such as vibration, is lost")
    finite = np.isfinite(imu.rate_ib_b).all(axis=1) & np.isfinite(imu.specific_force_b).all(axis=1)
    if not finite.all():
        notes.append(f"{np.count_nonzero(~finite)} samples with values that are not finite are skipped")
    low = -np.inf if description.start_s is None else description.start_s
    high = np.inf if description.stop_s is None else description.stop_s
    inside = np.asarray(finite & (imu.time >= low) & (imu.time <= high))
    if np.count_nonzero(inside) < 3:
        raise InputError(
            f"{label}: {np.count_nonzero(inside)} samples of {imu.name}"
            f" {window_words(description.start_s, description.stop_s)}: its times are {imu.time.min():.3f} to"
            f" {imu.time.max():.3f} s"
        )
    return longest(imu, inside, description.max_gap_s, notes)


def _gnss(fixes: FixSeries, description: FlightDescription, undulation: float | None, notes: list[str]) -> GnssFixes:
    notes.append(f"GNSS: {fixes.name}, {len(fixes.time)} fixes")
    height = fixes.height
    if fixes.height_sea:
        if undulation is None:
            notes.append(
                f"{fixes.name}: heights above mean sea level are used as ellipsoidal heights (undulation_m corrects it)"
            )
        height = height + (undulation or 0.0)
    position_sigma = _sigma(fixes.position_sigma, fixes, description.position_sigma_m, POSITION_SIGMA, "position", notes)
    velocity_sigma = None
    if fixes.velocity_n is None:
        notes.append(f"{fixes.name}: no velocity")
    else:
        velocity_sigma = _sigma(fixes.velocity_sigma, fixes, description.velocity_sigma_mps, VELOCITY_SIGMA, "velocity", notes)
    time = fixes.time + description.gnss_time_offset_s
    return GnssFixes(time, fixes.latitude, wrap(fixes.longitude), height, position_sigma, fixes.velocity_n, velocity_sigma)


def _lever_arm(
    flight: Flight, description: FlightDescription, fixes: bool, notes: list[str]
) -> tuple[Array, FlightDescription]:
    """Lever arm (3,) m: of the description, or by the parameters in the log, or 0; and the description with it."""
    if description.lever_arm_m is not None:
        return np.array(description.lever_arm_m), description
    found = lever_arm(flight.parameters) if fixes else None
    arm = np.zeros(3) if found is None else found[0]
    if found is not None:
        numbers = ", ".join(f"{value:.3g}" for value in arm)
        notes.append(f"lever arm of the antenna {numbers} m (forward, right, down), by the parameters {found[1]} in the log")
    return arm, description.model_copy(update={"lever_arm_m": tuple(float(value) for value in arm)})


def _placed(flight: Flight, description: FlightDescription, gnss: GnssFixes | None, notes: list[str]) -> FlightDescription:
    """The description with the place that the log states, if there are neither fixes nor a place in `[initial]`."""
    place, initial = flight.place, description.initial
    if place is None or gnss is not None or initial.latitude_deg is not None or initial.longitude_deg is not None:
        return description
    notes.append(f"the place is that of {place.name}, {np.degrees(place.latitude):.6f}, {np.degrees(place.longitude):.6f} deg")
    height = place.height + (description.undulation_m or 0.0 if place.height_sea else 0.0)
    found = {"latitude_deg": float(np.degrees(place.latitude)), "longitude_deg": float(np.degrees(place.longitude))}
    if initial.height_m is None:
        found["height_m"] = height
    return description.model_copy(update={"initial": initial.model_copy(update=found)})


def _sigma(
    stated: Array | None,
    fixes: FixSeries,
    wanted: tuple[float, ...] | None,
    assumed: tuple[float, ...],
    what: str,
    notes: list[str],
) -> Array:
    if wanted is None and stated is not None and not np.isnan(stated).any():
        return stated
    if wanted is None:
        numbers = ", ".join(f"{value:g}" for value in assumed)
        notes.append(f"the log states no accuracy of the fixes' {what}: {numbers} (N, E, D) assumed")
    return np.tile(np.array(assumed if wanted is None else wanted), (len(fixes.time), 1))


def _reference(solution: SolutionSeries, span: tuple[float, float], undulation: float, notes: list[str]) -> Reference | None:
    inside = (solution.time >= span[0]) & (solution.time <= span[1])
    if np.count_nonzero(inside) < 2:
        return None
    if solution.true:
        notes.append(f"reference: {solution.name}, a simulator's truth")
    else:
        notes.append(f"reference: {solution.name}, the vehicle's own estimate: errors against it are differences")
    columns = {each.name: getattr(rows_of(solution, inside), each.name) for each in fields(Reference)}
    columns |= {name: wrap(columns[name]) for name in ("longitude", "roll", "heading") if columns[name] is not None}
    if columns["height"] is not None and solution.height_sea:
        columns["height"] = columns["height"] + undulation
    lacking = [what for what, name in (("position", "latitude"), ("velocity", "velocity_n")) if columns[name] is None]
    if lacking:
        notes.append(f"{solution.name}: attitude without {' and '.join(lacking)}")
    return Reference(**columns)


def _as_log_description(
    description: FlightDescription,
    label: str,
    form: FlightFormat,
    imu: ImuSeries,
    fixes: FixSeries | None,
    rest: float | None,
) -> LogDescription:
    """The flight log as a description of text files: what a run reads of a description, and the columns that were used."""
    initial = description.initial
    if initial.static_until_s is None and rest is not None:
        initial = initial.model_copy(update={"static_until_s": rest})
    data: dict[str, Any] = {
        "title": description.title or Path(label).name,
        "source": description.source or f"{form.kind} {label}",
        "licence": description.licence,
        "start_s": description.start_s,
        "stop_s": description.stop_s,
        "imu": {
            "file": label,
            "time": "time",
            "gyro": [f"{imu.name}.rate_{axis}" for axis in "xyz"],
            "accel": [f"{imu.name}.force_{axis}" for axis in "xyz"],
            "kind": "rate",
            "stamp": imu.stamp,
            "gyro_unit": "rad/s",
            "accel_unit": "m/s2",
            "axes": "FRD",
            "grade": description.grade,
            "max_gap_s": description.max_gap_s,
        },
        "vehicle_kind": description.vehicle_kind,
        "in_place": description.in_place,
        "evaluation": description.evaluation.model_dump(),
        "estimator": description.estimator,
    }
    if fixes is not None:
        place = {name: f"{fixes.name}.{name}" for name in ("latitude", "longitude", "height")}
        data["gnss"] = {
            "file": label,
            "time": "time",
            **place,
            "position_unit": "rad",
            "position_sigma": [f"{fixes.name}.sigma_{axis}" for axis in "ned"],
            "lever_arm_m": description.lever_arm_m,
        }
    return validated(description_class(), data, label).model_copy(update={"initial": initial})

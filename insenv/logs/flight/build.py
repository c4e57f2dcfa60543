"""From a flight log to a `RecordedLog`: unit and receiver chosen, one unbroken stretch, and all that is missing said."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from insenv.errors import InputError, nearest
from insenv.files.toml import validated
from insenv.logs.assemble import Source
from insenv.logs.bridging import nominal_interval
from insenv.logs.description import LogDescription
from insenv.logs.flight.dataflash import read_dataflash
from insenv.logs.flight.description import FlightDescription
from insenv.logs.flight.series import FixSeries, Flight, ImuSeries, SolutionSeries
from insenv.logs.flight.stretches import longest, only, rest_until
from insenv.logs.flight.telemetry import read_telemetry
from insenv.logs.flight.ulog import read_ulog
from insenv.logs.recorded import GnssFixes, RecordedLog, Reference, increments, sanity
from insenv.logs.resources import read_bytes
from insenv.logs.units import Array, wrap

READERS: dict[str, Callable[[str, bytes], Flight]] = {
    ".tlog": read_telemetry,
    ".bin": read_dataflash,
    ".ulg": read_ulog,
}
"""By the end of a log's name, small letters."""
USABLE_HZ = 20.0
"""Below this rate no attitude can be carried through a vehicle's turns."""
SLOW_HZ = 90.0
POSITION_SIGMA = (2.5, 2.5, 5.0)
"""Assumed where a log states no accuracy: a single-frequency receiver under open sky (m)."""
VELOCITY_SIGMA = (0.3, 0.3, 0.5)
_HINTS = {
    "MAVLink telemetry log": "ask the vehicle for HIGHRES_IMU (SET_MESSAGE_INTERVAL), or take the log on its own card",
    "ArduPilot dataflash log": "LOG_BITMASK says what is logged: its IMU and fast bits",
    "PX4 ULog file": "SDLOG_PROFILE says what is logged: sensor_combined is in the default",
}
_NONE = "none"
AnySeries = TypeVar("AnySeries", ImuSeries, FixSeries, SolutionSeries)


def kind_of(name: str | Path) -> str:
    """The end of a log's name in small letters, that of packing (.gz, .zip) left out."""
    path = Path(str(name).lower())
    return Path(path.stem).suffix if path.suffix in (".gz", ".zip") else path.suffix


def is_flight_log(name: str | Path) -> bool:
    """Whether a name is that of a flight log."""
    return kind_of(name) in READERS


def load_flight(path: str | Path) -> RecordedLog:
    """A flight log of which nothing more is known.  Raises InputError."""
    path = Path(path)
    return build_flight(FlightDescription(flight=path.name), path.resolve().parent)


def build_flight(description: FlightDescription, folder: Path) -> RecordedLog:
    """The log of a description; a relative path starts at `folder`.  Raises InputError on any bad input."""
    if not is_flight_log(description.flight):
        raise InputError(f"flight = {description.flight!r}: its name must end in .tlog, .BIN or .ulg (or that and .gz, .zip)")
    label, data = read_bytes(description.flight, folder)
    flight = _read(label, description, data)
    notes = list(flight.notes)
    imu, part = _imu(label, flight, description, notes)
    interval = nominal_interval(imu.time, None, f"{label}: {imu.name}")
    samples = np.hstack([imu.rate_ib_b, imu.specific_force_b])
    end, angle, velocity, dt, bridged, gaps = increments(imu.time, samples, interval, "rate", imu.stamp, description.max_gap_s)
    sanity(velocity, dt, notes)

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
    span = float(end[0]), float(end[-1])
    if gnss is not None and (gnss.time[-1] < span[0] or gnss.time[0] > span[1]):
        notes.append(f"no GNSS: its times do not overlap the inertial unit's, {span[0]:.3f} to {span[1]:.3f} s")
        gnss = None
    reference = None if solution is None else _reference(solution, span, undulation or 0.0, notes)
    rest = rest_until(end, angle / dt[:, None], velocity / dt[:, None], gnss)
    return RecordedLog(
        end,
        angle,
        velocity,
        dt,
        gnss,
        np.array(description.lever_arm_m),
        reference,
        gaps,
        bridged,
        (Source("flight", label, flight.rows, len(imu.time), flight.sha256),),
        tuple(notes),
        _as_log_description(description, label, flight, imu, fixes, rest),
    )


def _read(label: str, description: FlightDescription, data: bytes) -> Flight:
    try:
        return READERS[kind_of(description.flight)](label, data)
    except InputError:
        raise
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:  # columns that a damaged file names or sizes wrongly
        raise InputError(f"{label}: the log is damaged, or of a kind not known here: {type(error).__name__}: {error}") from None


def _chosen(label: str, key: str, series: Sequence[AnySeries], wanted: str) -> AnySeries | None:
    if wanted == _NONE:
        return None
    if not wanted:
        return series[0] if series else None
    found = next((one for one in series if one.name == wanted), None)
    if found is None:
        raise InputError(f"{label}: no {key} {wanted!r} in the log{nearest(wanted, [one.name for one in series])}")
    return found


def _imu(label: str, flight: Flight, description: FlightDescription, notes: list[str]) -> tuple[ImuSeries, int]:
    """The unit's samples of one stretch, and after how many restarts of the clock that is."""
    found = ", ".join([f"{imu.name} at {imu.rate_hz:.3g} Hz" for imu in flight.imus] + list(flight.others)) or "none at all"
    imu = _chosen(label, "imu", flight.imus, description.imu)
    if imu is None or imu.rate_hz < USABLE_HZ:
        raise InputError(
            f"{label}: this {flight.kind} has no inertial unit at a usable rate, {USABLE_HZ:g} Hz or more: found {found};"
            f" {_HINTS[flight.kind]}"
        )
    notes.append(f"inertial unit: {imu.name} at {imu.rate_hz:.4g} Hz (in the log: {found})")
    if imu.rate_hz < SLOW_HZ:
        notes.append(f"{imu.rate_hz:.3g} Hz are few: motion between the samples, vibration above all, is lost")
    finite = np.isfinite(imu.rate_ib_b).all(axis=1) & np.isfinite(imu.specific_force_b).all(axis=1)
    if not finite.all():
        notes.append(f"{np.count_nonzero(~finite)} samples that are no finite numbers are left out")
    low = -np.inf if description.start_s is None else description.start_s
    high = np.inf if description.stop_s is None else description.stop_s
    inside = np.asarray(finite & (imu.time >= low) & (imu.time <= high))
    if np.count_nonzero(inside) < 3:
        raise InputError(
            f"{label}: {np.count_nonzero(inside)} samples of {imu.name} between start_s = {description.start_s} and stop_s ="
            f" {description.stop_s} s: its times are {imu.time.min():.3f} to {imu.time.max():.3f} s"
        )
    return longest(imu, inside, description.max_gap_s, notes)


def _gnss(fixes: FixSeries, description: FlightDescription, undulation: float | None, notes: list[str]) -> GnssFixes:
    notes.append(f"GNSS: {fixes.name}, {len(fixes.time)} fixes")
    height = fixes.height
    if fixes.height_sea:
        if undulation is None:
            notes.append(f"{fixes.name}: heights over the sea, taken for heights over the ellipsoid (undulation_m mends it)")
        height = height + (undulation or 0.0)
    count = len(fixes.time)
    position_sigma = _sigma(fixes.position_sigma, description.position_sigma_m, POSITION_SIGMA, count, "position", notes)
    velocity_sigma = None
    if fixes.velocity_n is None:
        notes.append(f"{fixes.name}: no velocity")
    else:
        velocity_sigma = _sigma(fixes.velocity_sigma, description.velocity_sigma_mps, VELOCITY_SIGMA, count, "velocity", notes)
    time = fixes.time - description.gnss_delay_s
    return GnssFixes(time, fixes.latitude, wrap(fixes.longitude), height, position_sigma, fixes.velocity_n, velocity_sigma)


def _sigma(
    stated: Array | None, wanted: tuple[float, ...] | None, assumed: tuple[float, ...], count: int, what: str, notes: list[str]
) -> Array:
    if wanted is None and stated is not None:
        return stated
    if wanted is None:
        numbers = ", ".join(f"{value:g}" for value in assumed)
        notes.append(f"the log states no accuracy of the fixes' {what}: {numbers} (N, E, D) assumed")
    return np.tile(np.array(assumed if wanted is None else wanted), (count, 1))


def _reference(solution: SolutionSeries, span: tuple[float, float], undulation: float, notes: list[str]) -> Reference | None:
    inside = (solution.time >= span[0]) & (solution.time <= span[1])
    if np.count_nonzero(inside) < 2:
        return None
    if solution.true:
        notes.append(f"reference: {solution.name}, a simulator's truth")
    else:
        notes.append(f"reference: {solution.name}, the vehicle's own estimate: what is printed are differences, not errors")
    height = solution.height + (undulation if solution.height_sea else 0.0)
    return Reference(
        time=solution.time[inside],
        latitude=solution.latitude[inside],
        longitude=wrap(solution.longitude[inside]),
        height=height[inside],
        velocity_n=None if solution.velocity_n is None else solution.velocity_n[inside],
        roll=wrap(solution.roll[inside]),
        pitch=solution.pitch[inside],
        heading=wrap(solution.heading[inside]),
    )


def _as_log_description(
    description: FlightDescription, label: str, flight: Flight, imu: ImuSeries, fixes: FixSeries | None, rest: float | None
) -> LogDescription:
    """What the rest of `insenv` reads of a description, said of the columns that were taken out of the log."""
    initial = description.initial
    if initial.static_until_s is None and rest is not None:
        initial = initial.model_copy(update={"static_until_s": rest})
    data: dict[str, Any] = {
        "title": description.title or Path(label).name,
        "source": description.source or f"{flight.kind} {label}",
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
    return validated(LogDescription, data, label).model_copy(update={"initial": initial})

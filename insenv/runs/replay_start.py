"""How a navigation estimator gets its start on a recorded log: from the log itself, or from the reference solution.

From the log: level from the mean specific force while the vehicle stands, heading from its first motion.  The attitude is
carried by the gyros (their mean at rest taken off) from rest with a heading of 0; the course over ground then minus the
heading carried is the heading at rest.  This needs no gyro good enough for the Earth's rotation and no reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.errors import InputError, InsenvError
from insenv.estimators import Knowledge, get
from insenv.logs import GnssFixes, RecordedLog
from insenv.plant.feeding import input_rows

Array = NDArray[np.float64]

COURSE_SPEED = 5.0  # m/s: above it the course over ground tells the heading to some degrees
COURSE_FIXES = 5  # so many of them are averaged
COURSE_SIGMA = np.radians(5.0)  # side slip and course noise
LEVEL_SIGMA = np.radians(0.5)  # of levelling with accelerometers of some milli-g


def from_reference(log: RecordedLog, first: int) -> Knowledge:
    """The reference solution's state where sample `first` begins."""
    reference = log.reference
    if reference is None or reference.roll is None or reference.velocity_n is None:
        raise InputError("start 'reference': the log's [reference] must give position, velocity and attitude")
    time = float(log.imu_time[first] - log.dt[first])
    if not reference.time[0] <= time <= reference.time[-1]:
        raise InputError(
            f"start 'reference' at {time:.3f} s: the reference covers {reference.time[0]:.3f} to {reference.time[-1]:.3f} s"
        )
    row = int(np.argmin(np.abs(reference.time - time)))
    assert reference.pitch is not None and reference.heading is not None
    return Knowledge(
        latitude=float(reference.latitude[row]),
        longitude=float(reference.longitude[row]),
        height=float(reference.height[row]),
        sample_interval=float(np.median(log.dt)),
        velocity_n=reference.velocity_n[row],
        roll=float(reference.roll[row]),
        pitch=float(reference.pitch[row]),
        heading=float(reference.heading[row]),
        position_sigma=np.full(3, 1.0),
        velocity_sigma=np.full(3, 0.1),
        tilt_sigma=float(np.radians(0.1)),
        heading_sigma=float(np.radians(0.5)),
        antenna_lever_arm=log.lever_arm_b,
        sensors=log.sensors(in_place=False),
    )


def from_log(log: RecordedLog, first: int) -> Knowledge:
    """Level and heading from the log alone, for a start where sample `first` begins, with the vehicle at rest there."""
    rest = _rest(log, first)
    force = (log.delta_velocity[rest] / log.dt[rest, None]).mean(axis=0)
    rate = (log.delta_angle[rest] / log.dt[rest, None]).mean(axis=0)
    roll = float(np.arctan2(-force[1], -force[2]))
    pitch = float(np.arctan2(force[0], np.hypot(force[1], force[2])))
    latitude, longitude, height, sigma = _rest_position(log, rest)

    initial = log.description.initial
    roll, pitch = (
        found if said is None else float(np.radians(said))
        for found, said in ((roll, initial.roll_deg), (pitch, initial.pitch_deg))
    )
    if initial.heading_deg is None:
        heading = _heading_from_motion(log, first, roll, pitch, rate)
    else:
        heading = float(np.radians(initial.heading_deg))
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(roll, pitch, heading))
    antenna = C_nb @ log.lever_arm_b
    place = geodesy.numeric.geodetic_from_ned_offset(-antenna, latitude, longitude, height)
    earth_rate_b = C_nb.T @ geodesy.numeric.earth_rate_n(latitude)
    return Knowledge(
        latitude=float(place[0]),
        longitude=float(place[1]),
        height=float(place[2]),
        sample_interval=float(np.median(log.dt)),
        roll=roll,
        pitch=pitch,
        heading=heading,
        position_sigma=sigma,
        velocity_sigma=np.full(3, 0.05),
        tilt_sigma=LEVEL_SIGMA,
        heading_sigma=COURSE_SIGMA,
        gyro_bias=rate - earth_rate_b,
        antenna_lever_arm=log.lever_arm_b,
        sensors=log.sensors(in_place=False),
    )


def _rest(log: RecordedLog, first: int) -> NDArray[np.intp]:
    """Samples at rest before the start (or, if there are none, at it), as the log's [initial] says."""
    initial = log.description.initial
    until = initial.static_until_s
    if until is None:
        raise InputError(
            "start 'coarse' of a navigation estimator: [initial] static_until_s must say until when the vehicle stands"
        )
    begin = initial.static_from_s if initial.static_from_s is not None else float(log.imu_time[0])
    rest = np.flatnonzero((log.imu_time >= begin) & (log.imu_time <= until))
    if len(rest) < 100:
        raise InputError(
            f"[initial] static_from_s = {begin:g} s to static_until_s = {until:g} s holds {len(rest)} samples: 100 are needed"
        )
    before = rest[rest < first]
    return before if len(before) >= 100 else rest


def _rest_position(log: RecordedLog, rest: NDArray[np.intp]) -> tuple[float, float, float, Array]:
    """Mean position of the antenna's fixes at rest (rad, rad, m) and its standard deviation (3, m)."""
    gnss, initial = log.gnss, log.description.initial
    if gnss is not None:
        still = (gnss.time >= log.imu_time[rest[0]]) & (gnss.time <= log.imu_time[rest[-1]])
        if still.any():
            mean = (gnss.latitude[still].mean(), gnss.longitude[still].mean(), gnss.height[still].mean())
            return float(mean[0]), float(mean[1]), float(mean[2]), gnss.position_sigma[still].mean(axis=0)
    if initial.latitude_deg is None or initial.longitude_deg is None or initial.height_m is None:
        raise InputError("no fix while the vehicle stands: [initial] must give latitude_deg, longitude_deg and height_m")
    return float(np.radians(initial.latitude_deg)), float(np.radians(initial.longitude_deg)), initial.height_m, np.ones(3)


def _heading_from_motion(log: RecordedLog, first: int, roll: float, pitch: float, rest_rate: Array) -> float:
    """Heading where sample `first` begins, from the course of the first fixes in motion."""
    if log.gnss is None:
        raise InputError("heading from motion needs [gnss]; or give [initial] heading_deg, or use --start reference")
    gnss, (time, velocity) = log.gnss, _ground_velocity(log.gnss)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    moving = np.flatnonzero((speed > COURSE_SPEED) & (time > log.imu_time[first]) & (time < log.imu_time[-1]))[:COURSE_FIXES]
    if len(moving) < COURSE_FIXES:
        raise InsenvError(
            f"heading from motion: fewer than {COURSE_FIXES} fixes are faster than {COURSE_SPEED:g} m/s; "
            "give [initial] heading_deg, or use --start reference"
        )
    last = int(np.searchsorted(log.imu_time, time[moving[-1]]))
    window = slice(first, last + 1)
    # any estimator that carries the attitude will do; the place is of no account for some minutes
    model = get("wander-sins").model
    runner = make_runner(model, {"start_latitude": float(gnss.latitude[0]), "start_roll": roll, "start_pitch": pitch})
    columns = {
        "delta_angle": log.delta_angle[window] - rest_rate * log.dt[window, None],
        "delta_velocity": log.delta_velocity[window],
        "dt": log.dt[window],
    }
    outputs = model.outputs.unpack(runner.run(last + 1 - first, input_rows(model, columns, last + 1 - first)))
    carried = attitude.numeric.to_euler(outputs["q_nb"])[2]
    at = np.searchsorted(log.imu_time[window], time[moving])
    course = np.arctan2(velocity[moving, 1], velocity[moving, 0])
    return float(np.angle(np.mean(np.exp(1j * (course - carried[at])))))


def _ground_velocity(gnss: GnssFixes) -> tuple[Array, Array]:
    """Times (s) and velocities over the ground (m/s, n): the receiver's, or differences of its positions at mid-time."""
    if gnss.velocity_n is not None:
        return gnss.time, gnss.velocity_n
    place = np.stack([gnss.latitude, gnss.longitude, gnss.height], axis=1)
    moved = geodesy.numeric.ned_offset(*place[1:].T, *place[:-1].T)
    return (gnss.time[1:] + gnss.time[:-1]) / 2, moved / np.diff(gnss.time)[:, None]

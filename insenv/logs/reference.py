"""The reference solution of a log: from its columns to position, velocity and attitude of the IMU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from insenv import attitude, geodesy
from insenv.core.tables import Array
from insenv.logs.assemble import LogReader, checked_position, ned_velocity
from insenv.logs.description import ReferenceSection
from insenv.logs.formats.csv_table import Column, TextTable
from insenv.logs.inertial import InertialSamples
from insenv.logs.recorded import Reference
from insenv.logs.units import ANGLE_UNITS, LOCAL_AXES, axes_matrix, of_ecef, of_local, wrap

Place = tuple[Array, Array, Array]
"""Latitude, longitude (n,) rad and height (n,) m above the ellipsoid."""
_LENGTH = 0.01
"""Largest difference of the length of a quaternion from 1: files round."""


def read_reference(section: ReferenceSection, reader: LogReader, imu: InertialSamples) -> Reference:
    """The reference of a section, at the IMU where it has an attitude by which its lever arm can be turned.

    imu: for the velocity of a point beside it.  Raises `InputError` for wrong columns or values.
    """
    table, time = reader.read("reference", section)
    place, C_ng = _place(section, table, reader)
    velocity, C_nb = _velocity(section, table, C_ng), _attitude(section, table, C_ng)
    arm = np.array(section.lever_arm_m)
    reference = Reference(time, lever_arm_b=arm if arm.any() else None, attitude_sigma=np.radians(section.attitude_sigma_deg))
    if place is not None:
        reference = replace(reference, latitude=place[:, 0], longitude=wrap(place[:, 1]), height=place[:, 2])
    if velocity is not None:
        reference = replace(reference, velocity_n=velocity)
    if section.roll is not None and _as_it_is(section):  # to the bit
        roll, pitch, heading = _angles(section, table)
        reference = replace(reference, roll=wrap(roll), pitch=pitch, heading=wrap(heading))
    elif C_nb is not None:
        roll, pitch, heading = attitude.numeric.to_euler(attitude.numeric.from_dcm(C_nb))
        reference = replace(reference, roll=roll, pitch=pitch, heading=wrap(heading))
    if C_nb is None or not arm.any():
        return reference
    known = None if place is None else (place[:, 0], place[:, 1], place[:, 2])
    known, velocity = at_imu(known, velocity, C_nb, body_rate(imu, time), arm)
    if known is not None:
        reference = replace(reference, latitude=known[0], longitude=known[1], height=known[2])
    return replace(reference, velocity_n=velocity, lever_arm_b=None)


def at_imu(
    place: Place | None, velocity_n: Array | None, C_nb: Array, rate_b: Array, lever_arm_b: Array
) -> tuple[Place | None, Array | None]:
    """Positions and velocities of a point, by its lever arm l from the IMU, moved to the IMU: by -C_nb l and by -C_nb (w x l).

    place: latitude, longitude (n,) rad, height (n,) m; velocity_n (n, 3) m/s; C_nb (n, 3, 3); rate_b (n, 3) rad/s: angular rate
    w of the body; lever_arm_b (3,) m.  Returns place and velocity; None of what is None.
    """
    if place is not None:
        latitude, longitude, height = geodesy.numeric.geodetic_from_ned_offset(-(C_nb @ lever_arm_b), *place)
        place = latitude, wrap(longitude), height
    if velocity_n is not None:
        velocity_n = velocity_n - np.einsum("kij,kj->ki", C_nb, np.cross(rate_b, lever_arm_b))
    return place, velocity_n


def body_rate(imu: InertialSamples, time: Array) -> Array:
    """The angular rate (n, 3) rad/s that the gyros show at times (n,) s; outside of the samples that of the nearest."""
    middle = imu.imu_time - 0.5 * imu.dt
    return np.column_stack([np.interp(time, middle, rate) for rate in (imu.delta_angle / imu.dt[:, None]).T])


def _place(section: ReferenceSection, table: TextTable, reader: LogReader) -> tuple[Array | None, Array]:
    """Latitude, longitude (rad), height (m), (n, 3), or None; and C_ng (n, 3, 3) from the axes of the section to n."""
    axes = LOCAL_AXES[section.navigation_axes]
    if section.position_ecef is not None:
        place, _ = of_ecef(table.columns(section.position_ecef))
    elif section.position_local is not None:
        assert section.origin_latitude_deg is not None and section.origin_longitude_deg is not None
        assert section.origin_height_m is not None
        origin = math.radians(section.origin_latitude_deg), math.radians(section.origin_longitude_deg), section.origin_height_m
        place, turned = of_local(table.columns(section.position_local) @ axes.T, origin)
        return place, turned @ axes
    elif section.height is not None:
        latitude, longitude = checked_position("reference", section, table, reader.notes)
        place = np.column_stack([latitude, longitude, table.column(section.height) + section.height_offset_m])
    else:
        return None, np.broadcast_to(axes, (len(table.lines), 3, 3))
    return place, np.broadcast_to(axes, (len(place), 3, 3))


def _velocity(section: ReferenceSection, table: TextTable, C_ng: Array) -> Array | None:
    """Velocity (n, 3) m/s, NED."""
    if section.velocity_ecef is not None:
        assert section.position_ecef is not None
        C_ne = of_ecef(table.columns(section.position_ecef))[1]
        return np.einsum("kij,kj->ki", C_ne, table.columns(section.velocity_ecef))
    velocity = ned_velocity(section, table)
    return velocity if velocity is None or _as_it_is(section) else np.einsum("kij,kj->ki", C_ng, velocity)


def _as_it_is(section: ReferenceSection) -> bool:
    """Whether the axes of the section are NED and FRD at the place itself."""
    frd = np.array_equal(axes_matrix(section.axes), np.eye(3))
    return section.navigation_axes == "NED" and section.position_local is None and frd


def _attitude(section: ReferenceSection, table: TextTable, C_ng: Array) -> Array | None:
    """C_nb (n, 3, 3); None for a reference without attitude."""
    if section.quaternion is not None:
        q = _quaternions(section.quaternion, table)
        q = q[:, [3, 0, 1, 2]] if section.quaternion_order == "xyzw" else q
        C_gc = attitude.numeric.to_dcm(q)
        C_gc = np.swapaxes(C_gc, 1, 2) if section.quaternion_direction == "nav-to-body" else C_gc
    elif section.roll is not None:
        C_gc = attitude.numeric.to_dcm(attitude.numeric.from_euler(*_angles(section, table)))
    else:
        return None
    return np.asarray(C_ng @ C_gc @ axes_matrix(section.axes).T)


def _quaternions(columns: Sequence[Column], table: TextTable) -> Array:
    """Unit quaternions (n, 4) in the order of the columns."""
    q = table.columns(columns)
    length = np.linalg.norm(q, axis=1)
    table.refuse(
        columns,
        np.abs(length - 1.0) > _LENGTH,
        lambda row, _: f"the quaternion has the length {length[row]:.4g}, allowed is 1",
        "; keep_where can exclude invalid rows",
    )
    return np.asarray(q / length[:, None])


def _angles(section: ReferenceSection, table: TextTable) -> tuple[Array, Array, Array]:
    """Roll, pitch, heading (n,) rad, in the axes of the section."""
    columns = [column for column in (section.roll, section.pitch, section.heading) if column is not None]
    assert section.attitude_unit is not None
    roll, pitch, heading = (table.column(column) * ANGLE_UNITS[section.attitude_unit] for column in columns)
    table.refuse(
        [columns[1]],
        np.abs(pitch) > math.pi / 2 + 1e-9,
        lambda row, _: (
            f"pitch is {math.degrees(pitch[row]):.6g} deg, allowed -90 to 90; check attitude_unit and the order of "
            "roll, pitch, heading"
        ),
    )
    return roll, pitch, heading

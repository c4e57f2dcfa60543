"""Messages of the sensors: inertial unit, magnetometer, barometer, GNSS.  Each function returns the values of the fields.

Specific forces and angular rates are means since the message was last sent, so that a client that integrates them
obtains what the unit measured, at any message rate; at the sample rate they are the samples themselves.
"""

from __future__ import annotations

from math import atan2, degrees, hypot, nan

import numpy as np

from insenv.core.tables import Vector
from insenv.mavlink.messages.fields import Values
from insenv.mavlink.messages.view import MILLI_G, View, wrapped
from insenv.mavlink.simulation import Fix

ACCELEROMETER, GYRO, MAGNETOMETER = 0b111, 0b111 << 3, 0b111 << 6
STATIC, DYNAMIC = 0b1101 << 9, 1 << 10
TESLA_TO_GAUSS, _HPA, KELVIN = 1e4, 1e-2, 273.15

GPS_FIX_TYPE_NO_FIX, GPS_FIX_TYPE_3D_FIX = 1, 3


def imu(view: View, name: str) -> Values:
    """HIGHRES_IMU and, for autopilots, HIL_SENSOR: as measured, without the estimated biases removed."""
    rates, forces, updated = means(view, name)
    air, readings = view.air, view.simulation.readings
    before = view.sent_readings.get(name, {})
    view.sent_readings[name] = dict(readings)
    if readings["magnetometer"] != before.get("magnetometer", 0):
        updated |= MAGNETOMETER
    if readings["barometer"] != before.get("barometer", 0):
        updated |= STATIC | (DYNAMIC if view.traits.airspeed else 0)
    return (
        view.time_us, *forces.tolist(), *rates.tolist(), *(air.magnetic_b * TESLA_TO_GAUSS).tolist(),
        air.pressure * _HPA, air.dynamic_pressure * _HPA, air.pressure_height, air.temperature - KELVIN, updated, 0,
    )  # fmt: skip


def raw_imu(view: View) -> Values:
    """RAW_IMU: milli-g, mrad/s and mG, as ArduPilot sends them; nothing in the vehicle has raw counts."""
    return view.time_us, *_milli(view, "RAW_IMU"), 0, _temperature(view)


def scaled_imu(view: View) -> Values:
    """SCALED_IMU: milli-g, mrad/s and mG, which is coarse: HIGHRES_IMU is not rounded."""
    return view.time_ms, *_milli(view, "SCALED_IMU"), _temperature(view)


def _milli(view: View, name: str) -> list[float]:
    rates, forces, _ = means(view, name)
    magnetic_mg = view.air.magnetic_b * TESLA_TO_GAUSS * 1e3
    return [*(forces * MILLI_G).tolist(), *(rates * 1e3).tolist(), *magnetic_mg.tolist()]


def _temperature(view: View) -> float:
    """In 0.01 degrees Celsius; 0 would mean "unknown"."""
    return round((view.air.temperature - KELVIN) * 100.0) or 1


def means(view: View, name: str) -> tuple[Vector, Vector, int]:
    """Mean rates (rad/s) and specific forces (m/s^2) since the message was last sent, and the bits of new values."""
    simulation = view.simulation
    before, sums = view.sent_increments.get(name, (0, np.zeros(6)))
    if simulation.samples == before:  # requested twice in a sample, or before the first
        before, sums = max(before - 1, 0), sums - simulation.last_increment
    elapsed = max(simulation.samples - before, 1) * simulation.interval
    mean = (simulation.increments - sums) / elapsed
    fresh = ACCELEROMETER | GYRO if simulation.truth["imu_valid"] and simulation.samples else 0
    view.sent_increments[name] = simulation.samples, simulation.increments.copy()
    return mean[:3], mean[3:], fresh


def scaled_pressure(view: View) -> Values | None:
    """SCALED_PRESSURE: the barometer; None before its first measurement."""
    air = view.air
    if not view.simulation.readings["barometer"]:
        return None
    celsius = (air.temperature - KELVIN) * 100.0
    return view.time_ms, air.pressure * _HPA, air.dynamic_pressure * _HPA, celsius, celsius


def gps_raw_int(view: View) -> Values | None:
    """GPS_RAW_INT: the latest fix of the antenna, stamped with its time of validity; None before the first fix.

    Dilutions of precision and the number of satellites are not simulated: they are sent as unknown.  h_acc, v_acc and
    vel_acc hold the accuracies that the receiver states.
    """
    fix = view.simulation.fix
    if fix is None:
        return None
    north, east, _ = fix.velocity_n.tolist() if fix.velocity_valid else (nan, nan, nan)
    horizontal, vertical = _accuracies(fix)
    speed = float(np.sqrt(np.mean(fix.velocity_sigma**2))) if fix.velocity_valid else 0.0
    return (
        round(fix.time * 1e6), GPS_FIX_TYPE_3D_FIX if view.has_lock else GPS_FIX_TYPE_NO_FIX, *_place(view, fix), nan, nan,
        hypot(north, east) * 1e2, _course(north, east), nan, fix.height * 1e3,
        horizontal * 1e3, vertical * 1e3, speed * 1e3, 0, nan,
    )  # fmt: skip


def hil_gps(view: View) -> Values | None:
    """HIL_GPS: each fix once; while there is none, "no fix" at the receiver's rate, with the latest position.

    eph and epv are 1-sigma accuracies in cm, as PX4 reads them, not dilutions.
    """
    simulation = view.simulation
    fix, gnss = simulation.fix, simulation.plant.scenario.gnss
    if not view.has_lock:
        return None if gnss is None else _no_fix(view, gnss.interval_s, gnss.latency_s)
    if fix is None or view.sent_fix == simulation.fixes:
        return None
    view.sent_fix, view.sent_gps_at = simulation.fixes, simulation.samples
    north, east, down = fix.velocity_n.tolist() if fix.velocity_valid else (0.0, 0.0, 0.0)
    horizontal, vertical = _accuracies(fix)
    return (
        round(fix.time * 1e6), GPS_FIX_TYPE_3D_FIX, *_place(view, fix), horizontal * 1e2, vertical * 1e2,
        hypot(north, east) * 1e2 if fix.velocity_valid else nan, north * 1e2, east * 1e2, down * 1e2,
        _course(north, east) if fix.velocity_valid else nan, nan, 0, nan,
    )  # fmt: skip


def _no_fix(view: View, interval: float, latency: float) -> Values | None:
    """HIL_GPS without a fix, due one fix interval after the one before; the first fix may take one and a half."""
    simulation, fix = view.simulation, view.simulation.fix
    if simulation.samples - view.sent_gps_at < round(interval / simulation.interval):
        return None
    if fix is None and simulation.time < 1.5 * interval + latency:
        return None
    view.sent_gps_at = simulation.samples
    place = (0.0, 0.0, 0.0) if fix is None else _place(view, fix)
    time_us = round(max(simulation.time - latency, 0.0) * 1e6)
    return time_us, GPS_FIX_TYPE_NO_FIX, *place, nan, nan, nan, 0, 0, 0, nan, nan, 0, nan


def _place(view: View, fix: Fix) -> tuple[float, float, float]:
    return view.place(fix.latitude, wrapped(fix.longitude), fix.height)


def _accuracies(fix: Fix) -> tuple[float, float]:
    """Stated sigmas of the position (m): horizontal, the root mean square of north and east, and vertical."""
    north, east, down = fix.position_sigma.tolist()
    return hypot(north, east) / np.sqrt(2.0), down


def _course(north: float, east: float) -> float:
    """Course over ground, centidegrees from 0 to 35999; NaN at rest."""
    if not hypot(north, east) > 0.0:
        return nan
    return round(degrees(atan2(east, north)) * 100.0) % 36000

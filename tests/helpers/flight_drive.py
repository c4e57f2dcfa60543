"""Ten seconds of a simulated car, written as flight logs of each format."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from flight_writers import DataflashWriter, UlogWriter

from insenv import attitude, geodesy
from insenv.logs.formats.tlog import TlogWriter
from insenv.mavlink import Vehicle
from insenv.mavlink.wire import dialect
from insenv.scenario import load as load_scenario

UNDULATION = 45.0
SECONDS = 10.0
START_UNIX = 1.7e9


@dataclass
class Drive:
    """What was measured, and the estimate and truth at each sample."""

    vehicle: Vehicle
    messages: list[list[Any]]
    increments: np.ndarray
    estimate: dict[str, np.ndarray]
    truth: dict[str, np.ndarray]
    fixes: list[Any]

    @property
    def interval(self) -> float:
        return self.vehicle.simulation.interval

    @property
    def time_us(self) -> np.ndarray:
        return np.rint(np.arange(1, len(self.increments) + 1) * self.interval * 1e6).astype(np.int64)


@cache
def drive() -> Drive:
    rates = {"HIL_STATE_QUATERNION": 50.0}
    vehicle = Vehicle(load_scenario("car-city-drive"), "loosely-coupled", seed=4, rates=rates, start_unix=START_UNIX)
    vehicle.view.undulation = UNDULATION
    simulation = vehicle.simulation
    messages, increments, fixes = [], [], []
    names = ("q_nb", "velocity_n", "latitude", "longitude", "height")
    estimate, truth = [], []
    for _ in range(round(SECONDS / simulation.interval)):
        messages.append(vehicle.step())
        increments.append(simulation.last_increment.copy())
        estimate.append([np.array(simulation.estimate[name]) for name in names])
        truth.append([np.array(simulation.truth[name]) for name in names])
        if simulation.fixes > len(fixes):
            fixes.append((simulation.time, simulation.fix))
    series = [dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True)) for rows in (estimate, truth)]
    return Drive(vehicle, messages, np.array(increments), *series, fixes)


def telemetry(drive: Drive, path: Path, leave_out: Callable[[Any], bool] = lambda message: False) -> Path:
    packer = dialect().MAVLink(None, srcSystem=1, srcComponent=1)
    with TlogWriter(path) as log:
        for time_us, group in zip(drive.time_us, drive.messages, strict=False):
            for message in group:
                if not leave_out(message):
                    log.write(round(START_UNIX * 1e6) + int(time_us), message.pack(packer))
                    packer.seq = (packer.seq + 1) % 256
    return path


def dataflash(drive: Drive, path: Path) -> Path:
    """As ArduPilot writes: increments (IMT), fixes with their accuracy, its own solution (here the truth)."""
    log = DataflashWriter("IMT", "IMU", "GPS", "GPA", "ATT", "POS", "XKF1")
    dt, truth, fixes = drive.interval, drive.truth, list(drive.fixes)
    for i, (time_us, sample) in enumerate(zip(drive.time_us, drive.increments, strict=True)):
        log.add("IMT", time_us, 0, dt, dt, dt, *sample)
        if i % 8 == 0:
            log.add("IMU", time_us, 0, *(sample / dt))
        if fixes and time_us * 1e-6 >= fixes[0][0] - 1e-9:
            _, fix = fixes.pop(0)
            north, east, down = fix.velocity_n
            place = np.degrees(fix.latitude), np.degrees(fix.longitude), fix.height - UNDULATION
            speed, course = np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360
            stamp = round(fix.time * 1e6)
            log.add("GPS", stamp, 0, 4, 0, 0, 12, 0.8, *place, speed, course, down, 0, 1)
            horizontal, _, vertical = fix.position_sigma
            log.add("GPA", stamp, 0, 1, horizontal, vertical, fix.velocity_sigma[0], 0, 1, 0, 0)
        if i % 20 == 0:
            log.add("ATT", time_us, *np.degrees(attitude.numeric.to_euler(truth["q_nb"][i])))
            height = truth["height"][i] - UNDULATION
            log.add("POS", time_us, np.degrees(truth["latitude"][i]), np.degrees(truth["longitude"][i]), height)
            log.add("XKF1", time_us, 0, *truth["velocity_n"][i])
    path.write_bytes(log.data)
    return path


def ulog(drive: Drive, path: Path, start_us: int = 0) -> Path:
    """As PX4 writes: mean rates over an integration time, fixes in degrees, its own solution (here the truth)."""
    log = UlogWriter(start_us)
    log.formats("sensor_combined", "vehicle_gps_position", "vehicle_attitude", "vehicle_local_position")
    origin = [drive.truth[name][0] for name in ("latitude", "longitude", "height")]
    dt_us, fixes = round(drive.interval * 1e6), list(drive.fixes)
    for i, (time_us, sample) in enumerate(zip(drive.time_us, drive.increments, strict=True)):
        at, rates = start_us + int(time_us), sample / drive.interval
        log.add("sensor_combined", at, rates[:3], dt_us, 0, rates[3:], dt_us)
        if fixes and time_us * 1e-6 >= fixes[0][0] - 1e-9:
            _, fix = fixes.pop(0)
            place = np.degrees(fix.latitude), np.degrees(fix.longitude), fix.height - UNDULATION, fix.height
            accuracy = fix.velocity_sigma[0], fix.position_sigma[0], fix.position_sigma[2]
            valid = start_us + round(fix.time * 1e6)
            log.add("vehicle_gps_position", at, valid, *place, *accuracy, *fix.velocity_n, np.nan, np.nan, 3, True)
        if i % 20 == 0:
            now = {name: values[i] for name, values in drive.truth.items()}
            log.add("vehicle_attitude", at, now["q_nb"])
            offset = geodesy.numeric.ned_offset(now["latitude"], now["longitude"], now["height"], *origin)
            told = np.degrees(origin[0]), np.degrees(origin[1]), origin[2] - UNDULATION
            log.add("vehicle_local_position", at, *offset, *now["velocity_n"], *told, True, True)
    path.write_bytes(log.data)
    return path


WRITERS: dict[str, Callable[[Drive, Path], Path]] = {"tlog": telemetry, "BIN": dataflash, "ulg": ulog}


def described(path: Path, text: str = f"undulation_m = {UNDULATION}") -> Path:
    """A TOML file that says more of a log."""
    toml = path.with_suffix(".toml")
    toml.write_text(f'flight = "{path.name}"\n{text}\n', encoding="utf-8")
    return toml

"""Flight logs: what a simulated flight writes in each format comes back with the estimates of the flight itself."""

from __future__ import annotations

import gzip
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import call, strict
from flight_writers import DataflashWriter, UlogWriter
from places import ROOT

from insenv import attitude, estimators, geodesy, replay
from insenv.errors import InputError
from insenv.logs import GnssFixes, RecordedLog, load
from insenv.logs.flight.records import TelemetryLog
from insenv.mavlink import Vehicle
from insenv.mavlink.wire import TlogWriter, dialect
from insenv.runs.follower import Follower
from insenv.runs.replayed import sample_columns
from insenv.scenario import load as load_scenario

DATA = Path(__file__).parent / "data" / "px4"
EXAMPLES = ROOT / "examples" / "logs"
UNDULATION = 45.0
SECONDS = 20.0
START_UNIX = 1.7e9


@dataclass
class Drive:
    """Twenty seconds of the simulated car: what was measured, and the estimate and truth at each sample."""

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


@pytest.fixture(scope="module")
def drive() -> Drive:
    rates = {"HIL_STATE_QUATERNION": 50.0}
    vehicle = Vehicle(load_scenario("car-city-drive"), "loosely-coupled", seed=4, rates=rates, start_unix=START_UNIX)
    vehicle.view.undulation = UNDULATION
    simulation = vehicle.simulation
    messages, increments, fixes = [], [], []
    estimate: dict[str, list[Any]] = {name: [] for name in ("q_nb", "velocity_n", "latitude", "longitude", "height")}
    truth: dict[str, list[Any]] = {name: [] for name in estimate}
    for _ in range(round(SECONDS / simulation.interval)):
        messages.append(vehicle.step())
        increments.append(simulation.last_increment.copy())
        for name in estimate:
            estimate[name].append(np.array(simulation.estimate[name]))
            truth[name].append(np.array(simulation.truth[name]))
        if simulation.fixes > len(fixes):
            fixes.append((simulation.time, simulation.fix))
    series = [{name: np.array(rows) for name, rows in group.items()} for group in (estimate, truth)]
    return Drive(vehicle, messages, np.array(increments), *series, fixes)


def telemetry(drive: Drive, path: Path, leave_out: Callable[[Any], bool] = lambda message: False) -> Path:
    packer = dialect().MAVLink(None, srcSystem=1, srcComponent=1)
    with TlogWriter(path) as log:
        for time_us, group in zip(drive.time_us, drive.messages, strict=True):
            for message in group:
                if not leave_out(message):
                    log.write(round(START_UNIX * 1e6) + int(time_us), message.pack(packer))
                    packer.seq = (packer.seq + 1) % 256
    return path


def dataflash(drive: Drive, path: Path) -> Path:
    """As ArduPilot writes: increments (IMT), fixes with their accuracy, its own solution (here the truth)."""
    log = DataflashWriter()
    log.define("IMT", "QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ")
    log.define("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    log.define("GPA", "QBCCCCfBIH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta")
    log.define("ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw")
    log.define("POS", "QLLf", "TimeUS,Lat,Lng,Alt")
    log.define("XKF1", "QBfff", "TimeUS,C,VN,VE,VD")
    dt, fixes = drive.interval, iter(drive.fixes)
    arrives, fix = next(fixes)
    for i, (time_us, sample) in enumerate(zip(drive.time_us, drive.increments, strict=True)):
        log.add("IMT", time_us, 0, dt, dt, dt, *sample)
        if i % 8 == 0:
            log.add("IMU", time_us, 0, *(sample / dt))
        if fix is not None and time_us * 1e-6 >= arrives - 1e-9:
            north, east, down = fix.velocity_n
            place = np.degrees(fix.latitude), np.degrees(fix.longitude), fix.height - UNDULATION
            speed, course = np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360
            stamp = round(fix.time * 1e6)
            log.add("GPS", stamp, 0, 4, 0, 0, 12, 0.8, *place, speed, course, down, 0, 1)
            horizontal, _, vertical = fix.position_sigma
            log.add("GPA", stamp, 0, 1, horizontal, vertical, fix.velocity_sigma[0], 0, 1, 0, 0)
            arrives, fix = next(fixes, (0.0, None))
        if i % 20 == 0:
            roll, pitch, heading = np.degrees(attitude.numeric.to_euler(drive.truth["q_nb"][i]))
            log.add("ATT", time_us, roll, pitch, heading)
            truth = drive.truth
            place = np.degrees(truth["latitude"][i]), np.degrees(truth["longitude"][i]), truth["height"][i] - UNDULATION
            log.add("POS", time_us, *place)
            log.add("XKF1", time_us, 0, *truth["velocity_n"][i])
    path.write_bytes(log.data)
    return path


def ulog(drive: Drive, path: Path, start_us: int = 0) -> Path:
    """As PX4 writes: mean rates over an integration time, fixes in degrees, its own solution (here the truth)."""
    log = UlogWriter(start_us)
    stamp = ("uint64_t", "timestamp")
    log.formats(
        {
            "sensor_combined": [
                stamp, ("float[3]", "gyro_rad"), ("uint32_t", "gyro_integral_dt"),
                ("int32_t", "accelerometer_timestamp_relative"), ("float[3]", "accelerometer_m_s2"),
                ("uint32_t", "accelerometer_integral_dt"),
            ],
            "vehicle_gps_position": [
                stamp, ("uint64_t", "timestamp_sample"), ("double", "latitude_deg"), ("double", "longitude_deg"),
                ("double", "altitude_msl_m"), ("double", "altitude_ellipsoid_m"), ("float", "s_variance_m_s"),
                ("float", "eph"), ("float", "epv"), ("float", "vel_n_m_s"), ("float", "vel_e_m_s"), ("float", "vel_d_m_s"),
                ("uint8_t", "fix_type"), ("bool", "vel_ned_valid"),
            ],
            "vehicle_attitude": [stamp, ("float[4]", "q")],
            "vehicle_local_position": [
                stamp, ("float", "x"), ("float", "y"), ("float", "z"), ("float", "vx"), ("float", "vy"), ("float", "vz"),
                ("double", "ref_lat"), ("double", "ref_lon"), ("float", "ref_alt"), ("bool", "xy_global"), ("bool", "z_global"),
            ],
        }
    )  # fmt: skip
    origin = [drive.truth[name][0] for name in ("latitude", "longitude", "height")]
    dt_us, fixes = round(drive.interval * 1e6), iter(drive.fixes)
    arrives, fix = next(fixes)
    for i, (time_us, sample) in enumerate(zip(drive.time_us, drive.increments, strict=True)):
        at = start_us + int(time_us)
        rates = sample / drive.interval
        log.add("sensor_combined", at, rates[:3], dt_us, 0, rates[3:], dt_us)
        if fix is not None and time_us * 1e-6 >= arrives - 1e-9:
            place = np.degrees(fix.latitude), np.degrees(fix.longitude), fix.height - UNDULATION, fix.height
            accuracy = fix.velocity_sigma[0], fix.position_sigma[0], fix.position_sigma[2]
            valid = start_us + round(fix.time * 1e6)
            log.add("vehicle_gps_position", at, valid, *place, *accuracy, *fix.velocity_n, 3, True)
            arrives, fix = next(fixes, (0.0, None))
        if i % 20 == 0:
            now = {name: values[i] for name, values in drive.truth.items()}
            log.add("vehicle_attitude", at, now["q_nb"])
            offset = geodesy.numeric.ned_offset(now["latitude"], now["longitude"], now["height"], *origin)
            told = np.degrees(origin[0]), np.degrees(origin[1]), origin[2] - UNDULATION
            log.add("vehicle_local_position", at, *offset, *now["velocity_n"], *told, True, True)
    path.write_bytes(log.data)
    return path


WRITERS = {"tlog": telemetry, "BIN": dataflash, "ulg": ulog}


def described(path: Path, text: str = f"undulation_m = {UNDULATION}") -> Path:
    """A TOML file that says more of a log."""
    toml = path.with_suffix(".toml")
    toml.write_text(f'flight = "{path.name}"\n{text}\n', encoding="utf-8")
    return toml


def followed(drive: Drive, log: RecordedLog) -> dict[str, np.ndarray]:
    """The flight's own estimator, told what it was told, on the samples of the log."""
    plant = drive.vehicle.simulation.plant
    estimator = estimators.get("loosely-coupled")
    follower = Follower.started(estimator, plant.parameters_of(estimator), 1)
    columns, dropped = sample_columns(log, slice(None))
    assert dropped == 0
    follower.follow(columns, len(log.imu_time))
    return follower.named()


FIX = ("time", "latitude", "longitude", "height", "position_sigma", "velocity_n", "velocity_sigma")


def differences(
    one: dict[str, np.ndarray], other: dict[str, np.ndarray], rows: Any = slice(None)
) -> tuple[float, float, float]:
    """Largest differences of position (m), velocity (m/s) and attitude (rad)."""
    one, other = ({name: group[name][rows] for name in other} for group in (one, other))
    place = ("latitude", "longitude", "height")
    metres = geodesy.numeric.ned_offset(*(one[name] for name in place), *(other[name] for name in place))
    turned = attitude.numeric.multiply(attitude.numeric.conjugate(one["q_nb"]), other["q_nb"])
    velocity = one["velocity_n"] - other["velocity_n"]
    return float(np.abs(metres).max()), float(np.abs(velocity).max()), float(2 * np.abs(turned[:, 1:]).max())


# how finely each format writes: position of fixes (m: north or east, height), velocity (m/s)
RESOLUTION = {"tlog": (1e-7, 1e-3, 1e-2), "BIN": (1e-7, 1e-2, 1e-6), "ulg": (1e-12, 1e-9, 1e-6)}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_flight_comes_back_with_its_estimate(kind: str, drive: Drive, tmp_path: Path) -> None:
    log = load(described(WRITERS[kind](drive, tmp_path / f"flight.{kind}")))  # type: ignore[operator]
    # every sample at its time, with its increments to single precision
    np.testing.assert_allclose(log.imu_time, drive.time_us * 1e-6, rtol=0, atol=1e-9)
    samples = np.hstack([log.delta_angle, log.delta_velocity])
    np.testing.assert_allclose(samples, drive.increments, rtol=1.2e-7, atol=1e-13)
    assert log.gaps.count == 0
    # every fix at its time of validity, to its resolution
    degrees, height, speed = RESOLUTION[kind]
    fixes = [fix for _, fix in drive.fixes]
    assert log.gnss is not None and log.gnss.velocity_n is not None and log.gnss.velocity_sigma is not None
    np.testing.assert_allclose(log.gnss.time, [f.time for f in fixes], rtol=0, atol=1e-6)
    half = np.radians(degrees) / 2 + 2e-16
    np.testing.assert_allclose(log.gnss.latitude, [f.latitude for f in fixes], rtol=0, atol=half)
    np.testing.assert_allclose(log.gnss.longitude, [f.longitude for f in fixes], rtol=0, atol=half)
    np.testing.assert_allclose(log.gnss.height, [f.height for f in fixes], rtol=0, atol=height / 2 + 1e-9)
    np.testing.assert_allclose(log.gnss.velocity_n, [f.velocity_n for f in fixes], rtol=0, atol=speed / 2 + 1e-5)
    np.testing.assert_allclose(log.gnss.position_sigma, [f.position_sigma for f in fixes], rtol=0, atol=5.1e-3)
    np.testing.assert_allclose(log.gnss.velocity_sigma, [f.velocity_sigma for f in fixes], rtol=0, atol=5.1e-3)
    # and so the estimate.  A filter averages the fixes, and with them what rounding did to them
    got = followed(drive, log)
    exact = GnssFixes(*(np.array([getattr(f, name) for f in fixes]) for name in FIX))
    rounded = replace(exact, position_sigma=log.gnss.position_sigma, velocity_sigma=log.gnss.velocity_sigma)
    angles, velocities = drive.increments[:, :3], drive.increments[:, 3:]
    without_rounding = followed(drive, replace(log, delta_angle=angles, delta_velocity=velocities, gnss=rounded))
    position, velocity, angle = differences(got, without_rounding)
    # the sum of the velocities' rounding grows with the root of the filter's memory, some 20 fixes (1.5 m over 0.07 m/s)
    assert position < max(degrees * 111_320.0, height) / 2 + 5 * speed / 2 + 1e-5
    assert velocity < speed / 2 + 1e-5
    assert angle < speed / 2 / 2.0 + 1e-6  # heading comes from velocity, over the speed of some metres a second
    # The flight itself took each fix 50 ms later, when it arrived, and knew its accuracy better than to the centimetre: half a
    # centimetre of 1.5 m changes a filter's gain by 0.7 %, of the 3 m that a fix may be off that is 2 cm.
    late = np.array([arrives for arrives, _ in drive.fixes])
    since = drive.time_us[:, None] * 1e-6 - late
    settled = np.where(since >= 0, since, np.inf).min(axis=1) < 0.9
    position, velocity, angle = differences(got, drive.estimate, settled)
    assert position < 0.05 and velocity < 0.02 and angle < 4e-3


@pytest.mark.parametrize("kind", WRITERS)
def test_the_reference_in_a_log(kind: str, drive: Drive, tmp_path: Path) -> None:
    log = load(WRITERS[kind](drive, tmp_path / f"flight.{kind}"))  # type: ignore[operator]
    reference = log.reference
    assert reference is not None and reference.velocity_n is not None and reference.heading is not None
    rows = np.rint(reference.time / drive.interval).astype(int) - 1
    truth = {name: values[rows] for name, values in drive.truth.items()}
    height = 0.0 if kind == "tlog" or kind == "ulg" else UNDULATION  # ArduPilot's logs do not tell the undulation
    places = [truth["latitude"], truth["longitude"], truth["height"] - height]
    metres = geodesy.numeric.ned_offset(reference.latitude, reference.longitude, reference.height, *places)
    assert np.abs(metres).max() < 0.02
    np.testing.assert_allclose(reference.velocity_n, truth["velocity_n"], atol=0.0051)
    q = attitude.numeric.from_euler(reference.roll, reference.pitch, reference.heading)
    turned = attitude.numeric.multiply(attitude.numeric.conjugate(q), truth["q_nb"])
    assert 2 * np.abs(turned[:, 1:]).max() < np.radians(0.01)
    own = [note for note in log.notes if "own estimate" in note]
    assert bool(own) == (kind != "tlog")  # HIL_STATE_QUATERNION is a simulator's truth


# --- the command line, and what is missing ---------------------------------------------------------


@pytest.mark.parametrize("kind", WRITERS)
def test_replay_at_the_command_line(kind: str, drive: Drive, tmp_path: Path) -> None:
    path = WRITERS[kind](drive, tmp_path / f"flight.{kind}")  # type: ignore[operator]
    status, out, err = call("replay", path, "-e", "loosely-coupled", "--start", "reference", "--json")
    assert status == 0, err
    report = strict(out)
    assert len(report["notes"]) >= 3
    (result,) = report["results"]
    assert result["rms"]["north_m"] < 3.0 and result["rms"]["roll_deg"] < 1.0


def test_the_start_comes_from_the_log_where_it_stands(tmp_path: Path) -> None:
    """A car as ArduPilot would log it: at rest, then under way; no reference, no initial conditions."""
    log = DataflashWriter()
    log.define("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS", "QBIHBcLLeffffB", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    draw = np.random.default_rng(1)
    heading = np.radians(70.0)
    for i in range(40 * 100):
        t = i / 100
        push = 2.0 if t > 20 else 0.0  # m/s^2
        log.add("IMU", round(t * 1e6), 0, *draw.normal(0, 1e-3, 3), *(draw.normal(0, 0.02, 3) + [push, 0, -9.8]))
        if i % 20 == 0:
            speed = max(t - 20, 0) * 2.0
            way = max(t - 20, 0) ** 2
            north, east = way * np.cos(heading), way * np.sin(heading)
            place = 47.0 + north / 111_190.0, 15.0 + east / (111_320.0 * np.cos(np.radians(47.0)))
            log.add("GPS", round(t * 1e6), 4, 0, 0, 12, 0.8, *place, 400.0, speed, 70.0, 0.0, 0, 1)
    path = tmp_path / "flight.bin"
    path.write_bytes(log.data)
    report = replay(path, ["loosely-coupled"])
    found = load(path).description.initial.static_until_s
    assert found == pytest.approx(20.0, abs=1.01)
    yaw = report.results[0].outputs["q_nb"]
    assert np.degrees(attitude.numeric.to_euler(yaw)[2][-1]) == pytest.approx(70.0, abs=1.0)
    assert any("no accuracy of the fixes' position" in note for note in report.notes)


def test_no_imu_at_a_usable_rate(drive: Drive, tmp_path: Path) -> None:
    imu = {"HIL_SENSOR", "HIGHRES_IMU"}
    none = telemetry(drive, tmp_path / "none.tlog", lambda message: message.get_type() in imu)
    with pytest.raises(InputError, match="no inertial unit at a usable rate, 20 Hz or more: found none at all; request"):
        load(none)
    few = telemetry(
        drive,
        tmp_path / "few.tlog",
        lambda message: message.get_type() in imu and (message.get_type() == "HIL_SENSOR" or message.time_usec % 500_000 != 0),
    )
    with pytest.raises(InputError, match="found HIGHRES_IMU at 2 Hz"):
        load(few)
    with pytest.raises(InputError, match=r"no imu 'IMU\[7\]'.*HIL_SENSOR"):
        load(described(telemetry(drive, tmp_path / "flight.tlog"), 'imu = "IMU[7]"'))


def test_no_gnss(drive: Drive, tmp_path: Path) -> None:
    path = telemetry(drive, tmp_path / "flight.tlog", lambda message: "GPS" in message.get_type())
    assert any(note == "no GNSS: the log has no fixes" for note in load(path).notes)
    status, _, err = call("replay", path, "-e", "loosely-coupled")
    assert status == 2 and "needs GNSS" in err
    assert load(described(path, 'gnss = "none"')).gnss is None


def test_another_unit_receiver_and_reference(drive: Drive, tmp_path: Path) -> None:
    path = telemetry(drive, tmp_path / "flight.tlog")
    text = 'imu = "HIGHRES_IMU"\ngnss = "GPS_RAW_INT"\nreference = "ATTITUDE_QUATERNION, GLOBAL_POSITION_INT"\n'
    more = (
        "gnss_time_offset_s = -0.1\nlever_arm_m = [0.5, 0.0, -1.0]\nposition_sigma_m = [3.0, 4.0, 5.0]\ngrade = 'consumer-mems'"
    )
    log = load(described(path, text + more.replace("grade = 'consumer-mems'", "")))
    assert log.rate_hz == pytest.approx(50.0, rel=1e-3)
    assert log.gnss is not None and log.gnss.velocity_sigma is not None
    assert (log.gnss.velocity_sigma[:, 2] == 100.0).all()  # GPS_RAW_INT knows nothing of the vertical velocity
    assert (log.gnss.position_sigma == [3.0, 4.0, 5.0]).all() and log.lever_arm_b.tolist() == [0.5, 0.0, -1.0]
    valid = np.array([fix.time for _, fix in drive.fixes])
    assert np.abs(log.gnss.time + 0.1 - valid[: len(log.gnss.time)]).max() < 1e-6
    assert log.reference is not None
    estimate = drive.estimate["velocity_n"][np.rint(log.reference.time / drive.interval).astype(int) - 1]
    np.testing.assert_allclose(log.reference.velocity_n, estimate, atol=0.0051)
    assert any("own estimate" in note for note in log.notes)


# --- time ------------------------------------------------------------------------------------------


def test_gaps_twice_out_of_order_and_restarts(tmp_path: Path) -> None:
    """An inertial unit whose log has gaps, repeated and swapped samples and a restart of the clock."""
    log = DataflashWriter()
    log.define("IMU", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    first = [t for t in range(0, 10_000_000, 10_000) if not 3_000_000 < t < 3_200_000]  # a gap that is bridged
    first[500], first[501] = first[501], first[500]
    first.insert(600, first[599])
    second = [t + 15_000_000 for t in range(0, 4_000_000, 10_000)]  # after a gap that is too long
    third = list(range(1_000_000, 3_000_000, 10_000))  # after a restart
    for t in (*first, *second, *third):
        log.add("IMU", t, 0, 0, 0, 0, 0, -9.8)
    path = tmp_path / "flight.BIN"
    path.write_bytes(log.data)
    found = load(path)
    assert (found.imu_time[0], found.imu_time[-1]) == (pytest.approx(0.01), pytest.approx(9.99))
    assert found.gaps.count == 1 and found.gaps.samples == 19
    assert (np.diff(found.imu_time) > 0).all()
    assert any("2 samples twice or out of order" in note for note in found.notes)
    assert any(note.startswith("3 segments between restarts and gaps longer than 1 s: the longest") for note in found.notes)
    other = load(described(path, "start_s = 12.0"))
    assert other.imu_time[-1] == pytest.approx(18.99)
    with pytest.raises(InputError, match="0 samples of IMU from start_s = 100 s: its times are"):
        load(described(path, "start_s = 100.0"))


@pytest.mark.parametrize("kind", ["ulg", "tlog"])
def test_unix_time_stamps_keep_their_microseconds(kind: str, drive: Drive, tmp_path: Path) -> None:
    path = tmp_path / f"flight.{kind}"
    if kind == "ulg":
        ulog(drive, path, start_us=1_700_000_000_000_000)
    else:
        drive_unix = replace(drive, messages=[[later(m) for m in group] for group in drive.messages[:2000]])
        drive_unix.increments = drive.increments[:2000]
        telemetry(drive_unix, path)
    log = load(path)
    assert log.imu_time[0] == 0.0 and any("Unix time" in note for note in log.notes)
    np.testing.assert_allclose(np.diff(log.imu_time), drive.interval, rtol=0, atol=1e-12)
    assert log.gnss is not None and log.gnss.time[0] == pytest.approx(drive.fixes[0][1].time - drive.interval, abs=2e-6)


def later(message: Any) -> Any:
    """The same message with a time of Unix."""
    if not hasattr(message, "time_usec"):
        return message
    copy = type(message)(*(getattr(message, name) for name in message.fieldnames))
    copy.time_usec += 1_700_000_000_000_000
    return copy


# --- broken files ----------------------------------------------------------------------------------


def test_a_telemetry_log_with_broken_bytes(drive: Drive, tmp_path: Path) -> None:
    whole = telemetry(drive, tmp_path / "flight.tlog").read_bytes()
    records = sum(len(group) for group in drive.messages)
    clean = TelemetryLog(whole)
    assert len(list(clean)) == records == clean.records and clean.skipped == clean.wrong == 0
    draw = random.Random(3)
    # a wrong byte costs the record that it is in, cut off bytes the last one
    for _ in range(8):
        at = draw.randrange(len(whole) // 2)
        broken = TelemetryLog(whole[:at] + bytes((whole[at] ^ 0x55,)) + whole[at + 1 : -5])
        assert records - 3 <= len(list(broken)) <= records - 1
    junk = TelemetryLog(draw.randbytes(200_000) + whole[: len(whole) // 20])
    assert len(list(junk)) >= records // 20 - 10
    path = tmp_path / "junk.tlog"
    path.write_bytes(draw.randbytes(5000))
    with pytest.raises(InputError, match="not a MAVLink telemetry log"):
        load(path)


def test_mavlogdump_reads_what_we_write(drive: Drive, tmp_path: Path) -> None:
    """pymavlink's own reader: every message, none lost."""
    from pymavlink import mavutil

    path = telemetry(drive, tmp_path / "flight.tlog")
    source = mavutil.mavlink_connection(str(path), dialect="common")
    try:
        got = []
        while (message := source.recv_msg()) is not None:
            got.append((message.get_type(), message.get_seq(), round((message._timestamp - START_UNIX) * 1e6)))
    finally:
        source.close()
    sent = [(message.get_type(), int(t)) for t, group in zip(drive.time_us, drive.messages, strict=True) for message in group]
    assert [name for name, _, _ in got] == [name for name, _ in sent]
    assert [sequence for _, sequence, _ in got] == [i % 256 for i in range(len(sent))]
    assert np.abs(np.array([t for _, _, t in got]) - [t for _, t in sent]).max() < 5


@pytest.mark.parametrize("kind", WRITERS)
def test_files_cut_anywhere_or_garbled_end_in_words(kind: str, drive: Drive, tmp_path: Path) -> None:
    short = replace(drive, messages=drive.messages[:400], increments=drive.increments[:400])
    whole = WRITERS[kind](short, tmp_path / f"whole.{kind}").read_bytes()  # type: ignore[operator]
    draw = random.Random(1)
    path = tmp_path / f"flight.{kind}"
    for trial in range(25):
        data = bytearray(whole[: draw.randrange(len(whole))])
        for _ in range(trial % 3 * 20):
            if data:
                data[draw.randrange(len(data))] = draw.randrange(256)
        path.write_bytes(data)
        try:
            assert np.isfinite(load(path).delta_velocity).all()
        except InputError as error:
            assert path.name in str(error)
    path.write_bytes(gzip.compress(whole))
    with pytest.raises(InputError):
        load(path)
    packed = path.with_suffix(f".{kind}.gz")
    path.rename(packed)
    assert len(load(packed).imu_time) == 400


def test_a_writer_that_was_cut_off_leaves_a_readable_part(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    writer = TlogWriter(path)
    frame = dialect().MAVLink_heartbeat_message(1, 0, 0, 0, 4, 3).pack(dialect().MAVLink(None, srcSystem=1))
    for i in range(10):
        writer.write(1_700_000_000_000_000 + i * 4, frame, link=1)
    writer.flush()
    part = path.with_name("flight.tlog.part").read_bytes()
    assert not path.exists()
    assert [record.time_us & 3 for record in TelemetryLog(part[:-3])] == [1] * 9
    writer.close()
    writer.close()
    assert path.read_bytes() == part and list(tmp_path.iterdir()) == [path]
    assert part[:8] == struct.pack(">Q", 1_700_000_000_000_001)
    with pytest.raises(InputError, match="no-such-folder"):
        TlogWriter(tmp_path / "no-such-folder" / "flight.tlog")


def test_descriptions(tmp_path: Path) -> None:
    toml = tmp_path / "log.toml"
    for text, words in (
        ('flight = "a.log"', "must end in .tlog, .BIN, .ulg, .mcap, .db3 or .bag"),
        ('flight = "a.tlog"\nleverarm = 1', "unknown key"),
        ('flight = "a.tlog"\nstart_s = 2\nstop_s = 1', "number|must be after"),
        ('flight = "a.tlog"\ngrade = "gold"', "gold"),
        ('flight = "a.tlog"', "file not found"),
    ):
        toml.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=words):
            load(toml)


# --- real logs -------------------------------------------------------------------------------------


def test_a_real_px4_log_of_2020() -> None:
    """A vehicle at rest; receiver in degrees times 1e7, a solution without origin; the logger dropped out once."""
    log = load(DATA / "rest.ulg.gz")
    assert log.rate_hz == pytest.approx(204.6, abs=0.1) and log.duration_s == pytest.approx(6.50, abs=0.01)
    assert log.gnss is not None and len(log.gnss.time) == 32
    assert log.reference is not None and log.reference.heading is not None and log.reference.latitude is None
    assert np.degrees(log.gnss.latitude[0]) == pytest.approx(63.417, abs=1e-3)
    assert np.linalg.norm((log.delta_velocity / log.dt[:, None]).mean(axis=0)) == pytest.approx(9.82, abs=0.25)  # uncalibrated
    assert log.description.initial.static_until_s == pytest.approx(26.33, abs=0.01)
    assert any("dropouts of the logger" in note for note in log.notes)


def test_a_real_px4_log_of_2024() -> None:
    """PX4's simulated quadrotor takes off: the estimate follows PX4's own."""
    report = replay(EXAMPLES / "px4-takeoff.ulg.gz", ["loosely-coupled"], start="reference")
    errors = {name: float(np.sqrt(np.mean(values**2))) for name, values in report.results[0].errors.items()}
    assert report.imu_samples > 5000
    assert max(errors["roll_deg"], errors["pitch_deg"], errors["heading_deg"]) < 0.5
    assert max(errors["north_m"], errors["east_m"]) < 0.5 and errors["down_m"] < 2.0

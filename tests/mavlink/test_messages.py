"""MAVLink messages: rounding, saturation and counts of fields; agreement with the simulation; rates."""

from itertools import pairwise
from math import degrees, inf, nan

import numpy as np
import pytest
from pymavlink.dialects.v20 import common, development
from streamed_vehicle import SILENT, quiet, steps

from insenv import attitude, geodesy
from insenv.mavlink import Vehicle
from insenv.mavlink.messages import DEFAULT_HZ, MESSAGES, Fields, Schedule
from insenv.mavlink.messages.fields import DEG_E7, FLOAT32_MAX
from insenv.mavlink.surroundings import BAROMETER_HZ, MAGNETOMETER_HZ
from insenv.scenario import load


def received(message):
    return development.MAVLink(None).decode(bytearray(message.pack(common.MAVLink(None, 1, 1))))


def position(fields, **changed):
    values = {"t": 1, "lat": 1, "lon": 2, "alt": 3, "rel": 4, "vx": 5, "vy": 6, "vz": 7, "hdg": 8, **changed}
    return fields.message("GLOBAL_POSITION_INT", *values.values())


def test_values_out_of_range_saturate_and_are_counted_others_are_rounded():
    fields = Fields()
    message = received(position(fields, vx=33000.0, vy=-1e300, alt=inf, vz=32767.4, hdg=65535.0))
    assert (message.vx, message.vy, message.alt, message.vz, message.hdg) == (32767, -32768, 2**31 - 1, 32767, 65534)
    names = ("vx", "vy", "alt", "hdg")  # 32767.4 rounds to a value in range: not counted
    assert fields.saturated == {f"GLOBAL_POSITION_INT.{name}": 1 for name in names}
    message = received(fields.message("ATTITUDE", -1, 1e39, -inf, FLOAT32_MAX, 0, 0, 0))
    assert message.time_boot_ms == 0 and message.roll == -message.pitch == message.yaw == pytest.approx(FLOAT32_MAX)
    assert fields.saturated["ATTITUDE.roll"] == fields.saturated["ATTITUDE.pitch"] == 1 and not fields.refused
    message = received(position(Fields(), lat=0.5, lon=1.5, alt=-0.5, vx=-1.5, vy=2.49))
    assert (message.lat, message.lon, message.alt, message.vx, message.vy) == (0, 2, 0, -2, 2)


def test_nan_is_never_a_position():
    fields = Fields()
    for name in ("lat", "lon", "alt", "rel", "vx"):
        assert position(fields, **{name: nan}) is None
    assert received(position(fields, hdg=nan)).hdg == 65535  # the field has a value for "unknown"
    odometry = [0, 1, 12, 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0), *[0.0] * 6, [nan] * 21, [nan] * 21, 0, 5, 0]
    assert np.isnan(received(fields.message("ODOMETRY", *odometry)).pose_covariance[0])
    odometry[3] = nan
    assert fields.message("ODOMETRY", *odometry) is None
    assert fields.refused["ODOMETRY.x"] == 1 and fields.refused.total() == 6


@pytest.mark.parametrize("hz", [0.3, 7.0, 133.0, 199.9, 350.0])
def test_a_rate_is_met_over_the_run(hz):
    schedule = Schedule(200.0, {**SILENT, "ATTITUDE": hz})
    due = [k for k in range(1, 20_001) if schedule.due(k)]
    assert len(due) == int(min(hz, 200.0) * 100.0 + 1e-6)
    per = max(200.0 / hz, 1.0)
    assert max(abs(k - n * per) for n, k in enumerate(due, 1)) < 1.0  # no drift


@pytest.fixture(scope="module")
def driven():
    """A car after 50 s, at about 14 m/s, with fixes."""
    vehicle = quiet(start_unix=1.8e9)
    steps(vehicle, 50.0)
    return vehicle


def read(vehicle, name):
    return received(vehicle.make(name))


def values(message, names):
    return [getattr(message, name) for name in names.split()]


def test_estimate_is_sent_within_the_resolution_of_its_fields(driven):
    estimate, truth, home = driven.simulation.estimate, driven.simulation.truth, driven.view.home
    place = latitude, longitude, height = [float(estimate[name]) for name in ("latitude", "longitude", "height")]
    roll, pitch, heading = (float(angle) for angle in attitude.numeric.to_euler(estimate["q_nb"]))
    message = read(driven, "ATTITUDE")
    np.testing.assert_allclose(values(message, "roll pitch yaw"), [roll, pitch, heading], rtol=1e-7, atol=1e-9)
    assert message.time_boot_ms == 50_000
    q = np.array(values(read(driven, "ATTITUDE_QUATERNION"), "q1 q2 q3 q4"))
    np.testing.assert_allclose(q * np.sign(q @ estimate["q_nb"]), estimate["q_nb"], rtol=0, atol=1e-7)

    message = read(driven, "GLOBAL_POSITION_INT")
    known = [latitude * DEG_E7, longitude * DEG_E7, height * 1e3, (height - home[2]) * 1e3, *estimate["velocity_n"] * 100]
    np.testing.assert_allclose(values(message, "lat lon alt relative_alt vx vy vz"), known, rtol=0, atol=0.5)
    assert abs(message.hdg / 100 - degrees(heading) % 360) <= 0.005

    offset = geodesy.numeric.ned_offset(*place, *home)
    message = read(driven, "ODOMETRY")
    velocity_b = attitude.numeric.to_dcm(estimate["q_nb"]).T @ estimate["velocity_n"]
    for shown in (message, read(driven, "LOCAL_POSITION_NED")):
        np.testing.assert_allclose(values(shown, "x y z"), offset, rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(values(message, "vx vy vz"), velocity_b, rtol=1e-6, atol=1e-6)
    assert velocity_b[0] > 10 and (message.frame_id, message.child_frame_id, message.estimator_type) == (1, 12, 5)
    message = read(driven, "VFR_HUD")
    known = [np.hypot(*estimate["velocity_n"][:2]), height, -estimate["velocity_n"][2]]
    np.testing.assert_allclose(values(message, "groundspeed alt climb"), known, rtol=1e-6)
    assert message.heading == round(degrees(heading)) % 360 and abs(height - float(truth["height"])) < 20


def full(triangle):
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = triangle
    return matrix + np.triu(matrix, 1).T


def test_covariance_of_odometry(driven):
    estimate, message, euler = driven.simulation.estimate, read(driven, "ODOMETRY"), attitude.numeric.to_euler
    pose, motion = full(message.pose_covariance), full(message.velocity_covariance)
    np.testing.assert_allclose(np.diag(pose)[:3], estimate["position_sigma"] ** 2, rtol=1e-6)
    C_nb = attitude.numeric.to_dcm(estimate["q_nb"])
    np.testing.assert_allclose(motion[:3, :3], C_nb.T @ np.diag(estimate["velocity_sigma"] ** 2) @ C_nb, rtol=1e-5, atol=1e-12)
    # angles: against finite differences of small rotations in n
    turned = [attitude.numeric.multiply(attitude.numeric.from_rotation_vector(v), estimate["q_nb"]) for v in np.eye(3) * 1e-6]
    moved = np.column_stack([np.array(euler(q)) - np.array(euler(estimate["q_nb"])) for q in turned]) / 1e-6
    expected = moved @ np.diag(estimate["attitude_sigma"] ** 2) @ moved.T
    np.testing.assert_allclose(pose[3:, 3:], expected, rtol=1e-3, atol=1e-5 * expected.max())


def test_truth_and_time_are_sent(driven):
    truth, dt = driven.simulation.truth, driven.simulation.interval
    message = read(driven, "HIL_STATE_QUATERNION")
    np.testing.assert_allclose(message.attitude_quaternion, truth["q_nb"], rtol=0, atol=1e-7)
    assert abs(message.lat - float(truth["latitude"]) * DEG_E7) <= 0.5 and message.time_usec == 50_000_000
    known = [*truth["velocity_n"] * 100, *truth["true_delta_velocity"] / dt / 9.80665 * 1e3]
    np.testing.assert_allclose(values(message, "vx vy vz xacc yacc zacc"), known, rtol=0, atol=0.5)
    # the dynamic pressure is that of the indicated airspeed in air of sea level; ISA
    speed, density = np.linalg.norm(truth["velocity_n"]), (1 - 0.0065 * float(truth["height"]) / 288.15) ** 4.2559
    assert speed > 5.0 and density < 0.97
    known = [speed * 100, speed * np.sqrt(density) * 100]
    np.testing.assert_allclose(values(message, "true_airspeed ind_airspeed"), known, rtol=1e-4, atol=1.0)
    message = read(driven, "SYSTEM_TIME")
    assert (message.time_unix_usec, message.time_boot_ms) == (1_800_000_050_000_000, 50_000)
    message, known = read(driven, "HOME_POSITION"), driven.simulation.plant.knowledge
    assert abs(message.latitude - known.latitude * DEG_E7) <= 0.5 and message.altitude == round(known.height * 1e3)


def test_sensor_measurements_are_sent(driven):
    fix, message = driven.simulation.fix, read(driven, "GPS_RAW_INT")
    assert message.fix_type == 3 and message.time_usec == round(fix.time * 1e6) < 50_000_000
    horizontal = np.hypot(*fix.position_sigma[:2]) / np.sqrt(2)
    known = [fix.latitude * DEG_E7, fix.height * 1e3, np.hypot(*fix.velocity_n[:2]) * 100, horizontal * 1e3]
    np.testing.assert_allclose(values(message, "lat alt vel h_acc"), known, rtol=0, atol=0.501)
    assert abs(message.cog / 100 - degrees(np.arctan2(fix.velocity_n[1], fix.velocity_n[0])) % 360) <= 0.0051
    assert (message.eph, message.satellites_visible) == (65535, 255)  # not simulated: sent as unknown
    assert driven.make("HIL_GPS").eph == round(horizontal * 100)
    assert driven.make("HIL_GPS") is None  # each fix once
    standard = 1013.25 * (1 - 0.0065 * float(driven.simulation.truth["height"]) / 288.15) ** 5.2559
    assert read(driven, "SCALED_PRESSURE").press_abs == pytest.approx(standard, abs=0.2)


def test_imu_messages_lose_no_increment_and_tell_what_is_new():
    vehicle = quiet()
    for name, hz in (("HIGHRES_IMU", 30.0), ("HIL_SENSOR", 200.0)):
        vehicle.schedule.set(name, hz, 0)
    simulation, sums, before, bits = vehicle.simulation, np.zeros(6), 0.0, []
    for _ in range(400):
        for message in vehicle.step():
            if message.get_type() == "HIL_SENSOR":
                bits.append(message.fields_updated)
            elif message.get_type() == "HIGHRES_IMU":
                elapsed, before = message.time_usec / 1e6 - before, message.time_usec / 1e6
                sums += np.array(values(message, "xgyro ygyro zgyro xacc yacc zacc")) * elapsed
                assert message.fields_updated & 0b111111 == 0b111111
                np.testing.assert_allclose(sums, simulation.increments, rtol=0, atol=1e-9)
    assert before > 1.9 and len(bits) == 400
    assert sum(b >> 6 & 7 == 7 for b in bits) == 2 * MAGNETOMETER_HZ
    assert sum(b & 0x1A00 == 0x1A00 for b in bits) == 2 * BAROMETER_HZ


def test_coarse_imu_messages_are_those_of_ardupilot_and_undulation_changes_heights_above_sea_level():
    vehicle = quiet()
    steps(vehicle, 2.0)
    fine, raw, scaled = (vehicle.make(name) for name in ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU"))
    means = vehicle.simulation.increments / 2.0  # never sent before
    for message in (raw, scaled):
        assert message.zacc == round(means[5] / 9.80665 * 1e3) and message.xgyro == round(means[0] * 1e3)
        assert message.xmag == round(fine.xmag * 1e3) and message.temperature == round(fine.temperature * 100)
    names = ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "HOME_POSITION", "HIL_STATE_QUATERNION")
    before, shown = [read(vehicle, name) for name in names], read(vehicle, "VFR_HUD").alt
    vehicle.view.undulation = 47.5
    assert shown - read(vehicle, "VFR_HUD").alt == pytest.approx(47.5, abs=1e-3)
    after = [read(vehicle, name) for name in names]
    for old, new in zip(before, after, strict=True):
        name = "altitude" if old.get_type() == "HOME_POSITION" else "alt"
        assert getattr(old, name) - getattr(new, name) == pytest.approx(47500, abs=1)
    assert before[0].relative_alt == after[0].relative_alt and before[1].alt_ellipsoid == after[1].alt_ellipsoid


@pytest.mark.parametrize("name, expected", [("ship-swaying", 11), ("car-city-drive", 10), ("aircraft-survey", 1)])
def test_every_message_of_every_kind_of_scenario_packs(name, expected):
    vehicle = Vehicle(load(name))
    steps(vehicle, 2.0)
    made = {kind: vehicle.make(kind) for kind in MESSAGES}
    without_gnss = {"GPS_RAW_INT", "HIL_GPS"} if name == "ship-swaying" else set()
    assert {kind for kind, message in made.items() if message is None} <= without_gnss | {"HIL_GPS"}
    known = {kind: message for kind, message in made.items() if message is not None}
    assert all(received(message).get_type() == kind for kind, message in known.items())
    assert (made["HEARTBEAT"].type, made["HEARTBEAT"].autopilot) == (expected, 0)
    assert not vehicle.view.fields.saturated and not vehicle.view.fields.refused


def with_receiver(**changed):
    """The car with another receiver, and HIL_GPS only."""
    car = load("car-city-drive")
    gnss = car.gnss.model_copy(update={"outages_s": (), "outlier_probability": 0.0, "epoch_offset_s": 0.0, **changed})
    return Vehicle(car.model_copy(update={"gnss": gnss}), rates={**SILENT, "HIL_GPS": DEFAULT_HZ["HIL_GPS"]})


@pytest.mark.parametrize("interval, latency", [(0.02, 0.01), (0.015, 0.0)])
def test_hil_gps_is_every_fix(interval, latency):
    vehicle = with_receiver(interval_s=interval, latency_s=latency)
    times, fixes = [], []
    for _ in range(600):
        seen = vehicle.simulation.fixes
        sent = [m for m in vehicle.step() if m.get_type() == "HIL_GPS"]
        assert len(sent) == vehicle.simulation.fixes - seen  # in the sample in which the fix is delivered
        times += [m.time_usec for m in sent]
        fixes += [round(vehicle.simulation.fix.time * 1e6) for _ in sent]
    assert times == fixes and len(times) >= int((3.0 - latency) / interval)
    np.testing.assert_allclose(np.diff(times), interval * 1e6, atol=1)


def test_an_outage_is_no_fix_at_the_rate_of_the_receiver():
    vehicle = with_receiver(interval_s=0.5, latency_s=0.1)
    sent, status = [], []
    for sample in range(1, 4001):
        if sample in (1000, 3000):
            vehicle.set_gnss(sample == 3000)
        sent += [(vehicle.simulation.time, m) for m in vehicle.step() if m.get_type() == "HIL_GPS"]
        if sample % 200 == 0:
            status.append(vehicle.make("ESTIMATOR_STATUS"))
    outage = [m for time, m in sent if 6.5 < time < 14.5]
    assert {m.fix_type for m in outage} == {1} and 15 <= len(outage) <= 17
    assert {m.fix_type for time, m in sent if time < 5.0 or time > 15.7} == {3}
    assert all(a.time_usec < b.time_usec for (_, a), (_, b) in pairwise(sent))
    held = [m for time, m in sent if time < 5.0][-1]
    assert abs(outage[0].lat - held.lat) < 10_000 and (outage[0].eph, outage[0].vel, outage[0].cog) == (65535,) * 3
    # the estimator's status follows: no absolute position and no innovation, while dead reckoning stays good
    absolute, relative, glitch = 16 | 32, 8 | 256 | 512, 1024
    assert all(s.flags & absolute == absolute and s.pos_horiz_ratio == s.pos_horiz_ratio for s in status[1:4] + status[16:])
    for s in status[7:14]:
        assert not s.flags & (absolute | glitch) and s.flags & relative == relative
        assert s.pos_horiz_ratio != s.pos_horiz_ratio and s.vel_ratio != s.vel_ratio


def test_no_fix_is_sent_before_the_first_one():
    vehicle = with_receiver(interval_s=0.5, latency_s=0.0, outages_s=((0.0, 3.0),))
    sent = [m for m in steps(vehicle, 2.5) if m.get_type() == "HIL_GPS"]
    assert len(sent) == 4 and {(m.fix_type, m.lat, m.lon) for m in sent} == {(1, 0, 0)}

"""MAVLink messages: rounding, saturation and counts of fields; agreement with the simulation; rates."""

from itertools import pairwise
from math import degrees, inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.mavlink import Vehicle
from insenv.mavlink.messages import DEFAULT_HZ, MESSAGES, Fields, Schedule, parse_rates
from insenv.mavlink.messages.fields import DEG_E7, FLOAT32_MAX
from insenv.mavlink.messages.schedule import STREAMS
from insenv.mavlink.messages.status import available_modes
from insenv.mavlink.surroundings import BAROMETER_HZ, MAGNETOMETER_HZ, Surroundings
from insenv.mavlink.wire.frames import Statistics, split
from insenv.mavlink.wire.further import DEFINITIONS, further_messages
from insenv.scenario import build, load, parse

common = pytest.importorskip("pymavlink.dialects.v20.common")

DEG = np.pi / 180


def received(message):
    """The message as a client reads it, decoded from its bytes."""
    sender, reader = common.MAVLink(None, 1, 1), common.MAVLink(None)
    return reader.decode(bytearray(message.pack(sender)))


# --- fields ----------------------------------------------------------------------------------------


def position(fields, **changed):
    values = {"t": 1, "lat": 1, "lon": 2, "alt": 3, "rel": 4, "vx": 5, "vy": 6, "vz": 7, "hdg": 8, **changed}
    return fields.message("GLOBAL_POSITION_INT", *values.values())


def test_values_out_of_range_saturate_and_are_counted():
    fields = Fields()
    message = received(position(fields, vx=33000.0, vy=-1e300, alt=inf, vz=32767.4, hdg=65535.0))
    assert (message.vx, message.vy, message.alt, message.vz, message.hdg) == (32767, -32768, 2**31 - 1, 32767, 65534)
    names = ("vx", "vy", "alt", "hdg")  # 32767.4 rounds to a value in range: not counted
    assert fields.saturated == {f"GLOBAL_POSITION_INT.{name}": 1 for name in names}
    message = received(fields.message("ATTITUDE", -1, 1e39, -inf, FLOAT32_MAX, 0, 0, 0))
    assert message.time_boot_ms == 0 and message.roll == -message.pitch == message.yaw == pytest.approx(FLOAT32_MAX)
    assert fields.saturated["ATTITUDE.roll"] == fields.saturated["ATTITUDE.pitch"] == 1 and not fields.refused


def test_nan_is_never_a_position():
    fields = Fields()
    for name in ("lat", "lon", "alt", "rel", "vx"):
        assert position(fields, **{name: nan}) is None
    assert received(position(fields, hdg=nan)).hdg == 65535  # the field has a value for "unknown"
    assert fields.message("LOCAL_POSITION_NED", 0, nan, 0, 0, 0, 0, 0) is None
    assert fields.message("ATTITUDE_QUATERNION", 0, 1, nan, 0, 0, 0, 0, 0, (0, 0, 0, 0)) is None
    odometry = [0, 1, 12, 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0), *[0.0] * 6, [nan] * 21, [nan] * 21, 0, 5, 0]
    assert np.isnan(received(fields.message("ODOMETRY", *odometry)).pose_covariance[0])
    odometry[3] = nan
    assert fields.message("ODOMETRY", *odometry) is None
    assert fields.refused["ODOMETRY.x"] == 1 and fields.refused.total() == 8


@given(st.floats(allow_nan=False), st.floats(allow_nan=False), st.integers(-(10**30), 10**30))
def test_any_number_makes_a_message_that_packs(a, b, c):
    fields = Fields()
    for name in ("HIL_GPS", "GPS_RAW_INT", "HIL_STATE_QUATERNION", "SYS_STATUS"):
        make = getattr(common, f"MAVLink_{name.lower()}_message")
        values = [
            [a] * make.array_lengths[order] if make.array_lengths[order] else (a, b, float(c))[place % 3]
            for place, order in enumerate(make.orders)
        ]
        assert received(fields.message(name, *values)).get_type() == name


def test_rounding_is_to_the_nearest():
    message = received(position(Fields(), lat=0.5, lon=1.5, alt=-0.5, vx=-1.5, vy=2.49))
    assert (message.lat, message.lon, message.alt, message.vx, message.vy) == (0, 2, 0, -2, 2)


# --- rates -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hz", [0.3, 1.0, 7.0, 50.0, 133.0, 199.9, 200.0, 350.0])
def test_a_rate_is_met_over_the_run(hz):
    schedule = Schedule(200.0, {**dict.fromkeys(DEFAULT_HZ, 0.0), "ATTITUDE": hz})
    due = [k for k in range(1, 20_001) if schedule.due(k)]
    assert len(due) == int(min(hz, 200.0) * 100.0 + 1e-6)
    per = max(200.0 / hz, 1.0)
    assert max(abs(k - n * per) for n, k in enumerate(due, 1)) < 1.0  # no drift


def test_rates_change_while_it_runs():
    schedule = Schedule(200.0)
    schedule.set("ATTITUDE", 100.0, 1000)
    assert sum("ATTITUDE" in schedule.due(k) for k in range(1001, 1201)) == 100
    schedule.set("ATTITUDE", 0.0, 1200)
    assert not any("ATTITUDE" in schedule.due(k) for k in range(1201, 1401))
    schedule.reset("ATTITUDE", 1400)
    assert sum("ATTITUDE" in schedule.due(k) for k in range(1401, 1601)) == DEFAULT_HZ["ATTITUDE"]
    assert {name for group in STREAMS.values() for name in group} <= set(DEFAULT_HZ)


@pytest.mark.parametrize("text", ["ATTITUDE", "ATTITUDE=fast", "ATITUDE=5", "ATTITUDE=-1", "ATTITUDE=1e9", "ATTITUDE=nan"])
def test_wrong_rates_are_refused(text):
    with pytest.raises(InputError):
        parse_rates([text])
    assert parse_rates(["attitude=5", "HIL_SENSOR=0"]) == {"ATTITUDE": 5.0, "HIL_SENSOR": 0.0}


# --- agreement with the simulation -------------------------------------------------------------------


@pytest.fixture(scope="module")
def driven():
    """A car after 50 s, at about 14 m/s, with fixes."""
    vehicle = Vehicle(load("car-city-drive"), start_unix=1.8e9, rates=dict.fromkeys(DEFAULT_HZ, 0.0))
    for _ in range(10_000):
        vehicle.step()
    return vehicle


def read(vehicle, name):
    message = received(vehicle.make(name))
    assert message is not None
    return message


def test_estimate_is_sent_within_the_resolution_of_its_fields(driven):
    estimate, truth, home = driven.simulation.estimate, driven.simulation.truth, driven.view.home
    roll, pitch, heading = (float(angle) for angle in attitude.numeric.to_euler(estimate["q_nb"]))
    message = read(driven, "ATTITUDE")
    np.testing.assert_allclose([message.roll, message.pitch, message.yaw], [roll, pitch, heading], rtol=1e-7, atol=1e-9)
    assert message.time_boot_ms == 50_000
    message = read(driven, "ATTITUDE_QUATERNION")
    q = np.array([message.q1, message.q2, message.q3, message.q4])
    np.testing.assert_allclose(q * np.sign(q @ estimate["q_nb"]), estimate["q_nb"], rtol=0, atol=1e-7)

    message = read(driven, "GLOBAL_POSITION_INT")
    assert abs(message.lat - float(estimate["latitude"]) * DEG_E7) <= 0.5
    assert abs(message.lon - float(estimate["longitude"]) * DEG_E7) <= 0.5
    assert abs(message.alt - float(estimate["height"]) * 1e3) <= 0.5
    assert abs(message.relative_alt - (float(estimate["height"]) - home[2]) * 1e3) <= 0.5
    np.testing.assert_allclose([message.vx, message.vy, message.vz], estimate["velocity_n"] * 100, rtol=0, atol=0.5)
    assert abs(message.hdg / 100 - degrees(heading) % 360) <= 0.005

    place = (estimate["latitude"], estimate["longitude"], estimate["height"])
    offset = geodesy.numeric.ned_offset(*place, *home)
    message = read(driven, "LOCAL_POSITION_NED")
    np.testing.assert_allclose([message.x, message.y, message.z], offset, rtol=1e-7, atol=1e-6)
    message = read(driven, "ODOMETRY")
    C_nb = attitude.numeric.to_dcm(estimate["q_nb"])
    np.testing.assert_allclose([message.x, message.y, message.z], offset, rtol=1e-7, atol=1e-6)
    velocity_b = C_nb.T @ estimate["velocity_n"]
    np.testing.assert_allclose([message.vx, message.vy, message.vz], velocity_b, rtol=1e-6, atol=1e-6)
    assert velocity_b[0] > 10 and (message.frame_id, message.child_frame_id, message.estimator_type) == (1, 12, 5)
    message = read(driven, "VFR_HUD")
    assert message.groundspeed == pytest.approx(np.hypot(*estimate["velocity_n"][:2]), rel=1e-6)
    assert message.heading == round(degrees(heading)) % 360 and message.alt == pytest.approx(
        float(estimate["height"]), rel=1e-7
    )
    assert message.climb == pytest.approx(-estimate["velocity_n"][2], rel=1e-6)
    assert abs(float(estimate["height"]) - float(truth["height"])) < 20


def full(triangle):
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = triangle
    return matrix + np.triu(matrix, 1).T


def test_covariance_of_odometry(driven):
    estimate = driven.simulation.estimate
    message = read(driven, "ODOMETRY")
    pose, motion = full(message.pose_covariance), full(message.velocity_covariance)
    np.testing.assert_allclose(np.diag(pose)[:3], estimate["position_sigma"] ** 2, rtol=1e-6)
    C_nb = attitude.numeric.to_dcm(estimate["q_nb"])
    np.testing.assert_allclose(motion[:3, :3], C_nb.T @ np.diag(estimate["velocity_sigma"] ** 2) @ C_nb, rtol=1e-5, atol=1e-12)
    # angles: against finite differences of small rotations in n
    angles = np.array(attitude.numeric.to_euler(estimate["q_nb"]))
    moved = np.empty((3, 3))
    for axis in range(3):
        turn = attitude.numeric.from_rotation_vector(np.eye(3)[axis] * 1e-6)
        moved[:, axis] = (
            np.array(attitude.numeric.to_euler(attitude.numeric.multiply(turn, estimate["q_nb"]))) - angles
        ) / 1e-6
    expected = moved @ np.diag(estimate["attitude_sigma"] ** 2) @ moved.T
    np.testing.assert_allclose(pose[3:, 3:], expected, rtol=1e-3, atol=1e-5 * expected.max())


def test_truth_and_time_are_sent(driven):
    truth, dt = driven.simulation.truth, driven.simulation.interval
    message = read(driven, "HIL_STATE_QUATERNION")
    np.testing.assert_allclose(message.attitude_quaternion, truth["q_nb"], rtol=0, atol=1e-7)
    assert abs(message.lat - float(truth["latitude"]) * DEG_E7) <= 0.5 and message.time_usec == 50_000_000
    np.testing.assert_allclose([message.vx, message.vy, message.vz], truth["velocity_n"] * 100, rtol=0, atol=0.5)
    force_mg = truth["true_delta_velocity"] / dt / 9.80665 * 1e3
    np.testing.assert_allclose([message.xacc, message.yacc, message.zacc], force_mg, rtol=0, atol=0.5)
    message = read(driven, "SYSTEM_TIME")
    assert (message.time_unix_usec, message.time_boot_ms) == (1_800_000_050_000_000, 50_000)
    message = read(driven, "HOME_POSITION")
    known = driven.simulation.plant.knowledge
    assert abs(message.latitude - known.latitude * DEG_E7) <= 0.5 and message.altitude == round(known.height * 1e3)


def test_sensor_measurements_are_sent(driven):
    fix = driven.simulation.fix
    message = read(driven, "GPS_RAW_INT")
    assert message.fix_type == 3 and message.time_usec == round(fix.time * 1e6) < 50_000_000
    assert abs(message.lat - fix.latitude * DEG_E7) <= 0.5 and abs(message.alt - fix.height * 1e3) <= 0.5
    assert abs(message.vel - np.hypot(*fix.velocity_n[:2]) * 100) <= 0.5
    course = degrees(np.arctan2(fix.velocity_n[1], fix.velocity_n[0])) % 360
    assert abs(message.cog / 100 - course) <= 0.0051
    assert (message.eph, message.satellites_visible) == (65535, 255)  # not simulated: sent as unknown
    assert message.h_acc == pytest.approx(np.hypot(*fix.position_sigma[:2]) / np.sqrt(2) * 1e3, abs=0.5)
    assert driven.make("HIL_GPS").eph == round(np.hypot(*fix.position_sigma[:2]) / np.sqrt(2) * 100)
    assert driven.make("HIL_GPS") is None  # each fix once
    message = read(driven, "SCALED_PRESSURE")
    standard = 1013.25 * (1 - 0.0065 * float(driven.simulation.truth["height"]) / 288.15) ** 5.2559
    assert message.press_abs == pytest.approx(standard, abs=0.2)


def test_imu_messages_lose_no_increment():
    vehicle = Vehicle(load("car-city-drive"), rates={"HIGHRES_IMU": 30.0})
    simulation, angle, velocity, before = vehicle.simulation, np.zeros(3), np.zeros(3), 0.0
    for _ in range(2000):
        for message in vehicle.step():
            if message.get_type() == "HIGHRES_IMU":
                elapsed, before = message.time_usec / 1e6 - before, message.time_usec / 1e6
                angle += np.array([message.xgyro, message.ygyro, message.zgyro]) * elapsed
                velocity += np.array([message.xacc, message.yacc, message.zacc]) * elapsed
                assert message.fields_updated & 0b111111 == 0b111111
                known = np.concatenate([angle, velocity])
                np.testing.assert_allclose(known, simulation.increments, rtol=0, atol=1e-9)
    assert before > 9.9


def test_updated_bits_mark_when_magnetometer_and_barometer_are_new():
    vehicle = Vehicle(load("car-city-drive"), rates={"HIL_SENSOR": 200.0})
    bits = [m.fields_updated for _ in range(400) for m in vehicle.step() if m.get_type() == "HIL_SENSOR"]
    assert len(bits) == 400
    assert sum(b >> 6 & 7 == 7 for b in bits) == 2 * MAGNETOMETER_HZ
    assert sum(b & 0x1A00 == 0x1A00 for b in bits) == 2 * BAROMETER_HZ


def test_undulation_changes_heights_above_sea_level_only():
    vehicle = Vehicle(load("car-city-drive"))
    for _ in range(400):
        vehicle.step()
    before = [read(vehicle, name) for name in ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "HOME_POSITION", "HIL_STATE_QUATERNION")]
    vehicle.view.undulation = 47.5
    after = [read(vehicle, name) for name in ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "HOME_POSITION", "HIL_STATE_QUATERNION")]
    for old, new in zip(before, after, strict=True):
        name = "altitude" if old.get_type() == "HOME_POSITION" else "alt"
        assert getattr(old, name) - getattr(new, name) == pytest.approx(47500, abs=1)
    assert before[0].relative_alt == after[0].relative_alt and before[1].alt_ellipsoid == after[1].alt_ellipsoid


def checked(message):
    """The number of a message that pymavlink's common dialect lacks, of a frame whose checksum is correct."""
    (frame,), used = split(bytes(message.pack(common.MAVLink(None, 1, 1))), Statistics())
    assert used == len(frame)
    return int.from_bytes(frame[7:10], "little")


def test_messages_that_pymavlink_lacks_are_defined_as_by_pymavlink():
    development = pytest.importorskip("pymavlink.dialects.v20.development")
    for name in ("AVAILABLE_MODES", "CURRENT_MODE"):
        theirs, ours = getattr(development, f"MAVLink_{name.lower()}_message"), further_messages()[name]
        for key in ("id", "fieldnames", "fieldtypes", "orders", "array_lengths", "crc_extra"):
            assert getattr(theirs, key) == getattr(ours, key), (name, key)
    # as published with the message set
    assert (further_messages()["PROTOCOL_VERSION"].crc_extra, further_messages()["COMPONENT_METADATA"].crc_extra) == (217, 182)
    vehicle = Vehicle(load("car-city-drive"))
    reader = development.MAVLink(None)
    modes = [reader.decode(bytearray(m.pack(common.MAVLink(None, 1, 1)))) for m in available_modes(vehicle.view)]
    assert [(m.number_modes, m.mode_index, m.custom_mode, m.mode_name) for m in modes] == [
        (2, 1, 0, "Scenario"), (2, 2, 1, "Manual control"),
    ]  # fmt: skip


def test_coarse_imu_messages_are_those_of_ardupilot():
    vehicle = Vehicle(load("car-city-drive"))
    for _ in range(40):
        vehicle.step()
    fine, raw, scaled = (vehicle.make(name) for name in ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU"))
    means = vehicle.simulation.increments / (40 * vehicle.simulation.interval)  # never sent before
    for message in (raw, scaled):
        assert message.zacc == round(means[5] / 9.80665 * 1e3) and message.xgyro == round(means[0] * 1e3)
        assert message.xmag == round(fine.xmag * 1e3) and message.temperature == round(fine.temperature * 100)


def test_every_message_of_every_kind_of_scenario_packs():
    for name in ("ship-swaying", "car-city-drive", "aircraft-survey"):
        vehicle = Vehicle(load(name))
        for _ in range(400):
            vehicle.step()
        made = {kind: vehicle.make(kind) for kind in MESSAGES}
        without_gnss = {"GPS_RAW_INT", "HIL_GPS"} if name == "ship-swaying" else set()
        assert {kind for kind, message in made.items() if message is None} <= without_gnss | {"HIL_GPS"}
        known = {kind: message for kind, message in made.items() if message is not None and kind not in DEFINITIONS}
        assert all(received(message).get_type() == kind for kind, message in known.items())
        assert all(checked(made[kind]) == number for kind, (number, _) in DEFINITIONS.items())
        expected = {"ship-swaying": 11, "car-city-drive": 10, "aircraft-survey": 1}[name]
        assert (made["HEARTBEAT"].type, made["HEARTBEAT"].autopilot) == (expected, 0)
        assert not vehicle.view.fields.saturated and not vehicle.view.fields.refused


def test_an_alignment_sends_the_known_position_and_no_velocity():
    vehicle = Vehicle(load("ship-swaying"), rates=dict.fromkeys(DEFAULT_HZ, 0.0))
    for _ in range(20_000):
        vehicle.step()
    message, known = read(vehicle, "GLOBAL_POSITION_INT"), vehicle.simulation.plant.knowledge
    assert abs(message.lat - known.latitude * DEG_E7) <= 0.5 and (message.vx, message.vy, message.vz) == (0, 0, 0)
    assert np.isnan(read(vehicle, "ODOMETRY").velocity_covariance[0])  # there is no velocity
    error = attitude.numeric.error_rotation_vector(vehicle.simulation.estimate["q_nb"], vehicle.simulation.truth["q_nb"])
    assert np.all(np.abs(error) < 1 * DEG)
    flags = read(vehicle, "ESTIMATOR_STATUS").flags
    assert flags & 1 and not flags & 2  # attitude good; no velocity


# --- magnetometer and barometer ------------------------------------------------------------------------


def parked(**sections):
    values = {"title": "t", "duration_s": 60.0, "start": {"latitude_deg": 50, "longitude_deg": 8, "height_m": 200.0}}
    return parse({**values, "vehicle": {"kind": "car"}, **sections})


def advanced(vehicle, samples):
    for _ in range(samples):
        vehicle.step()
    return vehicle.view.air


def test_the_stream_shows_the_instruments_of_the_scenario():
    """As they measure, with the errors that the scenario states, and at their own rates."""
    given = parked(
        magnetometer={
            "grade": "perfect",
            "hard_iron_nt": [1000.0, -2000.0, 500.0],
            "interval_s": 0.1,
            "field_nt": [2e4, 0, 4e4],
        },
        barometer={"grade": "perfect", "bias_m": 25.0, "interval_s": 0.2},
    )
    vehicle = Vehicle(given, "q-method")
    air = advanced(vehicle, 200)
    assert vehicle.simulation.readings == {"magnetometer": 10, "barometer": 5}
    field = np.array([2e4, 0, 4e4]) + [1000.0, -2000.0, 500.0]
    np.testing.assert_allclose(air.magnetic_b * 1e9, field, atol=1e-6)
    assert air.pressure_height == pytest.approx(225.0, abs=1e-9)
    assert received(vehicle.make("HIGHRES_IMU")).xmag == pytest.approx(0.21, abs=1e-6)


def test_without_them_it_has_a_field_of_the_date_and_no_number_of_the_run_changes():
    from pygeomag import GeoMag

    given = load("car-city-drive")
    vehicle = Vehicle(given, start_unix=1.8e9)
    air = advanced(vehicle, 400)
    exact = GeoMag().calculate(given.start.latitude_deg, given.start.longitude_deg, given.start.height_m / 1e3, 2027.04)
    C_nb = attitude.numeric.to_dcm(vehicle.simulation.truth["q_nb"])
    np.testing.assert_allclose(C_nb @ air.magnetic_b * 1e9, [exact.x, exact.y, exact.z], atol=5 * 50.0)
    alone = build(given)
    shown = alone.model.outputs.unpack(make_runner(alone.model, alone.parameters).run(400))
    for name, values in shown.items():
        np.testing.assert_array_equal(vehicle.simulation.truth[name], values[-1], err_msg=name)


def test_before_the_first_measurement_there_is_none():
    vehicle = Vehicle(load("car-city-drive"), rates={"HIL_SENSOR": 200.0, "SCALED_PRESSURE": 200.0})
    first = {m.get_type(): m for m in vehicle.step()}
    assert "SCALED_PRESSURE" not in first and first["HIL_SENSOR"].fields_updated & 0x1FC0 == 0
    assert first["HIL_SENSOR"].abs_pressure == pytest.approx(966.1, abs=0.5), "at 400 m in the standard atmosphere"


@pytest.mark.parametrize(
    "height, pressure, kelvin", [(0.0, 101325.0, 288.15), (10_000.0, 26_436.3, 223.15), (1000.0, 89_874.6, 281.65)]
)
def test_pressure_is_that_of_the_standard_atmosphere(height, pressure, kelvin):
    """Table of the U.S. Standard Atmosphere, 1976, at geopotential heights; 50 m of undulation."""
    geometric = 6356766.0 * height / (6356766.0 - height)
    truth = {"velocity_n": np.array([100.0, 0, 0]), "height": geometric + 50.0, "barometer_height": geometric + 50.0}
    truth["magnetometer_field_b"] = np.zeros(3)
    air = Surroundings(1).data(truth, 50.0, 1)
    assert air.pressure == pytest.approx(pressure, rel=2e-5) and air.temperature == pytest.approx(kelvin, abs=2e-3)
    assert air.pressure_height == pytest.approx(geometric, abs=1e-9)
    assert air.density == pytest.approx(pressure / (287.05287 * kelvin), rel=1e-4)
    assert air.dynamic_pressure == pytest.approx(0.5 * pressure / (287.05287 * kelvin) * 1e4, abs=6.0)  # of 1 Pa of noise


# --- fixes and outages ---------------------------------------------------------------------------------


def with_receiver(**changed):
    """The car with another receiver, and HIL_GPS and ESTIMATOR_STATUS only."""
    car = load("car-city-drive")
    gnss = car.gnss.model_copy(update={"outages_s": (), "outlier_probability": 0.0, **changed})
    rates = {**dict.fromkeys(DEFAULT_HZ, 0.0), "HIL_GPS": DEFAULT_HZ["HIL_GPS"]}
    return Vehicle(car.model_copy(update={"gnss": gnss}), rates=rates)


@pytest.mark.parametrize("interval, latency", [(0.05, 0.0), (0.02, 0.01), (1.0, 0.05), (0.015, 0.0)])
def test_hil_gps_is_every_fix(interval, latency):
    vehicle = with_receiver(interval_s=interval, latency_s=latency, epoch_offset_s=0.0)
    times, fixes = [], []
    for _ in range(600):
        seen = vehicle.simulation.fixes
        sent = [m for m in vehicle.step() if m.get_type() == "HIL_GPS"]
        assert len(sent) == vehicle.simulation.fixes - seen  # in the sample in which the fix is delivered
        times += [m.time_usec for m in sent]
        fixes += [round(vehicle.simulation.fix.time * 1e6) for _ in sent]
    assert times == fixes and len(times) >= int((3.0 - latency) / interval)
    np.testing.assert_allclose(np.diff(times), interval * 1e6, atol=1)


@pytest.mark.parametrize("by_command", [False, True])
def test_an_outage_is_no_fix_at_the_rate_of_the_receiver(by_command):
    changed = {} if by_command else {"outages_s": ((5.0, 15.0),)}
    vehicle = with_receiver(interval_s=0.5, latency_s=0.1, epoch_offset_s=0.0, **changed)
    sent, status = [], []
    for sample in range(1, 4001):
        if by_command and sample in (1000, 3000):
            vehicle.set_gnss(sample == 3000)
        sent += [(vehicle.simulation.time, m) for m in vehicle.step() if m.get_type() == "HIL_GPS"]
        if sample % 200 == 0:
            status.append(vehicle.make("ESTIMATOR_STATUS"))
    outage = [m for time, m in sent if 6.5 < time < 14.5]
    assert {m.fix_type for m in outage} == {1} and 15 <= len(outage) <= 17
    assert {m.fix_type for time, m in sent if time < 5.0 or time > 15.7} == {3}
    assert all(a.time_usec < b.time_usec for (_, a), (_, b) in pairwise(sent))
    before = max(m.time_usec for time, m in sent if time < 5.0)
    held = next(m for _, m in sent if m.time_usec == before)
    assert abs(outage[0].lat - held.lat) < 10_000 and (outage[0].eph, outage[0].vel, outage[0].cog) == (65535,) * 3
    # the estimator's status follows: no absolute position and no innovation, while dead reckoning stays good
    absolute, relative, glitch = 16 | 32, 8 | 256 | 512, 1024
    assert all(s.flags & absolute == absolute and s.pos_horiz_ratio == s.pos_horiz_ratio for s in status[1:4] + status[16:])
    for s in status[7:14]:
        assert not s.flags & (absolute | glitch) and s.flags & relative == relative
        assert s.pos_horiz_ratio != s.pos_horiz_ratio and s.vel_ratio != s.vel_ratio


def test_no_fix_is_sent_before_the_first_one():
    vehicle = with_receiver(interval_s=0.5, latency_s=0.0, epoch_offset_s=0.0, outages_s=((0.0, 3.0),))
    sent = [m for _ in range(500) for m in vehicle.step() if m.get_type() == "HIL_GPS"]
    assert len(sent) == 4 and {(m.fix_type, m.lat, m.lon) for m in sent} == {(1, 0, 0)}

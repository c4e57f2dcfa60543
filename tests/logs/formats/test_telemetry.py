"""MAVLink telemetry logs: messages, parameters and places."""

import random

import numpy as np
import pytest
from flight_drive import START_UNIX, described, drive, telemetry

from insenv import replay, run
from insenv.base.errors import InputError
from insenv.logs import load
from insenv.logs.formats.tlog import TelemetryLog, TlogWriter
from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.simulation import Simulation
from insenv.mavlink.wire import dialect, open_link
from insenv.scenario import build
from insenv.scenario import load as load_scenario


def streamed(path, scenario, estimator, seconds):
    vehicle = Vehicle(load_scenario(scenario), estimator, speed=0.0, start_unix=START_UNIX)
    with open_link("udpout:127.0.0.1:14599") as link, TlogWriter(path) as log:
        Stream(vehicle, link, log).run(seconds)
    return path


def test_lever_arm_data_sheet_and_settings_are_in_the_log(tmp_path):
    log = load(streamed(tmp_path / "drive.tlog", "car-city-drive", "loosely-coupled", 3.0))
    assert log.lever_arm_b == pytest.approx([-1.2, 0.3, -1.0])
    parameters = build(load_scenario("car-city-drive")).parameters
    for name in ("angle_random_walk", "gyro_bias_sigma"):
        np.testing.assert_allclose(log.unit[name], parameters[name], rtol=1e-6)
    assert log.settings["loosely-coupled"]["fix_wander_sigma"] == pytest.approx([1.5, 1.5, 3.05])
    assert any("lever arm of the antenna -1.2, 0.3, -1 m" in note for note in log.notes)
    told = load(described(tmp_path / "drive.tlog", 'lever_arm_m = [0.0, 0.0, 0.0]\ngrade = "consumer"'))
    assert told.lever_arm_b.tolist() == [0.0, 0.0, 0.0] and told.unit is None


def test_a_moored_ship_is_aligned_at_its_home_position(tmp_path):
    path = streamed(tmp_path / "moored.tlog", "ship-moored-paper", "q-method", 10.0)
    again, original = replay(path, "q-method"), run("ship-moored-paper", "q-method", duration_s=10.0)
    assert any("the place is that of HOME_POSITION, 28.2" in note for note in again.notes)
    for channel in ("roll_deg", "pitch_deg", "heading_deg"):
        assert again.results[0].errors[channel][-1] == pytest.approx(original.results[0].errors[channel][-1], abs=2e-4)


def test_the_log_holds_what_the_instruments_showed(tmp_path):
    path = streamed(tmp_path / "flight.tlog", "multirotor-hover", "loosely-coupled", 3.0)
    again = Simulation(load_scenario("multirotor-hover"), "loosely-coupled")
    shown = {"magnetometer_field_b": [], "barometer_height": []}
    for _ in range(600):
        again.advance()
        for name, rows in shown.items():
            if again.truth[f"{name.split('_')[0]}_new"]:
                rows.append((again.time, *np.ravel(again.truth[name])))
    found = {each.id: each for each in load(path).instruments}
    for name, rows in shown.items():
        written, read = np.array(rows)[:45], found[name.split("_")[0]]
        np.testing.assert_allclose(read.time[:45], written[:, 0], atol=1e-6)
        np.testing.assert_allclose(read.values[:45], written[:, 1:], rtol=1e-6, atol=1e-11)


def test_accuracies_are_those_of_gps_raw_int(tmp_path):
    """eph and epv of HIL_GPS are dilutions by the definition, here 0.9 and 1.5; GPS_RAW_INT states metres, fix by fix."""
    mavlink, path = dialect(), tmp_path / "flight.tlog"
    packer, place = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), (470000000, 150000000, 400000)
    with TlogWriter(path) as log:
        for i in range(1, 1001):
            t = i * 10_000
            sample = (0.0, 0.0, -9.8, 0.0, 0.0, 0.0, *[0.0] * 7, 0b111111, 0)
            messages = [mavlink.MAVLink_hil_sensor_message(t, *sample)]
            if i % 100 == 0:
                speed = 65535 if i == 500 else 0
                messages += [
                    mavlink.MAVLink_hil_gps_message(t, 3, *place, 90, 150, speed, 0, 0, 0, 0, 9),
                    mavlink.MAVLink_gps_raw_int_message(t, 3, *place, 90, 150, 0, 0, 9, 445000, 1000 + i, 2000 + i, 300, 0),
                ]
            for message in messages:
                log.write(1_700_000_000_000_000 + t, message.pack(packer))
    found, more = load(path).gnss, np.arange(1, 11) * 0.1
    np.testing.assert_allclose(found.position_sigma, np.stack([1 + more, 1 + more, 2 + more], axis=1), atol=1e-9)
    assert found.velocity_sigma[0].tolist() == pytest.approx([0.3] * 3)
    assert found.velocity_sigma[4].tolist() == [100.0] * 3  # the receiver had no velocity then


def test_the_heading_of_gps_raw_int(tmp_path):
    """In 0.01 deg: 36000 is north, 0 a receiver without a heading, 65535 one that has none now; accuracy in 1e-5 deg."""
    mavlink, path = dialect(), tmp_path / "flight.tlog"
    packer, yaws = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), (0, 65535, 36000, 1, 9000, 27000)
    with TlogWriter(path) as log:
        for i in range(1, 601):
            messages = [mavlink.MAVLink_hil_sensor_message(i * 10_000, 0.0, 0.0, -9.8, *[0.0] * 10, 0b111111, 0)]
            if i % 100 == 0:
                fix = (470000000, 150000000, 400000, 90, 150, 0, 0, 9, 445000, 1000, 2000, 300, 50_000)
                messages += [mavlink.MAVLink_gps_raw_int_message(i * 10_000, 3, *fix, yaws[i // 100 - 1])]
            for message in messages:
                log.write(1_700_000_000_000_000 + i * 10_000, message.pack(packer))
    (found,) = (each for each in load(path).instruments if each.id == "heading")
    np.testing.assert_allclose(found.time, [3.0, 4.0, 5.0, 6.0], atol=1e-6)
    np.testing.assert_allclose(np.degrees(found.values[:, 0]), [0.0, 0.01, 90.0, -90.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(found.values[:, 1]), 0.5)


def test_messages_that_are_missing(tmp_path):
    imu = {"HIL_SENSOR", "HIGHRES_IMU"}
    none = telemetry(drive(), tmp_path / "none.tlog", lambda message: message.get_type() in imu)
    with pytest.raises(InputError, match="no inertial unit at a usable rate, 20 Hz or more: found none at all"):
        load(none)
    path = telemetry(drive(), tmp_path / "blind.tlog", lambda message: "GPS" in message.get_type())
    assert any(note == "no GNSS: the log has no fixes" for note in load(path).notes)
    path = telemetry(drive(), tmp_path / "hil.tlog", lambda message: message.get_type() == "GPS_RAW_INT")
    log, (_, fix) = load(path), drive().fixes[0]
    assert any(note.startswith("HIL_GPS: eph and epv are taken as accuracies in cm") for note in log.notes)
    np.testing.assert_allclose(log.gnss.position_sigma[0], fix.position_sigma, atol=5.1e-3)


def test_another_unit_receiver_and_reference(tmp_path):
    text = 'imu = "HIGHRES_IMU"\ngnss = "GPS_RAW_INT"\nreference = "ATTITUDE_QUATERNION, GLOBAL_POSITION_INT"\n'
    text += "gnss_time_offset_s = -0.1\nlever_arm_m = [0.5, 0.0, -1.0]\nposition_sigma_m = [3.0, 4.0, 5.0]"
    own = drive()
    log = load(described(telemetry(own, tmp_path / "flight.tlog"), text))
    assert log.rate_hz == pytest.approx(50.0, rel=1e-3)
    assert (log.gnss.velocity_sigma[:, 2] == 100.0).all()  # GPS_RAW_INT knows nothing of the vertical velocity
    assert (log.gnss.position_sigma == [3.0, 4.0, 5.0]).all() and log.lever_arm_b.tolist() == [0.5, 0.0, -1.0]
    valid = [fix.time for _, fix in own.fixes[: len(log.gnss.time)]]
    np.testing.assert_allclose(log.gnss.time + 0.1, valid, atol=1e-6)
    estimate = own.estimate["velocity_n"][np.rint(log.reference.time / own.interval).astype(int) - 1]
    np.testing.assert_allclose(log.reference.velocity_n, estimate, atol=0.0051)


def test_broken_bytes_cost_the_record_that_they_are_in(tmp_path):
    whole = telemetry(drive(), tmp_path / "flight.tlog").read_bytes()
    records = sum(len(group) for group in drive().messages)
    clean = TelemetryLog(whole)
    assert len(list(clean)) == records == clean.records and clean.skipped == clean.wrong == 0
    draw = random.Random(3)
    at = draw.randrange(len(whole) // 2)
    broken = TelemetryLog(whole[:at] + bytes((whole[at] ^ 0x55,)) + whole[at + 1 : -5])  # the end of the last one is cut off
    assert records - 3 <= len(list(broken)) <= records - 1
    junk = TelemetryLog(draw.randbytes(100_000) + whole[: len(whole) // 10])
    assert len(list(junk)) >= records // 10 - 10
    (tmp_path / "junk.tlog").write_bytes(draw.randbytes(5000))
    with pytest.raises(InputError, match="not a MAVLink telemetry log"):
        load(tmp_path / "junk.tlog")


def test_a_writer_that_was_cut_off_leaves_a_readable_part(tmp_path):
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

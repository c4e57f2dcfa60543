"""ROS bags and MCAP recordings."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import insenv
from insenv.base.errors import InputError
from insenv.logs import load

highlevel, rosbag2 = pytest.importorskip("rosbags.highlevel"), pytest.importorskip("rosbags.rosbag2")
EPOCH_NS = 1767225600 * 10**9  # 2026-01-01
SCENARIO = {
    "title": "Car north of Tromso", "duration_s": 12.0, "rate_hz": 100.0, "seed": 2,
    "start": {"latitude_deg": 70.0, "longitude_deg": 19.0, "height_m": 50.0, "heading_deg": 60.0},
    "vehicle": {"kind": "car", "legs": [{"wait_s": 4.0}, {"accelerate_to_mps": 15.0}, {"turn_deg": 90.0, "radius_m": 30.0}]},
    "imu": {"grade": "tactical", "temperature_start_degc": 15.0, "temperature_end_degc": 40.0},
    "gnss": {"grade": "rtk", "latency_s": 0.1, "interval_s": 0.2, "lever_arm_m": [0.5, 0.0, -1.0],
             "position_noise_m": [0.01, 0.02, 0.04], "velocity_noise_mps": [0.03, 0.05, 0.07]},
    "magnetometer": {"interval_s": 0.1},
}  # fmt: skip


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ros")
    report, log = insenv.run(SCENARIO, "loosely-coupled"), insenv.record(SCENARIO)
    paths = insenv.write(report, folder, ["bag", "mcap"], log=log, name="drive")
    return report, log, {"bag": folder / "drive-bag", "mcap": folder / "drive.mcap", "db3": paths[0]}


def messages(path):
    """All messages by topic, with the times at which they were recorded, by rosbags."""
    found = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, at, raw in reader.messages():
            found.setdefault(connection.topic, []).append((at, reader.deserialize(raw, connection.msgtype)))
    return found


def stamp(message):
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def test_messages_have_the_axes_units_and_times_of_ros(drive):
    _, log, paths = drive
    found = messages(paths["bag"])
    assert {topic: len(each) for topic, each in found.items()} == {
        "/imu/data": 1200, "/imu/temperature": 1200, "/magnetometer": 120, "/gnss/fix": 59, "/gnss/velocity": 59,
        "/truth/odometry": 1200, "/truth/fix": 1200, "/loosely_coupled/odometry": 1200, "/loosely_coupled/fix": 1200,
    }  # fmt: skip
    at, imu = found["/imu/data"][100]
    assert at == EPOCH_NS + round(log.imu_time[100] * 1e9)
    assert abs(stamp(imu) - EPOCH_NS - (log.imu_time[100] - 0.005) * 1e9) <= 1, "the middle of the interval"
    assert imu.linear_acceleration.z == pytest.approx(9.82, abs=0.05), "at rest the force points up"
    rates = np.array([[m.angular_velocity.x, -m.angular_velocity.y, -m.angular_velocity.z] for _, m in found["/imu/data"]])
    np.testing.assert_allclose(rates * 0.01, log.delta_angle, atol=1e-17, rtol=1e-12)
    at, warmth = found["/imu/temperature"][700]
    assert at == stamp(warmth) == EPOCH_NS + round(log.imu_time[700] * 1e9)
    assert warmth.temperature == pytest.approx(log.temperature[700] - 273.15, abs=1e-9)
    assert log.temperature[700] - log.temperature[0] > 0.1, "the unit of this drive warms up"
    assert imu.orientation_covariance[0] == -1.0, "there is no orientation"
    arw = log.sensors(in_place=False).angle_random_walk
    assert imu.angular_velocity_covariance[0] == pytest.approx(arw**2 / 0.01)
    at, fix = found["/gnss/fix"][10]
    assert at - stamp(fix) == pytest.approx(0.1e9, abs=2), "recorded on arrival, stamped with its time of validity"
    assert fix.latitude == pytest.approx(np.degrees(log.gnss.latitude[10]), abs=1e-12) and fix.altitude == log.gnss.height[10]
    np.testing.assert_allclose(np.sqrt(fix.position_covariance[[4, 0, 8]]), log.gnss.position_sigma[10])
    twist = found["/gnss/velocity"][10][1].twist
    np.testing.assert_allclose(np.array(twist.covariance)[[7, 0, 14]], log.gnss.velocity_sigma[10] ** 2)
    field = found["/magnetometer"][5][1].magnetic_field
    np.testing.assert_allclose([field.x, -field.y, -field.z], log.instruments[0].values[5])


def test_odometry_is_the_track_in_east_north_up(drive):
    """Independent of our rotations: scipy, and a plane Earth over the 100 m of the drive."""
    report, _, paths = drive
    found, truth = messages(paths["mcap"]), report.truth
    message = found["/truth/odometry"][-1][1]
    assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
    q, v = message.pose.pose.orientation, message.twist.twist.linear
    roll, pitch, heading = truth.euler_deg()[-1]
    expected = Rotation.from_euler("ZYX", [90.0 - heading, -pitch, roll], degrees=True)
    apart = (Rotation.from_quat([q.x, q.y, q.z, q.w]).inv() * expected).magnitude()
    assert np.degrees(apart) < 0.01, "the convergence of the meridians over 100 m at 70 deg is 0.003 deg"
    assert v.x == pytest.approx(np.linalg.norm(truth.velocity_n[-1]), rel=1e-3) and abs(v.y) < 0.3
    place = message.pose.pose.position
    way = np.cumsum(truth.velocity_n, axis=0)[-1] * 0.01
    np.testing.assert_allclose([place.x, place.y], way[[1, 0]], atol=0.2)
    result = report.results[0]
    covariance = found["/loosely_coupled/odometry"][-1][1].pose.covariance
    assert np.sqrt(covariance[0]) == pytest.approx(result.sigma["east_m"][-1])
    assert np.sqrt(covariance[35]) == pytest.approx(np.radians(result.sigma["heading_deg"][-1]))


def test_mcap_is_read_by_its_own_reader(drive):
    reader = pytest.importorskip("mcap_ros2.reader")
    _, log, paths = drive
    found = [m.ros_msg.latitude for m in reader.read_ros2_messages(str(paths["mcap"]), topics=["/gnss/fix"])]
    np.testing.assert_allclose(found, np.degrees(log.gnss.latitude), atol=1e-12)


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
def test_a_bag_is_replayed_as_a_log(drive, kind):
    _, log, paths = drive
    back = load(paths[kind])
    start = log.dt[0] / 2  # the clock begins with the first stamp, the middle of the first sample
    np.testing.assert_allclose(back.gnss.time + start, log.gnss.time, atol=1e-8)
    for name in ("latitude", "longitude"):
        np.testing.assert_allclose(getattr(back.gnss, name), getattr(log.gnss, name), atol=1e-15)
    np.testing.assert_allclose(back.gnss.velocity_n, log.gnss.velocity_n, atol=1e-12)
    assert len(np.unique(log.gnss.position_sigma)) == len(np.unique(log.gnss.velocity_sigma)) == 3, "north, east, down differ"
    for name in ("position_sigma", "velocity_sigma"):
        np.testing.assert_allclose(getattr(back.gnss, name), getattr(log.gnss, name), rtol=1e-12, err_msg=name)
    for name in ("roll", "pitch", "heading", "velocity_n", "height"):
        rows = np.rint((back.reference.time + start) * 100.0).astype(int) - 1
        np.testing.assert_allclose(getattr(back.reference, name), getattr(log.reference, name)[rows], atol=1e-9, err_msg=name)
    total = (0.5 * (log.delta_angle[0] + log.delta_angle[-1])) + log.delta_angle[1:-1].sum(axis=0)
    np.testing.assert_allclose(back.delta_angle.sum(axis=0), total, atol=1e-9)
    (field,) = back.instruments
    np.testing.assert_allclose(field.values, log.instruments[0].values, rtol=1e-12)
    assert "reference: /truth/odometry, a simulator's truth" in back.notes


def test_a_ros_1_bag_is_read_too(tmp_path):
    """A unit that lies still, level, heading unknown: by hand, with the writer of rosbags."""
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types, kind = store.types, "sensor_msgs/msg/Imu"
    vector, zero = types["geometry_msgs/msg/Vector3"], np.zeros(9)
    with rosbag1.Writer(tmp_path / "still.bag") as writer:
        topic = writer.add_connection("/imu", kind, typestore=store)
        for count in range(300):
            at = 1_700_000_000 * 10**9 + count * 10**7
            header = types["std_msgs/msg/Header"](count, types["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9), "imu")
            still = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            message = types[kind](header, still, zero, vector(0.1, 0.2, 0.3), zero, vector(1.0, 2.0, 9.5), zero)
            writer.write(topic, at, store.serialize_ros1(message, kind))
    log = load(tmp_path / "still.bag")
    np.testing.assert_allclose(log.delta_angle, np.tile([0.001, -0.002, -0.003], (299, 1)), rtol=1e-6)
    np.testing.assert_allclose(log.delta_velocity, np.tile([0.01, -0.02, -0.095], (299, 1)), rtol=1e-6)
    assert log.gnss is None and log.imu_time[0] == pytest.approx(0.01, abs=1e-9)


def test_a_bag_that_was_cut_off_is_refused(tmp_path, drive):
    (tmp_path / "cut.mcap").write_bytes(drive[2]["mcap"].read_bytes()[:5000])
    with pytest.raises(InputError, match=r"cut\.mcap: not readable as a ROS bag"):
        load(tmp_path / "cut.mcap")


def test_an_odometry_without_a_place_is_no_reference(tmp_path, drive):
    """Its north is arbitrary; of our bag the NavSatFix of truth and estimate are left out."""
    made = {}
    with highlevel.AnyReader([drive[2]["bag"]]) as reader, rosbag2.Writer(tmp_path / "part", version=8) as writer:
        for connection, at, raw in reader.messages():
            topic = connection.topic
            if topic not in made:
                made[topic] = writer.add_connection(topic, connection.msgtype, typestore=reader.typestore)
            if topic not in ("/truth/fix", "/loosely_coupled/fix"):
                writer.write(made[topic], at, raw)
    part = load(tmp_path / "part")
    assert part.reference is None and any("/truth/odometry: not used" in note for note in part.notes)

"""The score of estimates that a client sends: known errors come back; frames, stated accuracies, nonsense."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from streamed_vehicle import SILENT, decoded, estimate, frame_of, quiet, steps

import insenv
from insenv import geodesy
from insenv.base.errors import InputError
from insenv.mavlink import Vehicle
from insenv.mavlink.commands import answers
from insenv.mavlink.score import Origin, Score, estimate_of, report_of
from insenv.scenario import build, limit_of, load

HEADING_ERROR, NORTH_ERROR, VELOCITY_ERROR = 1.5, 2.0, 0.3  # deg, m, m/s forward


def judged(scenario, reply, seconds=6.0, limited=True):
    """A vehicle whose truth a client gets and answers with estimates, and the answers that come back to it.

    reply: called with HIL_STATE_QUATERNION and the last HOME_POSITION; gives messages.
    """
    loaded, home, back = load(scenario), None, []
    vehicle = Vehicle(loaded, seed=3, rates={**SILENT, "HIL_STATE_QUATERNION": 50.0, "HOME_POSITION": 10.0})
    vehicle.score = Score(vehicle.view, limit_of(build(loaded, seed=3, duration_s=seconds)) if limited else None)
    for _ in range(round(seconds / vehicle.simulation.interval)):
        for made in vehicle.step():
            (message,) = decoded(frame_of(made, system=1, component=1))
            home = message if message.get_type() == "HOME_POSITION" else home
            if message.get_type() == "HIL_STATE_QUATERNION" and home is not None:
                back += [answer for each in reply(message, home) for answer in answers(vehicle, each)]
    return vehicle, back


def off(message):
    """The true attitude with a heading error, and the true velocity (n)."""
    wrong = Rotation.from_euler("z", HEADING_ERROR, degrees=True)
    wrong = wrong * Rotation.from_quat(message.attitude_quaternion, scalar_first=True)
    return wrong, np.array([message.vx, message.vy, message.vz]) * 0.01


def odometry(message, home):
    """ODOMETRY with a heading error, 2 m too far north, 0.3 m/s too fast forward; velocity in the body's axes."""
    wrong, velocity = off(message)
    home = [np.radians(home.latitude * 1e-7), np.radians(home.longitude * 1e-7), home.altitude * 1e-3]
    place = [np.radians(message.lat * 1e-7), np.radians(message.lon * 1e-7), message.alt * 1e-3]
    north, east, down = np.ravel(geodesy.numeric.ned_offset(*place, *home)) + [NORTH_ERROR, 0.0, 0.0]
    vx, vy, vz = wrong.inv().apply(velocity + wrong.apply([VELOCITY_ERROR, 0.0, 0.0]))
    pose = np.zeros(21)
    pose[[0, 6, 11, 15, 18, 20]] = np.array([3.0, 3.0, 3.0, 0.01, 0.01, 0.05]) ** 2
    q = wrong.as_quat(scalar_first=True)
    numbers = {"x": north, "y": east, "z": down, "vx": vx, "vy": vy, "vz": vz, "pose_covariance": pose}
    return [estimate("ODOMETRY", time_usec=message.time_usec, q=q, **numbers)]


def test_odometry_with_known_errors_is_scored_with_these():
    vehicle, back = judged("car-city-drive", odometry)
    report = report_of(vehicle.score)
    (result,) = report.results
    assert result.estimator == "odometry-42-191" and len(result.time) > 250 and not vehicle.score.refused
    heading = np.radians(90.0 + HEADING_ERROR)
    for name, error, tolerance in (
        ("heading_deg", HEADING_ERROR, 1e-4),
        ("north_m", NORTH_ERROR, 0.02),  # 1e-7 deg in the messages
        ("east_m", 0.0, 0.02),
        ("vn_mps", VELOCITY_ERROR * np.cos(heading), 0.01),
        ("ve_mps", VELOCITY_ERROR * np.sin(heading), 0.01),
    ):
        np.testing.assert_allclose(result.errors[name], error, atol=tolerance, err_msg=name)
    np.testing.assert_allclose(result.sigma["heading_deg"], np.degrees(0.05), rtol=1e-6)
    assert result.sigma["north_m"][0] == pytest.approx(3.0) and "vn_mps" not in result.sigma
    run = insenv.run("car-city-drive", "loosely-coupled", seed=3, duration_s=6.0)
    limit = np.interp(result.time, run.results[0].time, run.results[0].limit_sigma["heading_deg"])
    np.testing.assert_allclose(result.limit_sigma["heading_deg"], limit, rtol=0.02)
    sent, headings = {m.name: m.value for m in back}, [m for m in back if m.name == "E_HEADING"]
    assert sent["E_HEADING"] == pytest.approx(HEADING_ERROR, abs=1e-3) and sent["E_NORTH"] == pytest.approx(2.0, abs=0.02)
    assert 0.0 < sent["L_HEADING"] < 4.0 and len(headings) in (5, 6)
    times = np.round([m.time_boot_ms * 1e-3 for m in headings], 3)
    assert set(times) <= set(np.round(result.time, 3)), "an answer has the time of the estimate"


def test_attitudes_alone_are_scored_as_an_alignment_by_each_message():
    """Ten messages late, which is no error of them."""
    waiting = []

    def reply(message, home):
        waiting.append(message)
        if len(waiting) <= 10:
            return
        message = waiting.pop(0)
        wrong, _ = off(message)
        time, (yaw, pitch, roll) = message.time_usec // 1000, wrong.as_euler("ZYX")
        q = dict(zip(("q1", "q2", "q3", "q4"), wrong.as_quat(scalar_first=True), strict=True))
        yield estimate("ATTITUDE", time_boot_ms=time, roll=roll, pitch=pitch, yaw=yaw)
        yield estimate("ATTITUDE_QUATERNION", time_boot_ms=time, **q)

    vehicle, _ = judged("ship-swaying", reply, 2.0, limited=False)
    report = report_of(vehicle.score)
    for source in vehicle.score.sources.values():
        np.testing.assert_allclose(source.delays, 0.2, atol=1e-6)
    assert {result.estimator for result in report.results} == {"attitude-42-191", "attitude-quaternion-42-191"}
    for result in report.results:
        assert result.from_s == pytest.approx(0.75 * result.time[-1])
        assert set(result.errors) == {"roll_deg", "pitch_deg", "heading_deg"} and not result.limit
        np.testing.assert_allclose(result.errors["heading_deg"], HEADING_ERROR, atol=1e-3)


@pytest.fixture
def vehicle():
    vehicle = quiet(seed=1, start_unix=1.7e9)
    vehicle.score = Score(vehicle.view)
    steps(vehicle, 2.0)
    return vehicle


def test_times_without_truth_are_refused_and_counted_by_kind(vehicle):
    def send(**changes):
        return list(answers(vehicle, estimate("ODOMETRY", **changes)))

    assert send(time_usec=1_000_000)
    assert not send(time_usec=1_000_000) and not send(time_usec=2_500_000) and not send(time_usec=2_600_000)
    assert not send(time_usec=0) and not send(frame_id=7, time_usec=1_500_000)
    assert not send(time_usec=1_500_000), "a second has not passed since the last answer"
    assert send(time_usec=1_700_000_000_000_000 + 2_000_000), "Unix time of the run's clock"
    assert vehicle.score.sources["odometry-42-191"].count == 3
    assert list(vehicle.score.refused.values()) == [1, 2, 1, 1]
    for refused, word in zip(
        vehicle.score.refused, ("does not follow 1.0", "(2.500 s, clock 2.000 s)", "older", "= 7"), strict=True
    ):
        assert word in refused
    assert "frame_id = 7: allowed is 1 (MAV_FRAME_LOCAL_NED)" in "".join(text.text for text in vehicle.texts())
    vehicle.score = None
    assert not send(time_usec=2_000_000)


def test_of_very_many_estimates_a_part_is_kept(vehicle, monkeypatch):
    monkeypatch.setattr("insenv.mavlink.score.MAX_ESTIMATES", 4)
    for number in range(1, 11):
        vehicle.score.take(estimate("ODOMETRY", time_usec=number * 100_000))
    (source,) = vehicle.score.sources.values()
    assert [round(each.time, 6) for each, _ in source.recorded] == [0.1, 0.5, 0.9] and source.count == 10
    assert any("one in 4 of them is recorded" in note for note in report_of(vehicle.score).results[0].notes)


def test_truth_between_two_samples_is_that_of_the_motion():
    """At 60 m/s: the error of a straight interpolation is far below a millimetre."""
    name = "aircraft-inflight-alignment"
    plane, columns = quiet(name, seed=1), insenv.record(name, seed=1, duration_s=1.5).reference
    plane.score = Score(plane.view)
    steps(plane, 1.5)
    plane.score.take(estimate("ODOMETRY", time_usec=1_002_100))
    ((_, truth),) = plane.score.sources["odometry-42-191"].recorded
    row = round(1.0 / plane.simulation.interval) - 1
    assert columns.time[row] == pytest.approx(1.0)
    rows = np.ravel([columns.latitude[row], columns.longitude[row], columns.height[row]])
    moved = np.ravel(geodesy.numeric.ned_offset(*(float(truth[name]) for name in ("latitude", "longitude", "height")), *rows))
    np.testing.assert_allclose(moved, columns.velocity_n[row] * 0.0021, atol=1e-4)
    assert np.linalg.norm(moved) > 0.05 and np.linalg.norm(truth["q_nb"]) == pytest.approx(1.0, abs=1e-12)


def test_what_changes_the_drive_ends_the_limit_and_so_does_the_end_of_the_scenario(vehicle):
    score = vehicle.score
    score.limit = limit_of(build(load("car-city-drive"), duration_s=1.0))
    score.take(estimate("ODOMETRY", time_usec=900_000))
    assert report_of(score).results[0].limit
    score.take(estimate("ODOMETRY", time_usec=1_500_000))
    report = report_of(score)
    assert not report.results[0].limit and "no limit: the estimates last longer than the scenario, 1 s" in report.notes
    score.limit = limit_of(build(load("car-city-drive"), duration_s=5.0))
    assert "heading_deg" in score.limit_at(2.0)
    vehicle.set_gnss(False)
    vehicle.step()
    assert score.limit_at(1.0) and not score.limit_at(2.5)
    score.take(estimate("ODOMETRY", time_usec=2_000_000))
    report = report_of(score)
    assert not report.results[0].limit and any("changed the scenario at 2.005 s" in note for note in report.notes)


NAN = float("nan")
ORIGIN = Origin(0.8, 0.2, 100.0, 1.7e9)


@pytest.mark.parametrize(("name", "changes", "message"), [
    ("ODOMETRY", {"child_frame_id": 8}, "child_frame_id = 8: allowed is 12 .* or 1"),
    ("ODOMETRY", {"q": [NAN, 0, 0, 0]}, "q_nb = .*: allowed are finite numbers"),
    ("ODOMETRY", {"x": 4.8e6}, "x, y, z = .*: allowed are finite distances from home"),
    ("ATTITUDE", {"yaw": 90.0}, "yaw = 90 rad: allowed is a finite angle"),
    ("ATTITUDE_QUATERNION", {"q1": 0.5}, "has the norm 0.5"),
    ("ATTITUDE_QUATERNION", {"repr_offset_q": [0.0, 1.0, 0.0, 0.0]}, "repr_offset_q = .*: allowed is none"),
    ("VISION_POSITION_ESTIMATE", {"z": NAN}, "x, y, z"),
])  # fmt: skip
def test_nonsense_is_refused_in_one_sentence(name, changes, message):
    with pytest.raises(InputError, match=message) as error:
        estimate_of(estimate(name, **changes), ORIGIN)
    assert "\n" not in str(error.value)


def test_velocities_and_their_covariance_are_read_in_the_frame_that_the_message_states():
    turn = Rotation.from_euler("ZYX", [60.0, 20.0, -30.0], degrees=True)
    P = np.cov(np.random.default_rng(1).normal(size=(3, 9)))
    q, covariance = turn.as_quat(scalar_first=True).tolist(), np.zeros(21)
    covariance[[0, 1, 2, 6, 7, 11]] = P[np.triu_indices(3)]
    for frame, C in ((12, turn.as_matrix()), (1, np.eye(3))):
        found = estimate_of(estimate("ODOMETRY", q=q, child_frame_id=frame, velocity_covariance=list(covariance)), ORIGIN)
        np.testing.assert_allclose(found.rows["velocity_n"], C[:, 0], atol=1e-6)  # 1 m/s along the first axis
        sigma = dict(zip(("vn_mps", "ve_mps", "vd_mps"), np.sqrt(np.diag(C @ P @ C.T)), strict=True))
        assert found.sigma == pytest.approx(sigma, rel=1e-5)


def test_variances_are_those_of_the_diagonal_and_times_of_either_clock():
    """21 numbers: the upper triangle of 6 rows, whose diagonal stands at 0, 6, 11, 15, 18 and 20."""
    triangle = np.eye(6)[np.triu_indices(6)]
    triangle[triangle == 1.0] = [1.0, 4.0, 9.0, 0.01, 0.04, 0.09]
    stamps = (5_000_000, 1_700_000_000_000_000 + 5_000_000)  # of the simulation, and Unix time
    for stamp in stamps:
        odometry = estimate("ODOMETRY", time_usec=stamp, pose_covariance=list(triangle))
        vision = estimate("VISION_POSITION_ESTIMATE", usec=stamp, x=1.0, y=2.0, z=3.0, covariance=list(triangle))
        expected = (1.0, 2.0, 3.0, *np.degrees([0.1, 0.2, 0.3]))
        names = ("north_m", "east_m", "down_m", "roll_deg", "pitch_deg", "heading_deg")
        for found in (estimate_of(odometry, ORIGIN), estimate_of(vision, ORIGIN)):
            assert found.sigma == {name: pytest.approx(s) for name, s in zip(names, expected, strict=True)}
            assert found.time == pytest.approx(5.0, abs=1e-9)
            place = [float(found.rows[name]) for name in ("latitude", "longitude", "height")]
            np.testing.assert_allclose(
                np.ravel(geodesy.numeric.ned_offset(*place, 0.8, 0.2, 100.0)), [1.0, 2.0, 3.0], atol=1e-8
            )

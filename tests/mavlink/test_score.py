"""The score of estimates that a client sends over a real link: known errors come back, nonsense is refused in one sentence."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command_line import call
from scipy.spatial.transform import Rotation

import insenv
from insenv import geodesy
from insenv.errors import InputError
from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.received import Origin, estimate_of
from insenv.mavlink.score import Score
from insenv.mavlink.wire import open_link
from insenv.report import document
from insenv.runs.scored import report_of
from insenv.scenario import build, limit_of, load

mavutil = pytest.importorskip("pymavlink.mavutil")
common = pytest.importorskip("pymavlink.dialects.v20.common")
NAN = float("nan")
UNKNOWN = [NAN] * 21
HEADING_ERROR, NORTH_ERROR, VELOCITY_ERROR = 1.5, 2.0, 0.3  # deg, m, m/s forward


class Client(threading.Thread):
    """A pymavlink client: for each message of a kind it calls `reply(client, message)`; it keeps what comes back."""

    def __init__(self, kind: str, reply: Callable[[Any, Any], None]) -> None:
        super().__init__(daemon=True)
        self.link = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=42, source_component=191, dialect="common")
        self.port = self.link.port.getsockname()[1]
        self.kind, self.reply, self.open = kind, reply, True
        self.values: list[Any] = []
        self.texts: list[str] = []
        self.home: Any = None

    def run(self) -> None:
        while self.open:
            message = self.link.recv_match(blocking=True, timeout=0.1)
            if message is None:
                continue
            if message.get_type() == "NAMED_VALUE_FLOAT":
                self.values.append(message)
            elif message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)
            elif message.get_type() == "HOME_POSITION":
                self.home = message
            elif message.get_type() == self.kind:
                self.reply(self, message)

    def close(self) -> None:
        self.open = False
        self.join()
        self.link.close()


@pytest.fixture
def streamed() -> Iterator[Callable[..., tuple[Any, Client]]]:
    """Stream a scenario to a client at a multiple of real time, with a score; give the report's owner and the client."""
    clients: list[Client] = []

    def run(scenario: str, kind: str, reply: Callable[[Any, Any], None], duration_s: float = 6.0, limited: bool = True) -> Any:
        client = Client(kind, reply)
        clients.append(client)
        client.start()
        loaded = load(scenario)
        vehicle = Vehicle(loaded, seed=3, speed=4.0, rates={"HIL_STATE_QUATERNION": 50.0, "HOME_POSITION": 10.0})
        plant = build(loaded, seed=3, duration_s=duration_s)
        vehicle.score = Score(vehicle.view, limit_of(plant) if limited else None)
        with open_link(f"udpout:127.0.0.1:{client.port}") as link:
            stream = Stream(vehicle, link)
            stream.run(duration_s)
            for _ in range(20):  # what is still on its way
                stream.serve()
        return vehicle, client

    yield run
    for client in clients:
        client.close()


def off(message: Any) -> tuple[Rotation, np.ndarray]:
    """The true attitude with a heading error, and the true velocity (n)."""
    true = Rotation.from_quat(message.attitude_quaternion, scalar_first=True)
    wrong = Rotation.from_euler("z", HEADING_ERROR, degrees=True) * true
    return wrong, np.array([message.vx, message.vy, message.vz]) * 0.01


def odometry(client: Client, message: Any) -> None:
    """ODOMETRY with a heading error, 2 m too far north, 0.3 m/s too fast forward; velocity in the body's axes."""
    if client.home is None:
        return
    wrong, velocity = off(message)
    home = [np.radians(client.home.latitude * 1e-7), np.radians(client.home.longitude * 1e-7), client.home.altitude * 1e-3]
    place = [np.radians(message.lat * 1e-7), np.radians(message.lon * 1e-7), message.alt * 1e-3]
    offset = np.ravel(geodesy.numeric.ned_offset(*place, *home)) + [NORTH_ERROR, 0.0, 0.0]
    body = wrong.inv().apply(velocity + wrong.apply([VELOCITY_ERROR, 0.0, 0.0]))
    pose = np.zeros(21)
    pose[[0, 6, 11, 15, 18, 20]] = np.array([3.0, 3.0, 3.0, 0.01, 0.01, 0.05]) ** 2
    client.link.mav.odometry_send(
        message.time_usec, 1, 12, *offset, wrong.as_quat(scalar_first=True), *body, 0, 0, 0, pose, UNKNOWN, 0, 5
    )


def test_odometry_with_known_errors_is_scored_with_these(streamed: Any) -> None:
    vehicle, client = streamed("car-city-drive", "HIL_STATE_QUATERNION", odometry)
    report = report_of(vehicle.score)
    (result,) = report.results
    assert result.estimator == "odometry-42-191" and len(result.time) > 100
    assert not vehicle.score.refused
    np.testing.assert_allclose(result.errors["heading_deg"], HEADING_ERROR, atol=1e-4)
    np.testing.assert_allclose(result.errors["north_m"], NORTH_ERROR, atol=0.02)  # 1e-7 deg in the messages
    np.testing.assert_allclose(result.errors["east_m"], 0.0, atol=0.02)
    heading = np.radians(90.0 + HEADING_ERROR)
    np.testing.assert_allclose(result.errors["vn_mps"], VELOCITY_ERROR * np.cos(heading), atol=0.01)
    np.testing.assert_allclose(result.errors["ve_mps"], VELOCITY_ERROR * np.sin(heading), atol=0.01)
    np.testing.assert_allclose(result.sigma["heading_deg"], np.degrees(0.05), rtol=1e-6)
    assert result.sigma["north_m"][0] == pytest.approx(3.0) and "vn_mps" not in result.sigma
    run = insenv.run("car-city-drive", "loosely-coupled", seed=3, duration_s=6.0)
    limit = np.interp(result.time, run.results[0].time, run.results[0].limit_sigma["heading_deg"])
    np.testing.assert_allclose(result.limit_sigma["heading_deg"], limit, rtol=0.02)
    keys = set(document(run)["results"][0])
    assert set(document(report)["results"][0]) == keys and set(document(report)) == set(document(run))
    sent = {message.name: message.value for message in client.values}
    assert sent["E_HEADING"] == pytest.approx(HEADING_ERROR, abs=1e-3) and sent["E_NORTH"] == pytest.approx(2.0, abs=0.02)
    assert 0.0 < sent["L_HEADING"] < 4.0 and len([m for m in client.values if m.name == "E_HEADING"]) in (5, 6)
    times = [m.time_boot_ms * 1e-3 for m in client.values if m.name == "E_HEADING"]
    assert set(np.round(times, 3)) <= set(np.round(result.time, 3)), "an answer has the time of the estimate"


def test_a_client_that_states_too_small_a_sigma_is_told_so(vehicle: Vehicle) -> None:
    assert vehicle.score is not None
    pose = [0.0] * 21
    pose[0] = pose[6] = pose[11] = pose[15] = pose[18] = pose[20] = 1e-8
    vehicle.score.take(make("ODOMETRY", time_usec=1_000_000, pose_covariance=pose))
    notes = report_of(vehicle.score).results[0].notes
    assert any("larger than this estimator states" in note and "heading" in note for note in notes)


def test_attitudes_alone_are_scored_as_an_alignment_by_each_message(streamed: Any) -> None:
    def reply(client: Client, message: Any) -> None:
        wrong, _ = off(message)
        yaw, pitch, roll = wrong.as_euler("ZYX")
        client.link.mav.attitude_send(message.time_usec // 1000, roll, pitch, yaw, 0, 0, 0)
        client.link.mav.attitude_quaternion_send(message.time_usec // 1000, *wrong.as_quat(scalar_first=True), 0, 0, 0)

    vehicle, _ = streamed("ship-swaying", "HIL_STATE_QUATERNION", reply, limited=False)
    report = report_of(vehicle.score)
    assert {result.estimator for result in report.results} == {"attitude-42-191", "attitude-quaternion-42-191"}
    for result in report.results:
        assert result.from_s == pytest.approx(0.75 * result.time[-1]) and set(result.errors) == {
            "roll_deg",
            "pitch_deg",
            "heading_deg",
        }
        np.testing.assert_allclose(result.errors["heading_deg"], HEADING_ERROR, atol=1e-3)
        assert not result.limit


def test_vision_estimates_in_unix_time_are_scored_at_their_time(streamed: Any) -> None:
    """Late ones too: each is held back for ten messages, which is no error of it."""
    waiting: list[Any] = []

    def reply(client: Client, message: Any) -> None:
        waiting.append(message)
        if client.home is None or len(waiting) <= 10:
            return
        old = waiting.pop(0)
        wrong, _ = off(old)
        yaw, pitch, roll = wrong.as_euler("ZYX")
        start = vehicle_start[0]
        client.link.mav.vision_position_estimate_send(old.time_usec + start, 0, 0, 0, roll, pitch, yaw, UNKNOWN)

    vehicle_start = [0]
    vehicle, _ = streamed("ship-swaying", "HIL_STATE_QUATERNION", reply)
    (result,) = report_of(vehicle.score).results
    np.testing.assert_allclose(result.errors["heading_deg"], HEADING_ERROR, atol=1e-3)
    assert max(np.abs(result.errors["north_m"]).max(), np.abs(result.errors["down_m"]).max()) < 5.0, "it says it is at home"
    delays = np.array(next(iter(vehicle.score.sources.values())).delays)
    assert np.median(delays) > 0.19, "ten messages at 50 Hz"


ORIGIN = Origin(0.8, 0.2, 100.0, 1.7e9)


def make(name: str, **changes: Any) -> Any:
    """A message as a client sends it, with changed fields."""
    q, pose = [1.0, 0.0, 0.0, 0.0], UNKNOWN
    fields: dict[str, dict[str, Any]] = {
        "ODOMETRY": {"time_usec": 5_000_000, "frame_id": 1, "child_frame_id": 12, "x": 1.0, "y": 2.0, "z": 3.0, "q": q,
                     "vx": 1.0, "vy": 0.0, "vz": 0.0, "pose_covariance": pose, "velocity_covariance": pose},
        "ATTITUDE": {"time_boot_ms": 5000, "roll": 0.0, "pitch": 0.0, "yaw": 0.0},
        "ATTITUDE_QUATERNION": {"time_boot_ms": 5000, "q1": 1.0, "q2": 0.0, "q3": 0.0, "q4": 0.0, "repr_offset_q": [0.0] * 4},
        "VISION_POSITION_ESTIMATE": {"usec": 5_000_000, "x": 0.0, "y": 0.0, "z": 0.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0,
                                     "covariance": pose},
    }  # fmt: skip
    source = {"get_type": lambda: name, "get_srcSystem": lambda: 42, "get_srcComponent": lambda: 191}
    return SimpleNamespace(**{**fields[name], **changes}, **source)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("ODOMETRY", {"frame_id": 20}, r"frame_id = 20: allowed is 1 \(MAV_FRAME_LOCAL_NED\)"),
        ("ODOMETRY", {"child_frame_id": 8}, r"child_frame_id = 8: allowed is 12 \(MAV_FRAME_BODY_FRD\) or 1"),
        ("ODOMETRY", {"q": [NAN, 0, 0, 0]}, "q_nb = .*: allowed are finite numbers"),
        ("ODOMETRY", {"q": [0, 0, 0, 0]}, "q_nb = .* has the norm 0: allowed is 1"),
        ("ODOMETRY", {"x": NAN}, "x, y, z = .*: allowed are finite distances"),
        ("ODOMETRY", {"x": 4.8e6}, "x, y, z = .*: allowed are finite distances from home"),
        ("ODOMETRY", {"vx": float("inf")}, "velocity_n = .*: allowed are finite numbers"),
        ("ATTITUDE", {"yaw": NAN}, "yaw = nan rad: allowed is a finite angle"),
        ("ATTITUDE", {"yaw": 90.0}, "yaw = 90 rad: allowed is a finite angle up to a full turn"),
        ("ATTITUDE_QUATERNION", {"q1": 0.5}, "has the norm 0.5"),
        ("ATTITUDE_QUATERNION", {"repr_offset_q": [0.0, 1.0, 0.0, 0.0]}, "repr_offset_q = .*: allowed is none"),
        ("VISION_POSITION_ESTIMATE", {"z": NAN}, "x, y, z"),
    ],
)
def test_nonsense_is_refused_in_one_sentence(name: str, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        estimate_of(make(name, **changes), ORIGIN)
    assert "\n" not in str(error.value)


def test_velocities_are_read_in_the_frame_that_the_message_states() -> None:
    q = Rotation.from_euler("z", 90.0, degrees=True).as_quat(scalar_first=True)
    body = estimate_of(make("ODOMETRY", q=list(q)), ORIGIN)
    north = estimate_of(make("ODOMETRY", q=list(q), child_frame_id=1), ORIGIN)
    np.testing.assert_allclose(body.rows["velocity_n"], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(north.rows["velocity_n"], [1.0, 0.0, 0.0], atol=1e-12)
    place = [float(body.rows[name]) for name in ("latitude", "longitude", "height")]
    np.testing.assert_allclose(np.ravel(geodesy.numeric.ned_offset(*place, 0.8, 0.2, 100.0)), [1.0, 2.0, 3.0], atol=1e-8)


@pytest.fixture
def vehicle() -> Vehicle:
    vehicle = Vehicle(load("car-city-drive"), seed=1, start_unix=1.7e9)
    vehicle.score = Score(vehicle.view)
    for _ in range(400):
        vehicle.step()
    return vehicle


def test_times_without_truth_are_refused_and_counted_by_kind(vehicle: Vehicle) -> None:
    from insenv.mavlink.answers import answers

    assert vehicle.score is not None

    def send(**changes: Any) -> list[Any]:
        return list(answers(vehicle, make("ODOMETRY", **changes)))

    assert send(time_usec=1_000_000)
    assert not send(time_usec=1_000_000) and not send(time_usec=2_500_000) and not send(time_usec=2_600_000)
    assert not send(time_usec=0) and not send(frame_id=7, time_usec=1_500_000)
    assert not send(time_usec=1_500_000), "a second has not passed since the last answer"
    assert send(time_usec=1_700_000_000_000_000 + 2_000_000), "Unix time of the run's clock"
    assert vehicle.score.sources["odometry-42-191"].count == 3
    refused = list(vehicle.score.refused.items())
    assert [count for _, count in refused] == [1, 2, 1, 1]
    assert refused[0][0].startswith("ODOMETRY: the stamp 1.000000 s does not follow 1.000000 s")
    assert refused[1][0].startswith("ODOMETRY: the stamp is later than the simulation clock (2.500 s, clock 2.000 s)")
    assert refused[2][0].startswith("ODOMETRY: the stamp is older than the truth that is kept")
    texts = "".join(text.text for text in vehicle.texts())
    assert "frame_id = 7: allowed is 1 (MAV_FRAME_LOCAL_NED)" in texts
    notes = report_of(vehicle.score).notes
    assert any(note.startswith("refused 2 times: ODOMETRY: the stamp is later") for note in notes)


def test_truth_between_two_samples_is_that_of_the_motion(vehicle: Vehicle) -> None:
    """A car at constant speed: the error of a straight interpolation is far below a millimetre."""
    score = vehicle.score
    assert score is not None
    for _ in range(4000):
        vehicle.step()
    at = 20.0021
    score.take(make("ODOMETRY", time_usec=round(at * 1e6)))
    (_, truth), dt = score.sources["odometry-42-191"].kept[0], 0.005
    columns = insenv.record("car-city-drive", seed=1, duration_s=21.0).reference
    assert columns is not None and columns.latitude is not None and columns.velocity_n is not None
    row = round(20.0 / dt) - 1
    assert columns.time[row] == pytest.approx(20.0)
    north = (float(truth["latitude"]) - columns.latitude[row]) * 6.37e6
    assert north == pytest.approx(columns.velocity_n[row, 0] * 0.0021, abs=1e-4)
    assert np.linalg.norm(truth["q_nb"]) == pytest.approx(1.0, abs=1e-12)


def test_what_changes_the_drive_ends_the_limit(vehicle: Vehicle) -> None:
    assert vehicle.score is not None
    vehicle.score.limit = limit_of(build(load("car-city-drive"), duration_s=5.0))
    assert "heading_deg" in vehicle.score.limit_at(2.0)
    vehicle.set_gnss(False)
    vehicle.step()
    assert vehicle.score.limit_at(1.0) and not vehicle.score.limit_at(2.5)
    vehicle.score.take(make("ODOMETRY", time_usec=2_000_000))
    report = report_of(vehicle.score)
    assert not report.results[0].limit and any("the scenario was changed at 2.005 s" in note for note in report.notes)


def test_a_stream_that_outlasts_its_scenario_says_that_there_is_no_limit(vehicle: Vehicle) -> None:
    assert vehicle.score is not None
    vehicle.score.limit = limit_of(build(load("car-city-drive"), duration_s=1.0))
    vehicle.score.take(make("ODOMETRY", time_usec=900_000))
    assert report_of(vehicle.score).results[0].limit
    vehicle.score.take(make("ODOMETRY", time_usec=1_500_000))
    report = report_of(vehicle.score)
    assert not report.results[0].limit and "no limit of estimates that last longer than the scenario, 1 s" in report.notes


def test_without_a_score_estimates_of_clients_are_ignored(vehicle: Vehicle) -> None:
    from insenv.mavlink.answers import answers

    vehicle.score = None
    assert not list(answers(vehicle, make("ODOMETRY", time_usec=1_000_000)))


def test_the_command_writes_what_a_run_writes(tmp_path: Path) -> None:
    client = Client("HIL_STATE_QUATERNION", odometry)
    client.start()
    out = tmp_path / "score"
    try:
        status, text, _ = call(
            "stream", "car-city-drive", "--to", f"udpout:127.0.0.1:{client.port}", "--score", "--duration", "3", "--speed", "4",
            "--rate", "HOME_POSITION=10", "--out", out, "--json",
        )  # fmt: skip
    finally:
        client.close()
    summary = json.loads(text)
    assert status == 0 and summary["score"]["results"][0]["estimator"] == "odometry-42-191"
    assert summary["score"]["results"][0]["final"]["heading_deg"] == pytest.approx(HEADING_ERROR, abs=1e-3)
    assert summary["score"]["results"][0]["limit"]["heading_deg"] > 0.0
    assert {Path(path).suffix for path in summary["score"]["files"]} == {".npz", ".json", ".html", ".png", ".svg"}
    with np.load(out / "car-city-drive.npz") as arrays:
        np.testing.assert_allclose(arrays["odometry-42-191/errors/north_m"], NORTH_ERROR, atol=0.02)


def test_wrong_calls_are_refused() -> None:
    for arguments, message in (
        (("--out", "x"), "--out: allowed with --score"),
        (("--score", "--lockstep", "px4"), "--score: not allowed with --lockstep"),
    ):
        status, _, errors = call("stream", "car-city-drive", "--to", "udpout:127.0.0.1:14550", *arguments)
        assert status == 2 and message in errors

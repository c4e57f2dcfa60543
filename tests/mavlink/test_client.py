"""A real client on the stream: what MAVSDK discovers, reads and sees."""

import json
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest
from command_line import ROOT, strict
from streamed_vehicle import PROGRAM, SILENT

from insenv import attitude, geodesy
from insenv.mavlink import Vehicle
from insenv.scenario import load


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """What MAVSDK received from `insenv stream`, and the same vehicle simulated here sample by sample."""
    pytest.importorskip("mavsdk", reason="MAVSDK-Python (extra `test`) is not installed")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    vehicle = subprocess.Popen(
        # the car stands for 30 s, and is not aligned before it drives
        [
            sys.executable, "-c", PROGRAM, "stream", "car-city-drive", "--to", f"udpout:127.0.0.1:{port}", "--speed", "4",
            "--json",
        ],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        program = str(ROOT / "tests" / "helpers" / "mavsdk_client.py")
        client = [sys.executable, program, f"udpin://127.0.0.1:{port}", "5", "MAN_SPEED", "7.5"]
        seen = subprocess.run(client, capture_output=True, text=True, timeout=90)
    finally:
        vehicle.send_signal(signal.SIGINT)
        out, _ = vehicle.communicate(timeout=30)
    assert seen.returncode == 0, seen.stderr
    (document,) = [line for line in seen.stdout.splitlines() if line.startswith("{")]
    summary = strict(out)

    twin = Vehicle(load("car-city-drive"), rates=SILENT, speed=4.0)
    rows = []
    for _ in range(round(summary["simulated_s"] * 200)):
        twin.step()
        simulation = twin.simulation
        rows.append(
            {
                "truth": {name: np.array(value) for name, value in simulation.truth.items()},
                "estimate": {name: np.array(value) for name, value in simulation.estimate.items()},
                "increments": simulation.increments.copy(),
                "magnetic": twin.view.air.magnetic_b.copy(),
                "fix": simulation.fix,
            }
        )
    return {"seen": json.loads(document), "summary": summary, "rows": rows, "twin": twin}


def at(session, time_us):
    """The simulation at the time of a message."""
    return session["rows"][round(time_us / 5000) - 1]


def test_client_discovers_a_healthy_vehicle(session):
    found = session["seen"]
    assert found["system"] == [1, [1], "ROVER", "GENERIC"]
    assert found["seen"]["health_all_ok"][-1] is True and all(found["seen"]["health"][-1].values())
    assert found["seen"]["landed_state"][-1] == "ON_GROUND"
    assert (found["version"]["flight_sw_major"], found["version"]["flight_sw_minor"]) == (0, 1)
    assert session["summary"]["received"]["PARAM_SET"] >= 1 and not session["summary"]["saturated"]


def test_client_reads_all_parameters_and_sets_one(session):
    found, twin = session["seen"], session["twin"]
    listed = {row["name"]: row["value"] for row in found["parameters"]["float_params"]}
    assert not found["parameters"]["int_params"] and not found["parameters"]["custom_params"]
    expected = {parameter.name: parameter.value() for parameter in twin.parameters.all}
    assert set(listed) == set(expected)
    for name, value in expected.items():
        if not name.startswith("MAN_SPEED"):
            assert listed[name] == pytest.approx(value, rel=1e-6, abs=1e-30), name
    assert found["set"] == [15.0, 7.5]


def test_client_downloads_an_empty_mission_fence_and_rally_points(session):
    """MAVSDK refuses these downloads unless AUTOPILOT_VERSION announces them."""
    assert session["seen"]["downloads"] == [[], [], []]
    assert session["summary"]["received"]["MISSION_REQUEST_LIST"] == 3


def test_client_sees_the_estimated_attitude_and_odometry(session):
    seen = session["seen"]["seen"]
    assert min(len(seen[name]) for name in ("attitude_quaternion", "odometry", "attitude_euler")) > 30
    for row in seen["attitude_quaternion"]:
        q, expected = np.array([row[k] for k in "wxyz"]), at(session, row["timestamp_us"])["estimate"]["q_nb"]
        np.testing.assert_allclose(q * np.sign(q @ expected), expected, rtol=0, atol=1e-7)
    for row in seen["attitude_euler"]:
        angles = [row[f"{name}_deg"] for name in ("roll", "pitch", "yaw")]
        expected = attitude.numeric.to_euler(at(session, row["timestamp_us"])["estimate"]["q_nb"])
        np.testing.assert_allclose(angles, np.degrees(np.array(expected)), rtol=3e-7, atol=1e-6)
    home = session["twin"].view.home
    for row in seen["odometry"]:
        estimate = at(session, row["time_usec"])["estimate"]
        offset = geodesy.numeric.ned_offset(estimate["latitude"], estimate["longitude"], estimate["height"], *home)
        velocity_b = attitude.numeric.to_dcm(estimate["q_nb"]).T @ estimate["velocity_n"]
        np.testing.assert_allclose([row["position_body"][k] for k in ("x_m", "y_m", "z_m")], offset, rtol=1e-7, atol=1e-6)
        reported = [row["velocity_body"][k] for k in ("x_m_s", "y_m_s", "z_m_s")]
        np.testing.assert_allclose(reported, velocity_b, rtol=1e-6, atol=1e-7)
        variance = row["pose_covariance"]["covariance_matrix"][0]
        assert variance == pytest.approx(estimate["position_sigma"][0] ** 2, rel=1e-6)


def test_client_sees_the_imu_and_the_truth(session):
    seen, rows = session["seen"]["seen"], session["rows"]
    assert len(seen["imu"]) > 100 and len(seen["ground_truth"]) > 30
    for row in seen["imu"]:
        sample = round(row["timestamp_us"] / 5000)
        mean = (rows[sample - 1]["increments"] - (rows[sample - 5]["increments"] if sample > 4 else 0.0)) / 0.02
        force = [row["acceleration_frd"][f"{k}_m_s2"] for k in ("forward", "right", "down")]
        rate = [row["angular_velocity_frd"][f"{k}_rad_s"] for k in ("forward", "right", "down")]
        field = [row["magnetic_field_frd"][f"{k}_gauss"] for k in ("forward", "right", "down")]
        np.testing.assert_allclose(force, mean[3:], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(rate, mean[:3], rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(field, rows[sample - 1]["magnetic"] * 1e4, rtol=1e-6, atol=1e-8)
    for row in seen["ground_truth"]:
        truth = at(session, row["timestamp_us"])["truth"]
        assert abs(row["latitude_deg"] - np.degrees(truth["latitude"])) <= 0.51e-7
        assert abs(row["longitude_deg"] - np.degrees(truth["longitude"])) <= 0.51e-7
        assert abs(row["absolute_altitude_m"] - truth["height"]) <= 0.6e-3


def test_client_sees_positions_velocities_and_fixes(session):
    seen, rows = session["seen"]["seen"], session["rows"]
    estimates = [row["estimate"] for row in rows[19::20]]  # those of 10 Hz
    latitude, longitude, height = (np.array([e[name] for e in estimates]) for name in ("latitude", "longitude", "height"))
    velocity = np.array([e["velocity_n"] for e in estimates])
    for row in seen["position"]:
        off = [
            np.abs(np.degrees(latitude) - row["latitude_deg"]) / 0.51e-7,
            np.abs(np.degrees(longitude) - row["longitude_deg"]) / 0.51e-7,
        ]
        assert np.min(np.max([*off, np.abs(height - row["absolute_altitude_m"]) / 0.6e-3], axis=0)) <= 1.0
    for row in seen["velocity_ned"]:
        reported = [row[f"{name}_m_s"] for name in ("north", "east", "down")]
        assert np.min(np.max(np.abs(velocity - reported), axis=1)) <= 0.00501
    fixes = {round(row["fix"].time * 1e6): row["fix"] for row in rows if row["fix"] is not None}
    assert seen["raw_gps"]
    for row in seen["raw_gps"]:
        fix = fixes[row["timestamp_us"]]
        assert abs(row["latitude_deg"] - np.degrees(fix.latitude)) <= 0.51e-7
        assert abs(row["absolute_altitude_m"] - fix.height) <= 0.6e-3
    assert seen["gps_info"][-1]["fix_type"] == "FIX_3D"
    assert seen["home"][-1]["latitude_deg"] == pytest.approx(np.degrees(session["twin"].view.home[0]), abs=0.51e-7)

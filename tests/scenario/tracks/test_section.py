"""kind = "recorded": tracks against closed forms and simulated drives, and what is no track."""

import json

import numpy as np
import pytest
from closed_track import ATTITUDE, LATITUDE, closed_form, scenario, truth_of, write_csv, write_gpx

import insenv
from insenv import geodesy
from insenv.base.errors import InputError
from insenv.scenario import build
from insenv.testing import check_backends


@pytest.fixture(scope="module")
def csv(tmp_path_factory):
    path = tmp_path_factory.mktemp("track") / "track.csv"
    time = np.arange(0.0, 120.5, 0.5)
    write_csv(path, time, closed_form(time))
    return path


def test_a_closed_form_through_csv(csv):
    loaded = scenario(csv, vehicle={"columns": ATTITUDE})
    assert loaded.duration_s == 120.0
    assert loaded.start.latitude_deg == pytest.approx(45.0, abs=1e-8)
    time, shown = truth_of(loaded, 40.0)
    true = closed_form(time)
    north = 6.37e6 * (shown["latitude"].ravel() - true[:, 0])
    east = 6.37e6 * np.cos(LATITUDE) * (shown["longitude"].ravel() - true[:, 1])
    apart = np.abs(np.column_stack([north, east, shown["height"].ravel() - true[:, 2]])).max(axis=1)
    assert apart.max() < 2e-4 and apart[time > 3.0].max() < 5e-6  # at the begin nothing before it tells of the curvature
    step = 1e-3
    rate = (closed_form(time + step) - closed_form(time - step)) / (2.0 * step)
    R_M, R_N = geodesy.numeric.radii(np.sin(true[:, 0]))
    speed = [(R_M + true[:, 2]) * rate[:, 0], (R_N + true[:, 2]) * np.cos(true[:, 0]) * rate[:, 1], -rate[:, 2]]
    assert np.abs(shown["velocity_n"] - np.column_stack(speed))[time > 3.0].max() < 1e-5
    roll, pitch, heading = insenv.attitude.numeric.to_euler(shown["q_nb"])
    turned = np.column_stack([roll - true[:, 3], pitch - true[:, 4], np.angle(np.exp(1j * (heading - true[:, 5])))])
    assert np.abs(turned).max() < 2e-4 and np.abs(turned)[time > 3.0].max() < 5e-6


def test_a_perfect_unit_does_not_drift(csv):
    perfect = {"draw_errors": False, "tilt_sigma_deg": 0.001, "heading_sigma_deg": 0.001}
    loaded = scenario(csv, vehicle={"columns": ATTITUDE}, duration_s=30.0, knowledge=perfect)
    (result,) = insenv.run(loaded, "wander-sins").results
    worst = {name: float(np.abs(error).max()) for name, error in result.errors.items()}
    assert max(worst[name] for name in ("north_m", "east_m", "down_m")) < 1e-5, worst
    assert max(worst[name] for name in ("vn_mps", "ve_mps", "vd_mps")) < 1e-6, worst


@pytest.mark.slow
def test_every_backend_gives_the_same_bits(csv):
    plant = build(scenario(csv, vehicle={"columns": ATTITUDE}, rate_hz=20.0))
    check_backends(plant.model, plant.model.parameters.pack(plant.parameters), np.zeros((400, 0)))


def test_a_course_alone_gives_the_heading(tmp_path):
    time = np.arange(0.0, 120.0)
    write_gpx(tmp_path / "t.gpx", time, closed_form(time), digits=9)
    at, shown = truth_of(scenario(tmp_path / "t.gpx", rate_hz=50.0), 110.0)
    true = closed_form(at)
    assert np.abs(6.37e6 * (shown["latitude"].ravel() - true[:, 0])).max() < 0.02
    course = np.arctan2(*np.gradient(true[:, :2] * [1.0, np.cos(LATITUDE)], axis=0).T[::-1])
    heading = insenv.attitude.numeric.to_euler(shown["q_nb"])[2]
    fast = np.hypot(*shown["velocity_n"][:, :2].T) > 10.0
    assert np.abs(np.angle(np.exp(1j * (heading - course))))[fast].max() < np.radians(0.5)


def test_a_track_of_one_hertz_does_not_ring(tmp_path):
    """A drive as GPX once a second, to a centimetre: velocity and acceleration between the points are those of the drive."""
    time, true = truth_of(insenv.load({**insenv.load("car-city-drive").model_dump(mode="json"), "rate_hz": 100.0}), 120.0)
    time, true = time[9::10], {name: values[9::10] for name, values in true.items()}
    second = np.isclose(time, np.rint(time), atol=1e-6)
    place = np.column_stack([true[name].ravel()[second] for name in ("latitude", "longitude", "height")])
    write_gpx(tmp_path / "t.gpx", time[second], place)
    at, shown = truth_of(scenario(tmp_path / "t.gpx", rate_hz=50.0), 115.0)
    when = at + time[second][0]
    apart = shown["velocity_n"] - np.column_stack([np.interp(when, time, true["velocity_n"][:, k]) for k in range(3)])
    inner = (at > 3.0) & (at < 112.0)
    assert np.sqrt(np.mean(apart[inner, :2] ** 2)) < 0.15
    ours = np.linalg.norm(np.gradient(shown["velocity_n"][:, :2], at, axis=0), axis=1)[inner]
    theirs = np.linalg.norm(np.gradient(true["velocity_n"][:, :2], time, axis=0), axis=1)
    assert ours.max() < 1.3 * theirs.max()


TIME = np.arange(100.0)
ROWS = closed_form(TIME)
GAP = (TIME < 30) | (TIME > 45)
JUMP = ROWS + np.where(TIME[:, None] >= 60, [[100.0 / 6.37e6, 0, 0, 0, 0, 0]], 0.0)


@pytest.mark.parametrize(("time", "values", "vehicle", "said"), [
    (TIME[GAP], ROWS[GAP], {}, "no points between 29 s and 46 s: a gap of 17 s, allowed max_gap_s = 10 s$"),
    (TIME, JUMP, {}, "a jump near (59|60) s: .* m/s2 over a second, allowed max_acceleration_mps2 = 20"),
    (np.where(TIME == 50, 40.0, TIME), ROWS, {}, "time goes from 49 s to 40 s at point 51"),
    (TIME, ROWS, {"columns": {"position_unit": "rad"}}, "check position_unit"),
])  # fmt: skip
def test_what_is_no_track(tmp_path, time, values, vehicle, said):
    write_csv(tmp_path / "t.csv", time, values)
    with pytest.raises(InputError, match=said):
        scenario(tmp_path / "t.csv", vehicle=vehicle)


@pytest.mark.parametrize(("more", "said"), [
    ({"duration_s": 120.0}, r"^scenario: duration_s = 120 s: the track lasts 99 s$"),
    ({"rate_hz": 4.0, "vehicle": {"columns": ATTITUDE}}, r"rotation of 0.\d+ rad in a sample: allowed is 0.25 rad"),
    ({"start": {"latitude_deg": 46.0, "longitude_deg": 7.0}}, r"start\.latitude_deg = 46: the track begins at 45"),
])  # fmt: skip
def test_scenarios_that_do_not_fit_their_track(tmp_path, more, said):
    values = ROWS.copy()
    values[:, 5] = 1.5 * TIME
    write_csv(tmp_path / "t.csv", TIME, values)
    with pytest.raises(InputError, match=said):
        scenario(tmp_path / "t.csv", **more)
    with pytest.raises(InputError, match="allowed is up to 99 s, the duration of the track"):
        build(scenario(tmp_path / "t.csv"), duration_s=100.0)


def test_a_file_beside_a_scenario_that_must_not_change(tmp_path):
    write_csv(tmp_path / "t.csv", TIME, ROWS)
    dumped = json.loads(json.dumps(scenario(tmp_path / "t.csv").model_dump(mode="json")))
    insenv.load(dumped)
    (tmp_path / "s.toml").write_text('title = "t"\n[vehicle]\nkind = "recorded"\nfile = "t.csv"\n', encoding="utf-8")
    assert insenv.load(tmp_path / "s.toml").duration_s == 99.0
    write_csv(tmp_path / "t.csv", TIME, ROWS + 1e-9)
    with pytest.raises(InputError, match="the file has changed"):
        insenv.load(dumped)

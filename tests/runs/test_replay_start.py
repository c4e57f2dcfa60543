"""Starts of replays: an unknown unit, wrong headings, the standard deviations of [initial]."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_log import simulated_log

from insenv import attitude, fusion, geodesy, record, replay, write
from insenv.core import symmetric
from insenv.errors import InputError
from insenv.estimators import Knowledge, SensorNotes, get
from insenv.logs import LogDescription
from insenv.logs.description import InitialSection
from insenv.logs.rest import Rest, rest_of
from insenv.report import document
from insenv.runs.first_motion import heading_by_force
from insenv.runs.replay_start import initial_knowledge
from insenv.runs.rest import start_at_rest
from insenv.scenario import load

WANDER = {"loosely-coupled": {"fix_wander_sigma_m": [1.5, 1.5, 3.05], "fix_wander_time_s": 60.0}}
HEADING = 90.0  # of the car at rest, deg
LATITUDE = np.radians(47.07)


def car(grade, calm=False, outages=False):
    scenario = load("car-city-drive")
    gnss = {"outlier_probability": 0.0} | ({} if outages else {"outages_s": ()})
    still = {"engine": (), "wind_roll_sigma_deg": 0.0, "wind_pitch_sigma_deg": 0.0} if calm else {}
    return scenario.model_copy(
        update={
            "imu": scenario.imu.model_copy(update={"grade": grade}),
            "gnss": scenario.gnss.model_copy(update=gnss),
            "vehicle": scenario.vehicle.model_copy(update=still),
        }
    )


def started(log, **initial):
    """The log with other values in [initial]."""
    values = {**log.description.initial.model_dump(), **initial}
    return replace(log, description=LogDescription.model_validate({**log.description.model_dump(), "initial": values}))


def beyond(result, name, late):
    """Share of the errors beyond three stated standard deviations."""
    return float(np.mean(np.abs(result.errors[name][late]) > 3 * result.sigma[name][late]))


@pytest.mark.parametrize("grade", ["navigation", "tactical", "industrial", "autopilot", "consumer"])
def test_without_a_grade_the_stated_sigma_is_honest(grade):
    """As a ship's navigator, which no grade once meant, 33 to 99 % of these errors were beyond three sigma."""
    log = simulated_log(
        car(grade, outages=True), seed=301, duration_s=300.0, initial={"static_until_s": 30.0}, estimator=WANDER
    )
    report = replay(log, ["loosely-coupled"])
    result, late = report.results[0], report.results[0].time > 100.0
    for name in ("north_m", "east_m", "down_m", "roll_deg", "heading_deg"):
        assert beyond(result, name, late) < 0.01, name
    said = [note for note in document(report)["notes"] if "gives no grade of its inertial unit" in note]
    assert len(said) == 1 and "deg/sqrt(h)" in said[0] and "class" in said[0]


def test_nothing_is_assumed_of_a_unit_that_the_description_gives():
    log = simulated_log(
        car("tactical"), duration_s=60.0, grade="tactical", initial={"static_until_s": 30.0, "heading_deg": 90.0}
    )
    assert not [note for note in replay(log, ["loosely-coupled"]).notes if "no grade" in note]
    unit = {"arw_deg_sqrt_h": 0.15, "vrw_mps_sqrt_h": 0.06, "gyro_bias_deg_h": 4.0}
    bare = simulated_log(car("tactical"), duration_s=60.0, initial={"static_until_s": 30.0, "heading_deg": 90.0})
    in_part = replay(bare, ["loosely-coupled"], settings={"loosely-coupled": unit})
    assert [note for note in in_part.notes if "no grade" in note]
    whole = replay(bare, ["loosely-coupled"], settings={"loosely-coupled": {**unit, "accel_bias_ug": 750.0}})
    assert not [note for note in whole.notes if "no grade" in note]


@pytest.mark.parametrize("calm", [pytest.param(True, marks=pytest.mark.slow), False])
def test_any_heading_within_60_deg_ends_at_the_same_answer(calm):
    """A unit of 0.01 deg/h. Before, 60 deg ended 5 deg wrong at a stated 0.026, and 35 m beside the road."""
    log = simulated_log(
        car("navigation", calm),
        seed=201,
        duration_s=300.0,
        grade="navigation",
        initial={"static_until_s": 30.0},
        estimator=WANDER,
    )
    ends, late = [], None
    for error in (0.0, 2.6, -20.0, 20.0, -60.0, 60.0):
        result = replay(started(log, heading_deg=HEADING + error), ["loosely-coupled"]).results[0]
        late = result.time > 100.0
        for name in ("heading_deg", "north_m", "east_m"):
            assert beyond(result, name, late) < 0.01, (name, error)
        ends.append([result.errors[name][-1] / result.sigma[name][-1] for name in ("heading_deg", "north_m", "east_m")])
        assert np.abs(result.outputs["gyro_bias"][-1]).max() < np.radians(0.05) / 3600, error  # five sigma of the grade
    assert np.ptp(ends, axis=0).max() < 0.5, "in standard deviations"


def test_a_unit_on_its_back_is_refused():
    """Axes upside down gave 180 deg of roll at a stated 0.05 deg, with a healthy filter."""
    log = simulated_log(car("tactical"), seed=5, duration_s=40.0, grade="tactical", initial={"static_until_s": 30.0})
    turned = log.delta_angle * [1, -1, -1], log.delta_velocity * [1, -1, -1]
    log = replace(log, delta_angle=turned[0], delta_velocity=turned[1])
    with pytest.raises(InputError, match="axes or accel_axes of"):
        replay(started(log, heading_deg=HEADING), ["loosely-coupled"])
    found = replay(started(log, heading_deg=HEADING, roll_deg=180.0), ["loosely-coupled"]).results[0]
    assert abs(abs(found.errors["roll_deg"][-1]) - 180.0) < 1.0  # the reference is upright


def rtk(log):
    """The log with fixes as good as they say: 2 cm and 2 cm/s."""
    sigma = np.full(log.gnss.position_sigma.shape, 0.02)
    noise = np.random.default_rng(7).normal(size=(2, *sigma.shape)) * 0.02
    reference = log.reference
    at = [np.interp(log.gnss.time, reference.time, v) for v in (reference.latitude, reference.longitude, reference.height)]
    lat, lon, height = geodesy.numeric.geodetic_from_ned_offset(noise[0], *at)
    velocity = np.stack([np.interp(log.gnss.time, reference.time, v) for v in reference.velocity_n.T], axis=1) + noise[1]
    gnss = replace(
        log.gnss, latitude=lat, longitude=lon, height=height, velocity_n=velocity, position_sigma=sigma, velocity_sigma=sigma
    )
    return replace(log, gnss=gnss, lever_arm_b=np.zeros(3))


@pytest.mark.parametrize("grade", ["navigation", pytest.param("tactical", marks=pytest.mark.slow), "consumer"])
def test_a_heading_that_the_motion_contradicts_is_replaced(grade):
    """With fixes of 2 cm a linear filter ended 0.09 deg wrong in roll from 60 deg off, at a stated 0.006."""
    log = rtk(simulated_log(car(grade), seed=5, duration_s=150.0, grade=grade, initial={"static_until_s": 30.0}))
    for error in (20.0, -60.0, 180.0):
        found = replay(started(log, heading_deg=HEADING + error), ["loosely-coupled"]).results[0]
        assert "course of the first motion" in found.notes[0] and "navigation starts with" in found.notes[0]
        late = found.time > 60.0
        for name in ("roll_deg", "pitch_deg", "heading_deg", "north_m", "vn_mps"):
            assert beyond(found, name, late) < 0.01, (name, error)
        assert found.health.verdict == "consistent"
    right = replay(started(log, heading_deg=HEADING), ["loosely-coupled"]).results[0]
    assert not any("course" in note for note in right.notes)


def test_a_given_place_far_from_the_fixes_is_named():
    log = simulated_log(
        "car-city-drive", seed=5, duration_s=60.0, grade="tactical", initial={"static_until_s": 30.0, "heading_deg": HEADING}
    )

    def notes(**initial):
        (result,) = replay(started(log, **initial), ["loosely-coupled"]).results
        return [note for note in result.notes if "[initial]" in note]

    assert notes() == notes(latitude_deg=47.07, longitude_deg=15.44) == []
    near = {"latitude_deg": 47.07, "longitude_deg": 15.44, "position_sigma_m": (0.1, 0.1, 0.1)}
    assert notes(**near) == []
    (note,) = notes(**{**near, "latitude_deg": 46.07})
    assert "latitude_deg = 46.07" in note and "111 km" in note and "sigma) from the fixes at rest" in note
    far = initial_knowledge(started(log, **{**near, "latitude_deg": 46.07}), get("loosely-coupled"), "coarse", 0).knowledge
    np.testing.assert_allclose(far.position_sigma, log.gnss.position_sigma[0], rtol=1e-12)  # not that of the given place
    (note,) = notes(latitude_deg=46.07, longitude_deg=15.44)
    assert "111 km" in note


@pytest.mark.parametrize("id", ["qakf", "analytic"])
def test_an_alignment_whose_given_place_is_far_from_the_fixes_starts_with_them(id):
    log = simulated_log("ship-swaying", seed=5, duration_s=30.0, grade="navigation")
    log = replace(log, gnss=simulated_log("car-city-drive", seed=5, duration_s=29.0).gnss)
    latitude, longitude = (float(np.degrees(each[0])) for each in (log.gnss.latitude, log.gnss.longitude))
    near = {"latitude_deg": latitude, "longitude_deg": longitude, "height_m": 20.0}

    def begun(**initial):
        return initial_knowledge(started(log, **initial), get(id), "coarse", 0)

    assert begun().notes == begun(**near).notes == () and begun(**near).knowledge.height == 20.0
    far = begun(**{**near, "latitude_deg": latitude + 20.0})
    (note,) = far.notes
    assert "sigma) from the fix at the start: the start is that of the fixes" in note
    assert far.knowledge.latitude == log.gnss.latitude[0] and far.knowledge.height == log.gnss.height[0]
    (result,) = replay(started(log, **{**near, "latitude_deg": latitude + 20.0}), [id]).results
    assert note in result.notes


def test_a_stated_place_far_from_the_fix_at_the_start_is_named():
    log = simulated_log("car-city-drive", seed=5, duration_s=60.0, grade="tactical")
    reference = log.reference
    at = int(np.searchsorted(log.imu_time, 45.4))  # the car drives, between two fixes
    given = {
        "start_s": float(log.imu_time[at] - log.dt[at]), "height_m": float(reference.height[at]),
        "latitude_deg": float(np.degrees(reference.latitude[at])), "longitude_deg": float(np.degrees(reference.longitude[at])),
        "velocity_mps": tuple(map(float, reference.velocity_n[at])), "roll_deg": 0.0, "pitch_deg": 0.0, "heading_deg": HEADING,
        **SIGMAS, "position_sigma_m": (0.5, 0.5, 0.5),
    }  # fmt: skip
    assert np.hypot(*reference.velocity_n[at, :2]) > 5.0
    for id in ("velocity-integration", "loosely-coupled"):
        assert initial_knowledge(started(log, **given), get(id), "stated", at).notes == ()
        wrong = started(log, **{**given, "longitude_deg": given["longitude_deg"] + 1.0})
        (note,) = initial_knowledge(wrong, get(id), "stated", at).notes
        assert "is 76 km" in note and "from the fix at the start: estimators start with it all the same" in note


def test_a_vehicle_that_moves_sideways_keeps_its_heading():
    """A drone flies in any direction: its course does not contradict the heading, whose sigma went to 60 deg."""
    log = simulated_log(car("tactical"), seed=5, duration_s=80.0, grade="tactical", initial={"static_until_s": 30.0})
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # the unit's x axis points to the right side
    log = replace(log, delta_angle=log.delta_angle @ turn.T, delta_velocity=log.delta_velocity @ turn.T)
    log = replace(log, lever_arm_b=turn @ log.lever_arm_b)
    found = replay(started(log, heading_deg=HEADING + 90.0), ["loosely-coupled"]).results[0]
    assert not any("navigation starts with" in note for note in found.notes)
    assert any("from the direction of travel: if this vehicle moves forward" in note for note in found.notes)
    assert found.errors["heading_deg"][-1] == pytest.approx(90.0, abs=1.0)  # the reference has that of the car
    assert found.sigma["heading_deg"][0] < 6.0


def test_the_velocity_that_a_tilt_integrates_at_rest_does_not_count():
    """Thirty seconds at rest with a roll that is 0.01 rad wrong integrate 3 m/s to the side."""
    log = simulated_log(car("tactical", calm=True), seed=5, duration_s=80.0, grade="tactical", initial={"static_until_s": 30.0})
    rest = rest_of(log, np.flatnonzero(log.imu_time <= 30.0), 0)
    roll, pitch = rest.level
    heading, sigma = heading_by_force(log, 0, (roll + 0.01, pitch), rest.rate, log.sensors(in_place=True), 0.01)
    assert abs(heading - np.radians(HEADING)) < 2 * sigma < np.radians(30.0)


def test_a_level_too_poor_to_tell_leaves_a_wide_heading():
    log = simulated_log(car("tactical"), seed=5, duration_s=80.0, grade="tactical", initial={"static_until_s": 30.0})
    poor = started(log, heading_deg=HEADING + 60.0, tilt_sigma_deg=5.0)
    notes = " ".join(replay(poor, ["loosely-coupled"]).results[0].notes)
    assert "course of the first motion" in notes and "not 5 deg" in notes and "or aqe-sukf" in notes


def test_gyros_that_sense_the_earth_need_neither_heading_nor_motion():
    log = simulated_log(
        car("navigation", calm=True), seed=7, duration_s=29.0, grade="navigation", initial={"static_until_s": 29.0}
    )
    result = replay(log, ["loosely-coupled"]).results[0]
    assert abs(result.errors["heading_deg"][-1]) < 3 * result.sigma["heading_deg"][-1] < 1.5
    notes = replay(started(log, heading_deg=HEADING + 20.0), ["loosely-coupled"]).results[0].notes
    assert [note for note in notes if "differs by 20.2 deg from that of the gyros at rest" in note]


def rest(heading, bias, roll=0.02, pitch=-0.05, rate_sigma=1e-9):
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(roll, pitch, heading))
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(LATITUDE) + bias
    return Rest(rate, C_nb.T @ np.array([0.0, 0.0, -9.8]), np.full(3, rate_sigma), 0.0, 100.0, 0.0)


POOR = SensorNotes(1e-6, 1e-4, np.radians(100.0) / 3600, 1e-2, 1e9, 1e9)


@pytest.mark.parametrize("heading", [-2.5, 0.3, 3.0])
def test_the_rest_tells_the_heading_of_good_gyros_and_the_bias_of_poor_ones(heading):
    good = replace(POOR, gyro_bias_sigma=np.radians(0.01) / 3600, angle_random_walk=1e-9)
    bias = np.radians([0.005, -0.01, 0.008]) / 3600
    found = start_at_rest(rest(heading, bias), (0.02, -0.05), LATITUDE, heading + 0.1, np.radians(20.0), good, 1e-6)
    assert abs(found.heading - heading) < 3 * found.heading_sigma < np.radians(0.3)
    bias = np.radians([50.0, -100.0, 80.0]) / 3600
    found = start_at_rest(rest(heading, bias), (0.02, -0.05), LATITUDE, heading, np.radians(1.0), POOR, 0.01)
    assert found.heading == pytest.approx(heading, abs=1e-3) and found.heading_sigma == pytest.approx(np.radians(1.0), rel=1e-2)
    np.testing.assert_allclose(found.gyro_bias, bias, atol=np.radians(0.3) / 3600)
    assert found.rest_share == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("id", ["loosely-coupled", "aqe-ekf"])
def test_the_bias_of_a_rest_shares_the_errors_of_the_attitude(id):
    """Draws of the start attitude: covariance of what is left of the bias with the attitude error, against the filter's."""
    sigma, tilt, angles = np.radians(5.0), np.radians(0.5), (0.1, -0.2, 1.0)
    estimator, generator = get(id), np.random.default_rng(3)
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(*angles))
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(LATITUDE)
    known = Knowledge(
        LATITUDE, 0.0, 0.0, 0.01, roll=angles[0], pitch=angles[1], heading=angles[2], tilt_sigma=tilt, heading_sigma=sigma,
        gyro_bias_error=1e-9, rest_share=1.0, sensors=POOR,
    )  # fmt: skip
    model = estimator.model
    p = model.parameters.pack(estimator.parameters(known))
    state = model.state.unpack(np.asarray(model.kernels["start"].function(p, [])).ravel())
    n, gyro = (15, slice(9, 12)) if id == "loosely-coupled" else (16, slice(4, 7))
    stated = symmetric.full_array(state["covariance"], n)[gyro, gyro]

    turns = generator.normal(size=(4000, 3)) * [tilt, tilt, sigma]
    truth = np.array([attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(turn)) for turn in turns]) @ C_nb
    left = C_nb.T @ geodesy.numeric.earth_rate_n(LATITUDE) - truth.transpose(0, 2, 1) @ geodesy.numeric.earth_rate_n(LATITUDE)
    assert np.linalg.norm(rate) > 7e-5
    drawn = np.cov(left.T)
    np.testing.assert_allclose(stated, drawn, atol=0.06 * drawn.max())
    largest = float(np.degrees(np.sqrt(np.max(np.diag(stated)))) * 3600)
    assert largest > 0.5  # deg/h, of a bias that the rest alone would know to 0.0002


SIGMAS = {
    "tilt_sigma_deg": 2.0, "heading_sigma_deg": 30.0,
    "velocity_sigma_mps": (0.7, 0.8, 0.9), "position_sigma_m": (11.0, 12.0, 13.0),
}  # fmt: skip


@pytest.mark.parametrize("start", ["coarse", "reference"])
def test_the_sigmas_of_initial_are_those_of_the_start(start):
    log = simulated_log(
        car("tactical"), duration_s=40.0, grade="tactical", initial={"static_until_s": 20.0, "heading_deg": HEADING}
    )

    def first(log):
        result = replay(log, ["loosely-coupled"], start=start).results[0]
        return {name: result.sigma[name][0] for name in ("roll_deg", "heading_deg", "vn_mps", "vd_mps", "north_m", "down_m")}

    stated = first(started(log, start_s=25.0, **SIGMAS))
    default = first(started(log, start_s=25.0))
    assert stated["roll_deg"] == pytest.approx(2.0, rel=0.05) and stated["heading_deg"] == pytest.approx(30.0, rel=0.05)
    assert stated["north_m"] > 2 * default["north_m"] or start == "coarse"
    assert default["heading_deg"] == pytest.approx(5.0, rel=0.05)
    assert default["roll_deg"] == pytest.approx(1.0, rel=0.05) if start == "reference" else default["roll_deg"] < 0.2


@pytest.mark.parametrize(
    ("key", "value"),
    [("tilt_sigma_deg", 0.0), ("heading_sigma_deg", 181.0), ("velocity_sigma_mps", (1.0, 1.0, 0.0)), ("position_sigma_m", 3.0)],
)
def test_a_wrong_sigma_of_initial_is_an_error(key, value):
    from insenv.files.toml import validated

    with pytest.raises(InputError, match=key):
        validated(InitialSection, {key: value}, "log.toml")


def test_an_unknown_heading_starts_the_filters_of_large_misalignment():
    log = simulated_log(
        car("tactical"),
        seed=3,
        duration_s=120.0,
        grade="tactical",
        initial={"static_until_s": 30.0, "heading_sigma_deg": 180.0},
    )
    unscented, linear = replay(log, ["aqe-sukf", "loosely-coupled"]).results
    assert unscented.sigma["heading_deg"][0] > 60.0
    assert abs(unscented.errors["heading_deg"][-1]) < 3 * unscented.sigma["heading_deg"][-1] < 3.0
    assert "linearised filter states too small sigmas" in " ".join(linear.notes)
    assert "linearised" not in " ".join(unscented.notes)


@pytest.mark.parametrize(("rest", "said"), [(None, "the log does not begin at rest"), (15.0, "the vehicle moves at 40 s")])
def test_under_way_fusion_starts_from_nothing_and_others_need_an_attitude(rest, said):
    """Velocity of the fix at the start; level and heading are found.  A rest that ended 25 s before is no start at rest."""
    log = simulated_log(
        car("tactical"), seed=5, duration_s=100.0, grade="tactical", initial={"start_s": 40.0, "static_until_s": rest}
    )
    result = replay(log, "fusion").results[0]
    assert said in result.notes[0] and "its level is unknown, its heading is unknown" in result.notes[0]
    for name in ("roll_deg", "pitch_deg", "heading_deg", "vn_mps", "ve_mps", "vd_mps"):
        assert abs(result.errors[name][-1]) < 3 * result.sigma[name][-1], name
        assert beyond(result, name, result.time > 0) < 0.01, name
    assert result.sigma["heading_deg"][0] > 60 and result.sigma["heading_deg"][-1] < 1
    assert result.health.verdict == "consistent"
    for id in ("loosely-coupled", "wander-sins"):
        with pytest.raises(InputError, match=f"{said}.*others need roll_deg, pitch_deg"):
            replay(log, id)
    told = started(log, roll_deg=0.0, pitch_deg=0.0, heading_deg=0.0, tilt_sigma_deg=5.0, heading_sigma_deg=180.0)
    assert "its level is known to 5 deg, its heading is unknown" in replay(told, "aqe-sukf").results[0].notes[0]


def test_under_way_a_smoother_starts_from_nothing():
    log = record("ship-at-sea", seed=5, duration_s=30.0)
    log = replace(log, description=log.description.model_copy(update={"initial": InitialSection()}))
    result = replay(log, fusion((), ("gnss",), "few", smoother=True)).results[0]
    assert "its level is unknown, its heading is unknown" in result.notes[0]
    sigma = result.sigma["heading_deg"]
    found = int(np.argmax(sigma < 5.0))
    assert 2.0 < result.time[found] < 20.0 and np.all(sigma[:found] > 7.0) and np.all(sigma[found:] < 3.5)
    for name in ("roll_deg", "pitch_deg", "heading_deg", "north_m", "vn_mps"):
        assert np.all(np.abs(result.errors[name]) < 4.5 * result.sigma[name]), name


def test_without_a_velocity_of_fixes_a_doppler_log_starts_fusion_under_way(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")  # to compile would take longer
    log = record("ship-at-sea", duration_s=10.0)
    log = replace(
        log,
        gnss=replace(log.gnss, velocity_n=None, velocity_sigma=None),
        description=log.description.model_copy(update={"initial": InitialSection()}),
    )
    result = replay(log, "fusion").results[0]
    assert "the start has position of the fix at" in result.notes[0]
    assert any("the heading is not found" in note for note in result.notes)  # in minutes, by the Earth's rotation
    assert all(beyond(result, name, result.time > 0) == 0.0 for name in ("heading_deg", "north_m", "vn_mps"))
    with pytest.raises(InputError, match="the log does not begin at rest"):
        replay(replace(log, instruments=()), "fusion")


def test_a_log_without_fixes_starts_by_its_doppler_log_at_the_place_of_initial(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")  # to compile would take longer
    log = record("ship-log-alignment", duration_s=5.0)
    filter, alignment = replay(log, ["fusion", "velocity-integration"]).results
    assert "the start has the position of [initial]" in filter.notes[0]
    assert any("the heading is not found" in note for note in filter.notes)
    assert alignment.sigma["roll_deg"][-1] < 5.0 and alignment.sigma["heading_deg"][-1] > 90.0
    nowhere = replace(log, description=log.description.model_copy(update={"initial": InitialSection()}))
    with pytest.raises(InputError, match="alignment needs the place"):
        replay(nowhere, "fusion")


def test_a_steady_drive_at_the_start_of_a_part_is_no_rest(tmp_path):
    """20 m/s on a straight road: its inertial unit shows what one at rest does, and the fix there does not."""
    (path, *_) = write(record("car-city-drive", duration_s=330.0), tmp_path, ["log"])
    text = path.read_text()
    begin, end = text.index("\n[initial]"), text.index("\n[imu]")
    path.write_text((text[:begin] + text[end:]).replace("vehicle_kind", "start_s = 300.0\nvehicle_kind", 1))
    result = replay(path, "fusion").results[0]
    assert "the vehicle moves at 299.995 s" in result.notes[0] and result.sigma["heading_deg"][0] > 90.0


def cut(log, from_s, /, **initial):
    """The log from `from_s` on, with other values in [initial]."""
    kept, fixed = log.imu_time - log.dt >= from_s - 1e-6, log.gnss.time >= from_s
    names = ("imu_time", "delta_angle", "delta_velocity", "dt", "bridged")
    of_fixes = {name: value[fixed] for name, value in vars(log.gnss).items() if value is not None}
    parts = {name: getattr(log, name)[kept] for name in names}
    log = replace(log, **parts, gnss=replace(log.gnss, **of_fixes), temperature=None)
    log = started(log, **initial)
    return replace(log, description=log.description.model_copy(update={"start_s": from_s}))


def test_a_state_of_the_beginning_is_not_taken_for_that_of_a_later_start():
    """A car 250 m on and turned by 60 deg: the state at time 0 with its sigma of a metre and of 0.5 deg says nothing of it."""
    log = record(car("tactical"), seed=4, duration_s=90.0)
    for start in ("coarse", "stated"):
        with pytest.raises(
            InputError, match=r"start_s = 60 s leaves out .* \(latitude_deg, longitude_deg, height_m, velocity_mps"
        ):
            replay(cut(log, 60.0), "fusion", start=start)
        with pytest.raises(InputError, match=r"\[initial\] start_s = 0 s: .* the log is used from 60 s on: allowed is that"):
            replay(cut(log, 60.0, start_s=0.0), "fusion", start=start)
    assert replay(cut(log, 60.0, start_s=60.0), "fusion", start="stated").results[0].time[0] > 60.0  # said to be of 60 s
    assert replay(cut(log, 60.0), "fusion", start="reference").results[0].time[0] > 60.0  # which does not use it
    nothing = dict.fromkeys(InitialSection.model_fields)
    assert "its heading is unknown" in replay(cut(log, 60.0, **nothing), "fusion").results[0].notes[0]


def test_a_vehicle_in_place_has_the_same_state_later():
    log = record("car-parked", seed=4, duration_s=90.0)
    assert replay(replace(log, description=log.description.model_copy(update={"start_s": 60.0})), "q-method").results


@pytest.mark.parametrize("shown_by", ["gnss", "reference", "dvl"])
def test_in_place_is_refused_for_a_ship_that_moves(shown_by):
    log = record("ship-dvl", seed=4, duration_s=30.0)
    kept = {"gnss": log.gnss if shown_by == "gnss" else None, "reference": log.reference if shown_by == "reference" else None}
    log = replace(log, **kept, instruments=log.instruments if shown_by == "dvl" else ())
    log = replace(log, description=log.description.model_copy(update={"in_place": True}))
    for id in ("fusion", "q-method"):
        with pytest.raises(InputError, match=r"in_place = true, and the log shows that the vehicle moves, at .* m/s about"):
            replay(log, id)

"""Starts of replays: an unknown unit, wrong headings and places, the standard deviations of [initial], starts under way."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_log import simulated_log
from standing_car import HEADING, WANDER, beyond, car, car_log, started

from insenv import record, replay, write
from insenv.base.errors import InputError
from insenv.estimators import get
from insenv.logs.description import InitialSection
from insenv.report import run_document
from insenv.runs.replay_start import initial_knowledge
from insenv.scenario import load


@pytest.mark.parametrize(("grade", "seconds"), [
    ("navigation", 80.0),
    *(pytest.param(*each, marks=pytest.mark.slow) for each in (("consumer", 80.0), ("industrial", 300.0))),
])  # fmt: skip
def test_without_a_grade_the_stated_sigma_is_honest(grade, seconds):
    """As a ship's navigator, 33 to 99 % of these errors would be beyond three sigma."""
    log = car_log(grade, seconds, seed=301, wait_s=seconds / 10, told=False, outages=True, estimator=WANDER)
    report = replay(log, ["loosely-coupled"])
    result = report.results[0]
    for name in ("north_m", "east_m", "down_m", "roll_deg", "heading_deg"):
        assert beyond(result, name, result.time > seconds / 3) < 0.01, name
    said = [note for note in run_document(report).values["notes"] if "gives no grade of its inertial unit" in note]
    assert len(said) == 1 and "deg/sqrt(h)" in said[0] and "class" in said[0]


def test_nothing_is_assumed_of_a_unit_that_the_description_gives():
    unit = {"arw_deg_sqrt_h": 0.15, "vrw_mps_sqrt_h": 0.06, "gyro_bias_deg_h": 4.0}
    told, bare = (car_log("tactical", 15.0, told=each, heading_deg=HEADING) for each in (True, False))
    whole = {**unit, "accel_bias_ug": 750.0}
    for log, own, said in ((told, {}, False), (bare, unit, True), (bare, whole, False)):
        notes = replay(log, ["loosely-coupled"], settings={"loosely-coupled": own}).notes
        assert any("no grade" in note for note in notes) == said, own


@pytest.mark.parametrize(
    ("calm", "wrong", "seconds"),
    [(False, (0.0, 60.0), 120.0), pytest.param(True, (0.0, 2.6, -20.0, 60.0), 300.0, marks=pytest.mark.slow)],
)
def test_any_heading_within_60_deg_ends_at_the_same_answer(calm, wrong, seconds):
    """A unit of 0.01 deg/h.  Taken as it is, 60 deg ends 5 deg wrong at a stated 0.026, and 35 m beside the road."""
    log = car_log("navigation", seconds, seed=201, wait_s=30.0, calm=calm, estimator=WANDER)
    ends, names = [], ("heading_deg", "north_m", "east_m")
    for error in wrong:
        result = replay(started(log, heading_deg=HEADING + error), ["loosely-coupled"]).results[0]
        for name in names:
            assert beyond(result, name, result.time > 100.0) < 0.01, (name, error)
        ends.append([result.errors[name][-1] / result.sigma[name][-1] for name in names])
        assert np.abs(result.outputs["gyro_bias"][-1]).max() < np.radians(0.05) / 3600, error  # five sigma of the grade
    assert np.ptp(ends, axis=0).max() < 0.5, "in standard deviations"


def test_a_unit_on_its_back_is_refused():
    """Axes upside down give 180 deg of roll at a stated 0.05 deg, with a healthy filter."""
    log = car_log("tactical", 20.0)
    log = replace(log, delta_angle=log.delta_angle * [1, -1, -1], delta_velocity=log.delta_velocity * [1, -1, -1])
    with pytest.raises(InputError, match="axes or accel_axes of"):
        replay(started(log, heading_deg=HEADING), ["loosely-coupled"])
    found = replay(started(log, heading_deg=HEADING, roll_deg=180.0), ["loosely-coupled"]).results[0]
    assert abs(abs(found.errors["roll_deg"][-1]) - 180.0) < 1.0  # the reference is upright


def begun(log, id="loosely-coupled", start="coarse", at=0, **initial):
    return initial_knowledge(started(log, **initial), get(id), start, at)


def test_a_given_place_far_from_the_fixes_is_named():
    log = car_log("tactical", 15.0, heading_deg=HEADING)
    near = {"latitude_deg": 47.07, "longitude_deg": 15.44}
    exact = {**near, "position_sigma_m": (0.1, 0.1, 0.1)}
    for given in ({}, near, exact):
        assert not [note for note in begun(log, **given).notes if "[initial]" in note]
    far = begun(log, **{**exact, "latitude_deg": 46.07})
    (note,) = [note for note in far.notes if "[initial]" in note]
    assert "latitude_deg = 46.07" in note and "111 km" in note and "sigma) from the fixes at rest" in note
    np.testing.assert_allclose(far.knowledge.position_sigma, log.gnss.position_sigma[0], rtol=1e-12)  # not that of the place


def test_an_alignment_whose_given_place_is_far_from_the_fixes_starts_with_them():
    log = simulated_log("ship-swaying", seed=5, duration_s=5.0, grade="navigation")
    log = replace(log, gnss=simulated_log("car-city-drive", seed=5, duration_s=4.0).gnss)
    latitude, longitude = (float(np.degrees(each[0])) for each in (log.gnss.latitude, log.gnss.longitude))
    near = {"latitude_deg": latitude, "longitude_deg": longitude, "height_m": 20.0}
    wrong = {**near, "latitude_deg": latitude + 20.0}
    for id in ("qakf", "analytic"):
        assert begun(log, id).notes == begun(log, id, **near).notes == () and begun(log, id, **near).knowledge.height == 20.0
        far = begun(log, id, **wrong)
        assert "sigma) from the fix at the start: the start is that of the fixes" in far.notes[0] and len(far.notes) == 1
        assert far.knowledge.latitude == log.gnss.latitude[0] and far.knowledge.height == log.gnss.height[0]
    assert far.notes[0] in replay(started(log, **wrong), ["analytic"]).results[0].notes


@pytest.mark.parametrize("start", ["coarse", "reference"])
def test_the_sigmas_of_initial_are_those_of_the_start(start):
    log = car_log("tactical", 20.0, wait_s=20.0, heading_deg=HEADING, static_until_s=10.0)

    def first(**initial):
        result = replay(started(log, start_s=15.0, **initial), ["loosely-coupled"], start=start).results[0]
        return {name: sigma[0] for name, sigma in result.sigma.items()}

    sigmas = {"velocity_sigma_mps": (0.7, 0.8, 0.9), "position_sigma_m": (11.0, 12.0, 13.0)}
    stated, default = first(tilt_sigma_deg=2.0, heading_sigma_deg=30.0, **sigmas), first()
    assert stated["roll_deg"] == pytest.approx(2.0, rel=0.05) and stated["heading_deg"] == pytest.approx(30.0, rel=0.05)
    assert stated["north_m"] > 2 * default["north_m"] or start == "coarse"
    assert default["heading_deg"] == pytest.approx(5.0, rel=0.05)
    assert default["roll_deg"] == pytest.approx(1.0, rel=0.05) if start == "reference" else default["roll_deg"] < 0.2


@pytest.mark.parametrize(("rest", "said", "ids"), [
    (None, "the log does not begin at rest", ["fusion", "loosely-coupled"]),
    pytest.param(5.0, "the vehicle moves at 20 s", "fusion", marks=pytest.mark.slow),
])  # fmt: skip
def test_under_way_the_motion_gives_the_attitude(rest, said, ids):
    """A rest that ended 15 s before is no start at rest."""
    log = started(car_log("tactical", 80.0, seed=4, wait_s=3.0), start_s=20.0, static_until_s=rest)
    for result in replay(log, ids).results:
        assert "twelve were started" in result.notes[0] and said in result.notes[1]
        for name in ("roll_deg", "pitch_deg", "heading_deg", "vn_mps", "ve_mps", "vd_mps"):
            assert abs(result.errors[name][-1]) < 3 * result.sigma[name][-1], name
            assert beyond(result, name, result.time > 0) < 0.01, name
        assert result.sigma["heading_deg"][0] < 10.1 and result.sigma["heading_deg"][-1] < 1
        assert set(result.doubts) <= {"reference-contradicts"}  # positions: that its fixes wander the log does not say


@pytest.mark.slow
def test_where_the_motion_does_not_show_it_fusion_starts_from_nothing_and_others_need_an_attitude():
    """At a constant speed straight ahead."""
    log = started(car_log("consumer", 40.0, seed=4, wait_s=3.0), start_s=20.0, static_until_s=None)
    result = replay(log, "fusion").results[0]
    assert "its level is unknown, its heading is unknown" in result.notes[0] and result.sigma["heading_deg"][-1] > 30
    with pytest.raises(InputError, match=r"the log does not begin at rest.*others need .* or roll_deg, pitch_deg"):
        replay(log, "wander-sins")


NOTHING = {"initial": InitialSection()}


def described(log, **update):
    return replace(log, description=log.description.model_copy(update=update))


@pytest.mark.slow
def test_a_doppler_log_starts_fusion_under_way():
    log = record("ship-at-sea", duration_s=5.0)
    log = described(replace(log, gnss=replace(log.gnss, velocity_n=None, velocity_sigma=None)), **NOTHING)
    result = replay(log, "fusion").results[0]
    assert "the start has position of the fix at" in result.notes[0]
    assert any("the heading is not found" in note for note in result.notes)  # in minutes, by the Earth's rotation
    assert all(beyond(result, name, result.time > 0) == 0.0 for name in ("heading_deg", "north_m", "vn_mps"))
    with pytest.raises(InputError, match="the log does not begin at rest"):
        replay(replace(log, instruments=()), "fusion")


def test_a_log_without_fixes_starts_by_its_doppler_log_at_the_place_of_initial():
    log = record("ship-log-alignment", duration_s=5.0)
    filter, alignment = replay(log, ["fusion", "velocity-integration"]).results
    assert "the start has the position of [initial]" in filter.notes[0]
    assert any("the heading is not found" in note for note in filter.notes)
    assert alignment.sigma["roll_deg"][-1] < 5.0 and alignment.sigma["heading_deg"][-1] > 90.0
    with pytest.raises(InputError, match="alignment needs the place"):
        replay(described(log, **NOTHING), "fusion")


def test_a_steady_drive_at_the_start_of_a_part_is_no_rest(tmp_path):
    values = car("tactical").model_dump(mode="json", exclude_unset=True)
    values["vehicle"]["legs"] = [{"accelerate_to_mps": 20.0}, {"drive_s": 60.0}]
    (path, *_) = write(record(load({**values, "duration_s": 45.0})), tmp_path, ["log"])
    text = path.read_text()
    begin, end = text.index("\n[initial]"), text.index("\n[imu]")
    path.write_text((text[:begin] + text[end:]).replace("vehicle_kind", "start_s = 30.0\nvehicle_kind", 1))
    result = replay(path, "fusion").results[0]
    assert "the vehicle moves at 29.99 s" in result.notes[0] and result.sigma["heading_deg"][0] > 90.0


def cut(log, from_s, /, **initial):
    kept, fixed = log.imu_time - log.dt >= from_s - 1e-6, log.gnss.time >= from_s
    names = ("imu_time", "delta_angle", "delta_velocity", "dt", "bridged")
    of_fixes = {name: value[fixed] for name, value in vars(log.gnss).items() if value is not None}
    parts = {name: getattr(log, name)[kept] for name in names}
    log = started(replace(log, **parts, gnss=replace(log.gnss, **of_fixes), temperature=None), **initial)
    return described(log, start_s=from_s)


def test_a_state_of_the_beginning_is_not_taken_for_that_of_a_later_start():
    """A car 250 m on and turned by 60 deg: the state at time 0 with its sigma of a metre and of 0.5 deg says nothing of it."""
    log, begin = record(car("tactical"), seed=4, duration_s=40.0), 30.0
    for start in ("coarse", "stated"):
        with pytest.raises(InputError, match=r"start_s = 30 s leaves out .* \(latitude_deg, longitude_deg, height_m, velocity"):
            replay(cut(log, begin), "fusion", start=start)
        with pytest.raises(InputError, match=r"\[initial\] start_s = 0 s: .* the log is used from 30 s on: allowed is that"):
            replay(cut(log, begin, start_s=0.0), "fusion", start=start)
    assert replay(cut(log, begin, start_s=begin), "fusion", start="stated").results[0].time[0] > begin  # said to be of then
    assert replay(cut(log, begin), "fusion", start="reference").results[0].time[0] > begin  # which does not use it
    parked = described(record("car-parked", seed=4, duration_s=20.0), start_s=12.0)  # the same state later
    assert abs(replay(parked, "q-method").results[0].errors["roll_deg"][-1]) < 0.1
    nothing = dict.fromkeys(InitialSection.model_fields)
    assert "its heading is unknown" in replay(cut(log, begin, **nothing), "fusion").results[0].notes[0]


@pytest.mark.parametrize("shown_by", ["gnss", "reference", "dvl"])
def test_in_place_is_refused_for_a_ship_that_moves(shown_by):
    log = record("ship-dvl", seed=4, duration_s=10.0)
    kept = {name: getattr(log, name) if shown_by == name else None for name in ("gnss", "reference")}
    log = replace(log, **kept, instruments=log.instruments if shown_by == "dvl" else ())
    for id in ("fusion", "q-method"):
        with pytest.raises(InputError, match=r"in_place = true, and the log shows that the vehicle moves, at .* m/s about"):
            replay(described(log, in_place=True), id)

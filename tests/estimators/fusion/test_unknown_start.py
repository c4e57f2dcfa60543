"""`fusion` from a start attitude that is not known: found by velocity integration, then the filter, each with its sigma."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import insenv
from insenv.campaigns.block import run_block
from insenv.campaigns.plan import make_plan
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.estimators.fusion import unknown_start
from insenv.estimators.fusion.available import composition
from insenv.estimators.velocity_integration.estimator import BY_FIXES, BY_LOG
from insenv.plant.feeding import input_rows
from insenv.scenario import Scenario, build, load

STATES, AIDS = ("gnss_wander", "dvl_scale", "dvl_misalignment"), ("gnss", "dvl")
FEW = composition("few", STATES, AIDS)
LOGGED = composition("logged", STATES[1:], AIDS[1:])


def _known(name: str, **knowledge: Any) -> Scenario:
    """A scenario with other knowledge of the start (keys of its section)."""
    scenario = load(name)
    return scenario.model_copy(update={"knowledge": scenario.knowledge.model_copy(update=knowledge)})


def _outputs(scenario: Scenario, seed: int, duration_s: float, every: int = 1) -> dict[str, np.ndarray]:
    """Of `fusion` as the scenario's presets compose it."""
    plant = build(scenario, seed=seed, duration_s=duration_s)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    filter = plant.adapted("fusion")
    runner = make_runner(filter.model, plant.parameters_of(filter))
    return filter.model.outputs.unpack(runner.run(plant.samples, input_rows(filter.model, columns, plant.samples), every))


@pytest.mark.slow
def test_an_unknown_heading_at_sea_is_found_with_an_honest_sigma():
    """From 180 deg, 16 runs.  Without the alignment one in six settles 20 to 80 deg off, at a sigma of 0.5 deg."""
    summary = insenv.campaign("ship-at-sea", insenv.fusion(STATES, AIDS), 16, seed=20000, duration_s=60)
    heading = summary.courses["heading_deg"]
    assert heading.rms[-1] < 1.6 * heading.stated[-1] and heading.stated[-1] < 0.6
    assert summary.nees is not None and summary.nees.mean[-1] < 9.0 + 3.2  # 3 standard deviations of the mean of 16 runs


def test_a_car_and_an_aircraft_find_their_attitude():
    for name, duration_s, sigma in (("car-unknown-heading", 80.0, 0.5), ("aircraft-inflight-alignment", 60.0, 0.02)):
        result = insenv.run(_known(name, heading_sigma_deg=180.0), "fusion", seed=20001, duration_s=duration_s).results[0]
        for angle in ("roll_deg", "pitch_deg", "heading_deg"):
            assert np.all(np.abs(result.errors[angle]) < 4.5 * result.sigma[angle])
        assert result.sigma["heading_deg"][-1] < sigma
        assert [note.split(" after")[0] for note in result.notes if "heading" in note] == ["heading found"]


def test_a_run_and_a_replay_say_when_the_heading_was_found():
    """The time of the note is that at which the filter stopped seeking, to one record."""
    scenario, duration_s = _known("ship-at-sea"), 60.0
    report = insenv.run(scenario, ["fusion", "velocity-integration"], seed=20001, duration_s=duration_s)
    (said,) = [note for note in report.results[0].notes if "heading found" in note]
    assert said.endswith("by the velocity of GNSS; from then on the filter runs with all its aids")
    (found,) = [note for note in report.results[1].notes if "heading found" in note]
    plant = build(scenario, seed=20001, duration_s=duration_s)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    filter = plant.adapted("fusion")
    runner, rows = make_runner(filter.model, plant.parameters_of(filter)), input_rows(filter.model, columns, plant.samples)
    sought = 0
    while runner.state["alignment_seeking"]:
        runner.run(1, rows[sought : sought + 1])
        sought += 1
    stated_s = float(said.split("after ")[1].split(" s")[0])
    record_s = float(np.diff(report.results[0].time)[0])
    assert 0.0 <= stated_s - sought * plant.sample_interval < record_s + 0.01
    assert float(found.split("after ")[1].split(" s")[0]) <= stated_s
    replayed = insenv.replay(insenv.record(scenario, seed=20001, duration_s=duration_s), "fusion", start="stated")
    (again,) = [note for note in replayed.results[0].notes if "heading found" in note]
    assert abs(float(again.split("after ")[1].split(" s")[0]) - stated_s) < record_s + 0.01


def test_a_known_start_has_no_note_of_a_heading_found():
    result = insenv.run("car-city-drive", "fusion", duration_s=5.0).results[0]
    assert not any("heading found" in note for note in result.notes)


@pytest.mark.slow
def test_a_smoother_has_its_heading_from_where_the_filter_begins():
    """16 runs of a ship: the filter begins with degrees, the smoother states what the whole run shows, and keeps to it."""
    smoother = insenv.fusion((), ("gnss",), "few", smoother=True)
    ratios = []
    for seed in range(20000, 20016):
        result = insenv.run("ship-at-sea", smoother, seed=seed, duration_s=60).results[0]
        sigma = result.sigma["heading_deg"]
        found = int(np.argmax(sigma < 5.0))
        assert found > 0 and np.all(sigma[:found] > 7.0) and np.all(sigma[found:] < 2.5)
        ratios.append([result.errors[name][found] / result.sigma[name][found] for name in result.sigma])
    square = np.mean(np.square(ratios), axis=0)
    assert np.all(square < 2.5) and np.mean(square) < 1.4  # of 16 independent ones 2.5 is the bound at 99.9 %


@pytest.mark.parametrize(("name", "duration_s"), [("aircraft-inflight-alignment", 12.0), ("ship-at-sea", 8.0)])
def test_before_the_attitude_is_found_velocity_and_place_have_honest_sigmas(name, duration_s):
    """Of an attitude that may be any one, 12 runs.

    What first order leaves out of gravity, of the antenna's arm and of the specific force made 27 sigmas of position and 9 of
    velocity.
    """
    ratios = []
    for seed in range(20000, 20012):
        scenario = _known(name, heading_sigma_deg=180.0, tilt_sigma_deg=180.0)
        result = insenv.run(scenario, "fusion", seed=seed, duration_s=duration_s).results[0]
        found = int(np.argmax(result.sigma["heading_deg"] < 7.0)) or len(result.time)
        assert found > 10
        for error in ("north_m", "east_m", "down_m", "vn_mps", "ve_mps", "vd_mps"):
            ratios.append(np.abs(result.errors[error][:found]) / result.sigma[error][:found])
    ratio = np.concatenate(ratios)
    assert np.max(ratio) < 5.0 and np.mean(ratio > 3.0) < 0.01


def test_a_heading_that_is_roughly_known_is_kept_until_a_better_one_is_found():
    """A straight line shows none: 45 deg stay 45 deg, and level, velocity and place are known all the while."""
    result = insenv.run(_known("car-unknown-heading", heading_sigma_deg=45.0), "fusion", seed=20002, duration_s=29).results[0]
    assert 40.0 < result.sigma["heading_deg"][-1] < 50.0
    assert result.sigma["roll_deg"][-1] < 2.0 and result.sigma["vn_mps"][-1] < 1.0 and result.sigma["north_m"][-1] < 5.0
    assert abs(result.errors["vn_mps"][-1]) < 1.0
    assert any("the heading is not found" in note for note in result.notes)


@pytest.mark.slow
@pytest.mark.parametrize(("grade", "nees"), [("industrial", 9.0 + 3.2), ("consumer", 9.0 + 3.2)])
def test_gyros_of_low_cost_do_not_make_it_too_sure(grade, nees):
    """45 deg of heading, gyro biases of 230 and 720 deg/h, 16 runs; to first order alone it is 600."""
    scenario = _known("car-unknown-heading")
    unit = scenario.imu.model_copy(update={"grade": grade})
    summary = insenv.campaign(scenario.model_copy(update={"imu": unit}), "fusion", 16, seed=20000, duration_s=90)
    assert summary.nees is not None and summary.nees.mean[-1] < nees
    north = summary.courses["north_m"]
    assert north.rms[-1] < 1.6 * north.stated[-1] < 5.0


def test_each_fix_counts_where_no_attitude_is_found():
    """Gyros of a degree a second: the heading stays unknown, the place that of the fixes."""
    scenario = _known("car-unknown-heading", heading_sigma_deg=180.0)
    unit = scenario.imu.model_copy(update={"grade": "autopilot"})
    result = insenv.run(scenario.model_copy(update={"imu": unit}), "fusion", duration_s=60).results[0]
    assert np.hypot(result.errors["north_m"], result.errors["east_m"]).max() < 20.0
    assert result.sigma["heading_deg"][-1] > 60.0
    assert result.health is not None and result.health.verdict == "untested" and result.health.fixes > 50
    assert any("the heading is not found" in note for note in result.notes)
    assert not any("no fix came" in note for note in result.notes)


def test_an_outlier_is_not_the_first_fix():
    """Seed 74 has one of 40 m before the heading is found: the place was 8.7 sigmas off, and nothing said so."""
    scenario = _known("car-city-drive", heading_sigma_deg=180.0, tilt_sigma_deg=180.0)
    result = insenv.run(scenario, "fusion", seed=74, duration_s=40.0).results[0]
    found = int(np.argmax(result.sigma["heading_deg"] < 7.0))
    assert found > 100
    for error in ("north_m", "east_m", "down_m"):
        assert np.max(np.abs(result.errors[error][:found]) / result.sigma[error][:found]) < 4.0
    assert result.health is not None and result.health.refused >= 1


@pytest.mark.slow
def test_fixes_that_go_on_far_away_are_taken():
    """A place that is told wrong by far more than its sigma: after ten refused fixes the filter starts from the next."""
    plant = build(_known("ship-at-sea", heading_sigma_deg=180.0), seed=1, duration_s=20.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    model = unknown_start.model_of(FEW, BY_FIXES)
    known = plant.knowledge
    parameters = {**insenv.fusion(STATES, AIDS).parameters(known), **unknown_start.prepared(BY_FIXES, known)}
    own = {name: value for name, value in parameters.items() if name in model.parameters}
    own["start_latitude"] = own["start_latitude"] + 1e-3
    outputs = model.outputs.unpack(make_runner(model, own).run(plant.samples, input_rows(model, columns, plant.samples), 50))
    assert outputs["fix_refused_count"].max() == outputs["fix_refused_count"][-1] == 10
    assert abs(outputs["latitude"][-1] - columns["latitude"][-1]) * 6.4e6 < 10.0


def test_a_heading_that_is_better_known_but_not_found_is_said_so():
    """After 20 s this aircraft has 18 deg of heading: no measurement was compared yet, and no other aid used."""
    result = insenv.run("aircraft-inflight-alignment", "fusion", seed=1, duration_s=20.0).results[0]
    assert 7.0 < result.sigma["heading_deg"][-1] < 20.0
    assert any("the heading is not found to 7 deg" in note for note in result.notes)


def test_a_start_that_only_a_parameter_makes_uncertain_says_what_to_do():
    scenario = load("car-city-drive").model_copy(update={"estimator": {"fusion": {"heading_sigma_deg": 180.0}}})
    notes = insenv.run(scenario, "fusion", duration_s=2.0).results[0].notes
    assert any("180 deg of heading" in note and "what is told of the start ([knowledge]" in note for note in notes)


@pytest.mark.slow
def test_a_level_without_a_heading_keeps_its_biases():
    """Gyros of a degree a second, 16 runs: the level was up to 9 sigma off: its errors did not turn with the heading."""
    scenario = load("ship-at-sea")
    unit = scenario.imu.model_copy(update={"grade": "autopilot"})
    plan = make_plan(scenario.model_copy(update={"imu": unit}), "fusion", 16, first_seed=20000, duration_s=120)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    error, sigma = (np.concatenate([block[part] for block in blocks])[:, :, :2] for part in ("error", "sigma"))
    assert np.mean(np.abs(error) > 3.0 * sigma) < 0.005
    assert 0.6 < np.sqrt(np.mean((error / sigma)[:, -1] ** 2)) < 1.5


def test_no_other_aid_measures_before_and_no_fix_counts():
    scenario = load("ship-at-sea")
    outputs = _outputs(scenario, 1, 20.0)
    found = int(np.argmax(np.degrees(outputs["attitude_sigma"][:, 2]) < 7.0))
    assert 100 < found < 900
    assert not outputs["dvl_count"][:found].any() and not outputs["nis_used_count"][: found + 1].any()
    assert outputs["dvl_count"][-1] > 10 and outputs["nis_used_count"][-1].min() > 20
    assert np.all(outputs["nis_used"][: found + 1] < 1e-2)


def test_from_a_known_start_it_is_the_filter_itself_to_the_bit():
    """The alignment does not run where the parameters say that the start is known."""
    plant = build(_known("ship-at-sea", heading_sigma_deg=1.0), seed=2, duration_s=30.0)
    assert "seeking" not in "".join(plant.adapted("fusion").model.state.names)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    known = plant.knowledge
    parameters = {**insenv.fusion(STATES, AIDS).parameters(known), **unknown_start.prepared(BY_FIXES, known)}
    both = []
    for model in (FEW.model, unknown_start.model_of(FEW, BY_FIXES)):
        own = {name: value for name, value in parameters.items() if name in model.parameters}
        both.append(make_runner(model, own).run(plant.samples, input_rows(model, columns, plant.samples), 50))
    np.testing.assert_array_equal(*both)


@pytest.mark.parametrize(
    ("filter", "way", "name"),
    [(FEW, BY_FIXES, "ship-at-sea"), pytest.param(LOGGED, BY_LOG, "ship-log-alignment", marks=pytest.mark.slow)],
)
def test_all_runners_give_the_same_bits(filter, way, name):
    plant = build(load(name), seed=3, duration_s=15.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    model = unknown_start.model_of(filter, way)
    estimator = plant.adapted("fusion")
    parameters = {n: v for n, v in plant.parameters_of(estimator).items() if n in model.parameters}
    rows = input_rows(model, columns, plant.samples)
    native = make_runner(model, parameters, "native").run(plant.samples, rows, 50)
    np.testing.assert_array_equal(make_runner(model, parameters, "interpreter").run(plant.samples, rows, 50), native)
    batch = make_batch(model, 3, np.tile(model.parameters.pack(parameters), (3, 1)), threads=1)
    for row in batch.run(plant.samples, np.tile(rows, (3, 1, 1)), every=50):
        np.testing.assert_array_equal(row, native)


@pytest.mark.parametrize(
    ("name", "aids"), [("car-odometer", ["odometer", "zero_velocity"]), ("multirotor-hover", ["gnss", "magnetometer"])]
)
def test_without_the_velocity_of_gnss_or_with_a_measured_heading_there_is_no_alignment(name, aids):
    plant = build(_known(name, heading_sigma_deg=180.0), seed=1, duration_s=5.0)
    assert not any(row.startswith("alignment_") for row in plant.adapted(insenv.fusion([], aids)).model.state.names)


def test_fixes_without_a_velocity_leave_the_note():
    scenario = _known("car-city-drive", heading_sigma_deg=180.0)
    assert scenario.gnss is not None
    mute = scenario.model_copy(update={"gnss": scenario.gnss.model_copy(update={"velocity": False})})
    assert any("too small sigmas" in note for note in insenv.run(mute, "fusion", duration_s=5).results[0].notes)

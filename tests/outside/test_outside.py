"""A package outside insenv adds an estimator, a vehicle and a sensor, and is taken through every interface."""

import json
import os
import re
import sys
from dataclasses import replace

import fmpy
import numpy as np
import pytest
from live_pages import unpacked
from peers import ran
from places import ROOT

import insenv
from insenv import testing
from insenv.base.errors import InputError
from insenv.envs import AlignmentEnv, AlignmentVectorEnv, ManoeuvreEnv, agents
from insenv.estimators import Drive, registered
from insenv.estimators.fusion.family import aids_of
from insenv.logs.formats.text_log import texts
from insenv.logs.loading import load as load_log
from insenv.sensors.registry import section_of

PACKAGE = ROOT / "examples" / "insenv-rail"
CAR = {
    "title": "Car with a compass", "duration_s": 60, "rate_hz": 100,
    "start": {"latitude_deg": 50, "longitude_deg": 8, "height_m": 100},
    "vehicle": {"kind": "car", "legs": [
        {"wait_s": 5}, {"accelerate_to_mps": 10}, {"drive_s": 20}, {"turn_deg": 90, "radius_m": 30},
    ]},
    "imu": {"grade": "tactical"}, "gnss": {"grade": "spp", "interval_s": 1},
    "compass": {"grade": "perfect", "noise_deg": 0.5, "deviation_deg": 3},
    "knowledge": {"heading_error_deg": 5},
}  # fmt: skip


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    target = tmp_path_factory.mktemp("target")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    ran(*pip, "--target", target, PACKAGE)
    paths = [str(target), str(ROOT), str(ROOT / "tests" / "helpers")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def call(installed, *command):
    return ran(sys.executable, *command, env=installed)


@pytest.fixture
def registered_rail(rail):
    for thing in (rail["ahrs"].ESTIMATOR, rail["trolley"].TrolleySection, rail["compass"].COMPASS):
        insenv.register(thing)
    return rail


def test_the_conformance_suite_holds_for_it(registered_rail):
    testing.check_estimator("ahrs", PACKAGE / "rail.toml", compiled=False)
    testing.check_sensor(section_of(registered_rail["compass"].COMPASS), compiled=False, noise_deg=0.5)
    testing.check_vehicle(registered_rail["trolley"].TrolleySection, compiled=False, kind="trolley", amplitude_m=1.0)
    with pytest.raises(InputError, match="compas: unknown key; did you mean 'compass'"):
        insenv.load({**CAR, "compas": {}})


@pytest.mark.usefixtures("registered_rail")
def test_runs_campaigns_and_environments_take_it():
    rms = insenv.run(PACKAGE / "rail.toml", duration_s=20.0).results[0].statistics()["rms"]
    # levelling errors are those of the trolley's own acceleration, 0.27 m/s^2 low-passed at 20 s: up to 0.17 deg
    assert rms["pitch_deg"] < 0.3 and rms["roll_deg"] < 0.3
    assert rms["heading_deg"] < 2.5  # 5 deg at the start, corrected by the compass with a time constant of 10 s
    vary = {"compass.deviation_deg": (-1.0, 1.0)}
    found = insenv.campaign(PACKAGE / "rail.toml", "ahrs", 2, duration_s=10.0, vary=vary).figures()
    assert 0.3 < found["heading_deg"]["rms"] < 4.0
    single = AlignmentEnv(PACKAGE / "rail.toml", samples_per_step=50, duration_s=10.0)
    batch = AlignmentVectorEnv(3, PACKAGE / "rail.toml", samples_per_step=50, duration_s=10.0)
    one, many = agents.make("ahrs", single), agents.make("ahrs", batch)
    (observation, info), (observations, infos) = single.reset(seed=4), batch.reset(seed=4)
    assert single.named(observation)["imu"].shape == (50, 10)  # the compass, its age too, stands beside the inertial sample
    for _ in range(4):
        action, actions = one.act(observation, info), many.act(observations, infos)
        assert np.array_equal(action, actions[0])
        observation, *_, info = single.step(action)
        observations, *_, infos = batch.step(actions)
        assert np.array_equal(observation, observations[0])


SHORT = {**CAR, "compass": {"deviation_deg": 3}, "duration_s": 40}


@pytest.fixture
def compass(rail):
    return insenv.register(rail["compass"].COMPASS)


@pytest.mark.usefixtures("compass")
def test_an_instrument_in_one_file_is_measured_estimated_and_bounded():
    with pytest.raises(InputError, match=r"compass\.grade = 'boot'.*did you mean 'boat'"):
        insenv.load({**CAR, "compass": {"grade": "boot"}})
    with pytest.raises(InputError, match=r"compass\.noise_deg = -1"):
        insenv.load({**CAR, "compass": {"noise_deg": -1}})
    seen, blind = (insenv.run(scenario, "fusion", seed=5) for scenario in (SHORT, {**SHORT, "compass": None}))
    (result,), (without,) = seen.results, blind.results
    assert "compass_deviation, compass_drift; aids: gnss, compass, zero_velocity" in seen.notes[0]
    health = result.health.aids["compass"]
    assert health.verdict == "consistent" and health.measurements == 400
    deviation, sigma = (result.outputs[name][-1, 0] for name in ("compass_deviation", "compass_deviation_estimate_sigma"))
    assert abs(deviation - np.radians(3.0)) < 3 * np.hypot(sigma, np.radians(0.5))
    # the deviation is unknown to 3.6 deg, fixed and drawn parts together, and the start tells the heading to 2 deg
    assert 0.0 < result.limit["heading_deg"] < without.limit["heading_deg"]
    assert result.sigma["heading_deg"][-1] > 0.9 * result.limit_sigma["heading_deg"][-1]


@pytest.mark.slow
@pytest.mark.usefixtures("compass")
def test_its_log_and_its_error_budget_follow(tmp_path):
    quick = {**SHORT, "duration_s": 8, "rate_hz": 50}
    log, report = insenv.record(quick, seed=5), insenv.run(quick, "fusion", seed=5)
    insenv.write(report, tmp_path, ["log"], log=log)
    (path,) = tmp_path.glob("*.toml")
    again = insenv.replay(path, "fusion", start="stated")
    for name in ("q_nb", "compass_deviation", "compass_drift"):
        assert np.array_equal(again.results[0].outputs[name][-1], report.results[0].outputs[name][-1]), name
    path.write_text(path.read_text().replace('heading_unit = "rad"', 'heading_unit = "deg"'))
    assert 'heading_unit = "rad"' in texts(load_log(path), "again")["again.toml"]  # as it is written, not as it was read
    path.write_text(path.read_text().replace('heading = "heading_rad"\nheading_unit', 'heading = "course_rad"\nheading_unit'))
    with pytest.raises(InputError, match=r"compass.*course_rad"):
        insenv.replay(path, "fusion")
    sources = insenv.budget(quick, "fusion", runs=2, duration_s=1.0).as_json()["sources"]
    assert {"compass noise", "compass deviation", "compass drift"} <= {source["name"] for source in sources}


@pytest.mark.slow
@pytest.mark.usefixtures("compass")
def test_its_aid_is_exported_and_its_keys_are_controls(tmp_path):
    filter = insenv.fusion(["compass_deviation"], ["gnss", "compass", "zero_velocity"], id="with-compass")
    insenv.export_fmu(filter, tmp_path / "compass.fmu")
    names = {variable.name for variable in fmpy.read_model_description(str(tmp_path / "compass.fmu")).modelVariables}
    assert {"compass_heading", "compass_new", "parameters.compass_noise", "compass_deviation[1]"} <= names
    page = insenv.page({**CAR, "estimator": {filter.id: {"innovation_gate": 4}}}, tmp_path / "compass.html", filter)
    assert "compass.noise_deg" in unpacked(page.read_text())["live"]


@pytest.mark.usefixtures("registered_rail")
def test_its_vehicle_is_steered_and_gets_its_aids():
    steered = CAR | {"vehicle": {"kind": "trolley", "amplitude_m": 50.0, "period_s": 12.0}}
    env = ManoeuvreEnv({name: value for name, value in steered.items() if name != "compass"}, duration_s=20.0)
    env.reset(seed=1)
    paces = [env.step(np.array([each])) and float(env._runner.state["pace"]) for each in (1.0, -1.0, -1.0)]
    assert paces[0] > 2 * np.pi / 12 > paces[2] > 0
    drives = [Drive("here", frozenset(sensors), True, vehicle="trolley") for sensors in ((), ("odometer", "gnss"))]
    assert aids_of(drives[0]) == ("in_place",)
    assert set(aids_of(drives[1])) == {"gnss", "zero_velocity", "odometer", "non_holonomic"}


@pytest.mark.slow
def test_every_interface_takes_it(installed, tmp_path):
    vary = ["--vary", "compass.deviation_deg=-1:1"]
    campaign = ["campaign", PACKAGE / "rail.toml", "-e", "ahrs", "-n", "9", "--duration", "20", *vary, "--json"]
    own, workers = (json.loads(call(installed, "-m", "insenv", *campaign, *more)) for more in ([], ["--workers", "1"]))
    assert 0.3 < own["errors"]["heading_deg"]["rms"] < 2.5
    assert own["errors"] == workers["errors"]
    for what in ("ahrs", PACKAGE / "rail.toml"):
        call(installed, "-m", "insenv", "fmu", "export", what, "-o", tmp_path / "rail.fmu")
    log = tmp_path / "rail.tlog"
    command = ["stream", PACKAGE / "rail.toml", "--to", "udpout:127.0.0.1:14599", "--speed", "0", "--duration", "5"]
    call(installed, "-m", "insenv", *command, "--tlog", log)
    assert log.stat().st_size > 10_000


@pytest.mark.slow
def test_the_command_line_knows_what_is_installed(installed, tmp_path):
    quick, rail = {**installed, "INSENV_BACKEND": "interpreter"}, PACKAGE / "rail.toml"
    listed = json.loads(call(quick, "-m", "insenv", "list", "--json"))
    wanted = (("estimators", "id", "ahrs"), ("vehicles", "kind", "trolley"), ("sensors", "id", "compass"))
    assert all(id in [row[key] for row in listed[group]] for group, key, id in wanted)
    printed = call(quick, "-m", "insenv", "run", rail, "--duration", "10", "--out", tmp_path, "--no-figure")
    assert "ahrs" in printed and (tmp_path / "rail.npz").is_file()
    assert "ahrs" not in registered()
    with pytest.raises(InputError, match=re.escape("vehicle.kind = 'trolley': must be one of 'ship', 'car', 'aircraft'")):
        insenv.load(rail)


def test_an_estimator_object_needs_no_registration():
    own = insenv.Estimator(replace(registered()["analytic"].model, id="my-analytic"), kind="alignment")
    mine, theirs = insenv.run("static-ecef", [own, "analytic"], duration_s=5.0).results
    assert mine.estimator == "my-analytic" and mine.statistics() == theirs.statistics()
    with pytest.raises(InputError, match="worker process knows installed estimators"):
        insenv.campaign("static-ecef", own, 2, duration_s=5.0, workers=1)
    assert insenv.register(own) is own and insenv.register(own) is own
    with pytest.raises(InputError, match="estimator 'my-analytic' exists already"):
        insenv.register(insenv.Estimator(replace(own.model), kind="alignment"))


@pytest.mark.slow
def test_a_campaign_of_other_equations_or_functions_under_the_same_id_is_not_resumed(tmp_path):
    loose = registered()["loosely-coupled"]
    own = replace(loose, model=replace(loose.model, id="mine"))

    def campaign(estimator, **resume):
        return insenv.campaign("car-city-drive", estimator, 2, duration_s=1.0, folder=tmp_path, **resume)

    def turned(p, x):
        shown = loose.model.output(p, x)
        return {**shown, "q_nb": shown["q_nb"][[0, 1, 2, 2]]}

    campaign(own)
    assert campaign(replace(own), resume=True).plan.runs == 2
    for changes, differs in (
        ({"model": replace(own.model, output=turned)}, "equations"),
        ({"prepare": lambda known: {**known.rows_of(loose.model.parameters), "angle_random_walk": 1e-3}}, "parameters"),
    ):
        with pytest.raises(InputError, match=f"holds another campaign: it differs in {differs}"):
            campaign(replace(own, **changes), resume=True)

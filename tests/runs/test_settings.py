"""Parameters of estimators from the command line and from Python."""

import json

import numpy as np
import pytest
from command_line import call
from simulated_log import simulated_log

from insenv import replay, run
from insenv.errors import InputError
from insenv.estimators import get
from insenv.scenario import load
from insenv.scenario.tuning import parsed_settings, setting_rows

SET = {"loosely-coupled": {"arw_deg_sqrt_h": 3.0, "fix_wander_sigma_m": [1.0, 2.0, 3.0]}}


def outputs(result):
    return np.concatenate([values.ravel() for values in result.outputs.values()])


def test_settings_are_those_of_the_scenario_file():
    scenario = load("car-city-drive")
    tables = {"loosely-coupled": {**scenario.estimator["loosely-coupled"], **SET["loosely-coupled"]}}
    written = run(scenario.model_copy(update={"estimator": tables}), duration_s=10.0).results[0]
    given, plain = (run(scenario, duration_s=10.0, settings=settings).results[0] for settings in (SET, None))
    assert np.array_equal(outputs(given), outputs(written)) and not np.array_equal(outputs(given), outputs(plain))


def test_settings_of_the_filter_are_those_of_its_smoother():
    given, plain = (run("car-city-drive", "smoother", duration_s=10.0, settings=s).results[0] for s in (SET, None))
    assert not np.array_equal(outputs(given), outputs(plain))


def test_settings_of_a_replay_replace_those_of_the_log():
    log = simulated_log(
        "car-city-drive", duration_s=20.0, grade="tactical", initial={"static_until_s": 20.0, "heading_deg": 90.0},
        estimator={"loosely-coupled": {"standing_sigma_mps": 0.5}},
    )  # fmt: skip
    wide, narrow = (
        replay(log, "loosely-coupled", settings=settings).results[0].sigma["vn_mps"][-1]
        for settings in (None, {"loosely-coupled": {"standing_sigma_mps": 0.002}})
    )
    assert narrow < wide


def test_set_at_the_command_line():
    arguments = ["run", "car-city-drive", "--duration", "5", "--json"]
    status, plain, _ = call(*arguments)
    assert status == 0
    status, text, _ = call(*arguments, "--set", "loosely-coupled.tilt_sigma_deg=5")
    assert status == 0
    last = [json.loads(each)["results"][0]["stated"]["roll_deg"] for each in (plain, text)]
    assert last[1] > 2 * last[0]
    texts = ["a.b=1.5", "a.list=[1, 2, 3]", "c.file=x/y=z.json"]
    assert parsed_settings(texts) == {"a": {"b": 1.5, "list": [1, 2, 3]}, "c": {"file": "x/y=z.json"}}


@pytest.mark.parametrize("command", [["run", "car-city-drive", "--duration", "5"], ["replay", "examples/logs/plain.toml"]])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x", "allowed is ESTIMATOR.KEY=VALUE"),
        ("loosely-coupled.arw_deg_sqrt_h=", "allowed is ESTIMATOR.KEY=VALUE"),
        ("aqe-ekf.arw_deg_sqrt_h=1", "not an estimator of this run (allowed: loosely-coupled)"),
        ("loosely-coupled.arw=1", "unknown key"),
        ("loosely-coupled.arw=1", "(allowed: arw_deg_sqrt_h, "),
        ("loosely-coupled.arw_deg_sqrt_h=-1", "allowed is a finite number from 0"),
        ("loosely-coupled.arw_deg_sqrt_h=much", "allowed is a finite number"),
        ("loosely-coupled.start_heading=1", "unknown key"),
    ],
)
def test_a_wrong_setting_is_an_error(command, text, message):
    status, _, err = call(*command, "-e", "loosely-coupled", "--set", text)
    assert status == 2 and message in err


def test_a_setting_given_twice_is_an_error():
    with pytest.raises(InputError, match="given twice"):
        parsed_settings(["a.b=1", "a.b=2"])


def test_all_wrong_settings_are_named_at_once():
    with pytest.raises(InputError) as caught:
        parsed_settings(["foo", "a.b=1", "a.b=2"])
    assert "--set 'foo'" in str(caught.value) and "a.b is given twice" in str(caught.value)
    settings = {"loosely-coupled": {"foo": 1, "innovation_gate": "x"}, "none": {}}
    with pytest.raises(InputError) as caught:
        setting_rows(settings, [get("loosely-coupled")])
    for words in ("foo: unknown key", "innovation_gate = 'x'", "'none' is not an estimator of this run"):
        assert words in str(caught.value), words


@pytest.mark.parametrize("settings", [3, {"loosely-coupled": 3}, {"ecef-kf": {}}])
def test_wrong_settings_in_python_are_errors(settings):
    with pytest.raises(InputError, match="settings"):
        run("car-city-drive", duration_s=1.0, settings=settings)

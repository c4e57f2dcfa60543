"""Parameters of estimators from files, the command line and Python."""

import numpy as np
import pytest
from interpreted import interpreted  # noqa: F401
from places import ROOT
from simulated_log import simulated_log

from insenv import replay, run
from insenv.base.errors import InputError
from insenv.base.toml import read_toml
from insenv.estimators import get
from insenv.estimators.settings import keys_by_row, parsed_changes, setting_rows, tuning
from insenv.scenario import load

SET = {"loosely-coupled": {"arw_deg_sqrt_h": 3.0, "fix_wander_sigma_m": [1.0, 2.0, 3.0]}}


def test_units_of_parameters():
    table = {"arw_deg_sqrt_h": 0.3, "vrw_mps_sqrt_h": 0.1, "correlation_time_s": 3600, "position_sigma_m": [1, 2, 3]}
    rows = tuning("loosely-coupled", table)
    assert rows["angle_random_walk"] == pytest.approx(0.3 * np.pi / 180.0 / 60)
    assert rows["velocity_random_walk"] == pytest.approx(0.1 / 60)
    assert rows["gyro_correlation_time"] == rows["accel_correlation_time"] == 3600
    np.testing.assert_array_equal(rows["position_sigma"], [1, 2, 3])
    log = read_toml(ROOT / "examples/n380-car.toml")
    for id, table in log["estimator"].items():
        get(id).model.parameters.pack(tuning(id, table))
    for bad in ({"gyro_bias_ug": 1.0}, {"start_latitude": 1.0}, {"arw_deg_sqrt_h": 10**400}, {"position_sigma_m": [1.0, 2.0]},
                {"arw_deg_sqrt_h": 1.0, "angle_random_walk_deg_sqrt_h": 1.0}):  # fmt: skip
        with pytest.raises(InputError, match=f"estimator.loosely-coupled.{list(bad)[-1]}"):
            tuning("loosely-coupled", bad)


DEG, HOUR, UG = np.pi / 180, 3600.0, 9.80665e-6
SCALES = {  # of the unit that a key ends with, in SI, by the SI unit of its row; the others are in SI
    "rad": {"deg": DEG}, "rad/s": {"deg_h": DEG / HOUR}, "rad/s^0.5": {"deg_sqrt_h": DEG / 60},
    "m/s^2": {"ug": UG, "mgal": 1e-5}, "m/s^1.5": {"ug_sqrt_hz": UG, "mps_sqrt_h": 1 / 60},
}  # fmt: skip


@pytest.mark.parametrize("id", ["ecef-kf", "loosely-coupled", "fusion"])
def test_the_refusal_of_a_setting_names_its_bounds_in_the_unit_of_its_key(id):
    rows = get(id).settable_rows
    # of a key that sets two rows the first is named
    keys = {key: rows[name] for name, found in reversed(keys_by_row(rows).items()) for key in found}
    with pytest.raises(InputError) as caught:
        tuning(id, dict.fromkeys(keys, "x"))
    said, wrong = dict(line.split(" = ", 1) for line in str(caught.value).splitlines()), {}
    for key, row in keys.items():
        (scale,) = [one for end, one in SCALES.get(row.unit, {"": 1.0}).items() if key.endswith(end)]
        bounds = f" from {row.lower / scale:g} to {row.upper / scale:g} ({row.meaning})"
        if not said[f"estimator.{id}.{key}"].endswith(bounds):
            wrong[key] = said[f"estimator.{id}.{key}"], bounds
    assert not wrong and "arw_deg_sqrt_h" in keys


def test_settings_are_those_of_the_scenario_file_and_of_a_filter_s_smoother():
    def outputs(result):
        return np.concatenate([values.ravel() for values in result.outputs.values()])

    scenario, short = load("car-city-drive"), {"duration_s": 3.0}
    tables = {"loosely-coupled": {**scenario.estimator["loosely-coupled"], **SET["loosely-coupled"]}}
    written = run(scenario.model_copy(update={"estimator": tables}), **short).results[0]
    ids = ["loosely-coupled", "smoother"]
    given, plain = ([outputs(each) for each in run(scenario, ids, **short, settings=s).results] for s in (SET, None))
    assert np.array_equal(given[0], outputs(written))
    assert not np.array_equal(given[0], plain[0]) and not np.array_equal(given[1], plain[1])


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
    texts = ["fusion.b=1.5", "estimator.fusion.list=[1, 2, 3]", "imu.file=x/y=z.json"]
    assert parsed_changes(texts, ["imu"]) == ({"fusion": {"b": 1.5, "list": [1, 2, 3]}}, {"imu.file": "x/y=z.json"})


def test_wrong_settings_in_python_are_all_named_at_once():
    with pytest.raises(InputError, match="settings"):
        run("car-city-drive", duration_s=1.0, settings={"loosely-coupled": 3})
    with pytest.raises(InputError) as caught:
        setting_rows({"loosely-coupled": {"foo": 1, "innovation_gate": "x"}, "none": {}}, [get("loosely-coupled")])
    for words in ("foo: unknown key", "innovation_gate = 'x'", "'none' is not an estimator of this run"):
        assert words in str(caught.value), words

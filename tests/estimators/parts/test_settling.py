"""The movement of an alignment's answer as a part of what it states, on a ship that surges slowly at its mooring."""

import os
from unittest import mock

import numpy as np
import pytest

import insenv
from insenv.scenario import load, parse


@pytest.fixture(scope="module")
def surging():
    """q-method and ecef-kf in a surge of 2 m and 25 s, of which nobody knows."""
    values = load("ship-slow-surge").model_dump(mode="json", warnings=False) | {"rate_hz": 20.0}
    values["vehicle"]["sway"]["north"][1] = {"amplitude_m": 2.0, "period_s": 25.0}
    values["vehicle"]["random_phases"] = True
    values["knowledge"] = {**(values.get("knowledge") or {}), "heading_sigma_deg": 180.0}
    with mock.patch.dict(os.environ, INSENV_BACKEND="interpreter"):
        return insenv.run(parse(values, "surge", "surge"), ["q-method", "ecef-kf"], seed=3, duration_s=240.0).results


def test_answers_that_swing_with_a_slow_surge_are_not_stated_as_settled(surging):
    """Of two earlier answers both agreed with one that was 148 s old, by chance: 181 stated sigmas."""
    for result in surging:
        late = result.time > 100.0
        ratio = np.abs(result.errors["heading_deg"][late]) / result.sigma["heading_deg"][late]
        assert ratio.max() < 3.0 and (np.abs(result.errors["heading_deg"][late]) > 5.0).any(), result.estimator


def test_a_filter_of_first_order_waits_for_its_coarse_alignment(surging):
    rough, fine = surging
    assert rough.sigma["heading_deg"][rough.time > 120.0].min() > 10.0
    assert np.array_equal(fine.errors["heading_deg"], rough.errors["heading_deg"])
    with mock.patch.dict(os.environ, INSENV_BACKEND="interpreter"):
        calm = load("ship-swaying").model_copy(update={"rate_hz": 20.0})
        rough, fine = insenv.run(calm, ["q-method", "ecef-kf"], seed=3, duration_s=130.0).results
    same = fine.errors["heading_deg"] == rough.errors["heading_deg"]
    assert same[rough.time < 119.9].all() and not same[rough.time > 120.2].any()


def codes(result):
    return [note.code for note in result.notes if note.code.startswith("answer-moves")]


def test_motion_that_outweighs_the_sensors_is_named(surging):
    assert [codes(result) for result in surging] == [["answer-moves"], []]
    values = load("ship-slow-surge").model_dump(mode="json", warnings=False)
    values["vehicle"]["sway"]["north"][1] = {"amplitude_m": 2.0, "period_s": 120.0}
    (result,) = insenv.run(parse(values, "surge", "surge"), "qakf", seed=5).results
    assert codes(result) == ["answer-moves-much"] and result.outputs["motion_ratio"][-1] > 2.0
    for result in insenv.run("ship-swaying", ["q-method", "qakf", "qakf-improved"], seed=5).results:
        assert codes(result) == [] and result.outputs["motion_ratio"][-1] < 1.5, result.estimator

"""The public face: names, paths and objects alike; short reprs; wrong arguments answered in one sentence."""

import re
from dataclasses import replace

import pytest
from places import ROOT

import insenv
from insenv.base.errors import InputError

SHIP = "ship-swaying"
ANALYTIC = insenv.Estimator(replace(insenv.estimators.get("analytic").model), kind="alignment")
VALUES = {
    "title": "Anchored", "duration_s": 1, "start": {"latitude_deg": 10, "longitude_deg": 20}, "vehicle": {"kind": "ship"},
    "imu": {"grade": "navigation"},
}  # fmt: skip


def test_a_scenario_is_a_name_a_path_an_object_or_values():
    path = ROOT / "scenarios" / f"{SHIP}.toml"
    runs = [insenv.run(scenario, "q-method", duration_s=1.0) for scenario in (SHIP, path, str(path), insenv.load(SHIP))]
    assert len({str(run.results[0].statistics()) for run in runs}) == 1
    (once,) = insenv.run(VALUES, ["analytic", "analytic"]).results
    assert once.estimator == "analytic"


@pytest.mark.parametrize(("wrong", "message"), [
    (lambda: insenv.run(3), "scenario = 3"),
    (lambda: insenv.run(SHIP, []), "no estimator"),
    (lambda: insenv.run(SHIP, [ANALYTIC, "analytic"]), "two estimators have the id 'analytic'"),
    (lambda: insenv.run(SHIP, "q-method", seed="3"), "seed = '3'"),
    (lambda: insenv.replay(None, "q-method"), "log = None"),
    (lambda: insenv.campaign(SHIP, "q-method", "8"), "runs = '8'"),
    (lambda: insenv.export_fmu("q-method", "x.fmu", platforms=[3]), "platforms = [3]"),
])  # fmt: skip
def test_wrong_arguments(wrong, message):
    with pytest.raises(InputError, match=re.escape(message)):
        wrong()


def test_an_attitude_of_no_length_is_no_estimate():
    analytic = insenv.estimators.get("analytic").model
    zero = replace(analytic, id="zero", output=lambda p, x: {**analytic.output(p, x), "q_nb": 0 * x.angle[[0, 0, 0, 0]]})
    with pytest.raises(insenv.InsenvError, match="estimator 'zero' diverged: its output q_nb has length 0"):
        insenv.run(SHIP, insenv.Estimator(zero, kind="alignment"), duration_s=1.0)

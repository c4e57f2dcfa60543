"""The public face: names, paths and objects alike; short reprs; wrong arguments answered in one sentence."""

import re
import subprocess
import sys
from dataclasses import replace

import pytest
from command_line import call
from places import ROOT

import insenv
from insenv.errors import InputError
from insenv.scenario import Scenario
from insenv.sensors import ImuSection

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


@pytest.mark.slow
def test_a_report_is_saved_with_its_figure(tmp_path):
    written = insenv.run(SHIP, "analytic", duration_s=1.0).save(tmp_path).paths
    assert {path.suffix for path in written} == {".npz", ".json", ".html", ".png", ".svg"}


def test_every_public_name_is_found_by_help_and_type_checkers():
    assert set(insenv.__all__) <= set(dir(insenv))
    assert all(getattr(insenv, name).__doc__ for name in insenv.__all__)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: insenv.run(3), "scenario = 3"),
        (lambda: insenv.run({"titel": "x"}), "titel: unknown key; did you mean 'title'?"),
        (lambda: insenv.run(SHIP, [5]), "estimator = 5"),
        (lambda: insenv.run(SHIP, []), "no estimator"),
        (lambda: insenv.run(VALUES), "names no estimator"),
        (lambda: insenv.run(SHIP, "q-metod"), "did you mean 'q-method'"),
        (lambda: insenv.run(SHIP, "loosely-coupled"), "needs GNSS"),
        (lambda: insenv.run("car-city-drive", "q-method"), "in place"),
        (lambda: insenv.run(SHIP, [ANALYTIC, "analytic"]), "two estimators have the id 'analytic'"),
        (lambda: insenv.run(SHIP, "q-method", seed="3"), "seed = '3'"),
        (lambda: insenv.run(SHIP, "q-method", duration_s="60"), "duration_s = '60'"),
        (lambda: insenv.run(SHIP, "q-method", progress=lambda x: 0), "a function of (done, total)"),
        (lambda: insenv.run(SHIP, "q-method", duration_s=1.0).save(None), "folder = None"),
        (lambda: Scenario(VALUES), "allowed are keys with their values"),
        (lambda: insenv.load(VALUES).model_copy(update={"durations": 1}), "durations: unknown key; did you mean 'duration_s'?"),
        (lambda: ImuSection(grade=3), "ImuSection: grade = 3"),
        (lambda: insenv.replay(None, "q-method"), "log = None"),
        (lambda: insenv.replay("none.toml", "q-method"), "none.toml: file not found"),
        (lambda: insenv.replay("none.toml", "q-method", progress=3), "progress = 3"),
        (lambda: insenv.campaign(SHIP, "q-method", "8"), "runs = '8'"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, vary={"duration_s": 3}), "vary['duration_s'] = 3"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, folder=3), "folder = 3"),
        (lambda: insenv.export_fmu("q-method", None), "output = None"),
        (lambda: insenv.export_fmu("q-method", "x.fmu", platforms=[3]), "platforms = [3]"),
        (lambda: insenv.export_ssp(SHIP, "q-method", 3), "output = 3"),
    ],
)
def test_wrong_arguments(wrong, message):
    with pytest.raises(InputError, match=re.escape(message)):
        wrong()


def test_an_attitude_of_no_length_is_no_estimate():
    analytic = insenv.estimators.get("analytic").model
    zero = replace(analytic, id="zero", output=lambda p, x: {**analytic.output(p, x), "q_nb": 0 * x.angle[[0, 0, 0, 0]]})
    with pytest.raises(insenv.InsenvError, match="estimator 'zero' diverged: its output q_nb has length 0"):
        insenv.run(SHIP, insenv.Estimator(zero, kind="alignment"), duration_s=1.0)


@pytest.mark.slow
def test_a_misspelt_argument_is_caught_by_a_type_checker(tmp_path):
    script = tmp_path / "script.py"
    script.write_text('import insenv\n\ninsenv.run("ship-swaying", "q-method", sed=3)\n', "utf-8")
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", script], capture_output=True, text=True, cwd=ROOT)
    assert 'Unexpected keyword argument "sed" for "run"' in done.stdout


def test_the_command_line_names_wrong_values_in_the_same_words():
    status, _, err = call("run", SHIP, "--duration", "x")
    assert status == 2 and "'--duration': allowed is a number" in err

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
VALUES = {
    "title": "Anchored",
    "duration_s": 5,
    "start": {"latitude_deg": 10, "longitude_deg": 20},
    "vehicle": {"kind": "ship"},
    "imu": {"grade": "navigation"},
}


def test_a_scenario_is_a_name_a_path_an_object_or_values():
    path = ROOT / "scenarios" / f"{SHIP}.toml"
    runs = [insenv.run(scenario, "q-method", duration_s=2.0) for scenario in (SHIP, path, str(path), insenv.load(SHIP))]
    assert len({str(run.results[0].statistics()) for run in runs}) == 1
    assert insenv.run(VALUES, "analytic").duration_s == 5.0


def test_reports_are_short(tmp_path):
    report = insenv.run(SHIP, ["q-method", "analytic"], duration_s=2.0)
    assert len(repr(report)) < 400 and "q-method" in repr(report)
    assert "<table" in report._repr_html_()
    assert {path.suffix for path in report.save(tmp_path).paths} == {".npz", ".json", ".html", ".png", ".svg"}
    summary = insenv.campaign(SHIP, "q-method", 3, duration_s=2.0)
    assert len(repr(summary)) < 400 and len(repr(report.results[0])) < 400


def test_every_public_name_is_found_by_help_and_type_checkers():
    assert set(insenv.__all__) <= set(dir(insenv))
    assert all(getattr(insenv, name).__doc__ for name in insenv.__all__)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: insenv.run("ship-swayin"), "no scenario 'ship-swayin'; did you mean 'ship-swaying'?"),
        (lambda: insenv.run(3), "scenario = 3: allowed is a name, the path of a .toml file, a Scenario or its values"),
        (lambda: insenv.run({"titel": "x"}), "titel: unknown key; did you mean 'title'?"),
        (lambda: insenv.run(SHIP, 5), "estimators = 5: allowed is an id, an insenv.Estimator, or several of them"),
        (lambda: insenv.run(SHIP, [5]), "estimator = 5: allowed is an id or an insenv.Estimator"),
        (lambda: insenv.run(SHIP, []), "no estimator: name one or several"),
        (lambda: insenv.run(VALUES), "names no estimator: name one with -e ID (in Python: estimators="),
        (lambda: insenv.run(SHIP, "q-metod"), "no estimator 'q-metod'; did you mean 'q-method'?"),
        (lambda: insenv.run(SHIP, "q-method", seed="3"), "seed = '3': allowed is a whole number from 0 to 2^53"),
        (lambda: insenv.run(SHIP, "q-method", duration_s="60"), "duration_s = '60': allowed is a number of seconds"),
        (lambda: insenv.run(SHIP, "q-method", progress=3), "progress = 3: allowed is None or a function of (done, total)"),
        (lambda: insenv.run(SHIP, "q-method", progress=lambda x: 0), "allowed is None or a function of (done, total)"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, duration_s=1.0, progress="bar"), "progress = 'bar': allowed is None"),
        (lambda: insenv.replay("none.toml", "q-method", progress=3), "progress = 3: allowed is None or a function"),
        (lambda: Scenario(title="x", duration_s=-3), "Scenario: duration_s = -3 [s]: must be greater than 0"),
        (lambda: Scenario(VALUES), "allowed are keys with their values"),
        (
            lambda: ImuSection(grade=3),
            "ImuSection: grade = 3: must be the name of a grade, the path of a grade file, or a table",
        ),
        (lambda: insenv.replay(None, "q-method"), "log = None: allowed is a path"),
        (lambda: insenv.replay("none.toml", "q-method"), "none.toml: file not found"),
        (lambda: insenv.campaign(SHIP, "q-method", "8"), "runs = '8': allowed is a whole number from 1 to"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, vary={"duration_s": 3}), "vary['duration_s'] = 3: allowed is a pair"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, workers="2"), "workers = '2': allowed is a whole number of processes"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, folder=3), "folder = 3: allowed is a path"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, vary=["a"]), "vary = ['a']: allowed is a dict of ranges by key"),
        (lambda: insenv.campaign(SHIP, "q-method", 1, duration_s="1"), "duration_s = '1': allowed is a number of seconds"),
        (lambda: insenv.export_fmu("q-metod", "x.fmu"), "no estimator or scenario 'q-metod'; did you mean 'q-method'?"),
        (lambda: insenv.export_fmu("q-method", None), "output = None: allowed is a path"),
        (lambda: insenv.export_fmu("q-method", "x.fmu", fmi=2.0), "fmi = 2.0: allowed is 2 or 3"),
        (lambda: insenv.export_fmu("q-method", "x.fmu", platforms=[3]), "platforms = [3]: allowed are names of host"),
        (lambda: insenv.export_fmu("q-method", "x.fmu", settings=["latitude"]), "settings = ['latitude']: allowed is a dict"),
        (lambda: insenv.export_ssp(SHIP, "q-method", 3), "output = 3: allowed is a path"),
        (lambda: insenv.load(VALUES).model_copy(update={"durations": 1}), "durations: unknown key; did you mean 'duration_s'?"),
        (lambda: insenv.run(SHIP, "q-method", duration_s=1.0).save(None), "folder = None: allowed is a path"),
        (lambda: insenv.run(SHIP, "q-method", duration_s=1.0).to_dataframe(7), "estimator 7: not in this run"),
    ],
)
def test_wrong_arguments(wrong, message):
    with pytest.raises(InputError, match=re.escape(message)):
        wrong()


def test_two_estimators_of_one_id_are_refused():
    analytic = insenv.estimators.get("analytic")
    other = insenv.Estimator(replace(analytic.model), kind="alignment")
    with pytest.raises(InputError, match="two estimators have the id 'analytic'"):
        insenv.run(SHIP, [other, "analytic"], duration_s=1.0)
    assert len(insenv.run(SHIP, ["analytic", "analytic"], duration_s=1.0).results) == 1


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", SHIP, "--duration", "x"), "'--duration': allowed is a number"),
        (
            ("replay", "a.toml", "-e", "q-method", "--start", "fine"),
            "'--start': 'fine': allowed is one of 'coarse', 'reference'",
        ),
    ],
)
def test_the_command_line_names_wrong_values_in_the_same_words(arguments, message):
    status, _, err = call(*arguments)
    assert status == 2 and message in err

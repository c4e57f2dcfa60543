"""A package outside insenv adds an estimator, a vehicle and a sensor, and is taken through every interface."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest
from places import ROOT

import insenv
from insenv.errors import InputError
from insenv.estimators import registered

PACKAGE = ROOT / "tests" / "outside" / "rail"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Environment of a process that has the outside package installed."""
    target = tmp_path_factory.mktemp("target")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    done = subprocess.run([*pip, "--target", target, PACKAGE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    paths = [str(target), str(ROOT), str(ROOT / "tests" / "helpers")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def call(installed, *command):
    done = subprocess.run([sys.executable, *map(str, command)], capture_output=True, text=True, env=installed, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_interface_takes_it(installed, tmp_path):
    found = json.loads(call(installed, ROOT / "tests" / "outside" / "take_through.py", tmp_path))
    # levelling errors are those of the trolley's own acceleration, 0.27 m/s^2 low-passed at 20 s: up to 0.17 deg
    assert found["run"]["pitch_deg"] < 0.3 and found["run"]["roll_deg"] < 0.3
    assert found["run"]["heading_deg"] < 2.5  # 5 deg at the start, corrected by the compass with a time constant of 10 s
    assert found["replay"] < 2.0
    assert 0.3 < found["campaign"] < 2.5
    assert found["workers_agree"] and found["batch_of_9_agrees"] and found["fmpy_agrees"]
    assert found["window"] == [50, 9]  # the compass stands beside the inertial sample
    assert found["plant_fmu"] > 10_000


@pytest.mark.slow
def test_every_interface_takes_an_aid(installed, tmp_path):
    """A compass with a constant error of 3 deg beside GNSS, in 31 lines of the outside package."""
    found = json.loads(call(installed, ROOT / "tests" / "outside" / "take_aid_through.py", tmp_path))
    assert found["sigma_deg"] < 0.9 * found["blind_sigma_deg"]
    assert all(abs(error) < 3 * found["sigma_deg"] for error in found["heading_deg"])
    assert abs(found["error_deg"] - 3.0) < 1.5
    assert found["health"]["verdict"] == "consistent" and found["health"]["measurements"] > 500
    assert any(note.startswith("the estimate of compass_error") for note in found["notes"])
    assert found["campaign"] > 0
    assert found["interpreter_agrees"] and found["batch_agrees"] and found["fmu_agrees"]


def test_the_command_line_knows_it(installed, tmp_path):
    listed = json.loads(call(installed, "-m", "insenv", "list", "--json"))
    assert "ahrs" in [row["id"] for row in listed["estimators"]]
    assert {"kind": "trolley", "title": "A trolley on a straight, level rail"} in listed["vehicles"]
    assert {"id": "compass", "title": "A compass"} in listed["sensors"]
    printed = call(installed, "-m", "insenv", "run", PACKAGE / "rail.toml", "--duration", "10", "--out", tmp_path / "out")
    assert "ahrs" in printed
    assert (tmp_path / "out" / "rail.npz").is_file()
    log = tmp_path / "rail.tlog"
    command = ["stream", PACKAGE / "rail.toml", "--to", "udpout:127.0.0.1:14599", "--speed", "0", "--duration", "5"]
    call(installed, "-m", "insenv", *command, "--tlog", log)
    assert log.stat().st_size > 10_000


def test_wrong_keys_of_an_outside_vehicle_and_sensor_are_named(installed, tmp_path):
    text = (PACKAGE / "rail.toml").read_text("utf-8")
    for old, new, message in (
        ("amplitude_m = 1", "amplitude_m = -1", "vehicle.amplitude_m = -1 [m]: must be greater than or equal to 0"),
        ("noise_deg", "nois_deg", "compass.nois_deg: unknown key; did you mean 'noise_deg'?"),
        ("[compass]", "[compas]", "compas: unknown key; did you mean 'compass'?"),
    ):
        path = tmp_path / "wrong.toml"
        path.write_text(text.replace(old, new), "utf-8")
        done = subprocess.run(
            [sys.executable, "-m", "insenv", "run", path], capture_output=True, text=True, env=installed, timeout=100
        )
        assert done.returncode == 2 and message in done.stderr, done.stderr


def test_without_the_package_its_names_are_unknown():
    assert "ahrs" not in registered()
    with pytest.raises(InputError, match=re.escape("vehicle.kind = 'trolley': must be one of 'ship', 'car', 'aircraft'")):
        insenv.load(PACKAGE / "rail.toml")


def test_an_estimator_object_needs_no_registration():
    own = insenv.Estimator(replace(registered()["analytic"].model, id="my-analytic"), kind="alignment")
    mine, theirs = insenv.run("static-ecef", [own, "analytic"], duration_s=5.0).results
    assert mine.estimator == "my-analytic" and mine.statistics() == theirs.statistics()
    assert insenv.campaign("static-ecef", own, 2, duration_s=5.0).figures()["heading_deg"]["rms"] > 0
    with pytest.raises(InputError, match="worker process knows installed estimators"):
        insenv.campaign("static-ecef", own, 2, duration_s=5.0, workers=1)
    with pytest.raises(InputError, match="no estimator 'my-analytic'"):
        insenv.run("static-ecef", "my-analytic")


def test_what_is_registered_is_known_by_its_name(monkeypatch):
    from insenv.estimators import registry

    monkeypatch.setattr(registry._PLUGINS, "_added", dict(registry._PLUGINS._added))
    own = insenv.Estimator(replace(registered()["analytic"].model, id="my-analytic"), kind="alignment")
    assert insenv.register(own) is own and insenv.register(own) is own
    assert insenv.run("static-ecef", "my-analytic", duration_s=2.0).results[0].estimator == "my-analytic"
    other = insenv.Estimator(replace(own.model), kind="alignment")
    with pytest.raises(InputError, match="estimator 'my-analytic' exists already: choose another name"):
        insenv.register(other)


@pytest.mark.parametrize(
    ("thing", "message"),
    [
        (3, "allowed is an Estimator, a subclass of VehicleSection or a subclass of SensorSection"),
        (insenv.VehicleSection, "a kind of vehicle is a subclass of VehicleSection with kind: Literal"),
        (insenv.SensorSection, "a sensor is registered by a subclass of SensorSection whose `sensor` is a Sensor"),
    ],
)
def test_register_refuses_what_is_none_of_them(thing, message):
    with pytest.raises(InputError, match=message):
        insenv.register(thing)


def test_an_estimator_says_what_it_lacks():
    model = registered()["analytic"].model
    with pytest.raises(InputError, match="'analytic': an estimator of kind 'navigation' has the output 'velocity_n'"):
        insenv.Estimator(model, kind="navigation")
    with pytest.raises(InputError, match="kind = 'filter': allowed is 'alignment' or 'navigation'"):
        insenv.Estimator(model, kind="filter")


def test_a_campaign_of_other_equations_under_the_same_id_is_not_resumed(tmp_path):
    analytic = registered()["analytic"].model
    own = insenv.Estimator(replace(analytic, id="mine"), kind="alignment")
    insenv.campaign("static-ecef", own, 2, duration_s=2.0, folder=tmp_path)
    assert insenv.campaign("static-ecef", own, 2, duration_s=2.0, folder=tmp_path, resume=True).plan.runs == 2
    turned = replace(
        own.model, output=lambda p, x: {**analytic.output(p, x), "q_nb": analytic.output(p, x)["q_nb"][[0, 1, 2, 2]]}
    )
    with pytest.raises(InputError, match="holds another campaign: it differs in equations"):
        insenv.campaign(
            "static-ecef", insenv.Estimator(turned, kind="alignment"), 2, duration_s=2.0, folder=tmp_path, resume=True
        )


def test_a_campaign_of_other_functions_under_the_same_id_is_not_resumed(tmp_path):
    """What `prepare` makes of the knowledge and what `error` compares count as much as the equations."""
    loose = registered()["loosely-coupled"]
    own = replace(loose, model=replace(loose.model, id="mine"))

    def resume(estimator):
        return insenv.campaign("car-city-drive", estimator, 2, duration_s=2.0, folder=tmp_path, resume=True)

    insenv.campaign("car-city-drive", own, 2, duration_s=2.0, folder=tmp_path)
    assert resume(replace(own)).plan.runs == 2
    wider = replace(own, prepare=lambda known: {**known.rows_of(loose.model.parameters), "angle_random_walk": 1e-3})
    with pytest.raises(InputError, match="holds another campaign: it differs in parameters"):
        resume(wider)
    twice = replace(own, error=lambda x, found, true: tuple(2.0 * part for part in loose.error(x, found, true)))
    with pytest.raises(InputError, match="holds another campaign: it differs in equations"):
        resume(twice)

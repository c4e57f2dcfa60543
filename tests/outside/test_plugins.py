"""What an author of an estimator, a vehicle or a sensor is told about a mistake, and what a broken package spoils."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from typing import Literal

import casadi as ca
import pytest
from command_line import strict
from places import ROOT

import insenv
from insenv import Estimator, InputError, InsenvError, Row, Sensor, SensorSection, Step, Table
from insenv.base.plugins import Plugins
from insenv.base.shipped import ESTIMATORS
from insenv.core.compose import Part
from insenv.estimators import registry as estimators
from insenv.scenario import Scenario, build
from insenv.scenario.plant import plant_model
from insenv.sensors import registry as sensors
from insenv.sensors.registry import instruments, section_of
from insenv.vehicles import registry as vehicles

Q_NB = Row("q_nb", "Attitude", "1", (4,), "n", (1, 0, 0, 0))
START = {"title": "t", "duration_s": 1, "start": {"latitude_deg": 50, "longitude_deg": 8}}


def said(message):
    return pytest.raises(InputError, match=re.escape(message))


def of_step(rail, function):
    return of_model(rail, {"id": "my-level", "steps": {"sample": Step(function)}})


def of_model(rail, changes):
    return Estimator(replace(rail["ahrs"].ESTIMATOR.model, **changes), kind="alignment").model.kernels


def of_estimator(rail, changes):
    return insenv.run("ship-swaying", replace(rail["ahrs"].ESTIMATOR, **changes), duration_s=1.0)


def of_law(rail, changes):
    return plant_model(replace(rail["trolley"].trolley(), **changes), ()).kernels


def of_section(rail, methods):
    insenv.register(section(rail, **methods))
    return build(insenv.load({**START, "vehicle": {"kind": "trolley"}}))


def section(rail, **methods):
    return type("Mine", (rail["trolley"].TrolleySection,), {"__module__": __name__, **methods})


@pytest.mark.parametrize(("made", "changes", "message"), [
    (of_step, lambda p, x, u: {"q_nb": x.q_nb + u.delta_velo[0]}, "no row named 'delta_velo'; did you mean"),
    (of_step, lambda p, x, u: {"q_nb": x.q_nb[:3]}, "row 'q_nb' has the shape 3 x 1"),
    (of_step, lambda p, x, u: None, "the result is of type NoneType"),
    (of_step, lambda p, x, u: {"q_nb": x.q_nb if u.dt > 0 else -x.q_nb}, "a CasADi symbol has no truth value"),
    (of_step, lambda p, x, u: {"q_nb": x.q_nb + ca.SX.zeros(3)}, "RuntimeError: Dimension mismatch"),
    (of_model, {"output": lambda p, x: {}}, "output: row 'q_nb' is missing"),
    (of_model, {"steps": {"sample": lambda p, x, u: {}}}, "step 'sample': function: allowed is a Step"),
    (of_estimator, {"motion": "foo"}, "estimator 'ahrs': motion = 'foo'"),
    (of_model, {"outputs": Table((Q_NB, Row("attitude_sigma", "Mine", "rad", (2,))))},
     "estimator 'ahrs': output 'attitude_sigma' has the shape (2,): allowed is (3,)"),
    (of_step, lambda p, x, u: {"q_nb": ca.sin(u.dt) * x.q_nb}, "casadi's sin is not exactly rounded: its bits differ"),
    (of_estimator, {"kind": "navigation"}, "'ahrs': an estimator of kind 'navigation' has the output 'velocity_n'"),
    (of_estimator, {"prepare": lambda known: {"lattitude": 1}}, "prepare: no row named 'lattitude'; did you mean"),
    (of_estimator, {"prepare": lambda known: 1 / 0}, "estimator 'ahrs', prepare: ZeroDivisionError"),
    (of_law, {"along": lambda p, x: [{"rail_phase": 0}]}, "along: 1 results: allowed are 3"),
    (of_law, {"angles": lambda p, x: [p.mean_rol, p.mean_pitch, 0]}, "no row named 'mean_rol'; did you mean"),
    (of_law, {"state": Table((Row("q_nb", "Mine"),))}, "q_nb"),
    (of_section, {"vehicle": lambda self: self.law}, "vehicle kind 'trolley', vehicle: AttributeError: 'Mine'"),
    (of_section, {"rows": lambda self, start: {"rail_amplitude": 1}}, "rows: 'rail_angular_frequency' is missing"),
])  # fmt: skip
def test_a_fault_names_its_model_estimator_or_vehicle(rail, made, changes, message):
    with said(message) as caught:
        made(rail, changes)
    named = {of_step: "model 'my-level', step 'sample': ", of_model: "'ahrs'", of_law: "trolley"}.get(made, "")
    assert named in str(caught.value) and "\n" not in str(caught.value)


def test_names_are_plain_and_not_taken(rail):
    def of_sensor(id):
        sensor = Sensor(id, lambda instant: Part(), ())
        return type("Mine", (SensorSection,), {"__module__": __name__, "sensor": sensor, "rows": lambda self, rate_hz: {}})

    model = rail["ahrs"].ESTIMATOR.model
    for id in ("My Est/..!", "ship-swaying"):
        with pytest.raises(InputError, match=rf"estimator.*{id!r}"):
            insenv.register(Estimator(replace(model, id=id), kind="alignment"))
    own = section(rail)
    own.model_fields["kind"].annotation = Literal["a b"]
    for what, thing in (("kind", own), ("sensor id", of_sensor("a b"))):
        with said(f"Mine: {what} = 'a b'"):
            insenv.register(thing)
    for id in ("start", "name", "model_copy"):
        with said(f"sensor {id!r}: a key or attribute of a scenario has this name"):
            insenv.register(of_sensor(id))
    assert {name for name in dir(Scenario) if not name.startswith("_")} | set(Scenario.model_fields) <= sensors.TAKEN


def test_a_scenario_names_an_estimator_that_only_its_call_passes(rail):
    insenv.register(rail["trolley"].TrolleySection)
    insenv.register(rail["compass"].COMPASS)
    file = ROOT / "examples" / "insenv-rail" / "rail.toml"
    assert insenv.run(file, [rail["ahrs"].ESTIMATOR], duration_s=1.0).results[0].estimator == "ahrs"
    with said("estimators[0]: no estimator 'ahrs'"):
        insenv.run(file, duration_s=1.0)


def test_a_fault_of_a_sensor_names_it(rail):
    compass = section_of(rail["compass"].COMPASS).sensor
    for wrong, message in (
        ([replace(compass, outputs=("compas_new",))], "sensor 'compass': no row named 'compas_new'; did you mean"),
        ([compass, replace(compass, id="other")], "two rows are named 'compass_"),
    ):
        with said(message):
            plant_model(rail["trolley"].trolley(), tuple(wrong))
    misspelt = replace(rail["compass"].COMPASS, measure=lambda motion, e, p: {"compass_headin": e.noise})
    with said("sensor 'compass', measure: no row named 'compass_headin'; did you mean 'compass_heading'"):
        plant_model(rail["trolley"].trolley(), (section_of(misspelt).sensor,)).kernels  # noqa: B018


@pytest.fixture
def declare(tmp_path, monkeypatch):
    """A function that installs a package with the given entry points."""

    def written(text):
        info = tmp_path / "mine-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        return tmp_path

    return written


@pytest.mark.parametrize(("name", "entry", "warned", "refused"), [
    ("other", "insenv.estimators.gyrocompass:ESTIMATOR", "it holds the estimator 'gyrocompass'", "the same name"),
    ("broken", "no_such_module:X", "No module named 'no_such_module'", "package 'mine'.*mend or uninstall the package"),
])  # fmt: skip
def test_a_broken_package_is_an_error_only_if_it_is_asked_for(declare, name, entry, warned, refused):
    declare(f"[insenv.test]\n{name} = {entry}\nanalytic = insenv.estimators.analytic:ESTIMATOR")
    found = Plugins("estimator", "insenv.test", estimators._id, {"q-method": ESTIMATORS["q-method"]})
    with pytest.warns(RuntimeWarning, match=f"package 'mine': its entry point '{name}' .*{warned}"):
        assert list(found.all()) == ["q-method", "analytic"]
    with pytest.raises(InsenvError, match=refused):
        found.get(name)


def test_a_broken_sensor_or_vehicle_stops_only_the_scenarios_that_name_it(monkeypatch):
    values = {**START, "vehicle": {"kind": "car"}}
    for registry, wanted in ((sensors, {"sonar": {}}), (vehicles, {"vehicle": {"kind": "sonar"}})):
        monkeypatch.setattr(registry._PLUGINS, "_broken", {"sonar": "package 'mine': cannot be loaded"})
        insenv.load(values)
        with pytest.raises(InsenvError, match="'sonar': package 'mine': cannot be loaded"):
            insenv.load({**values, **wanted})


def test_an_installed_package_with_faults_leaves_the_command_line_alone(declare):
    folder = declare("[insenv.sensors]\nknowledge = own_sensor:KNOWLEDGE\n[insenv.estimators]\nx = gone:X\n")
    (folder / "own_sensor.py").write_text(
        "from insenv import Sensor, SensorSection\nfrom insenv.core.compose import Part\n"
        "class KNOWLEDGE(SensorSection):\n    sensor = Sensor('knowledge', lambda instant: Part(), ())\n"
        "    def rows(self, rate): return {}\n"
    )
    command = [sys.executable, "-m", "insenv", "list", "--json"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(folder), str(ROOT)))}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=100)
    assert done.returncode == 0, done.stderr
    assert "internal error" not in done.stderr and done.stderr.count("insenv: warning: package 'mine'") == 2
    assert [row["id"] for row in strict(done.stdout)["sensors"]] == ["gnss", *instruments()]

"""What an author of an estimator, a vehicle or a sensor is told about a mistake, and what a broken package spoils."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from typing import Literal

import casadi as ca
import numpy as np
import pytest
from command_line import strict
from places import ROOT

import insenv
from insenv import Estimator, InputError, InsenvError, Row, Sensor, SensorSection, Step, Table, VehicleSection
from insenv.core.compose import Part
from insenv.estimators import registry as estimators
from insenv.instruments import INSTRUMENTS
from insenv.plant import plant_model
from insenv.plugins import Plugins
from insenv.scenario import Scenario, build
from insenv.sensors import registry as sensors
from insenv.shipped import ESTIMATORS
from insenv.vehicles import registry as vehicles

START = {"title": "t", "duration_s": 1, "start": {"latitude_deg": 50, "longitude_deg": 8}}


def said(message):
    return pytest.raises(InputError, match=re.escape(message))


# --- models, estimators, vehicles --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda p, x, u: {"q_nb": x.q_nb + u.delta_velo[0]}, "no row named 'delta_velo'; did you mean 'delta_velocity'?"),
        (lambda p, x, u: {"qnb": x.q_nb}, "no row named 'qnb'; did you mean 'q_nb'?"),
        (lambda p, x, u: {"q_nb": x.q_nb[:3]}, "row 'q_nb' has the shape 3 x 1: allowed is (4,)"),
        (lambda p, x, u: {"q_nb": "x"}, "row 'q_nb' is of type str: allowed is a CasADi expression or a number"),
        (lambda p, x, u: None, "the result is of type NoneType: allowed is a dict of values by row name"),
        (lambda p, x, u: {"q_nb": x.q_nb if u.dt > 0 else -x.q_nb}, "a CasADi symbol has no truth value"),
        (lambda p, x, u: {"q_nb": np.eye(4).foo}, "AttributeError: 'numpy.ndarray' object has no attribute 'foo'"),
        (lambda p, x, u: {"q_nb": x.q_nb + ca.SX.zeros(3)}, "RuntimeError: Dimension mismatch"),
        (lambda p, x, u: {"q_nb": x.q_nb * float("inf")}, "row 'q_nb' contains a constant that is not finite"),
        (lambda p, x, u: {"q_nb": x.q_nb / 0}, "row 'q_nb' contains a constant that is not finite"),
    ],
)
def test_a_fault_of_a_step_names_estimator_and_step(rail, function, message):
    model = replace(rail["ahrs"].ESTIMATOR.model, id="my-level", steps={"sample": Step(function)})
    with said("model 'my-level', step 'sample': ") as caught:
        insenv.run("ship-swaying", Estimator(model, kind="alignment"), duration_s=1.0)
    assert message in str(caught.value) and "\n" not in str(caught.value)


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


@pytest.mark.parametrize(
    ("made", "changes", "message"),
    [
        (of_model, {"output": lambda p, x: {}}, "model 'ahrs', output: row 'q_nb' is missing"),
        (of_model, {"output": lambda p, x: None}, "model 'ahrs', output: the result is of type NoneType"),
        (of_model, {"output": None}, "model 'ahrs': output and start must be functions"),
        (of_model, {"start": {}}, "model 'ahrs': output and start must be functions"),
        (of_model, {"start": lambda p: None}, "model 'ahrs', start: the result is of type NoneType"),
        (of_model, {"start": lambda p: {"q": 1}}, "model 'ahrs', start: no row named 'q'"),
        (of_model, {"steps": {"sample": lambda p, x, u: {}}}, "model 'ahrs', step 'sample': function: allowed is a Step"),
        (of_model, {"steps": [Step(lambda p, x, u: {})]}, "model 'ahrs': steps is of type list"),
        (of_model, {"state": ()}, "model 'ahrs': state is of type tuple: allowed is a Table"),
        (of_model, {"id": ""}, "estimator id = '': allowed are letters, digits"),
        (of_model, {"id": "My Est/..!"}, "estimator id = 'My Est/..!': allowed are letters, digits"),
        (of_estimator, {"motion": "foo"}, "estimator 'ahrs': motion = 'foo': allowed is 'in place', 'moving' or 'any'"),
        (of_estimator, {"sensors": "gnss"}, "estimator 'ahrs': sensors = 'gnss': allowed is a tuple of sensor ids"),
        (of_estimator, {"sensors": 3}, "estimator 'ahrs': sensors = 3: allowed is a tuple"),
        (of_estimator, {"model": "x"}, "Estimator: model = 'x': allowed is an insenv.Model"),
        (of_estimator, {"kind": "filter"}, "kind = 'filter': allowed is 'alignment' or 'navigation'"),
        (of_estimator, {"kind": "navigation"}, "'ahrs': an estimator of kind 'navigation' has the output 'velocity_n'"),
        (of_estimator, {"prepare": lambda known: [1]}, "estimator 'ahrs', prepare: the result is of type list"),
        (
            of_estimator,
            {"prepare": lambda known: {"lattitude": 1}},
            "prepare: no row named 'lattitude'; did you mean 'latitude'?",
        ),
        (of_estimator, {"prepare": lambda known: 1 / 0}, "estimator 'ahrs', prepare: ZeroDivisionError: division by zero"),
        (of_law, {"along": lambda p, x: [{"rail_phase": 0}]}, "along: 1 results: allowed are 3, one for each node of PLACES"),
        (of_law, {"along": lambda p, x: None}, "TypeError: 'NoneType' object is not iterable"),
        (of_law, {"start": lambda p: {"rail_fase": 0}}, "no row named 'rail_fase'; did you mean 'rail_phase'?"),
        (of_law, {"start": lambda p: None}, "the result is of type NoneType"),
        (of_law, {"angles": lambda p, x: [p.mean_rol, p.mean_pitch, 0]}, "no row named 'mean_rol'; did you mean 'mean_roll'?"),
        (of_law, {"derivative": lambda p, x: {"fase": 1}}, "no row named 'fase'"),
        (of_law, {"state": Table((Row("q_nb", "Mine"),))}, "q_nb"),
        (of_section, {"vehicle": lambda self: None}, "vehicle = None: allowed is an insenv.Vehicle"),
        (of_section, {"rows": lambda self, start: None}, "vehicle kind 'trolley', rows: the result is of type NoneType"),
        (of_section, {"rows": lambda self, start: self.period}, "vehicle kind 'trolley', rows: AttributeError: 'Mine'"),
        (of_section, {"vehicle": lambda self: self.law}, "vehicle kind 'trolley', vehicle: AttributeError: 'Mine'"),
        (of_section, {"rows": lambda self, start: {"rail_amp": 1}}, "vehicle kind 'trolley', rows: no row named 'rail_amp'"),
        (of_section, {"rows": lambda self, start: {"rail_amplitude": 1}}, "rows: 'rail_angular_frequency' is missing"),
    ],
)
def test_a_fault_names_its_model_estimator_or_vehicle(rail, made, changes, message):
    with said(message) as caught:
        made(rail, changes)
    assert made is not of_law or "trolley" in str(caught.value)


def test_register_refuses_other_things_in_a_few_words(rail):
    ahrs, trolley, compass = rail["ahrs"].ESTIMATOR, rail["trolley"].trolley(), rail["compass"].COMPASS
    for taken, things in (
        (insenv.register, (ahrs.model, [ahrs], trolley, compass)),
        (vehicles.register, (ahrs,)),
        (sensors.register, (ahrs,)),
        (estimators.register, (ahrs.model,)),
        (lambda model: insenv.run("ship-swaying", model), (ahrs.model,)),
    ):
        for thing in things:
            with pytest.raises(InputError, match=r"ahrs|trolley|compass") as caught:
                taken(thing)
            assert len(str(caught.value)) < 250
    with said("estimator 'ship-swaying': a scenario has this name"):
        insenv.register(Estimator(replace(ahrs.model, id="ship-swaying"), kind="alignment"))
    for thing, allowed in (
        (3, "allowed is an Estimator, a subclass of VehicleSection or a subclass of SensorSection"),
        (VehicleSection, "a kind of vehicle is a subclass of VehicleSection with kind: Literal"),
        (SensorSection, "a sensor is registered by a subclass of SensorSection whose `sensor` is a Sensor"),
    ):
        with said(allowed):
            insenv.register(thing)


# --- sensors, and names ------------------------------------------------------------------------------


def of_sensor(id):
    sensor = Sensor(id, lambda instant: Part(), ())
    return type("Mine", (SensorSection,), {"__module__": __name__, "sensor": sensor, "rows": lambda self, rate_hz: {}})


@pytest.mark.parametrize("name", ["", "a b", "Compass"])
def test_kinds_and_sensors_have_lower_case_names(rail, name):
    own = section(rail)
    own.model_fields["kind"].annotation = Literal[name]
    for what, thing in (("kind", own), ("sensor id", of_sensor(name))):
        with said(f"Mine: {what} = {name!r}: allowed are lower-case letters, digits and '_', a letter first"):
            insenv.register(thing)


def test_a_sensor_does_not_take_the_name_of_another_section():
    for id in ("start", "title", "knowledge", "imu", "name", "model_copy"):
        with said(f"sensor {id!r}: a key or attribute of a scenario has this name"):
            insenv.register(of_sensor(id))
    assert {name for name in dir(Scenario) if not name.startswith("_")} | set(Scenario.model_fields) <= sensors.TAKEN


def test_a_section_must_define_what_its_contract_declares():
    class Bare(VehicleSection):
        kind: Literal["bare"]

    class Mute(SensorSection):
        sensor = Sensor("mute", part=lambda instant: Part(), outputs=())

    with said("Bare: a subclass of VehicleSection must define 'in_place'"):
        insenv.register(Bare)
    with said("Mute: a subclass of SensorSection must define 'rows'"):
        insenv.register(Mute)


def test_a_fault_of_a_sensor_names_it(rail):
    compass = rail["compass"].COMPASS
    for wrong, message in (
        ([replace(compass, part=lambda instant: None)], "sensor 'compass': part gave None"),
        ([replace(compass, outputs=("compas_valid",))], "sensor 'compass': no row named 'compas_valid'; did you mean"),
        ([compass, replace(compass, id="other")], "two rows are named 'compass_valid'"),
    ):
        with said(message):
            plant_model(rail["trolley"].trolley(), tuple(wrong))


# --- entry points ------------------------------------------------------------------------------------


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


def known():
    return Plugins("estimator", "insenv.test", estimators._id, {"q-method": ESTIMATORS["q-method"]})


def test_an_entry_point_has_the_name_of_what_it_holds(declare):
    declare("[insenv.test]\nother = insenv.estimators.analytic:ESTIMATOR")
    found = known()
    with pytest.warns(RuntimeWarning, match=r"package 'mine': its entry point 'other' .* it holds the estimator 'analytic'"):
        found.all()
    with pytest.raises(InsenvError, match="give both the same name"):
        found.get("other")


def test_a_broken_package_is_an_error_only_if_it_is_asked_for(declare):
    declare("[insenv.test]\nbroken = no_such_module:X\nanalytic = insenv.estimators.analytic:ESTIMATOR")
    found = known()
    with pytest.warns(RuntimeWarning, match="package 'mine': its entry point 'broken' .* No module named 'no_such_module'"):
        assert list(found.all()) == ["q-method", "analytic"]
    assert found.get("analytic").id == "analytic" and found.get("q-method").id == "q-method"
    with pytest.raises(InsenvError, match=r"estimator 'broken': package 'mine'.*mend or uninstall the package"):
        found.get("broken")


def test_a_broken_sensor_or_vehicle_stops_only_the_scenarios_that_name_it(monkeypatch):
    values = {**START, "vehicle": {"kind": "car"}}
    for registry, wanted in ((sensors, {"sonar": {}}), (vehicles, {"vehicle": {"kind": "sonar"}})):
        monkeypatch.setattr(registry._PLUGINS, "_broken", {"sonar": "package 'mine': cannot be loaded"})
        insenv.load(values)
        with pytest.raises(InputError, match=r"vehicle\.kind"):
            insenv.load({**values, "vehicle": {"kind": []}})
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
    assert [row["id"] for row in strict(done.stdout)["sensors"]] == ["gnss", *INSTRUMENTS]

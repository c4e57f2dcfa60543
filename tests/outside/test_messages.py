"""What an author of an estimator, a vehicle or a sensor is told about a mistake."""

import importlib
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from typing import Literal

import casadi as ca
import numpy as np
import pytest
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

PACKAGE = ROOT / "tests" / "outside" / "rail"


@pytest.fixture(autouse=True)
def only_here(monkeypatch):
    """What a test registers is forgotten after it."""
    for registry in (estimators, vehicles, sensors):
        monkeypatch.setattr(registry._PLUGINS, "_added", dict(registry._PLUGINS._added))


@pytest.fixture
def rail(monkeypatch):
    """The modules of the outside package."""
    monkeypatch.syspath_prepend(PACKAGE)
    return {name: importlib.import_module(f"insenv_rail.{name}") for name in ("ahrs", "trolley", "compass")}


def said(message):
    return pytest.raises(InputError, match=re.escape(message))


# --- estimators --------------------------------------------------------------------------------------


def misspelt(p, x, u):
    return {"q_nb": x.q_nb + u.delta_velo[0]}


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (misspelt, "no row named 'delta_velo'; did you mean 'delta_velocity'?"),
        (lambda p, x, u: {"qnb": x.q_nb}, "no row named 'qnb'; did you mean 'q_nb'?"),
        (lambda p, x, u: {"q_nb": x.q_nb[:3]}, "row 'q_nb' has the shape 3 x 1: allowed is (4,)"),
        (lambda p, x, u: {"q_nb": "x"}, "row 'q_nb' is of type str: allowed is a CasADi expression or a number"),
        (lambda p, x, u: None, "the result is of type NoneType: allowed is a dict of values by row name"),
        (
            lambda p, x, u: {"q_nb": x.q_nb if u.dt > 0 else -x.q_nb},
            "a CasADi symbol has no truth value: allowed is casadi.if_else",
        ),
        (lambda p, x, u: {"q_nb": np.eye(4).foo}, "AttributeError: 'numpy.ndarray' object has no attribute 'foo'"),
        (
            lambda p, x, u: {"q_nb": x.q_nb + ca.SX.zeros(3)},
            "RuntimeError: Dimension mismatch for (x+y), x is 4x1, while y is 3x1",
        ),
        (lambda p, x, u: {"q_nb": x.q_nb * float("inf")}, "row 'q_nb' contains a constant that is not finite"),
        (lambda p, x, u: {"q_nb": x.q_nb / 0}, "row 'q_nb' contains a constant that is not finite"),
    ],
)
def test_a_fault_of_a_step_names_estimator_and_step(rail, function, message):
    model = replace(rail["ahrs"].ESTIMATOR.model, id="my-level", steps={"sample": Step(function)})
    with said("model 'my-level', step 'sample': ") as caught:
        insenv.run("ship-swaying", Estimator(model, kind="alignment"), duration_s=1.0)
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"output": lambda p, x: {}}, "model 'ahrs', output: row 'q_nb' is missing"),
        ({"output": lambda p, x: None}, "model 'ahrs', output: the result is of type NoneType"),
        ({"output": None}, "model 'ahrs': output and start must be functions"),
        ({"start": {}}, "model 'ahrs': output and start must be functions"),
        ({"start": lambda p: None}, "model 'ahrs', start: the result is of type NoneType"),
        ({"start": lambda p: {"q": 1}}, "model 'ahrs', start: no row named 'q'"),
        ({"steps": {"sample": lambda p, x, u: {}}}, "model 'ahrs', step 'sample': function: allowed is a Step"),
        ({"steps": [Step(misspelt)]}, "model 'ahrs': steps is of type list: allowed is a dict of Step by name"),
        ({"state": ()}, "model 'ahrs': state is of type tuple: allowed is a Table"),
        ({"id": ""}, "estimator id = '': allowed are letters, digits"),
        ({"id": "My Est/..!"}, "estimator id = 'My Est/..!': allowed are letters, digits"),
    ],
)
def test_a_fault_of_a_model_is_named(rail, changes, message):
    with said(message):
        _ = Estimator(replace(rail["ahrs"].ESTIMATOR.model, **changes), kind="alignment").model.kernels


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"motion": "foo"}, "estimator 'ahrs': motion = 'foo': allowed is 'in place', 'moving' or 'any'"),
        ({"sensors": "gnss"}, "estimator 'ahrs': sensors = 'gnss': allowed is a tuple of sensor ids, such as ('gnss',)"),
        ({"sensors": 3}, "estimator 'ahrs': sensors = 3: allowed is a tuple"),
        ({"model": "x"}, "Estimator: model = 'x': allowed is an insenv.Model"),
    ],
)
def test_a_fault_of_an_estimator_is_named(rail, changes, message):
    with said(message):
        replace(rail["ahrs"].ESTIMATOR, **changes)


@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda known: [1], "estimator 'ahrs', prepare: the result is of type list"),
        (lambda known: {"lattitude": 1}, "estimator 'ahrs', prepare: no row named 'lattitude'; did you mean 'latitude'?"),
        (lambda known: 1 / 0, "estimator 'ahrs', prepare: ZeroDivisionError: division by zero"),
    ],
)
def test_a_fault_of_prepare_is_named(rail, prepare, message):
    with said(message):
        insenv.run("ship-swaying", replace(rail["ahrs"].ESTIMATOR, prepare=prepare), duration_s=1.0)


def test_an_estimator_does_not_take_the_name_of_a_scenario(rail):
    own = Estimator(replace(rail["ahrs"].ESTIMATOR.model, id="ship-swaying"), kind="alignment")
    with said("estimator 'ship-swaying': a scenario has this name: choose another name"):
        insenv.register(own)


def test_messages_show_a_model_in_a_few_words(rail):
    model = rail["ahrs"].ESTIMATOR.model
    for call in (
        lambda: insenv.run("ship-swaying", model),
        lambda: insenv.register(model),
        lambda: insenv.register([rail["ahrs"].ESTIMATOR]),
        lambda: insenv.register(rail["trolley"].trolley()),
        lambda: insenv.register(rail["compass"].COMPASS),
        lambda: vehicles.register(rail["ahrs"].ESTIMATOR),
        lambda: sensors.register(rail["ahrs"].ESTIMATOR),
        lambda: estimators.register(model),
    ):
        with pytest.raises(InputError, match=r"ahrs|trolley|compass") as caught:
            call()
        assert len(str(caught.value)) < 250


# --- vehicles ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"along": lambda p, x: [{"rail_phase": 0}]}, "along: 1 results: allowed are 3, one for each node of PLACES"),
        ({"along": lambda p, x: None}, "TypeError: 'NoneType' object is not iterable"),
        ({"start": lambda p: {"rail_fase": 0}}, "no row named 'rail_fase'; did you mean 'rail_phase'?"),
        ({"start": lambda p: None}, "the result is of type NoneType"),
        ({"angles": lambda p, x: [p.mean_rol, p.mean_pitch, 0]}, "no row named 'mean_rol'; did you mean 'mean_roll'?"),
        ({"derivative": lambda p, x: {"fase": 1}}, "no row named 'fase'"),
        ({"state": Table((Row("q_nb", "Mine"),))}, "q_nb"),
    ],
)
def test_a_fault_of_a_law_of_motion_names_the_vehicle(rail, changes, message):
    with said(message) as caught:
        _ = plant_model(replace(rail["trolley"].trolley(), **changes), ()).kernels
    assert "trolley" in str(caught.value)


def section(rail, **methods):
    return type("Mine", (rail["trolley"].TrolleySection,), {"__module__": __name__, **methods})


@pytest.mark.parametrize(
    ("methods", "message"),
    [
        ({"vehicle": lambda self: None}, "vehicle = None: allowed is an insenv.Vehicle"),
        ({"rows": lambda self, start: None}, "vehicle kind 'trolley', rows: the result is of type NoneType"),
        ({"rows": lambda self, start: self.period}, "vehicle kind 'trolley', rows: AttributeError: 'Mine' object has no"),
        ({"vehicle": lambda self: self.law}, "vehicle kind 'trolley', vehicle: AttributeError: 'Mine' object has no"),
        ({"rows": lambda self, start: {"rail_amp": 1}}, "vehicle kind 'trolley', rows: no row named 'rail_amp'"),
        (
            {"rows": lambda self, start: {"rail_amplitude": 1}},
            "vehicle kind 'trolley', rows: 'rail_angular_frequency' is missing: allowed is a value",
        ),
    ],
)
def test_a_fault_of_a_vehicle_section_is_named(rail, methods, message):
    insenv.register(section(rail, **methods))
    values = {"title": "t", "duration_s": 1, "start": {"latitude_deg": 50, "longitude_deg": 8}, "vehicle": {"kind": "trolley"}}
    with said(message):
        build(insenv.load(values))


@pytest.mark.parametrize("kind", ["", "a b", "Trolley"])
def test_a_kind_of_vehicle_is_a_lower_case_name(rail, kind):
    own = section(rail)
    own.model_fields["kind"].annotation = Literal[kind]
    with said(f"Mine: kind = {kind!r}: allowed are lower-case letters, digits and '_', a letter first"):
        insenv.register(own)


def test_a_section_must_define_what_its_contract_declares():
    class Bare(VehicleSection):
        kind: Literal["bare"]

    class Mute(SensorSection):
        sensor = Sensor("mute", part=lambda instant: Part(), outputs=())

    with said("Bare: a subclass of VehicleSection must define 'in_place'"):
        insenv.register(Bare)
    with said("Mute: a subclass of SensorSection must define 'rows'"):
        insenv.register(Mute)


# --- sensors -----------------------------------------------------------------------------------------


def of_sensor(id):
    class Mine(SensorSection):
        sensor = Sensor(id, lambda instant: Part(), ())

        def rows(self, rate_hz):
            return {}

    return Mine


@pytest.mark.parametrize("id", ["start", "title", "knowledge", "imu", "name", "model_copy"])
def test_a_sensor_does_not_take_the_name_of_another_section(id):
    with said(f"sensor {id!r}: a key or attribute of a scenario has this name: choose another name"):
        insenv.register(of_sensor(id))


@pytest.mark.parametrize("id", ["", "a b", "Compass"])
def test_a_sensor_has_a_lower_case_name(id):
    with said(f"Mine: sensor id = {id!r}: allowed are lower-case letters, digits and '_', a letter first"):
        insenv.register(of_sensor(id))


def test_no_name_of_a_scenario_is_free():
    assert {name for name in dir(Scenario) if not name.startswith("_")} | set(Scenario.model_fields) <= sensors.TAKEN


def test_a_fault_of_a_sensor_names_it(rail):
    compass = rail["compass"].COMPASS
    vehicle = rail["trolley"].trolley()
    for sensor, message in (
        (
            replace(compass, part=lambda instant: None),
            "sensor 'compass': part gave None: allowed is an insenv.core.compose.Part",
        ),
        (replace(compass, outputs=("compas_valid",)), "sensor 'compass': no row named 'compas_valid'; did you mean"),
    ):
        with said(message):
            plant_model(vehicle, (sensor,))
    with said("two rows are named 'compass_valid'"):
        plant_model(vehicle, (compass, replace(compass, id="other")))


# --- entry points ------------------------------------------------------------------------------------


@pytest.fixture
def declared(tmp_path, monkeypatch):
    """A registry of estimators, of an installed package that declares the given entry points."""

    def declare(*lines):
        info = tmp_path / "mine-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[insenv.test]\n" + "\n".join(lines))
        monkeypatch.syspath_prepend(tmp_path)
        return Plugins("estimator", "insenv.test", estimators._id, {"q-method": ESTIMATORS["q-method"]})

    return declare


def test_an_entry_point_has_the_name_of_what_it_holds(declared):
    found = declared("other = insenv.estimators.analytic:ESTIMATOR")
    with pytest.warns(RuntimeWarning, match=r"package 'mine': its entry point 'other' .* it holds the estimator 'analytic'"):
        found.all()
    with pytest.raises(InsenvError, match="give both the same name"):
        found.get("other")


def test_a_broken_package_is_an_error_only_if_it_is_asked_for(declared):
    found = declared("broken = no_such_module:X", "analytic = insenv.estimators.analytic:ESTIMATOR")
    with pytest.warns(RuntimeWarning, match="package 'mine': its entry point 'broken' .* No module named 'no_such_module'"):
        assert list(found.all()) == ["q-method", "analytic"]
    assert found.get("analytic").id == "analytic" and found.get("q-method").id == "q-method"
    with pytest.raises(InsenvError, match=r"estimator 'broken': package 'mine'.*mend or uninstall the package"):
        found.get("broken")


def test_a_broken_sensor_or_vehicle_stops_only_the_scenarios_that_name_it(monkeypatch):
    values = {"title": "t", "duration_s": 1, "start": {"latitude_deg": 50, "longitude_deg": 8}, "vehicle": {"kind": "car"}}
    for registry, wanted in ((sensors, {"sonar": {}}), (vehicles, {"vehicle": {"kind": "sonar"}})):
        monkeypatch.setattr(registry._PLUGINS, "_broken", {"sonar": "package 'mine': cannot be loaded"})
        insenv.load(values)
        with pytest.raises(InputError, match=r"vehicle\.kind"):
            insenv.load({**values, "vehicle": {"kind": []}})
        with pytest.raises(InsenvError, match="'sonar': package 'mine': cannot be loaded"):
            insenv.load({**values, **wanted})


def test_an_installed_package_with_faults_leaves_the_command_line_alone(tmp_path, monkeypatch):
    info = tmp_path / "mine-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[insenv.sensors]\nknowledge = own_sensor:KNOWLEDGE\n[insenv.estimators]\nx = gone:X\n"
    )
    (tmp_path / "own_sensor.py").write_text(
        "from insenv import Sensor, SensorSection\nfrom insenv.core.compose import Part\n"
        "class KNOWLEDGE(SensorSection):\n    sensor = Sensor('knowledge', lambda instant: Part(), ())\n"
        "    def rows(self, rate): return {}\n"
    )
    path = f"{tmp_path}:{ROOT}"
    done = subprocess.run(
        [sys.executable, "-m", "insenv", "list", "--json"],
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "internal error" not in done.stderr and done.stderr.count("insenv: warning: package 'mine'") == 2
    assert [row["id"] for row in json.loads(done.stdout)["sensors"]] == ["gnss", *INSTRUMENTS]

"""The SSP file of a plant and an estimator."""

import zipfile

import numpy as np
import pytest
from command_line import call, strict
from fmpy import read_model_description
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import get_connections, ns, read_ssd, read_ssv
from fmu_tools import in_process, plant_outputs, scratch
from lxml import etree

from insenv import estimators
from insenv.base.errors import InputError
from insenv.fmu.reading import element_names
from insenv.fmu.ssp import export_ssp, structure
from insenv.scenario import build, load

SCENARIO, ID, INTERVAL, SAMPLES = "ship-swaying", "qakf-improved", 0.005, 200
INCREMENTS = ("delta_angle", "delta_velocity")
PARTS = ("plant", "estimator")


@pytest.fixture(scope="module")
def loop():
    path = scratch() / "loop.ssp"
    status, out, _ = call("fmu", "ssp", SCENARIO, "-e", ID, "-o", path, "--json")
    assert status == 0 and strict(out)["written"] == str(path)
    return path


@pytest.fixture(scope="module")
def files(loop):
    with zipfile.ZipFile(loop) as archive:
        archive.extractall(loop.with_suffix(""))
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def described(files, loop):
    return {part: read_model_description(str(loop.with_suffix("") / "resources" / f"{part}.fmu")) for part in PARTS}


def test_the_structure_validates_and_connects_by_name(loop):
    ssd = read_ssd(str(loop), validate=True)
    assert [(part.name, part.source) for part in ssd.system.elements] == [(name, f"resources/{name}.fmu") for name in PARTS]
    assert ssd.name == "ship_swaying"  # OMSimulator's command line takes identifiers only
    joined = {(a.parent.name, a.name, b.parent.name, b.name) for a, b in get_connections(ssd.system)}
    names = [f"{name}[{k}]" for name in INCREMENTS for k in (1, 2, 3)]
    outputs = [v for row in estimators.get(ID).model.outputs for v in element_names(row.name, row.shape)]
    # a name of the system is an identifier: OMSimulator refuses q_nb[1] there
    shown = {("estimator", name, "loop", name.replace("[", "_").replace("]", "")) for name in outputs}
    assert joined == {("plant", name, "estimator", name) for name in names} | shown


@pytest.mark.parametrize("part", PARTS)
def test_the_parameter_sets_hold_the_start_values(loop, described, part):
    found = {p.name: (p.type, p.value) for p in read_ssv(str(loop), f"resources/{part}.ssv", validate=True).parameters}
    assert found == {v.name: (v.type, v.start) for v in described[part].modelVariables if v.causality == "parameter"}
    assert found


def test_descriptions_for_other_masters(files):
    """The step in annotations, and a second description with connections between components alone."""
    whole, inner = (etree.fromstring(files[name]) for name in ("SystemStructure.ssd", "Components.ssd"))
    by_type = {a.get("type"): a for a in whole.iter("{*}Annotation")}
    assert by_type["org.openmodelica"].find(".//{*}FixedStepMaster").get("stepSize") == "0.005"
    assert by_type["com.opensimulationplatform"].find(".//{*}FixedStepAlgorithm").get("baseStepSize") == "0.005"
    assert [(w.get("startElement"), w.get("endElement")) for w in inner.iter("{*}Connection")] == [PARTS] * 6
    assert inner.find("{*}System/{*}Connectors") is None and whole.find("{*}System/{*}Connectors") is not None
    elements = (etree.tostring(root.find("{*}System/{*}Elements"), method="c14n") for root in (inner, whole))
    assert len(set(elements)) == 1


def test_units_are_those_of_the_components(files, described):
    root = etree.fromstring(files["SystemStructure.ssd"])
    units = {unit.get("name"): unit.find("ssc:BaseUnit", ns).attrib for unit in root.iterfind("ssd:Units/ssc:Unit", ns)}
    for part in root.iterfind(".//ssd:Component", ns):
        description = described[part.get("name")]
        variables = {v.name: v for v in description.modelVariables}
        defined = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
        for real in part.iterfind(".//ssd:Connector/ssc:Real", ns):
            variable, unit = variables[real.getparent().get("name")], real.get("unit")
            assert unit == (variable.unit or getattr(variable.declaredType, "unit", None))
            for si in ("kg", "m", "s", "K", "rad") if unit else ():
                assert int(units[unit].get(si, 0)) == getattr(defined[unit], si, 0)


def test_the_same_call_writes_the_same_bytes(loop):
    told = export_ssp(SCENARIO, ID, scratch() / "again.ssp")
    assert (scratch() / "again.ssp").read_bytes() == loop.read_bytes()
    assert told == {"step_s": INTERVAL, "stop_time_s": load(SCENARIO).duration_s, "connections": 6}


def recorded(found, component, row):
    """A row of the tables, (steps, n), from the record of a master."""
    return np.stack([found[f"{component}.{name}"] for name in element_names(row.name, row.shape)], axis=1)


def test_the_master_runs_the_same_numbers_one_step_late(loop):
    simulated = simulate_ssp(str(loop), stop_time=(SAMPLES + 0.5) * INTERVAL, step_size=INTERVAL)
    assert len(simulated) == SAMPLES + 1
    shown = plant_outputs(SCENARIO, SAMPLES + 1)
    for name in ("delta_angle", "delta_velocity", "q_nb"):
        row = build(load(SCENARIO)).model.outputs[name]
        np.testing.assert_array_equal(recorded(simulated, "plant", row), shown[name])
    found = np.hstack([recorded(simulated, "estimator", row) for row in estimators.get(ID).model.outputs])
    # in its first step the master has passed no values on: the estimator waits for a sample
    np.testing.assert_array_equal(found[1:], in_process(ID, {name: shown[name][:-1] for name in INCREMENTS}))


def test_what_cannot_be_connected_is_named(described, tmp_path):
    text = load(SCENARIO).model_dump(mode="json", exclude_unset=True)
    text["imu"]["drop_probability"] = 0.01
    with pytest.raises(InputError, match="loses inertial samples"):
        export_ssp(text, ID, tmp_path / "x.ssp")
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="none of its inputs is an output"):
        structure("x", described["plant"], described["plant"], 1.0, ())

"""The SSP file of a plant and an estimator: it validates, and FMPy's master runs it.

The estimate is that of `insenv run` except for the master's delay of one step.
"""

import subprocess
import sys
import zipfile

import numpy as np
import pytest
from command_line import call, refused, strict
from fmu_tools import in_process, plant_outputs, scratch, thorough

from insenv import attitude, estimators, run
from insenv.errors import InputError
from insenv.evaluation.errors import ATTITUDE
from insenv.files.resources import scenario_folder
from insenv.fmu.reading import element_names
from insenv.fmu.ssp import export_ssp, structure
from insenv.scenario import build, load

SCENARIO, ID, INTERVAL, SAMPLES = "ship-swaying", "qakf-improved", 0.005, 2000
INCREMENTS = ("delta_angle", "delta_velocity")


@pytest.fixture(scope="module")
def loop():
    """The file that the command writes."""
    path = scratch() / "loop.ssp"
    status, out, err = call("fmu", "ssp", SCENARIO, "-e", ID, "-o", path, "--json")
    assert status == 0, err
    assert strict(out)["written"] == str(path)
    return path


@pytest.fixture(scope="module")
def simulated(loop):
    """The record of FMPy's master: one step more than samples, because of its delay."""
    from fmpy.ssp.simulation import simulate_ssp

    found = simulate_ssp(str(loop), stop_time=(SAMPLES + 0.5) * INTERVAL, step_size=INTERVAL)
    assert len(found) == SAMPLES + 1
    return found


def recorded(found, component, row):
    """A row of the tables, (steps, n), from the record of a master."""
    return np.stack([found[f"{component}.{row.name}[{k + 1}]"] for k in range(row.size)], axis=1)


def test_the_structure_validates_and_connects_by_name(loop):
    from fmpy.ssp.ssd import get_connections, read_ssd

    ssd = read_ssd(str(loop), validate=True)
    assert [(part.name, part.source) for part in ssd.system.elements] == [
        ("plant", "resources/plant.fmu"),
        ("estimator", "resources/estimator.fmu"),
    ]
    assert ssd.name == "ship_swaying"  # OMSimulator's command line takes identifiers only
    joined = {(a.parent.name, a.name, b.parent.name, b.name) for a, b in get_connections(ssd.system)}
    names = [f"{name}[{k}]" for name in ("delta_angle", "delta_velocity") for k in (1, 2, 3)]
    outputs = [v for row in estimators.get(ID).model.outputs for v in element_names(row.name, row.shape)]
    # a name of the system is an identifier: OMSimulator refuses q_nb[1] there
    shown = {("estimator", name, "loop", name.replace("[", "_").replace("]", "")) for name in outputs}
    assert joined == {("plant", name, "estimator", name) for name in names} | shown


@pytest.mark.parametrize("part", ["plant", "estimator"])
def test_the_parameter_sets_hold_the_start_values(loop, part):
    from fmpy import read_model_description
    from fmpy.ssp.ssd import read_ssd, read_ssv

    with zipfile.ZipFile(loop) as archive:
        archive.extract(f"resources/{part}.fmu", scratch())
    variables = read_model_description(str(scratch() / "resources" / f"{part}.fmu")).modelVariables
    found = {p.name: (p.type, p.value) for p in read_ssv(str(loop), f"resources/{part}.ssv", validate=True).parameters}
    assert found == {v.name: (v.type, v.start) for v in variables if v.causality == "parameter"}
    assert "parameters.seed" in found or "parameters.latitude" in found
    (component,) = [c for c in read_ssd(str(loop)).system.elements if c.name == part]
    assert [binding.source for binding in component.parameterBindings] == [f"resources/{part}.ssv"]


def test_a_second_description_has_only_connections_between_components(loop):
    from lxml import etree

    with zipfile.ZipFile(loop) as archive:
        whole, inner = (etree.fromstring(archive.read(name)) for name in ("SystemStructure.ssd", "Components.ssd"))
    ends = [(wire.get("startElement"), wire.get("endElement")) for wire in inner.iter("{*}Connection")]
    assert ends == [("plant", "estimator")] * 6
    assert inner.find("{*}System/{*}Connectors") is None
    assert whole.find("{*}System/{*}Connectors") is not None
    for path in ("{*}System/{*}Elements", "{*}DefaultExperiment"):  # Elements: with the parameter sets
        assert etree.tostring(inner.find(path), method="c14n") == etree.tostring(whole.find(path), method="c14n")


def test_the_step_stands_in_the_annotations_of_other_masters(loop):
    from lxml import etree

    with zipfile.ZipFile(loop) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
    (system,) = [a for a in root.iter("{*}Annotation") if a.get("type") == "org.openmodelica"]
    assert system.find(".//{*}FixedStepMaster").get("stepSize") == "0.005"
    (experiment,) = [a for a in root.iter("{*}Annotation") if a.get("type") == "com.opensimulationplatform"]
    assert experiment.find(".//{*}FixedStepAlgorithm").get("baseStepSize") == "0.005"


def test_a_master_with_another_step_is_refused(loop):
    script = "import sys; from fmpy.ssp.simulation import simulate_ssp; simulate_ssp(sys.argv[1], stop_time=100.0)"
    done = subprocess.run([sys.executable, "-c", script, str(loop)], capture_output=True, text=True)
    assert done.returncode == 1
    assert "fmi2DoStep failed with status 3" in done.stderr
    assert "communication step is 1 s: allowed is one sample interval, 0.005 s" in done.stdout


def test_units_are_those_of_the_components(loop):
    from fmpy import read_model_description
    from fmpy.ssp.ssd import ns
    from lxml import etree

    with zipfile.ZipFile(loop) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
        archive.extractall(loop.with_suffix(""))
    units = {unit.get("name"): unit.find("ssc:BaseUnit", ns).attrib for unit in root.iterfind("ssd:Units/ssc:Unit", ns)}
    used = set()
    for part in root.iterfind(".//ssd:Component", ns):
        description = read_model_description(str(loop.with_suffix("") / part.get("source")))
        variables = {v.name: v for v in description.modelVariables}
        defined = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
        for connector in part.iterfind(".//ssd:Connector", ns):
            variable, real = variables[connector.get("name")], connector.find("ssc:Real", ns)
            assert connector.get("kind") == variable.causality
            assert (real is None) == (variable.type == "Boolean") == (connector.find("ssc:Boolean", ns) is not None)
            if real is None:
                continue
            assert real.get("unit") == (variable.unit or variable.declaredType.unit)
            if real.get("unit") is not None:
                used.add(real.get("unit"))
                base = defined[real.get("unit")]
                assert {si: int(n) for si, n in units[real.get("unit")].items()} == {
                    si: getattr(base, si) for si in ("kg", "m", "s", "K", "rad") if base is not None and getattr(base, si)
                }
    assert used == set(units) >= {"rad", "m/s"}


def test_the_same_call_writes_the_same_bytes(loop):
    told = export_ssp(SCENARIO, ID, scratch() / "again.ssp")
    assert (scratch() / "again.ssp").read_bytes() == loop.read_bytes()
    assert told == {"step_s": INTERVAL, "stop_time_s": load(SCENARIO).duration_s, "connections": 6}


def test_the_master_runs_the_same_numbers_one_step_late(simulated):
    shown = plant_outputs(SCENARIO, SAMPLES + 1)
    for name in ("delta_angle", "delta_velocity", "q_nb"):
        row = build(load(SCENARIO)).model.outputs[name]
        np.testing.assert_array_equal(recorded(simulated, "plant", row), shown[name])
    table = estimators.get(ID).model.outputs
    found = np.concatenate([recorded(simulated, "estimator", row) if row.shape else
                            simulated[f"estimator.{row.name}"][:, None] for row in table], axis=1)  # fmt: skip
    np.testing.assert_array_equal(found, in_process(ID, {name: late(shown, name) for name in INCREMENTS}))


def angles_apart(found, true):
    """Roll, pitch and heading of `found` minus those of `true`, deg."""
    apart = np.degrees(np.array(attitude.numeric.to_euler(found)) - np.array(attitude.numeric.to_euler(true)))
    return (apart + 180.0) % 360.0 - 180.0


def run_to_the_end():
    """The final errors of `insenv run` and their limits, deg; the number of samples."""
    (result,) = (report := run(load(SCENARIO), [ID])).results
    errors, limits = (np.array([values[name] for name in ATTITUDE]) for values in (result.errors, result.limit))
    return errors[:, -1], limits, report.imu_samples


def late(shown, name):
    """The inputs of the estimator: all zero at its first step, before the master has passed values on."""
    return np.concatenate([np.zeros((1, 3)), shown[name][:-1]])


def test_the_alignment_error_at_the_end_is_that_of_a_run_within_the_delay():
    expected, limits, count = run_to_the_end()
    shown = plant_outputs(SCENARIO, count + 1)
    q_found = in_process(ID, {name: late(shown, name) for name in INCREMENTS})[
        :, estimators.get(ID).model.outputs.slice("q_nb")
    ]
    # The last estimate is the attitude one step before.  Compared with that, only the first sample differs from the run: all
    # zeros, which an estimator reads as free fall.
    apart = angles_apart(q_found[-1], shown["q_nb"][-2])
    assert (abs(apart - expected) < 0.1 * limits).all()
    # compared with the attitude at the same time it lags by the rotation of the ship in one step
    turned = angles_apart(shown["q_nb"][-2], shown["q_nb"][-1])
    np.testing.assert_allclose(angles_apart(q_found[-1], shown["q_nb"][-1]), apart + turned, atol=1e-9)
    assert 0.005 < abs(turned).max() < 0.05


@thorough
def test_the_whole_loop_in_the_master(loop):
    from fmpy.ssp.simulation import simulate_ssp

    expected, limits, count = run_to_the_end()
    found = simulate_ssp(str(loop), stop_time=(count + 0.5) * INTERVAL, step_size=INTERVAL)
    assert len(found) == count + 1
    q_true = recorded(found, "plant", build(load(SCENARIO)).model.outputs["q_nb"])
    q_found = recorded(found, "estimator", estimators.get(ID).model.outputs["q_nb"])
    assert (abs(angles_apart(q_found[-1], q_true[-2]) - expected) < 0.1 * limits).all()


def test_a_plant_that_loses_samples_is_refused(tmp_path):
    text = (scenario_folder() / f"{SCENARIO}.toml").read_text("utf-8")
    assert text.count("[imu]") == 1
    (tmp_path / "lossy.toml").write_text(text.replace("[imu]", "[imu]\ndrop_probability = 0.01"))
    with pytest.raises(InputError, match="loses inertial samples"):
        export_ssp(str(tmp_path / "lossy.toml"), ID, tmp_path / "x.ssp")


def test_a_combination_that_is_not_allowed_is_named(tmp_path):
    refused(call("fmu", "ssp", "car-city-drive", "-e", ID, "-o", tmp_path / "x.ssp"), ID, "car-city-drive", "moves")
    refused(
        call("fmu", "ssp", "car-city-drive", "-e", "smoother", "-o", tmp_path / "x.ssp"), "smooths a whole run from its end"
    )
    refused(call("fmu", "ssp", SCENARIO, "-e", "qakf-improve", "-o", tmp_path / "x.ssp"), "qakf-improved")
    refused(call("fmu", "ssp", "ship-swayin", "-e", ID, "-o", tmp_path / "x.ssp"), SCENARIO)
    assert not list(tmp_path.iterdir())


def test_components_without_a_common_name_are_refused(loop):
    from fmpy import read_model_description

    with zipfile.ZipFile(loop) as archive:
        archive.extract("resources/plant.fmu", scratch())
    plant = read_model_description(str(scratch() / "resources" / "plant.fmu"))
    with pytest.raises(InputError, match="none of its inputs is an output"):
        structure("x", plant, plant, 1.0, ())

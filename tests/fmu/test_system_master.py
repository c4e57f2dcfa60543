"""`insenv fmu run loop.ssp`: in the order of the data, bit-identical to `insenv run`; natively and in Python."""

import ctypes
import zipfile

import numpy as np
import pytest
from command_line import call, refused, strict
from fmu_tools import scratch

from insenv import run
from insenv.base.errors import InputError, InsenvError
from insenv.fmu import export_ssp, run_ssp, running
from insenv.fmu.instance import Instance
from insenv.fmu.stepping import KINDS, STEPPING, Plan, Ports, Stopped, interpreted, native

backends = pytest.mark.parametrize("backend", ("native", "interpreter"))
LOOP = ("ship-swaying", "qakf-improved", 2)
SSD, PLANT, ESTIMATOR = "SystemStructure.ssd", "resources/plant.ssv", "resources/estimator.ssv"


def exported(scenario, id, fmi):
    path = scratch() / f"{scenario}-{id}-{fmi}.ssp"
    if not path.exists():
        export_ssp(scenario, id, path, fmi=fmi)
    return path


@pytest.fixture
def path():
    return exported(*LOOP)


@backends
@pytest.mark.parametrize("case", [LOOP, pytest.param(("car-city-drive", "loosely-coupled", 3), marks=pytest.mark.slow)])
def test_the_outputs_are_bit_identical_to_those_of_a_run(case, backend):
    path, duration = exported(*case), 5.0
    found = run_ssp(path, stop_time=duration, backend=backend)
    (result,) = run(case[0], [case[1]], duration_s=duration).results
    places, named = np.round(result.time / found.step).astype(int) - 1, found.named()
    assert len(places) > 20
    for name, values in result.outputs.items():
        np.testing.assert_array_equal(named[f"estimator.{name}"][places], values, err_msg=name)
    seventh = run_ssp(path, stop_time=duration, every=7, backend=backend)
    np.testing.assert_array_equal(seventh.values, found.values[6::7])
    np.testing.assert_array_equal(seventh.time, found.time[6::7])


@backends
def test_a_failed_step_is_reported_with_its_component_and_reason(path, backend):
    said = r"\.ssp, component estimator: the step failed at step 0, t = 0 s .*allowed is one sample interval"
    with pytest.raises(InsenvError, match=said):
        run_ssp(path, stop_time=1.0, step=0.05, backend=backend)


def test_a_component_that_ends_the_simulation_gives_the_rows_until_then(path, monkeypatch):
    whole = run_ssp(path, stop_time=0.5)
    stopped = Stopped(0, STEPPING, 3)
    monkeypatch.setattr(Instance, "ends", lambda self, status: True)
    monkeypatch.setattr(running, "make_steps", lambda block, steps, progress: (block(0, 42)[0], stopped))
    found = run_ssp(path, stop_time=0.5, every=4)
    assert found.ended and not whole.ended
    assert (found.steps, len(found.time)) == (40, 10)
    np.testing.assert_array_equal(found.values, whole.values[3:40:4])


def flags_of():
    return (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double())


STEP_2 = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
DO_STEP = {2: ctypes.CFUNCTYPE(ctypes.c_int, *STEP_2), 3: ctypes.CFUNCTYPE(ctypes.c_int, *STEP_2, *[ctypes.c_void_p] * 4)}


def test_values_of_all_types_pass_natively_as_in_python():
    kinds = [np.dtype(kind) for kind in KINDS]
    pairs = [(a, b) for a in kinds for b in kinds if np.can_cast(a, b, "safe")]
    assert len(pairs) > 40
    limits = {kind: (0, 1) if kind.kind == "b" else (-7, 9) for kind in kinds}
    limits |= {kind: (np.iinfo(kind).min, np.iinfo(kind).max) for kind in kinds if kind.kind in "iu"}
    rows = {kind: np.array(limits[kind], dtype=kind) for kind in kinds}

    def outputs(make, version):
        do_step = DO_STEP[version](lambda *arguments: 0)
        first, second = (Ports(name, version, n, [], [], {}, {}, do_step, flags_of()) for n, name in ((1, "a"), (2, "b")))
        for kind, row in rows.items():
            first.outputs |= {f"{kind}[{i}]": (row, i) for i in range(2)}
        for a, b in pairs:
            taken = np.zeros(2, dtype=b)
            for i in range(2):
                second.inputs[f"{a}-{b}[{i}]"] = second.outputs[f"{a}-{b}[{i}]"] = (taken, i)
                second.connect(f"{a}-{b}[{i}]", first, f"{a}[{i}]")
        values = np.empty((2, len(first.outputs) + len(second.outputs)))
        assert make(Plan([first, second], values, 1.0, 1.0, 2))(0, 4) == (4, None)
        return values

    for version in (2, 3):
        found = outputs(native, version)
        np.testing.assert_array_equal(found, outputs(interpreted, version))
        wanted = [value for a, _ in pairs for value in rows[a].astype(float)]
        np.testing.assert_array_equal(found[1, 2 * len(kinds) :], wanted)


@pytest.mark.parametrize("make", [native, interpreted])
def test_the_flag_of_fmi_3_ends_the_simulation(make):
    flags = flags_of()

    def advance(instance, now, *others):
        flags[1].value = now >= 3.0
        return 0

    part = Ports("part", 3, 1, [], [], {}, {"y": (np.zeros(1), 0)}, DO_STEP[3](advance), flags)
    assert make(Plan([part], np.empty((9, 1)), 0.0, 1.0, 1))(0, 9) == (4, Stopped(0, STEPPING, 0))


def test_a_connection_that_loses_values_is_refused():
    flags, source = np.zeros(1, dtype=bool), Ports("a", 3, 0, [], [], {}, {"y": (np.zeros(1), 0)}, None, ())
    with pytest.raises(InputError, match=r"a connection from a\.y \(float64\) to b\.u \(bool\) would lose values"):
        Ports("b", 3, 0, [], [], {"u": (flags, 0)}, {}, None, ()).connect("u", source, "y")


def changed(path, output, name, old, new):
    """The SSP file with a text in one of its files replaced."""
    with zipfile.ZipFile(path) as archive:
        files = {entry: archive.read(entry).decode("latin-1") for entry in archive.namelist()}
    assert old in files[name]
    files[name] = files[name].replace(old, new)
    with zipfile.ZipFile(output, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content.encode("latin-1"))
    return output


def test_the_parameter_sets_are_applied(path, tmp_path):
    """In a file, in the system, and before both those that are given."""
    entry = '"parameters.seed">\n      <ssv:Real value="{}"'
    in_file = changed(path, tmp_path / "x.ssp", PLANT, entry.format("1.0"), entry.format("77"))
    bound = (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="x">'
        '<ssv:Parameters><ssv:Parameter name="plant.parameters.seed"><ssv:Real value="77"/></ssv:Parameter></ssv:Parameters>'
        "</ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings><ssd:Elements>"
    )
    in_system = changed(path, tmp_path / "y.ssp", SSD, "<ssd:Elements>", bound)
    own = run_ssp(path, stop_time=0.5).values
    wanted = run_ssp(path, stop_time=0.5, parameters={"plant.seed": 77.0}).values
    assert not np.array_equal(wanted, own)
    for edited in (in_file, in_system):
        np.testing.assert_array_equal(run_ssp(edited, stop_time=0.5).values, wanted)
        np.testing.assert_array_equal(run_ssp(edited, stop_time=0.5, parameters={"plant.seed": 1.0}).values, own)


RING = '<ssd:Connection startElement="estimator" startConnector="q_nb[1]" endElement="plant" endConnector="x" />'


@pytest.mark.parametrize(("file", "old", "new", "said"), [
    (SSD, PLANT, "resources/none.ssv", "parameter set 'resources/none.ssv' cannot be read"),
    (ESTIMATOR, 'unit="rad"', 'unit="deg"', "in deg: allowed is the unit of the FMU, rad"),
    (PLANT, 'value="', 'value="x', "= 'x.*': allowed is a number"),
    (SSD, "</ssd:Connections>", RING + "</ssd:Connections>", "plant, estimator form a ring"),
    (SSD, 'startConnector="delta_angle[1]"', 'startConnector="delta"', "plant: no output 'delta'"),
    (SSD, "<ssd:", "<broken", "not an SSP file"),
])  # fmt: skip
def test_wrong_systems_and_parameter_sets_are_named(path, tmp_path, file, old, new, said):
    edited = changed(path, tmp_path / "x.ssp", file, old, new)
    with pytest.raises(InputError, match=said) as wrong:
        run_ssp(edited, stop_time=1.0)
    assert "x.ssp" in str(wrong.value) or "startConnector" in old


def test_wrong_parameters_are_named(path):
    with pytest.raises(InputError, match=r"component plant: parameter seed = 5\.5 refused: .*whole number"):
        run_ssp(path, stop_time=0.1, parameters={"plant.seed": 5.5})
    with pytest.raises(InputError, match=r"parameter 'planet\.seed'.*plant, estimator"):
        run_ssp(path, stop_time=0.1, parameters={"planet.seed": 5})


def test_the_command(path, tmp_path):
    output = tmp_path / "out.csv"
    status, out, err = call("fmu", "run", path, "--stop", "1", "--every", "10", "--set", "plant.seed=5", "-o", output, "--json")
    assert status == 0, err
    assert strict(out)["steps"] == 200 and output.read_text().startswith("time,plant.")
    refused(call("fmu", "run", path, "--input", output), "--input", "--input is allowed with an .fmu file")

"""`insenv fmu run loop.ssp`: in the order of the data, bit-identical to `insenv run`."""

import ctypes
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, refused, strict
from fmu_tools import scratch

from insenv import run
from insenv.core.compile import find_compiler
from insenv.errors import InputError, InsenvError
from insenv.fmu import export_ssp, run_ssp, stepping
from insenv.fmu.instance import Instance
from insenv.fmu.ports import Ports, Step
from insenv.fmu.stepping import Plan

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler found")

DURATION = 20.0
BACKENDS = ("native", "interpreter")


@pytest.fixture(scope="module", params=(("ship-swaying", "qakf-improved", 2), ("car-city-drive", "loosely-coupled", 3)))
def system(request):
    """An SSP file, and the run that it must repeat."""
    scenario, id, fmi = request.param
    path = scratch() / f"{scenario}.ssp"
    export_ssp(scenario, id, path, fmi=fmi)
    (result,) = run(scenario, [id], duration_s=DURATION).results
    return path, result


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_outputs_are_bit_identical_to_those_of_a_run(system, backend):
    path, result = system
    calls = []
    found = run_ssp(path, stop_time=DURATION, backend=backend, progress=lambda *done: calls.append(done))
    places, named = np.round(result.time / found.step).astype(int) - 1, found.named()
    assert len(places) > 100
    for name, values in result.outputs.items():
        np.testing.assert_array_equal(named[f"estimator.{name}"][places], values, err_msg=name)
    assert calls[-1] == (found.steps, found.steps)
    seventh = run_ssp(path, stop_time=DURATION, every=7, backend=backend)
    np.testing.assert_array_equal(seventh.values, found.values[6::7])
    np.testing.assert_array_equal(seventh.time, found.time[6::7])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_failed_step_is_reported_with_its_component_and_reason(system, backend):
    with pytest.raises(
        InsenvError, match=r"\.ssp, component estimator: the step failed at step 0, t = 0 s .*allowed is one sample interval"
    ):
        run_ssp(system[0], stop_time=1.0, step=0.05, backend=backend)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_component_that_ends_the_simulation_gives_the_rows_until_then(system, backend, monkeypatch):
    monkeypatch.setattr(Instance, "ends", lambda self, status: True)
    whole = run_ssp(system[0], stop_time=0.5, backend=backend)
    with monkeypatch.context() as patch:
        patch.setattr(stepping, "native", ending_at(system, stepping.native))
        patch.setattr(stepping, "interpreted", ending_at(system, stepping.interpreted))
        found = run_ssp(system[0], stop_time=0.5, every=4, backend=backend)
    assert found.ended
    assert not whole.ended
    assert (found.steps, len(found.time)) == (40, 10)
    np.testing.assert_array_equal(found.values, whole.values[3:40:4])


def ending_at(system, make):
    """Steps of `make` of which step 42 is refused by the FMU because its length is changed."""

    def steps(plan):
        whole, wrong = make(plan), make(replace(plan, step=0.4 * plan.step))

        def block(first, count):
            if first + count <= 42:
                return whole(first, count)
            made, _ = whole(first, 42 - first)
            _, stopped = wrong(42, 1)
            return made, stopped

        return block

    return steps


@pytest.mark.parametrize("version", [2, 3])
def test_values_of_all_types_pass_natively_as_in_python(version):
    kinds = [np.dtype(kind) for kind in stepping.KINDS]
    pairs = [(a, b) for a in kinds for b in kinds if np.can_cast(a, b, "safe")]
    assert len(pairs) > 40

    def outputs(make):
        given = {kind: np.zeros(3, dtype=kind) for kind in kinds}
        taken = [np.zeros(3, dtype=b) for _, b in pairs]
        flags = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double())

        def advance(instance, now, *rest):
            if instance == 1:
                for kind, row in given.items():
                    low, high = (
                        (0, 1)
                        if kind.kind == "b"
                        else (-7, 9)
                        if kind.kind == "f"
                        else (np.iinfo(kind).min, np.iinfo(kind).max)
                    )
                    row[:] = [low, high, now]
            return 0

        function = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double)(advance)
        address = ctypes.cast(function, ctypes.c_void_p).value
        first, second = (
            Ports(f"part{n}", version, n, [], [], {}, {}, Step(lambda now, step, n=n: advance(n, now), address, flags))
            for n in (1, 2)
        )
        first.outputs = {f"{kind}[{i}]": (row, i) for kind, row in given.items() for i in range(3)}
        second.inputs = {f"{a}-{b}[{i}]": (row, i) for (a, b), row in zip(pairs, taken, strict=True) for i in range(3)}
        second.outputs = second.inputs
        for a, b in pairs:
            for i in range(3):
                second.connect(f"{a}-{b}[{i}]", first, f"{a}[{i}]")
        values = np.empty((2, len(first.outputs) + len(second.outputs)))
        assert make(Plan([first, second], values, 1.0, 1.0, 2))(0, 4) == (4, None)
        return values

    found, wanted = outputs(stepping.native), outputs(stepping.interpreted)
    np.testing.assert_array_equal(found, wanted)
    assert found[0, 2] == 2.0
    assert found[1, 2] == 4.0


@pytest.mark.parametrize("make", [stepping.native, stepping.interpreted])
def test_the_flag_of_fmi_3_ends_the_simulation(make):
    flags = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double())

    def advance(instance, now, step):
        flags[1].value = now >= 3.0
        return 0

    function = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double)(advance)
    step = Step(lambda now, step: advance(1, now, step), ctypes.cast(function, ctypes.c_void_p).value, flags)
    part = Ports("part", 3, 1, [], [], {}, {"y": (np.zeros(1), 0)}, step)
    assert make(Plan([part], np.empty((9, 1)), 0.0, 1.0, 1))(0, 9) == (3, stepping.Stopped(0, stepping.STEP, 0))


def test_a_connection_that_loses_values_is_refused():
    row, flags = np.zeros(1), np.zeros(1, dtype=bool)
    step = Step(lambda now, step: 0, 0, ())
    source = Ports("a", 3, 0, [], [], {}, {"y": (row, 0)}, step)
    with pytest.raises(InputError, match=r"a connection from a\.y \(float64\) to b\.u \(bool\) would lose values"):
        Ports("b", 3, 0, [], [], {"u": (flags, 0)}, {}, step).connect("u", source, "y")


def changed(path, output, *changes):
    """The SSP file with the text of some of its files changed: name, old, new."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    for name, old, new in changes:
        assert old.encode() in files[name]
        files[name] = files[name].replace(old.encode(), new.encode())
    with zipfile.ZipFile(output, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return output


def test_the_parameter_sets_are_applied(system, tmp_path):
    path, _ = system
    with zipfile.ZipFile(path) as archive:
        (seed,) = re.findall(r'"parameters.seed">\s*<ssv:Real value="([^"]*)"', archive.read("resources/plant.ssv").decode())
    entry = '"parameters.seed">\n      <ssv:Real value="{}"'
    edited = changed(path, tmp_path / "x.ssp", ("resources/plant.ssv", entry.format(seed), entry.format("77")))
    found, wanted, own = (
        run_ssp(file, stop_time=1.0, parameters=given).values
        for file, given in ((edited, {}), (path, {"plant.seed": 77.0}), (path, {}))
    )
    np.testing.assert_array_equal(found, wanted)
    assert not np.array_equal(wanted, own)
    np.testing.assert_array_equal(run_ssp(edited, stop_time=1.0, parameters={"plant.seed": float(seed)}).values, own)


def test_a_parameter_set_in_the_system_is_applied(system, tmp_path):
    path, _ = system
    space = 'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"'
    values = (
        '<ssv:Parameters><ssv:Parameter name="plant.parameters.seed"><ssv:Real value="77"/></ssv:Parameter></ssv:Parameters>'
    )
    bound = (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        f"<ssv:ParameterSet {space} version='1.0' name='x'>{values}</ssv:ParameterSet>"
        "</ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
    )
    edited = changed(path, tmp_path / "x.ssp", ("SystemStructure.ssd", "<ssd:Elements>", bound + "<ssd:Elements>"))
    found, wanted = run_ssp(edited, stop_time=1.0), run_ssp(path, stop_time=1.0, parameters={"plant.seed": 77.0})
    np.testing.assert_array_equal(found.values, wanted.values)
    edited = changed(edited, tmp_path / "y.ssp", ("SystemStructure.ssd", '"plant.parameters.seed"', '"seed"'))
    with pytest.raises(InputError, match=r"parameter 'seed' of the system: allowed is COMPONENT\.NAME"):
        run_ssp(edited, stop_time=1.0)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        (
            "SystemStructure.ssd",
            "resources/plant.ssv",
            "resources/none.ssv",
            "parameter set 'resources/none.ssv' cannot be read",
        ),
        ("resources/plant.ssv", "<ssv:Parameters>", "<broken", "parameter set 'resources/plant.ssv' cannot be read"),
        ("resources/plant.ssv", 'name="parameters.seed"', 'name="parameters.sed"', "no scalar parameter 'parameters.sed'"),
        ("resources/estimator.ssv", 'unit="rad"', 'unit="deg"', r"in deg: allowed is the unit of the FMU, rad"),
        ("resources/plant.ssv", 'value="', 'value="x', r"= 'x.*': allowed is a number"),
        ("resources/plant.ssv", "ssv:Real", "ssv:String", "allowed is Real, Integer or Boolean"),
    ],
)
def test_a_wrong_parameter_set_is_named(system, tmp_path, file, old, new, said):
    edited = changed(system[0], tmp_path / "x.ssp", (file, old, new))
    refused(call("fmu", "run", edited, "--stop", "1"), "x.ssp")
    with pytest.raises(InputError, match=said):
        run_ssp(edited, stop_time=1.0)


def test_the_command(system, tmp_path):
    path, _ = system
    output = tmp_path / "out.csv"
    status, out, err = call("fmu", "run", path, "--stop", "1", "--every", "10", "--set", "plant.seed=5", "-o", output, "--json")
    assert status == 0, err
    assert strict(out)["steps"] == 200
    assert output.read_text().startswith("time,plant.")
    refused(call("fmu", "run", path, "--set", "planet.seed=5"), "planet.seed", "plant, estimator")
    refused(call("fmu", "run", path, "--input", output), "--input", "--input is allowed with an .fmu file")
    refused(call("fmu", "run", tmp_path / "none.ssp"), "no such file")


def test_a_ring_and_other_wrong_systems_are_named(system, tmp_path):
    path, _ = system
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    ssd = files["SystemStructure.ssd"].decode()
    ring = '<ssd:Connection startElement="estimator" startConnector="q_nb[1]" endElement="plant" endConnector="x" />'
    for changed, said in (
        (ssd.replace("</ssd:Connections>", ring + "</ssd:Connections>"), "plant, estimator form a ring"),
        (ssd.replace("resources/plant.fmu", "resources/none.fmu"), "no file 'resources/none.fmu'"),
        (ssd.replace('startConnector="delta_angle[1]"', 'startConnector="delta"'), "no output 'delta'"),
        ("<broken", "not an SSP file"),
    ):
        with zipfile.ZipFile(tmp_path / "x.ssp", "w") as archive:
            for name, content in {**files, "SystemStructure.ssd": changed.encode()}.items():
                archive.writestr(name, content)
        with pytest.raises(InputError, match=said):
            run_ssp(tmp_path / "x.ssp", stop_time=1.0)

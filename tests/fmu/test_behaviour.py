"""Behaviour of exported FMUs in an importer: FMPy's low-level instances, simulate_fmu and compile."""

import contextlib
import io
import os
import subprocess
import sys
from ctypes import byref
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy
from fmu_tools import exported, unzipped
from places import ROOT

from insenv import estimators
from insenv.core.compile import find_compiler
from insenv.core.runner import make_runner
from insenv.fmu import export_fmu
from insenv.fmu.subject import subject

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler found")

IDS = ("qakf-improved", "loosely-coupled", "ship-swaying")

LONG = ("aqe-sukf-printed", "fusion", "fusion-smoother")
"""Long to compile; each has the equations of an estimator that runs here, or in test_fusion_fmu.py."""


class Slave:
    """An instance of either version, with values in the flat order of the tables and a list of its messages."""

    def __init__(self, id, fmi, folder=None, start=True, stop_time=None):
        self.what, self.fmi, self.said = subject(id, {}), fmi, []
        folder = str(folder or unzipped(id, fmi))
        description = fmpy.read_model_description(folder, validate=False)
        shared = {
            "guid": description.guid or description.instantiationToken,
            "unzipDirectory": folder,
            "modelIdentifier": description.coSimulation.modelIdentifier,
            "instanceName": "one",
        }
        listed = {
            kind: [v for v in description.modelVariables if v.causality == kind] for kind in ("parameter", "input", "output")
        }
        self.references = {kind: [v.valueReference for v in found] for kind, found in listed.items()}
        self.booleans = {v.valueReference for v in description.modelVariables if v.type == "Boolean"}
        self.widths = {v.valueReference: int(np.prod([int(d.start) for d in v.dimensions])) for v in description.modelVariables}
        self.names = {v.name: v.valueReference for v in description.modelVariables}
        model = self.what.model
        self.shown = np.concatenate([np.full(row.size, row.name != "time") for row in model.outputs])
        if fmi == 2:
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(lambda e, name, *message: self.said.append(message))
            addLoggerProxy(byref(callbacks))  # formats the message
            self.fmu = fmi2.FMU2Slave(**shared)
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu = fmi3.FMU3Slave(**shared)
            self.fmu.instantiate(logMessage=lambda e, status, category, text: self.said.append((status, category, text)))
        if start:
            self.begin(stop_time)

    def begin(self, stop_time=None, start_time=0.0):
        if self.fmi == 2:
            self.fmu.setupExperiment(startTime=start_time, stopTime=stop_time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start_time, stopTime=stop_time)
        self.fmu.exitInitializationMode()

    def set(self, references, values):
        """Set variables; the values of all are flat, in order."""
        places = np.cumsum([0, *(self.widths.get(reference, 1) for reference in references)])
        for number, reference in enumerate(references):
            if reference in self.booleans:
                self.fmu.setBoolean([reference], [bool(values[places[number]])])
        numbers = [r for r in references if r not in self.booleans]
        kept = [values[i] for n, r in enumerate(references) if r not in self.booleans for i in range(places[n], places[n + 1])]
        if numbers:
            (self.fmu.setReal if self.fmi == 2 else self.fmu.setFloat64)(numbers, kept)

    def outputs(self):
        """All outputs, flat."""
        found = []
        numbers = [r for r in self.references["output"] if r not in self.booleans]
        if self.fmi == 2:
            values = list(self.fmu.getReal(numbers))
        else:
            values = list(self.fmu.getFloat64(numbers, sum(self.widths[r] for r in numbers)))
        for reference in self.references["output"]:
            if reference in self.booleans:
                found += [float(value) for value in self.fmu.getBoolean([reference])]
            else:
                found += [values.pop(0) for _ in range(self.widths[reference])]
        return found

    def step(self, k, n=1):
        self.fmu.doStep(currentCommunicationPoint=k * self.interval, communicationStepSize=n * self.interval)

    @property
    def interval(self):
        return self.what.sample_interval

    def run(self, rows, first=0, n=1):
        """Make steps of n samples with a row of inputs each; return the outputs after each."""
        found = np.empty((len(rows), int(self.shown.sum())))
        for k, row in enumerate(rows):
            if row.size:
                self.set(self.references["input"], row.tolist())
            self.step(first + k * n, n)
            found[k] = self.outputs()
        return found

    def refused(self, call, *words):
        """Check that the call ends with an error status and one message that contains all words."""
        self.said.clear()
        with pytest.raises(FMICallException) as raised:
            call()
        assert raised.value.status == 3 and len(self.said) == 1, self.said
        status, category, text = self.said[0]
        assert (status, category) == (3, b"logStatusError")
        assert all(word in text.decode() for word in words), text

    def state(self):
        return self.fmu.getFMUState() if self.fmi == 3 else self.fmu.getFMUstate()

    def restore(self, state):
        (self.fmu.setFMUState if self.fmi == 3 else self.fmu.setFMUstate)(state)

    def free(self):
        self.fmu.freeInstance()


@pytest.fixture
def slave():
    """Create instances that are freed at the end."""
    with contextlib.ExitStack() as stack:

        def make(*arguments, **named):
            made = Slave(*arguments, **named)
            stack.callback(made.free)
            return made

        yield make


def rows_for(id, count):
    """Inputs of the reference signals, repeated."""
    from insenv.fmu.reference import signals

    what = subject(id, {})
    if not what.model.inputs.size:
        return np.zeros((count, 0))
    inputs = signals(what)[0]
    return inputs[np.arange(count) % len(inputs)]


def expected(id, rows, shown):
    what = subject(id, {})
    return make_runner(what.model, what.parameters).run(len(rows), rows if rows.size else None)[:, shown]


@pytest.mark.parametrize("fmi", (2, 3))
@pytest.mark.parametrize("id", IDS)
def test_outputs_are_bit_identical_to_those_of_the_model(slave, id, fmi):
    count = 60_000 if (id, fmi) in (("qakf-improved", 2), ("ship-swaying", 3)) else 2_000
    rows, one = rows_for(id, count), slave(id, fmi)
    start = make_runner(one.what.model, one.what.parameters).output()[one.shown]
    np.testing.assert_array_equal(one.outputs(), start)
    np.testing.assert_array_equal(one.run(rows), expected(id, rows, one.shown))


@pytest.mark.parametrize(("id", "fmi"), (("loosely-coupled", 2), ("qakf-improved", 3)))
def test_simulate_fmu_gives_the_same_and_the_reference_signals(id, fmi):
    folder = unzipped(id, fmi) / "extra" / "org.fmi-standard.fmi-ls-ref"
    inputs = fmpy.read_csv(str(folder / "in.csv"))
    if fmi == 3:  # FMPy accepts inputs of one shape only; dt keeps its start value, the sample interval
        assert (inputs["dt"] == 0.005).all()
        inputs = inputs[["time", "delta_angle", "delta_velocity"]]
    found = fmpy.simulate_fmu(str(exported(id, fmi)), input=inputs, output_interval=0.005, stop_time=1.5, validate=False)
    reference = fmpy.read_csv(str(folder / "ref.csv"))
    assert len(found) == 301 and found.dtype.names == reference.dtype.names
    for name in reference.dtype.names[1:]:
        np.testing.assert_array_equal(found[name][::10], reference[name], err_msg=name)
    np.testing.assert_allclose(found["time"][::10], reference["time"], rtol=1e-12)
    assert id != "loosely-coupled" or inputs["gnss_valid"].sum() == 1  # a fix arrived


def test_simulate_fmu_takes_all_inputs_of_fmi_3_without_arrays(tmp_path):
    path = export_fmu("loosely-coupled", tmp_path / "x.fmu", fmi=3, arrays=False)
    with ZipFile(path) as archive:
        for name in ("in.csv", "ref.csv"):
            (tmp_path / name).write_bytes(archive.read(f"extra/org.fmi-standard.fmi-ls-ref/{name}"))
    inputs, reference = (fmpy.read_csv(str(tmp_path / name)) for name in ("in.csv", "ref.csv"))
    assert {"dt", "delta_angle[1]", "gnss_valid", "gnss_velocity_n[3]"} <= set(inputs.dtype.names)
    found = fmpy.simulate_fmu(str(path), input=inputs, output_interval=0.005, stop_time=1.5, validate=False)
    for name in reference.dtype.names[1:]:
        np.testing.assert_array_equal(found[name][::10], reference[name], err_msg=name)


def test_simulate_fmu_gets_the_reason_for_a_refused_interval():
    path = str(exported("qakf-improved", 2))
    said = []
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(path, output_interval=0.0123, validate=False, logger=lambda *message: said.append(message[-1]))
    assert b"communication step is 0.0123" in said[-1] and b"one sample interval, 0.005 s" in said[-1]


@pytest.mark.parametrize("fmi", (pytest.param(2, marks=pytest.mark.slow), 3))
def test_a_plant_takes_several_samples_a_step_and_holds_its_commands(slave, fmi):
    one = slave("ship-underway", fmi)
    inputs = one.what.model.inputs
    commands = np.zeros((30, inputs.size))
    commands[10:20, inputs.slice("command_speed")] = 4.0
    commands[10:20, inputs.slice("command_valid")] = 1.0
    held = np.repeat(commands, 10, axis=0)
    np.testing.assert_array_equal(one.run(commands, n=10), expected("ship-underway", held, one.shown)[9::10])


@pytest.mark.parametrize("fmi", (pytest.param(2, marks=pytest.mark.slow), 3))
@pytest.mark.parametrize("id", [pytest.param(id, marks=[pytest.mark.slow] * (id in LONG)) for id in estimators.registered()])
def test_an_estimator_takes_one_sample_a_step(slave, id, fmi):
    one = slave(id, fmi)
    for step in (0.01, 0.16, 1.0, 0.0025):
        one.refused(
            lambda step=step: one.fmu.doStep(0.0, step), "allowed is one sample interval, 0.005 s", "output_interval=0.005"
        )


def test_the_default_step_of_fmpy_is_refused_with_the_step_to_set():
    said, rows = [], np.zeros(20_000, dtype=[(name, float) for name in ("time", "delta_velocity[3]")])
    rows["time"], rows["delta_velocity[3]"] = 0.005 * np.arange(len(rows)), -9.8 * 0.005
    path = str(exported("q-method", 2))
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(path, input=rows, stop_time=100.0, validate=False, logger=lambda *message: said.append(message[-1]))
    assert b"communication step is 0.16 s" in said[-1] and b"output_interval=0.005" in said[-1]


@pytest.mark.parametrize("fmi", (2, 3))
@pytest.mark.parametrize("id", ("qakf-improved", "loosely-coupled"))
def test_a_step_can_be_one_increment_of_its_own_length(slave, id, fmi):
    rows, one = rows_for(id, 200), slave(id, fmi, start=False)
    one.set([one.names["parameters.step_is_one_increment"]], [True])
    one.begin()
    lengths = np.tile([0.005, 0.01, 0.16, 0.0042], 50)
    rows[:, one.what.model.inputs.slice("dt")] = lengths[:, None]
    wanted, time = expected(id, rows, one.shown), 0.0
    for k, length in enumerate(lengths):
        row = rows[k].copy()
        row[one.what.model.inputs.slice("dt")] = 0.005  # dt follows the step, whatever it was
        one.set(one.references["input"], row.tolist())
        one.fmu.doStep(time, length)
        time += length
        np.testing.assert_array_equal(one.outputs(), wanted[k])
    one.refused(lambda: one.fmu.doStep(time, 11.0), "communication step is 11 s", "1e-06 to 10 s")


@pytest.mark.parametrize("fmi", (2, 3))
@pytest.mark.parametrize("id", ("qakf-improved", "ship-swaying"))
def test_the_rest_of_summed_up_steps_counts_as_done(slave, id, fmi):
    """An importer that sums up its steps ends 400 steps of 0.005 s 2e-14 s before 2 s."""
    rows, one, time = rows_for(id, 401), slave(id, fmi, stop_time=2.0), 0.0
    while time < 2.0:
        step = min(0.005, 2.0 - time)
        row = rows[round(time / 0.005)]
        if row.size:
            one.set(one.references["input"], row.tolist())
        one.fmu.doStep(time, step)
        time += step
    assert step < 1e-12
    np.testing.assert_array_equal(one.outputs(), expected(id, rows[:400], one.shown)[-1])


def test_dt_must_be_about_the_step(slave):
    one = slave("qakf-improved", 2)
    for dt in (9.9, 0.011, 0.0024):
        one.set([one.names["dt"]], [dt])
        one.refused(lambda: one.step(0), f"dt = {dt:g} s in a step of 0.005 s", "half to twice the step")
    one.set([one.names["dt"]], [0.0051])
    one.step(0)


@pytest.mark.parametrize("fmi", (2, 3))
def test_what_a_flag_switches_off_may_be_nan(slave, fmi):
    rows, one = rows_for("loosely-coupled", 300), slave("loosely-coupled", fmi)
    wanted, inputs = expected("loosely-coupled", rows, one.shown), one.what.model.inputs
    assert rows[:, inputs.slice("gnss_valid")].sum() == 1
    off = rows[:, inputs.slice("gnss_valid")][:, 0] == 0
    for name in inputs.names:
        if name.startswith("gnss_") and not inputs[name].flag:
            rows[off, inputs.slice(name)] = np.nan
    np.testing.assert_array_equal(one.run(rows), wanted)
    one.set([one.names["gnss_valid"]], [True])
    one.refused(lambda: one.step(300), "gnss_age = nan s", "allowed is a finite number")


def test_flags_are_booleans(slave):
    one = slave("loosely-coupled", 2)
    assert {one.names[name] for name in ("gnss_valid", "gnss_velocity_valid", "standing")} <= one.booleans
    one.refused(lambda: one.fmu.setReal([one.names["gnss_valid"]], [1.0]), "gnss_valid is a Boolean")
    one.refused(lambda: one.fmu.getBoolean([one.names["gnss_age"]]), "gnss_age is a Real")


@pytest.mark.parametrize("fmi", (2, 3))
def test_a_tunable_parameter_counts_from_the_next_step(slave, fmi):
    rows, one = rows_for("loosely-coupled", 600), slave("loosely-coupled", fmi)
    model = one.what.model
    runner = make_runner(model, one.what.parameters)
    wanted = [runner.run(250, rows[:250])]
    changed = one.what.parameters.copy()
    changed[model.parameters.slice("innovation_gate")] = 0.5
    changed[model.parameters.slice("angle_random_walk")] *= 3
    runner.p[:] = changed
    wanted.append(runner.run(350, rows[250:]))
    found = [one.run(rows[:250])]
    values = [0.5, float(changed[model.parameters.slice("angle_random_walk")][0])]
    one.set([one.names[f"parameters.{name}"] for name in ("innovation_gate", "angle_random_walk")], values)
    found.append(one.run(rows[250:], first=250))
    np.testing.assert_array_equal(np.concatenate(found), np.concatenate(wanted)[:, one.shown])
    one.refused(lambda: one.set([one.names["parameters.innovation_gate"]], [-1.0]), "innovation_gate = -1")
    one.refused(lambda: one.set([one.names["parameters.heading_sigma"]], [0.1]), "heading_sigma cannot be set in this state")


@pytest.mark.parametrize("fmi", (2, 3))
@pytest.mark.parametrize("id", IDS)
def test_a_run_from_a_restored_state_is_bit_identical(slave, id, fmi):
    rows, one = rows_for(id, 400), slave(id, fmi)
    one.run(rows[:250])
    state = one.state()
    ahead = one.run(rows[250:], first=250)
    one.restore(state)
    np.testing.assert_array_equal(one.run(rows[250:], first=250), ahead)
    another = slave(id, fmi)
    another.restore(state)  # in an instance that has not run
    np.testing.assert_array_equal(another.run(rows[250:], first=250), ahead)


OTHER_PROCESS = """
import sys; sys.path[:0] = {path!r}
import numpy as np
from test_behaviour import Slave, rows_for
one = Slave({id!r}, {fmi}, folder={folder!r})
data = open({state!r}, "rb").read()
load = one.fmu.deSerializeFMUstate if {fmi} == 2 else one.fmu.deserializeFMUState
one.restore(load(data))
np.save({out!r}, one.run(rows_for({id!r}, 400)[250:], first=250))
"""


@pytest.mark.parametrize(("id", "fmi"), (("loosely-coupled", 2), ("ship-swaying", 3)))
def test_a_serialized_state_continues_in_another_process(slave, tmp_path, id, fmi):
    rows, one = rows_for(id, 400), slave(id, fmi)
    one.run(rows[:250])
    save = one.fmu.serializeFMUstate if fmi == 2 else one.fmu.serializeFMUState
    data = bytes(save(one.state()))
    (tmp_path / "state").write_bytes(data)
    script = OTHER_PROCESS.format(
        path=[os.path.dirname(__file__), str(ROOT / "tests" / "helpers")],
        id=id,
        fmi=fmi,
        folder=str(unzipped(id, fmi)),
        state=str(tmp_path / "state"),
        out=str(tmp_path / "out.npy"),
    )
    subprocess.run([sys.executable, "-c", script], check=True)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), one.run(rows[250:], first=250))
    load = one.fmu.deSerializeFMUstate if fmi == 2 else one.fmu.deserializeFMUState
    for broken in (b"", data[:-1], bytes(len(data)), data[:200] + b"x" + data[201:]):
        one.refused(lambda broken=broken: load(broken), "serialized state")


@pytest.mark.parametrize("fmi", (2, 3))
def test_two_instances_interleaved_and_a_reset(slave, fmi):
    rows, one, two = rows_for("qakf-improved", 100), slave("qakf-improved", fmi), slave("qakf-improved", fmi)
    wanted = expected("qakf-improved", rows, one.shown)
    for k in range(100):
        np.testing.assert_array_equal(one.run(rows[k : k + 1], first=k)[0], wanted[k])
        if k % 2 == 0:
            np.testing.assert_array_equal(two.run(rows[k // 2 : k // 2 + 1], first=k // 2)[0], wanted[k // 2])
    one.fmu.reset()
    one.begin()
    np.testing.assert_array_equal(one.run(rows), wanted)


@pytest.mark.parametrize("fmi", (2, 3))
def test_steps_of_another_length_are_refused(slave, fmi):
    rows, one = rows_for("qakf-improved", 20), slave("qakf-improved", fmi, stop_time=0.2)
    for step in (0.0, -0.005, 0.0049, 0.0075, 0.01, float("nan"), float("inf"), 1e300):
        one.refused(lambda step=step: one.fmu.doStep(0.0, step), "communication step is", "sample interval")
    for point in (0.005, -1.0, float("nan")):
        one.refused(lambda point=point: one.fmu.doStep(point, 0.005), "communication point is", "the instance stands at 0 s")
    # the refused calls have changed nothing; times with rounding errors are accepted
    np.testing.assert_array_equal(one.run(rows), expected("qakf-improved", rows, one.shown))
    one.fmu.doStep(0.1 + 1e-13, 0.1 + 0.005 - 0.1)
    plant = slave("ship-swaying", fmi, stop_time=0.2)
    plant.refused(lambda: plant.fmu.doStep(0.0, 0.205), "passes the stop time, 0.2 s")
    plant.refused(lambda: plant.fmu.doStep(0.0, 0.0075), "communication step is", "whole number of sample intervals")


@pytest.mark.parametrize("fmi", (2, 3))
def test_values_that_are_not_allowed_are_refused(slave, fmi):
    one = slave("loosely-coupled", fmi, start=False)
    reference = {name: one.names[f"parameters.{name}"] for name in ("start_latitude", "heading_sigma")}
    one.refused(lambda: one.set([reference["start_latitude"]], [2.0]), "start_latitude = 2 rad", "-1.5708 to 1.5708")
    one.refused(lambda: one.set([reference["heading_sigma"]], [float("nan")]), "heading_sigma = nan rad")
    one.refused(lambda: one.set([99_999], [0.0]), "no variable has the value reference 99999")
    one.refused(lambda: one.set([one.names["sample_interval"]], [0.01]), "sample_interval cannot be set")
    one.refused(lambda: one.step(0), "not allowed in this state (instantiated)")
    one.begin()
    one.refused(lambda: one.set([reference["heading_sigma"]], [0.1]), "heading_sigma cannot be set in this state: step mode")
    one.refused(lambda: one.set([one.references["output"][0]], [1.0] * (4 if fmi == 3 else 1)), "cannot be set")
    rows = rows_for("loosely-coupled", 210)
    for value in (float("nan"), float("-inf")):
        row = rows[0].tolist()
        row[1] = value
        one.refused(lambda row=row: one.set(one.references["input"], row), "delta_angle", "allowed is a finite number")
    one.set([one.names["dt"]], [0.0])
    one.refused(lambda: one.step(0), "dt = 0 s: allowed is a finite number from 1e-06 to 10")
    # the inputs of a fix are checked only if there is a fix
    one.set(one.references["input"], rows[0].tolist())
    one.set([one.names["gnss_latitude"], one.names["gnss_height"]], [9.0, 1e9])
    one.step(0)
    one.set([one.names["gnss_valid"]], [1.0])
    one.refused(lambda: one.step(1), "gnss_latitude = 9 rad")
    one.fmu.terminate()
    one.refused(lambda: one.step(1), "not allowed in this state (terminated)")


def test_an_instance_that_diverges_reports_it_and_can_be_reset(slave):
    rows, one = rows_for("wander-sins", 20), slave("wander-sins", 2)
    row = rows[0].copy()
    row[:6] = 1e3, 1e3, 1e3, 1e5, 1e5, 1e5
    one.said.clear()
    with pytest.raises(FMICallException):
        for k in range(20_000):
            one.set(one.references["input"], row.tolist())
            one.step(k)
    assert b"diverged" in one.said[-1][2]
    one.refused(lambda: one.step(0), "not allowed in this state (failed)")
    one.fmu.reset()
    one.begin()
    np.testing.assert_array_equal(one.run(rows), expected("wander-sins", rows, one.shown))


def test_parameters_set_before_the_start_are_those_of_the_model(slave):
    one = slave("ship-swaying", 2, start=False)
    one.set([one.names["parameters.seed"]], [7.0])
    one.begin()
    p = one.what.parameters.copy()
    p[one.what.model.parameters.slice("seed")] = 7.0
    wanted = make_runner(one.what.model, p).run(50)[:, one.shown]
    np.testing.assert_array_equal(one.run(np.zeros((50, 0))), wanted)


def test_debug_logging_reports_the_states(slave):
    one = slave("qakf-improved", 3)
    assert one.said == []
    one.fmu.setDebugLogging(True, ["logEvents"])
    one.fmu.terminate()
    assert one.said == [(0, b"logEvents", b"terminated")]
    one.refused(lambda: one.fmu.setDebugLogging(True, ["logAny"]), "no category logAny")


@pytest.mark.parametrize("fmi", (2, 3))
def test_the_sources_rebuild_to_the_same_outputs(slave, tmp_path, fmi):
    import shutil

    from fmpy.build import build_platform_binary

    if shutil.which("cmake") is None:
        pytest.skip("fmpy compile needs cmake")
    folder, built = tmp_path / "x", tmp_path / "built"
    built.mkdir()
    shutil.copytree(unzipped("qakf-improved", fmi), folder)
    shutil.rmtree(folder / "binaries")
    with contextlib.redirect_stdout(io.StringIO()):
        build_platform_binary(folder, build_dir=built)
    assert any((folder / "binaries").rglob("qakf_improved.*"))
    rows, one = rows_for("qakf-improved", 500), slave("qakf-improved", fmi, folder=folder)
    np.testing.assert_array_equal(one.run(rows), expected("qakf-improved", rows, one.shown))


@pytest.mark.parametrize("fmi", (2, 3))
@pytest.mark.parametrize("id", ("qakf-improved", "ship-swaying"))
def test_steps_follow_the_start_time(slave, id, fmi):
    """The equations know no time: the outputs are those from 0; time, steps and stop time count from the start."""
    begin, one = 37.25, slave(id, fmi, start=False)
    one.begin(begin + 60 * one.interval, begin)
    rows, first = rows_for(id, 50), round(begin / one.interval)
    assert first * one.interval == pytest.approx(begin, abs=1e-9)

    def now():
        return float((one.fmu.getReal if fmi == 2 else one.fmu.getFloat64)([one.names["time"]])[0])

    np.testing.assert_array_equal(one.run(rows, first), expected(id, rows, one.shown))
    assert now() == pytest.approx(begin + 50 * one.interval, abs=1e-9)
    one.refused(lambda: one.step(0), "communication point")
    if id == "ship-swaying":  # a plant makes many samples in a step
        one.step(first + 50, 5)
        assert now() == pytest.approx(begin + 55 * one.interval, abs=1e-9)
        one.refused(lambda: one.step(first + 55, 8), "passes the stop time")

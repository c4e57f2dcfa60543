"""The C interface of exported FMUs in an importer, FMPy."""

import contextlib
import functools
import io
import re
import shutil
from ctypes import byref

import fmpy
import numpy as np
import pytest
from fmpy import fmi2, fmi3
from fmpy.build import build_platform_binary
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy
from fmu_tools import LOOP, exported, subject_of, unzipped

from insenv.core.runner import make_runner
from insenv.fmu.exporter import signals as reference_signals
from insenv.scenario.inputs import SAMPLES

ALIGNMENT, AIDED = "qakf-improved", "lssvm"
PLANT = {2: "ship-swaying", 3: LOOP}
both = pytest.mark.parametrize("fmi", (2, 3))


class Slave:
    """An instance; values in the flat order of the tables.  Of FMI 2, FMPy gives messages to the last instance alone."""

    def __init__(self, id, fmi, folder=None, start=True, stop_time=None):
        self.what, self.fmi, self.said = subject_of(id), fmi, []
        self.model, self.interval = self.what.model, self.what.sample_interval
        folder = str(folder or unzipped(id, fmi))
        read = fmpy.read_model_description(folder, validate=False)
        self.references = {
            kind: [v.valueReference for v in read.modelVariables if v.causality == kind and v.name != "sample_number"]
            for kind in ("input", "output")
        }
        self.booleans = {v.valueReference for v in read.modelVariables if v.type == "Boolean"}
        self.widths = {v.valueReference: int(np.prod([int(d.start) for d in v.dimensions])) for v in read.modelVariables}
        self.names = {v.name: v.valueReference for v in read.modelVariables}
        self.increments = {number for name, number in self.names.items() if re.match(r"delta_(angle|velocity)(\[|$)", name)}
        self.shown = np.concatenate([np.full(row.size, row.name != "time") for row in self.model.outputs])
        token, module = read.guid or read.instantiationToken, read.coSimulation.modelIdentifier
        kind = fmi2.FMU2Slave if fmi == 2 else fmi3.FMU3Slave
        self.fmu = kind(guid=token, unzipDirectory=folder, modelIdentifier=module, instanceName="one")
        if fmi == 2:
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(lambda e, name, *message: self.said.append(message))
            addLoggerProxy(byref(callbacks))  # formats the message
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu.instantiate(logMessage=lambda e, *message: self.said.append(message))
        calls = {name.lower(): getattr(self.fmu, name) for name in dir(self.fmu)}  # FMI 3 spells some in another way
        self.state, self.restore = calls["getfmustate"], calls["setfmustate"]
        self.serialize, self.deserialize = calls["serializefmustate"], calls["deserializefmustate"]
        if start:
            self.begin(stop_time)

    def begin(self, stop_time=None, start_time=0.0):
        times = {"startTime": start_time, "stopTime": stop_time}
        if self.fmi == 2:
            self.fmu.setupExperiment(**times)
        self.fmu.enterInitializationMode(**({} if self.fmi == 2 else times))
        self.fmu.exitInitializationMode()

    def set(self, references, values):
        """Set variables; the values of all are flat, in order."""
        places = np.cumsum([0, *(self.widths[reference] for reference in references)])
        parts = {r: list(values[places[n] : places[n + 1]]) for n, r in enumerate(references)}
        for known in self.booleans & parts.keys():
            self.fmu.setBoolean([known], [bool(value) for value in parts.pop(known)])
        if parts:
            write = self.fmu.setReal if self.fmi == 2 else self.fmu.setFloat64
            write(list(parts), [value for part in parts.values() for value in part])

    def give(self, **values):
        """Set variables of one element, parameters and inputs, by name."""
        known = [name if name in self.names else f"parameters.{name}" for name in values]
        self.set([self.names[name] for name in known], list(values.values()))

    def get(self, references):
        if references[0] in self.booleans:
            return self.fmu.getBoolean(references)
        if self.fmi == 2:
            return self.fmu.getReal(references)
        return self.fmu.getFloat64(references, sum(self.widths[r] for r in references))

    def outputs(self):
        return [float(value) for r in self.references["output"] for value in self.get([r])]

    @property
    def now(self):
        return self.get([self.names["time"]])[0]

    @property
    def stepped_to(self):
        """Until when steps succeeded, as the FMU tells: FMI 3 with each step, FMI 2 when it is asked."""
        return self.told[-1] if self.fmi == 3 else self.fmu.getRealStatus(fmi2.fmi2LastSuccessfulTime)

    def step(self, k, n=1):
        self.told = self.fmu.doStep(currentCommunicationPoint=k * self.interval, communicationStepSize=n * self.interval)

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

    def no_step(self, point, length, *words):
        self.refused(lambda: self.fmu.doStep(point, length), *words)


@pytest.fixture
def slave():
    with contextlib.ExitStack() as stack:

        def make(*arguments, **named):
            made = Slave(*arguments, **named)
            stack.callback(made.fmu.freeInstance)
            return made

        yield make


@functools.cache
def signals(id):
    return reference_signals(subject_of(id))[0]


def rows_for(id, count):
    return signals(id)[np.arange(count) % SAMPLES].copy()


def expected(one, rows):
    return make_runner(one.model, one.what.parameters).run(len(rows), rows if rows.size else None)[:, one.shown]


@both
def test_states_are_saved_restored_and_serialized_and_a_reset_begins_anew(slave, fmi):
    rows, one, two = rows_for(ALIGNMENT, 100), slave(ALIGNMENT, fmi), slave(ALIGNMENT, fmi)
    np.testing.assert_array_equal(one.outputs(), make_runner(one.model, one.what.parameters).output()[one.shown])
    wanted = expected(one, rows)
    np.testing.assert_array_equal(one.run(rows[:60]), wanted[:60])
    state = one.state()
    data = bytes(one.serialize(state))
    two.restore(two.deserialize(data))
    for other in (one, two):
        np.testing.assert_array_equal(other.run(rows[60:], first=60), wanted[60:])
    one.restore(state)
    assert bytes(one.serialize(one.state())) == data
    one.fmu.reset()
    one.begin()
    np.testing.assert_array_equal(one.run(rows), wanted)


@both
def test_steps_follow_the_start_time(slave, fmi):
    """The equations know no time: the outputs are those from 0; time, steps and stop time count from the start."""
    begin, one = 37.25, slave(PLANT[fmi], fmi, start=False)
    one.begin(begin + 60 * one.interval, begin)
    rows, first = rows_for(PLANT[fmi], 50), round(begin / one.interval)
    np.testing.assert_array_equal(one.run(rows, first), expected(one, rows))
    assert one.now == one.stepped_to == pytest.approx(begin + 50 * one.interval, abs=1e-9)
    assert fmi == 3 or not one.fmu.getBooleanStatus(fmi2.fmi2Terminated)
    one.no_step(0.0, one.interval, "communication point")
    one.step(first + 50, 5)
    assert one.now == one.stepped_to == pytest.approx(begin + 55 * one.interval, abs=1e-9)
    assert fmi == 2 or one.told[:3] == (False, False, False)  # no event, no end, no early return
    one.refused(lambda: one.step(first + 55, 8), "passes the stop time")


@both
def test_steps_of_another_length_are_refused(slave, fmi):
    """Which changes nothing; times with rounding errors are accepted."""
    rows, one = rows_for(ALIGNMENT, 20), slave(ALIGNMENT, fmi, stop_time=0.2)
    for step in (0.0025, 0.0049, 0.01, float("nan"), 1e300):
        one.no_step(0.0, step, "communication step is", "allowed is one sample interval, 0.005 s", "output_interval=0.005")
    one.no_step(0.005, 0.005, "communication point is", "the instance stands at 0 s")
    np.testing.assert_array_equal(one.run(rows), expected(one, rows))
    one.fmu.doStep(0.1 + 1e-13, 0.1 + 0.005 - 0.1)
    plant = slave(PLANT[fmi], fmi, stop_time=0.2)
    plant.no_step(0.0, 0.205, "passes the stop time, 0.2 s")
    plant.no_step(0.0, 0.0075, "communication step is", "whole number of sample intervals")
    plant.no_step(0.0, 1e9, "communication step is", "up to 1e+09 sample intervals")
    plant.fmu.doStep(0.0, 0.05 - 1e-10)  # ten samples
    assert plant.now == pytest.approx(0.05, abs=1e-15)


@both
def test_a_long_sample_at_the_start_is_none_too_many(slave, fmi):
    """The first of a log may be longer than the step by up to three steps in all; from then on dt adds up to their time."""
    rows, one = rows_for(ALIGNMENT, 40), slave(ALIGNMENT, fmi)
    rows[:3, one.model.inputs.slice("dt")] = 0.0095
    np.testing.assert_array_equal(one.run(rows), expected(one, rows))


ONCE, BETWEEN, ADDS_UP = "samples count more than once", "The inputs lie between two samples", "dt adds up to"
IMPORTED = {  # samples a row, offset of the rows (samples), held or interpolated, a further column by row: what is refused
    "100 Hz": (2, 0, False, "", ONCE),
    "50 Hz between steps": (4, 0.5, False, "", ONCE),
    "190 Hz held": (1.05, 0, True, "", ONCE),
    "every tenth row, dt": (10, 0, False, "", ONCE),
    "100 Hz, dt": (2, 0, False, "dt", ADDS_UP),
    "125 Hz, numbered": (1.6, 0, False, "sample_number", BETWEEN),
    "half a step off, numbered": (1, 0.5, False, "sample_number", BETWEEN),
    "every second, numbered": (0.5, 0, True, "sample_number", "sample_number = 2 follows 0"),
}


@both
@pytest.mark.parametrize("case", IMPORTED)
def test_samples_that_an_importer_repeats_omits_or_interpolates_are_refused(slave, fmi, case):
    width, offset, held, further, said = IMPORTED[case]
    one, rows, steps = slave(ALIGNMENT, fmi), rows_for(ALIGNMENT, 1500), np.arange(1400)
    columns = np.column_stack([rows[:, :6], np.full(1500, width * one.interval) if further == "dt" else np.arange(1500)])
    place = np.maximum((steps - offset) / width, 0.0)  # of each step among the rows of the log
    share, first = (0.0 if held else place % 1.0), np.floor(place + 1e-9).astype(int)
    made = ((1 - share) * columns[first % 1500].T + share * columns[(first + 1) % 1500].T).T
    with pytest.raises(FMICallException):
        for k, (*increments, more) in enumerate(made.tolist()):
            one.set([r for r in one.references["input"] if r in one.increments], increments)
            if further:
                one.give(**{further: more})
            one.step(k)
    assert said in one.said[-1][2].decode(), one.said
    assert [message[1] for message in one.said[:-1]] == ([] if further else [b"logStatusWarning"])


@both
def test_right_samples_are_taken_with_and_without_their_numbers(slave, fmi):
    """Constant ones too, coarsely rounded ones, and any steps of a vehicle if they are numbered."""
    rows = rows_for(ALIGNMENT, 300)
    coarse = np.column_stack([np.round(rows[:, :6], 4), rows[:, 6:]])
    assert (np.diff(coarse[:, :6], axis=0) == 0).all(axis=1).any()
    for numbered, fed in ((0, rows), (1, rows), (0, rows[[0] * 300]), (0, coarse), (1, rows[np.arange(300) // 10 * 10])):
        one = slave(ALIGNMENT, fmi)
        for k, row in enumerate(fed):
            one.set(one.references["input"], row.tolist())
            one.give(sample_number=7.0 + k if numbered else -1.0)
            one.step(k)
        np.testing.assert_array_equal(one.outputs(), expected(one, fed)[-1])


@both
def test_an_estimator_waits_for_its_first_sample(slave, fmi):
    """Zeros before it are what a master has not passed on yet; zeros after it, and a numbered zero, are samples."""
    rows, one, two = rows_for(ALIGNMENT, 40), slave(ALIGNMENT, fmi), slave(ALIGNMENT, fmi)
    rows[:3, :6] = rows[20, :6] = 0.0
    begin = one.outputs()
    np.testing.assert_array_equal(one.run(rows[:3]), [begin] * 3)
    np.testing.assert_array_equal(one.run(rows[3:], first=3), expected(one, rows[3:]))
    two.give(sample_number=0)
    np.testing.assert_array_equal(two.run(rows[:1]), expected(two, rows[:1]))


@both
def test_the_rest_of_summed_up_steps_counts_as_done(slave, fmi):
    """An importer that sums up its steps ends 400 steps of 0.005 s 2e-14 s before 2 s."""
    rows, one, time = rows_for(ALIGNMENT, 401), slave(ALIGNMENT, fmi, stop_time=2.0), 0.0
    while time < 2.0:
        step = min(0.005, 2.0 - time)
        one.set(one.references["input"], rows[round(time / 0.005)].tolist())
        one.fmu.doStep(time, step)
        time += step
    assert step < 1e-12
    np.testing.assert_array_equal(one.outputs(), expected(one, rows[:400])[-1])


@both
def test_a_step_can_be_one_increment_of_its_own_length(slave, fmi):
    rows, one = rows_for(ALIGNMENT, 100), slave(ALIGNMENT, fmi, start=False)
    one.give(step_is_one_increment=True)
    one.begin()
    lengths, dt = np.tile([0.005, 0.01, 0.16, 0.0042], 25), one.model.inputs.slice("dt")
    rows[:, dt] = lengths[:, None]
    wanted, time = expected(one, rows), 0.0
    for k, length in enumerate(lengths):
        row = rows[k].copy()
        row[dt] = 0.005  # dt follows the step, whatever it was
        one.set(one.references["input"], row.tolist())
        one.fmu.doStep(time, length)
        time += length
        np.testing.assert_array_equal(one.outputs(), wanted[k])
    one.no_step(time, 11.0, "communication step is 11 s", "1e-06 to 10 s")


@both
def test_parameters_are_set_before_the_start_and_tunable_ones_between_steps(slave, fmi):
    rows, one = rows_for(ALIGNMENT, 120), slave(ALIGNMENT, fmi, start=False)
    one.give(latitude=0.7)
    one.begin()
    runner = make_runner(one.model, one.what.parameters)
    runner.p[one.model.parameters.slice("latitude")] = 0.7
    runner.start()
    np.testing.assert_array_equal(one.run(rows[:60]), runner.run(60, rows[:60])[:, one.shown])
    before = runner.output()
    noise = 3.0 * float(runner.p[one.model.parameters.slice("angle_random_walk")][0])
    runner.p[one.model.parameters.slice("angle_random_walk")] = noise
    one.give(angle_random_walk=noise)
    np.testing.assert_array_equal(one.outputs(), before[one.shown])  # it counts from the next step
    np.testing.assert_array_equal(one.run(rows[60:], first=60), runner.run(60, rows[60:])[:, one.shown])
    one.refused(lambda: one.give(angle_random_walk=-1.0), "angle_random_walk = -1")
    one.refused(lambda: one.give(latitude=0.1), "latitude cannot be set in this state: step mode")


@both
def test_values_that_are_not_allowed_are_refused(slave, fmi):
    plant = slave(PLANT[fmi], fmi, start=False)
    plant.refused(lambda: plant.give(seed=5.5), "parameters.seed = 5.5 : allowed is a whole number")
    one = slave(ALIGNMENT, fmi, start=False)
    one.refused(lambda: one.give(latitude=2.0), "latitude = 2 rad", "-1.5708 to 1.5708")
    one.refused(lambda: one.give(sample_interval=0.01), "sample_interval cannot be set")
    one.refused(lambda: one.step(0), "not allowed in this state (instantiated)")
    one.begin()
    row = rows_for(ALIGNMENT, 1)[0]
    row[1] = float("nan")
    one.refused(lambda: one.set(one.references["input"], row.tolist()), "delta_angle (element 2) = nan", "allowed is a finite")
    one.give(dt=0.0)
    one.refused(lambda: one.step(0), "dt = 0 s: allowed is a finite number from 1e-06 to 10")
    one.give(dt=0.011)
    one.refused(lambda: one.step(0), "dt = 0.011 s in a step of 0.005 s")


def test_inputs_count_where_their_flags_are_true(slave):
    """What they switch off may have any value; a velocity has the flag of the fix too.  Here FMI 3 has scalars for arrays."""
    one = slave(AIDED, 3, folder=unzipped(AIDED, 3, arrays=False))
    inputs = one.model.inputs
    assert {one.names[name] for name in ("gnss_valid", "gnss_velocity_valid")} <= one.booleans
    one.refused(lambda: one.fmu.setFloat64([one.names["gnss_valid"]], [1.0]), "gnss_valid is a Boolean")
    one.refused(lambda: one.fmu.getBoolean([one.names["gnss_age"]]), "gnss_age is a Float64")
    rows = rows_for(AIDED, 40)
    rows[10:20, inputs.slice("gnss_valid")] = rows[15:40, inputs.slice("gnss_velocity_valid")] = 1.0
    wanted = expected(one, rows)
    for flag, off in (("gnss_", rows[:, inputs.slice("gnss_valid")][:, 0] == 0), ("gnss_velocity_", np.r_[:15, 20:40])):
        for name in inputs.names:
            if name.startswith(flag) and not inputs[name].flag:
                rows[off, inputs.slice(name)] = np.nan
    np.testing.assert_array_equal(one.run(rows), wanted)
    one.give(gnss_valid=True, gnss_velocity_valid=False)
    one.refused(lambda: one.step(40), "gnss_age = nan s", "allowed is a finite number")
    one.give(gnss_age=0.0, gnss_latitude=9.0)
    one.refused(lambda: one.step(40), "gnss_latitude = 9 rad")


def test_a_plant_takes_several_samples_a_step_and_holds_its_commands(slave):
    one = slave(LOOP, 3)
    inputs = one.model.inputs
    commands = np.zeros((30, inputs.size))
    commands[10:20, inputs.slice("command_speed")] = 4.0
    commands[10:20, inputs.slice("command_valid")] = 1.0
    wanted = expected(one, np.repeat(commands, 10, axis=0))[9::10]
    commands[20:, inputs.slice("command_speed")] = np.nan
    np.testing.assert_array_equal(one.run(commands, n=10), wanted)
    one.give(command_valid=True)
    one.refused(lambda: one.step(300), "command_speed = nan", "allowed is a finite number")


def test_an_instance_that_diverges_reports_it_and_can_be_reset(slave):
    rows, one = rows_for(ALIGNMENT, 20), slave(ALIGNMENT, 2)
    rows[5:, :3], rows[5:, 3:6] = 1e3, 1e5
    with pytest.raises(FMICallException):
        one.run(rows)
    assert b"diverged" in one.said[-1][2]
    one.refused(lambda: one.step(0), "not allowed in this state (failed)")
    one.fmu.reset()
    one.begin()
    np.testing.assert_array_equal(one.run(rows[:5]), expected(one, rows[:5]))


def test_simulate_fmu_gives_the_reference_signals():
    folder = unzipped(ALIGNMENT, 2) / "extra" / "org.fmi-standard.fmi-ls-ref"
    inputs, wanted = (fmpy.read_csv(str(folder / name)) for name in ("in.csv", "ref.csv"))
    given = {"input": inputs, "stop_time": 1.5, "output_interval": 0.005, "validate": False}
    found = fmpy.simulate_fmu(str(exported(ALIGNMENT)), **given)
    assert len(found) == 301 and found.dtype.names == wanted.dtype.names
    for name in wanted.dtype.names[1:]:
        np.testing.assert_array_equal(found[name][::10], wanted[name], err_msg=name)
    np.testing.assert_allclose(found["time"][::10], wanted["time"], rtol=1e-12)


@pytest.mark.slow
def test_the_sources_rebuild_to_the_same_outputs(slave, tmp_path):
    """By cmake, which `fmpy compile` uses."""
    folder, built = tmp_path / "x", tmp_path / "built"
    built.mkdir()
    shutil.copytree(unzipped(ALIGNMENT, 3), folder, ignore=shutil.ignore_patterns("binaries"))
    with contextlib.redirect_stdout(io.StringIO()):
        build_platform_binary(folder, build_dir=built)
    rows, one = rows_for(ALIGNMENT, 100), slave(ALIGNMENT, 3, folder=folder)
    np.testing.assert_array_equal(one.run(rows), expected(one, rows))

"""`insenv.fmu.run` and `insenv fmu run`: the numbers of the model, what is refused, CSV of sampled inputs and outputs."""

import contextlib
import io
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from zipfile import ZipFile

import numpy as np
import pytest
from command_line import call, refused, strict
from fmpy import simulate_fmu
from fmu_host import table
from fmu_tools import INTERVAL, LOOP, exported, in_process, subject_of

from insenv.base.errors import InputError, InsenvError
from insenv.core.runner import make_runner
from insenv.fmu import run
from insenv.fmu.exporter import signals
from insenv.fmu.reading import read_variable
from insenv.fmu.running import Series, flattened, read_csv, write_csv
from insenv.scenario.inputs import input_rows

ID, PLANT = "qakf-improved", "ship-swaying"
MODEL = subject_of(ID)
COLUMNS = {name: values[:100] for name, values in MODEL.model.inputs.unpack(signals(MODEL)[0]).items() if name != "dt"}
both = pytest.mark.parametrize("fmi", [2, 3])


@pytest.fixture
def log(tmp_path):
    """100 samples of an estimator, 0.5 s, as a CSV file."""
    write_csv(tmp_path / "log.csv", table(COLUMNS))
    return tmp_path / "log.csv"


@both
def test_the_outputs_are_those_of_the_model(fmi):
    found = run(exported(ID, fmi), COLUMNS, parameters={"latitude": 0.7})
    np.testing.assert_array_equal(found.values, in_process(ID, COLUMNS, {"latitude": 0.7}))
    np.testing.assert_array_equal(found.time, INTERVAL * np.arange(1, 101))
    assert found.steps == 100 and not found.passed_over and set(found.held) == {"dt", "sample_number"}
    seventh = run(exported(ID, fmi), COLUMNS, parameters={"latitude": 0.7}, every=7)
    np.testing.assert_array_equal(seventh.values, found.values[6::7])
    np.testing.assert_array_equal(seventh.time, found.time[6::7])
    assert (found.units["q_nb[1]"], found.units["attitude_sigma[1]"]) == ("1", "rad")


def test_a_plant_runs_without_inputs_and_its_outputs_feed_an_estimator(tmp_path):
    shown = run(exported(PLANT), stop_time=100 * INTERVAL)
    assert shown.steps == 100
    write_csv(tmp_path / "ship.csv", shown)
    fed = run(exported(ID), read_csv(tmp_path / "ship.csv"))
    np.testing.assert_array_equal(fed.values, in_process(ID, COLUMNS))
    assert "height" in fed.passed_over
    assert fed.time[0] == pytest.approx(2 * INTERVAL)  # the first row is at the end of the plant's first step


def test_an_input_that_its_flag_switches_off_may_be_nan(tmp_path):
    fmu, path, what = exported(LOOP, 3), tmp_path / "x.csv", subject_of(LOOP)
    columns = {name: np.zeros(40) for name in ("command_valid", "command_speed", "command_yaw_rate")}
    columns["command_valid"][20:], columns["command_speed"][20:] = 1.0, 3.0
    runner = make_runner(what.model, what.parameters)
    wanted = what.model.outputs.unpack(runner.run(40, input_rows(what.model, columns, 40)))
    columns["command_speed"][:20] = np.nan
    write_csv(path, table(columns))
    for name, values in run(fmu, read_csv(path, switched={"command_speed"})).named().items():
        np.testing.assert_array_equal(values, wanted[name.replace(".", "_")], err_msg=name)
    columns["command_valid"][7] = 1.0
    write_csv(path, table(columns))
    refused(call("fmu", "run", fmu, "--input", path), "step 7", "command_speed = nan", "allowed is a finite number")


GOOD = table(COLUMNS)
LATE = np.where(np.arange(100) > 50, GOOD.time + 0.1, GOOD.time)
BROKEN = {name: column.copy() for name, column in COLUMNS.items()}
BROKEN["delta_velocity"][40, 2] = np.nan
WRONG = [
    ({"delta_angel": COLUMNS["delta_angle"]}, {}, "no column is an input"),
    ({"delta_angle": COLUMNS["delta_angle"][:, :2]}, {}, r"input delta_angle\[3\] has no column"),
    (replace(GOOD, time=GOOD.time * 2), {}, "rows are 0.01 s apart"),
    (replace(GOOD, time=LATE), {}, r"time = 0.355 s in row 52 follows 0.25 s.*fill gaps first \(1 such row\)"),
    (COLUMNS, {"parameters": {"latitud": 0.7}}, "no scalar parameter 'latitud'; did you mean 'latitude'"),
    (COLUMNS, {"parameters": {"latitude": 7.0}}, "parameter latitude = 7 refused: .*latitude = 7 rad"),
    (COLUMNS, {"parameters": {"step_is_one_increment": 0.5}}, "step_is_one_increment = .*: allowed is 0 or 1"),
    (COLUMNS, {"stop_time": 0.52}, r"the inputs end at 0\.5 s"),
    (COLUMNS, {"step": 1.5 * INTERVAL}, r"the step failed at step 0, t = 0 s \(error\): .*allowed is one sample interval"),
    (BROKEN, {}, r"setting the inputs failed at step 40, t = 0.2 s \(error\): .*delta_velocity"),
    (None, {"parameters": {"seed": True}}, "parameter seed = .*: allowed is a number"),
    (None, {"parameters": {"seed": 2.0**53 + 2}}, "seed = .*allowed is a whole number"),
    (None, {"parameters": {"seed": 5, "parameters.seed": 6}}, "parameters.seed is set twice"),
]


@both
@pytest.mark.parametrize(("inputs", "options", "said"), WRONG)
def test_wrong_inputs_and_values_are_named(inputs, options, said, fmi):
    id = ID if inputs is not None else {2: PLANT, 3: LOOP}[fmi]
    more = {} if inputs is not None else {"stop_time": 0.1}
    with pytest.raises(InputError, match=said):
        run(exported(id, fmi), inputs, **more, **options)


@both
def test_what_is_allowed_is_taken(fmi):
    fmu = exported(ID, fmi)
    for stop_time, steps in ((0.25, 50), (0.5 + 1e-9, 100)):
        assert run(fmu, COLUMNS, stop_time=stop_time).steps == steps
    # a step of two samples is allowed only when it is one increment
    assert run(fmu, COLUMNS, parameters={"step_is_one_increment": True}, step=2 * INTERVAL).steps == 100


def test_an_fmu_that_fails_is_no_wrong_call():
    columns = {"delta_angle": np.full((100, 3), 1e3), "delta_velocity": np.full((100, 3), 1e5)}
    with pytest.raises(InsenvError, match="diverged") as raised:
        run(exported(ID), columns)
    assert not isinstance(raised.value, InputError)


def test_damaged_files_are_reported(tmp_path):
    (tmp_path / "x.fmu").write_text("no archive")
    with ZipFile(exported(ID)) as archive:
        binary = next(entry for entry in archive.infolist() if entry.filename.startswith("binaries/"))
    raw = bytearray(exported(ID).read_bytes())
    raw[binary.header_offset + 600] ^= 0xFF
    (tmp_path / "damaged.fmu").write_bytes(raw)
    for name, said in (("none", "no such file"), ("x", "not an FMU"), ("damaged", r"damaged\.fmu: cannot be unpacked")):
        with pytest.raises(InputError, match=said):
            run(tmp_path / f"{name}.fmu", stop_time=1.0)


def test_messages_are_kept_beside_those_of_fmpy():
    """FMPy keeps the logger that it was given last for all FMUs of a process, and frees it: to call it crashes the process."""
    others, told = [], io.StringIO()
    fmu, given = str(exported(PLANT)), {"stop_time": 0.1, "output_interval": INTERVAL}
    run(fmu, stop_time=0.1)
    with pytest.raises(Exception, match="fmi2SetReal"), contextlib.redirect_stdout(told):
        simulate_fmu(fmu, start_values={"parameters.seed": 5.5}, **given)  # its own logger
    assert "parameters.seed = 5.5 : allowed is a whole number" in told.getvalue()
    simulate_fmu(fmu, logger=lambda *message: others.append(message), **given)
    with pytest.raises(InputError, match=r"seed = 5\.5 refused: .*allowed is a whole number"):
        run(fmu, stop_time=0.1, parameters={"seed": 5.5})
    assert not others


@pytest.mark.slow
def test_an_fmu_of_fmpy_after_ours_can_log(tmp_path):
    """Our logger must outlive its instance."""
    script = (
        "import sys\nfrom fmpy.ssp.simulation import FMU2Slave\nimport fmpy\nfrom insenv.fmu import run\n"
        "run(sys.argv[1], stop_time=0.1)\n"
        "d = fmpy.read_model_description(sys.argv[1])\n"
        "s = FMU2Slave(guid=d.guid, unzipDirectory=fmpy.extract(sys.argv[1]), instanceName='x',\n"
        "              modelIdentifier=d.coSimulation.modelIdentifier)\n"
        "s.instantiate()\ns.setupExperiment()\ns.enterInitializationMode()\ns.exitInitializationMode()\n"
        "s.doStep(0.0, 0.0123)\n"
    )
    done = subprocess.run([sys.executable, "-c", script, str(exported(PLANT))], capture_output=True, text=True)
    assert done.returncode == 1, done.stderr[-500:]
    assert "communication step is 0.0123 s" in done.stdout


def test_a_dimension_of_a_structural_parameter_has_its_start_value():
    size = SimpleNamespace(start=None, variable=SimpleNamespace(start="3"))
    text = dict.fromkeys(("declaredType", "unit", "description"))
    read = SimpleNamespace(name="u", valueReference=1, type="Float64", causality="input", dimensions=[size], **text)
    assert read_variable(read).elements == ("u[1]", "u[2]", "u[3]")


def test_the_command_writes_the_result_of_the_function(log, tmp_path):
    output, command = tmp_path / "out.csv", ("fmu", "run", exported(ID), "--input", log, "--set", "latitude=0.7")
    status, out, err = call(*command, "--json", "--output", output)
    assert status == 0, err
    document, written, given = strict(out), read_csv(output), run(exported(ID), COLUMNS, parameters={"latitude": 0.7})
    assert document["steps"] == 100 and written.names == given.names
    np.testing.assert_array_equal(written.values, given.values)
    np.testing.assert_array_equal(list(document["outputs"].values()), given.values[-1])


@pytest.mark.parametrize(("options", "said"), [
    (("--set", "latitude=1,2"), "--set latitude"),
    (("--output", "no/such/folder/x.csv"), "no/such/folder/x.csv"),
    (("--stop", "1e300"), "stop time 1e+300 s"),
    (("--every", "101"), "every = 101"),
])  # fmt: skip
def test_the_command_reports_what_is_wrong(log, options, said):
    refused(call("fmu", "run", exported(ID), "--input", log, *options), said)


def test_csv_reads_back_bit_identical_and_one_without_times_is_named(tmp_path):
    """Wrong rows: tests/logs/formats/test_csv_table.py."""
    columns = {"a": np.array([0.1, 1e-300, -1 / 3]), "m": np.arange(12.0).reshape(3, 2, 2) / 7}
    flat = flattened(columns)
    write_csv(tmp_path / "x.csv", Series(0.005 * np.arange(3), tuple(flat), np.array(list(flat.values())).T))
    back = read_csv(tmp_path / "x.csv")
    assert back.names == ("a", "m[1,1]", "m[1,2]", "m[2,1]", "m[2,2]")
    np.testing.assert_array_equal(back.time, 0.005 * np.arange(3))
    for name, value in back.named().items():
        np.testing.assert_array_equal(value, columns[name])
    # FMPy writes blanks inside arrays
    (tmp_path / "x.csv").write_text('"time","a","b"\n0.0,1 2 3,4\n0.005,5 6 7,8\n')
    back = read_csv(tmp_path / "x.csv")
    assert back.names == ("a[1]", "a[2]", "a[3]", "b")
    np.testing.assert_array_equal(back.values, [[1, 2, 3, 4], [5, 6, 7, 8]])
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="no column 'time'"):
        read_csv(tmp_path / "bad.csv")

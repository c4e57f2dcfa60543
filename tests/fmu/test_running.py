"""`insenv.fmu.run` and `insenv fmu run`: bit-identical results, CSV, messages of errors."""

import json
import os
import subprocess
import sys
from zipfile import ZipFile

import numpy as np
import pytest
from command_line import call
from fmu_tools import INTERVAL, columns_for, exported, in_process

from insenv import estimators
from insenv.errors import InputError, InsenvError
from insenv.fmu import run
from insenv.fmu.instance import Instance
from insenv.fmu.reading import read_variable
from insenv.fmu.series import Series, flattened, read_csv, write_csv

SAMPLES = 3000
PAIRS = [("qakf-improved", 2), ("qakf-improved", 3), ("loosely-coupled", 2), ("loosely-coupled", 3)]


def series_of(columns):
    flat = flattened(columns)
    count = len(next(iter(flat.values())))
    return Series(np.arange(count) * INTERVAL, tuple(flat), np.array(list(flat.values())).T)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Inputs of qakf-improved as a CSV file."""
    path = tmp_path_factory.mktemp("log") / "log.csv"
    write_csv(path, series_of(columns_for("qakf-improved", 400)))
    return path


@pytest.mark.parametrize(("id", "fmi"), PAIRS)
def test_the_outputs_are_bit_identical_to_those_of_the_model(id, fmi):
    columns = columns_for(id, SAMPLES)
    found = run(exported(id, fmi), columns)
    np.testing.assert_array_equal(found.values, in_process(id, columns))
    np.testing.assert_array_equal(found.time, INTERVAL * np.arange(1, SAMPLES + 1))
    assert found.steps == SAMPLES
    assert not found.passed_over
    assert set(found.held) <= {"standing", "dt"}


@pytest.mark.parametrize("fmi", [2, 3])
def test_outputs_by_name_have_the_shapes_of_the_tables(fmi):
    found = run(exported("loosely-coupled", fmi), columns_for("loosely-coupled", 50), every=10)
    named, table = found.named(), estimators.get("loosely-coupled").model.outputs
    assert {name: value.shape for name, value in named.items()} == {row.name: (5, *row.shape) for row in table}
    assert found.units["q_nb[1]"] == "1"
    assert found.units["latitude"] == "rad"
    np.testing.assert_allclose(found.time, [0.05, 0.1, 0.15, 0.2, 0.25], rtol=1e-15)


def test_every_records_the_same_as_thinning_out():
    columns = columns_for("qakf-improved", 400)
    every, seventh = run(exported("qakf-improved"), columns), run(exported("qakf-improved"), columns, every=7)
    np.testing.assert_array_equal(seventh.values, every.values[6::7])
    np.testing.assert_array_equal(seventh.time, every.time[6::7])


def test_parameters_are_set_before_the_start():
    columns = columns_for("qakf-improved", 400)
    found = run(exported("qakf-improved"), columns, parameters={"latitude": 0.7})
    np.testing.assert_array_equal(found.values, in_process("qakf-improved", columns, {"latitude": 0.7}))


def test_a_plant_runs_without_inputs_and_its_outputs_feed_an_estimator(tmp_path):
    shown = run(exported("ship-swaying"), stop_time=400 * INTERVAL)
    assert shown.steps == 400
    path = tmp_path / "ship.csv"
    write_csv(path, shown)
    fed = run(exported("qakf-improved"), read_csv(path))
    np.testing.assert_array_equal(fed.values, in_process("qakf-improved", columns_for("qakf-improved", 400)))
    assert "height" in fed.passed_over
    assert fed.time[0] == pytest.approx(2 * INTERVAL)  # the first row is at the end of the plant's first step


def test_progress_is_reported():
    calls = []
    run(exported("qakf-improved"), columns_for("qakf-improved", SAMPLES), progress=lambda *done: calls.append(done))
    assert calls[-1] == (SAMPLES, SAMPLES)


def test_csv_reads_back_bit_identical(tmp_path):
    columns = {"a": np.array([0.1, 1e-300, -1 / 3]), "m": np.arange(12.0).reshape(3, 2, 2) / 7}
    write_csv(tmp_path / "x.csv", series_of(columns))
    back = read_csv(tmp_path / "x.csv")
    assert back.names == ("a", "m[1,1]", "m[1,2]", "m[2,1]", "m[2,2]")
    for name, value in back.named().items():
        np.testing.assert_array_equal(value, columns[name])


def test_csv_of_fmpy_with_blanks_inside_arrays(tmp_path):
    (tmp_path / "x.csv").write_text('"time","a","b"\n0.0,1 2 3,4\n0.005,5 6 7,8\n')
    back = read_csv(tmp_path / "x.csv")
    assert back.names == ("a[1]", "a[2]", "a[3]", "b")
    np.testing.assert_array_equal(back.values, [[1, 2, 3, 4], [5, 6, 7, 8]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column 'time'"),
        ("a,b\n1,2\n", "no column 'time'"),
        ("time,a\n", "no data rows"),
        ("time,a\n0,x\n", r"line 2, column 'a': 'x' is not a number"),
        ("time,a\n0,1\n1,\n", r"line 3, column 'a': the value is missing"),
        ("time,a\n0,nan\n", r"line 2, column 'a': value is nan"),
        ("time,a\n0,1\n1\n", r"line 3 has 1 fields, expected 2"),
        ("time,a,a\n0,1,2\n", "repeated columns: a"),
        ('time,"a[1,1]"\n0,z\n', r"line 2, column 'a\[1,1\]'"),
    ],
)
def test_a_bad_csv_is_named(tmp_path, text, said):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_csv(tmp_path / "bad.csv")


def test_rows_must_be_a_step_apart():
    good = series_of(columns_for("qakf-improved", 100))
    for time, said in (
        (good.time * 2, "rows are 0.01 s apart"),
        (np.where(np.arange(100) > 50, good.time + 0.1, good.time), "time = 0.355 s in row 52 follows 0.25 s"),
        (np.where(np.arange(100) == 50, 0.0, good.time), "follows"),
    ):
        with pytest.raises(InputError, match=said):
            run(exported("qakf-improved"), Series(time, good.names, good.values))


def test_wrong_inputs_are_named():
    fmu, columns = exported("qakf-improved"), columns_for("qakf-improved", 100)
    for inputs, options, said in (
        ({"delta_angel": columns["delta_angle"]}, {}, "no column is an input"),
        ({"delta_angle": columns["delta_angle"][:, :2]}, {}, r"input delta_angle\[3\] has no column"),
        ({**columns, "delta_angle": columns["delta_angle"][:50]}, {}, "different lengths"),
        (columns, {"parameters": {"latitud": 0.7}}, r"no scalar parameter 'latitud'; did you mean 'latitude'"),
        (columns, {"every": 0}, "every = 0"),
        (columns, {"step": -1.0}, "step = -1.0"),
        (columns, {"stop_time": -1.0}, "stop time"),
    ):
        with pytest.raises(InputError, match=said):
            run(fmu, inputs, **options)


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_messages_of_the_fmu_are_part_of_the_error(fmi):
    fmu, columns = exported("qakf-improved", fmi), columns_for("qakf-improved", 100)
    with pytest.raises(InputError, match=r"parameter latitude = 7 refused: .*latitude = 7 rad"):
        run(fmu, columns, parameters={"latitude": 7.0})
    with pytest.raises(InsenvError, match=r"the step failed at step 0, t = 0 s \(error\): .*allowed is one sample interval"):
        run(fmu, columns, step=1.5 * INTERVAL)
    broken = {name: column.copy() for name, column in columns.items()}
    broken["delta_velocity"][40, 2] = np.nan
    with pytest.raises(InsenvError, match=r"setting the inputs failed at step 40, t = 0.2 s \(error\): .*delta_velocity"):
        run(fmu, broken)


def test_an_fmu_of_fmpy_after_ours_can_log(tmp_path):
    """FMPy keeps one logger for all FMUs of a process: ours must outlive its instance."""
    script = (
        "import sys, numpy as np\nfrom fmpy.ssp.simulation import FMU2Slave\nimport fmpy\nfrom insenv.fmu import run\n"
        "run(sys.argv[1], stop_time=0.1)\n"
        "d = fmpy.read_model_description(sys.argv[1])\n"
        "s = FMU2Slave(guid=d.guid, unzipDirectory=fmpy.extract(sys.argv[1]), instanceName='x',\n"
        "              modelIdentifier=d.coSimulation.modelIdentifier)\n"
        "s.instantiate()\ns.setupExperiment()\ns.enterInitializationMode()\ns.exitInitializationMode()\n"
        "s.doStep(0.0, 0.0123)\n"
    )
    command = [sys.executable, "-c", script, str(exported("ship-swaying"))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr[-500:]
    assert "communication step is 0.0123 s" in done.stdout


def test_a_dimension_of_a_structural_parameter_has_its_start_value():
    from types import SimpleNamespace

    size = SimpleNamespace(start=None, variable=SimpleNamespace(start="3"))
    read = SimpleNamespace(
        name="u",
        valueReference=1,
        type="Float64",
        causality="input",
        declaredType=None,
        unit=None,
        description="",
        dimensions=[size],
    )
    assert read_variable(read).elements == ("u[1]", "u[2]", "u[3]")


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_that_ends_the_simulation_gives_the_rows_until_then(monkeypatch, fmi):
    made = []
    monkeypatch.setattr(Instance, "ends", lambda self, status: made.append(status) or len(made) == 40)
    found = run(exported("ship-swaying", fmi), stop_time=1.0, every=4)
    assert found.ended
    assert (found.steps, len(found.time), found.values.shape[0]) == (40, 10, 10)


def test_a_file_that_is_not_an_fmu_is_reported(tmp_path):
    (tmp_path / "x.fmu").write_text("no archive")
    for path, said in ((tmp_path / "none.fmu", "no such file"), (tmp_path / "x.fmu", "not an FMU")):
        with pytest.raises(InputError, match=said):
            run(path, {"a": np.zeros(3)})


def test_a_damaged_fmu_is_reported(tmp_path):
    with ZipFile(exported("qakf-improved")) as archive:
        binary = next(entry for entry in archive.infolist() if entry.filename.startswith("binaries/"))
    raw = bytearray(exported("qakf-improved").read_bytes())
    raw[binary.header_offset + 600] ^= 0xFF
    (tmp_path / "damaged.fmu").write_bytes(raw)
    with pytest.raises(InputError, match=r"damaged\.fmu: cannot be unpacked"):
        run(tmp_path / "damaged.fmu", stop_time=1.0)


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_closed_pipe_is_not_an_error():
    command = [sys.executable, "-m", "insenv", "fmu", "run", str(exported("ship-swaying")), "--stop", "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert (process.stderr.read(), process.wait(60)) == ("", 141)


def test_the_command_writes_the_result_of_the_function(log, tmp_path):
    output = tmp_path / "out.csv"
    command = [sys.executable, "-m", "insenv", "fmu", "run", str(exported("qakf-improved")), "--input", str(log), "--json"]
    done = subprocess.run([*command, "--output", str(output)], capture_output=True, text=True, check=True)
    document = json.loads(done.stdout)
    assert document["steps"] == 400
    written, given = read_csv(output), run(exported("qakf-improved"), read_csv(log))
    assert written.names == given.names
    np.testing.assert_array_equal(written.values, given.values)
    np.testing.assert_array_equal(list(document["outputs"].values()), given.values[-1])


def test_the_command_prints_the_last_outputs(log):
    status, shown, _ = call("fmu", "run", exported("qakf-improved"), "--input", log, "--set", "latitude=0.7")
    assert status == 0
    assert "400 steps of 0.005 s" in shown
    assert "attitude_sigma[3]" in shown


@pytest.mark.parametrize(
    ("options", "status", "said"),
    [
        (["--input", "missing.csv"], 2, "missing.csv: No such file"),
        (["--input", "LOG", "--set", "latitude=north"], 2, "--set 'latitude=north': 'north' is not a number"),
        (["--input", "LOG", "--set", "latitude=nan"], 2, "--set latitude: allowed is one finite number"),
        (["--input", "LOG", "--set", "latitude=1,2"], 2, "--set latitude: allowed is one finite number"),
        (["--input", "LOG", "--step", "0.0075"], 2, "rows are 0.005 s apart"),
        (["--input", "LOG", "--output", "no/such/folder/x.csv"], 2, "no/such/folder/x.csv"),
        (["--input", "LOG", "--output", "."], 2, "'.': it is a folder"),
        (["--stop", "nan"], 2, "stop time nan s"),
        (["--stop", "inf"], 2, "stop time inf s"),
        (["--stop", "1e300"], 2, "stop time 1e+300 s"),
        (["--input", "LOG", "--every", "401"], 2, "every = 401: allowed is 1 to 400"),
    ],
)
def test_the_command_reports_what_is_wrong(log, options, status, said):
    options = [log if option == "LOG" else option for option in options]
    code, out, err = call("fmu", "run", exported("qakf-improved"), "--json", *options)
    assert code == status
    assert said in err
    assert said in json.loads(out)["error"]["message"]

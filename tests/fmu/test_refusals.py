"""Values, names and times that `insenv.fmu.run` and an FMU refuse instead of reading them in another way."""

import contextlib
import io
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, refused
from fmpy import simulate_fmu
from fmu_tools import INTERVAL, columns_for, exported

from insenv.errors import InputError, InsenvError
from insenv.fmu import export_ssp, run, run_ssp
from insenv.fmu.series import Series, flattened, write_csv

STEERED = "ship-underway"
"""A plant with commands, sampled every 0.01 s."""


def table(columns, interval=INTERVAL):
    flat = flattened(columns)
    time = interval * np.arange(len(next(iter(flat.values()))))
    return Series(time, tuple(flat), np.array(list(flat.values())).T)


@pytest.fixture
def log(tmp_path):
    """100 samples of qakf-improved, 0.5 s, as a CSV file."""
    write_csv(tmp_path / "log.csv", table(columns_for("qakf-improved", 100)))
    return tmp_path / "log.csv"


@pytest.fixture
def commands(tmp_path):
    """Write a CSV file of commands, 40 rows, with changes by column name and row."""

    def write(changes):
        columns = {name: np.zeros(40) for name in ("command_valid", "command_speed", "command_turn_rate")}
        for (name, row), value in changes.items():
            columns[name][row] = value
        write_csv(tmp_path / "commands.csv", table(columns, 0.01))
        return tmp_path / "commands.csv"

    return write


def test_a_stop_time_after_the_inputs_is_refused(log):
    refused(call("fmu", "run", exported("qakf-improved"), "--input", log, "--stop", "1"), "stop time 1.0 s", "end at 0.5 s")
    with pytest.raises(InputError, match=r"the inputs end at 0\.5 s"):
        run(exported("qakf-improved"), columns_for("qakf-improved", 100), stop_time=0.52)
    for stop_time, steps in ((0.25, 50), (0.5, 100), (0.5 + 1e-9, 100), (None, 100)):
        assert run(exported("qakf-improved"), columns_for("qakf-improved", 100), stop_time=stop_time).steps == steps


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_fraction_is_no_seed(fmi):
    for seed in (5.5, -1.0, 2.0**53 + 2):
        with pytest.raises(InputError, match=r"seed = .*allowed is a whole number from 0 to 9\.007"):
            run(exported("ship-swaying", fmi), stop_time=0.1, parameters={"seed": seed})
    largest = run(exported("ship-swaying", fmi), stop_time=0.1, parameters={"seed": 2.0**53})
    assert largest.steps == 20


def test_the_fmu_itself_refuses_a_fraction_as_a_seed():
    told = io.StringIO()
    with pytest.raises(Exception, match="fmi2SetReal"), contextlib.redirect_stdout(told):
        simulate_fmu(
            str(exported("ship-swaying")), stop_time=0.1, output_interval=INTERVAL, start_values={"parameters.seed": 5.5}
        )
    assert "parameters.seed = 5.5 : allowed is a whole number" in told.getvalue()


def test_the_message_of_a_refusal_is_kept_after_a_simulation_by_fmpy_with_a_logger_of_its_own():
    """FMPy's helper keeps the logger that it was given last, which FMPy frees: to call it crashed the process."""
    others: list[tuple] = []
    run(exported("ship-swaying"), stop_time=0.1)
    simulate_fmu(
        str(exported("ship-swaying")), stop_time=0.1, output_interval=INTERVAL, logger=lambda *given: others.append(given)
    )
    with pytest.raises(InputError, match=r"seed = 5\.5 refused: .*allowed is a whole number"):
        run(exported("ship-swaying"), stop_time=0.1, parameters={"seed": 5.5})
    assert not others


def test_a_fraction_is_no_seed_of_a_system(tmp_path):
    export_ssp("ship-swaying", "qakf-improved", tmp_path / "loop.ssp")
    with pytest.raises(InputError, match=r"component plant: parameter seed = 5\.5 refused: .*whole number"):
        run_ssp(tmp_path / "loop.ssp", stop_time=0.1, parameters={"plant.seed": 5.5})
    with pytest.raises(InputError, match=r"parameters\.seed is set twice"):
        run_ssp(tmp_path / "loop.ssp", stop_time=0.1, parameters={"plant.seed": 5, "plant.parameters.seed": 6})
    refused(
        call("fmu", "run", tmp_path / "loop.ssp", "--stop", "1", "--step", "1"), "component estimator", "allowed is one sample"
    )


@pytest.mark.parametrize("value", ["5", [5], None, 5j, True])
def test_what_is_no_number_is_no_parameter(value):
    with pytest.raises(InputError, match=r"parameter seed = .*: allowed is a number"):
        run(exported("ship-swaying"), stop_time=0.1, parameters={"seed": value})


def test_one_parameter_under_two_names_is_refused():
    options = ("--stop", "1", "--set", "seed=5", "--set", "parameters.seed=6")
    refused(
        call("fmu", "run", exported("ship-swaying"), *options), "parameters.seed is set twice", "as seed and as parameters.seed"
    )


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_boolean_parameter_is_true_or_false(fmi, log):
    fmu, name = exported("qakf-improved", fmi), "step_is_one_increment"
    for value in (7.0, 0.5, -1.0):
        with pytest.raises(InputError, match=r"step_is_one_increment = .*: allowed is 0 or 1"):
            run(fmu, columns_for("qakf-improved", 100), parameters={name: value})
    refused(call("fmu", "run", fmu, "--input", log, "--set", f"{name}=7"), f"{name} = 7: allowed is 0 or 1")
    for value in ("true", "True", "1"):
        assert call("fmu", "run", fmu, "--input", log, "--set", f"{name}={value}")[0] == 0
    # a step of two samples is allowed only when it is one increment
    double = columns_for("qakf-improved", 100)
    assert run(fmu, double, parameters={name: True}, step=2 * INTERVAL).steps == 100
    with pytest.raises(InsenvError, match="allowed is one sample interval"):
        run(fmu, double, parameters={name: False}, step=2 * INTERVAL)
    refused(call("fmu", "run", fmu, "--input", log, "--set", "latitude=true"), "latitude = True: allowed is a number")


def test_true_and_false_are_set_at_the_export(tmp_path):
    given = ("fmu", "export", "q-method", "-o", tmp_path / "q.fmu", "--set")
    assert call(*given, "step_is_one_increment=true")[0] == 0
    assert run(tmp_path / "q.fmu", columns_for("q-method", 100), step=2 * INTERVAL).steps == 100
    refused(call(*given, "latitude=true"), "latitude = true: allowed is a number")
    refused(call(*given, "step_is_one_increment=2"), "step_is_one_increment = 2.0: allowed is true or false")
    refused(
        call("fmu", "export", "ship-swaying", "-o", tmp_path / "s.fmu", "--set", "seed=true"),
        "seed = true: allowed is a number",
    )


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_input_column_of_a_flag_holds_0_and_1(commands, fmi):
    file = commands({("command_valid", 30): 0.5})
    refused(
        call("fmu", "run", exported(STEERED, fmi), "--input", file), "input command_valid = 0.5 in row 31: allowed is 0 or 1"
    )


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_input_that_its_flag_switches_off_may_be_nan(commands, fmi, tmp_path):
    fmu, out = exported(STEERED, fmi), tmp_path / "out.csv"
    off = {("command_speed", row): np.nan for row in range(20)}
    on = {**{("command_valid", row): 1.0 for row in range(20, 40)}, **{("command_speed", row): 3.0 for row in range(20, 40)}}
    assert call("fmu", "run", fmu, "--input", commands(off | on), "--output", out)[0] == 0
    holed = out.read_bytes()
    assert call("fmu", "run", fmu, "--input", commands(on), "--output", out)[0] == 0
    assert holed == out.read_bytes()
    used = commands({**off, ("command_valid", 7): 1.0})
    refused(call("fmu", "run", fmu, "--input", used), "step 7", "command_speed = nan", "allowed is a finite number")
    refused(call("fmu", "run", fmu, "--input", commands({("command_valid", 7): np.nan})), "'command_valid': value is nan")


def test_a_nan_of_a_csv_file_has_no_advice_about_logs(tmp_path):
    (tmp_path / "x.csv").write_text("time,delta_angle[1]\n0,nan\n")
    answer = call("fmu", "run", exported("qakf-improved"), "--input", tmp_path / "x.csv")
    refused(answer, "'delta_angle[1]': value is nan")
    assert "skip_empty" not in answer[2]


def test_a_step_or_a_value_that_the_fmu_refuses_is_a_wrong_call(commands, log):
    refused(
        call("fmu", "run", exported("ship-swaying"), "--stop", "1", "--step", "0.0123"), "0.0123 s", "whole number of sample"
    )
    columns = columns_for("q-method", 100)
    with pytest.raises(InputError, match="allowed is one sample interval"):
        run(exported("q-method"), columns, step=0.02)
    fast = commands({("command_valid", 3): 1.0, ("command_speed", 3): 5000.0})
    refused(call("fmu", "run", exported(STEERED), "--input", fast), "step 3", "command_speed = 5000", "from ")


def test_an_fmu_that_fails_is_no_wrong_call():
    columns = {"delta_angle": np.full((20_000, 3), 1e3), "delta_velocity": np.full((20_000, 3), 1e5)}
    with pytest.raises(InsenvError, match="diverged") as raised:
        run(exported("wander-sins"), columns)
    assert not isinstance(raised.value, InputError)


def test_one_gap_is_one_row(log):
    columns = table(columns_for("qakf-improved", 100))
    with pytest.raises(InputError, match=r"fill gaps first \(1 such row\)"):
        run(exported("qakf-improved"), replace(columns, time=np.where(np.arange(100) > 50, columns.time + 0.1, columns.time)))


def test_the_outputs_of_a_loop_fit_a_screen(tmp_path):
    export_ssp("ship-swaying", "qakf-improved", tmp_path / "loop.ssp")
    status, out, _ = call("fmu", "run", tmp_path / "loop.ssp", "--stop", "1")
    lines = out.splitlines()
    assert status == 0
    assert len(lines) <= 24 and max(map(len, lines)) <= 80
    found = run_ssp(tmp_path / "loop.ssp", stop_time=1.0)
    named = {name.partition("[")[0] for name in found.names}
    assert all(name in out for name in named), named - {name for name in named if name in out}
    assert f"{found.columns()['estimator.attitude_sigma[3]'][-1]:.5g}" in out

"""Our FMUs and SSP files in OMSimulator, to the bit; docs/fmu.md builds it."""

import os
import subprocess
import zipfile
from itertools import zip_longest

import numpy as np
import pytest
from fmu_tools import INTERVAL, columns_for, in_process, plant_outputs
from scipy.io import loadmat

from insenv import estimators
from insenv.fmu import export_fmu, export_ssp, run, run_ssp
from insenv.fmu.reading import element_names

PROGRAM = os.environ.get("INSENV_OMSIMULATOR", "")
pytestmark = pytest.mark.skipif(
    not PROGRAM, reason="INSENV_OMSIMULATOR names no binary: build OMSimulator as docs/fmu.md tells"
)
SEED = '"parameters.seed">\n      <ssv:Real value="{}"'


def simulated(path, stop, folder):
    """(rows, n) of the record by variable name, without the model's; the output of the program.  The first row is the start."""
    result = folder / "result.mat"
    command = [PROGRAM, "--emitEvents=false", f"--stopTime={stop}", f"--resultFile={result}", f"--tempDir={folder}", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder)
    if done.returncode:
        return {}, done.stdout + done.stderr
    file = loadmat(result, chars_as_strings=True)
    names = ["".join(letters).rstrip(" \0") for letters in zip_longest(*file["name"], fillvalue=" ")]
    tables = {1: file["data_1"], 2: file["data_2"]}
    rows = len(file["data_2"][0])
    columns = {}
    for name, (table, row) in zip(names, file["dataInfo"][:2].T.tolist(), strict=True):
        values = tables[table or 2][abs(row) - 1] * np.sign(row)
        columns[name] = np.broadcast_to(values if len(values) == rows else values[:1], rows)
    return columns, done.stdout + done.stderr


@pytest.mark.parametrize("stop", [1, 2, 3])  # at 2 and 3 s it adds a step of 2e-14 s
@pytest.mark.parametrize(
    ("what", "options"),
    [
        ("q-method", {"fmi": 2}),
        ("q-method", {"fmi": 3, "arrays": False}),
        ("ship-swaying", {"fmi": 2}),
        ("ship-swaying", {"fmi": 3, "arrays": False}),
        ("ship-swaying", {"fmi": 2, "estimator": "qakf-improved"}),
        ("ship-swaying", {"fmi": 3, "arrays": False, "estimator": "qakf-improved"}),
    ],
)
def test_an_fmu_gives_our_outputs_to_the_bit_at_its_default_step(what, options, stop, tmp_path):
    path = export_fmu(what, tmp_path / "x.fmu", **options)
    found, said = simulated(path, stop, tmp_path)
    assert found, said
    wanted = run(path, stop_time=float(stop)).columns()
    assert len(wanted) >= 7
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[name][1 : len(values) + 1], values, err_msg=name)


def test_arrays_are_refused(tmp_path):
    path = export_fmu("ship-swaying", tmp_path / "x.fmu", fmi=3)
    _, said = simulated(path, 1, tmp_path)
    assert "nValues = 1: allowed is 3, the number of elements of the variables" in said


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_ssp_runs_one_step_late_at_the_step_of_its_annotation(fmi, tmp_path):
    path, samples = tmp_path / "loop.ssp", 400
    export_ssp("ship-swaying", "qakf-improved", path, fmi=fmi)
    found, said = simulated(path, samples * INTERVAL, tmp_path)
    assert found, said
    prefix = "ship_swaying.loop."
    plant = run_ssp(path, stop_time=samples * INTERVAL).columns()
    for name in ("q_nb[1]", "delta_angle[3]", "delta_velocity[2]"):
        np.testing.assert_array_equal(found[f"{prefix}plant.{name}"][1 : samples + 1], plant[f"plant.{name}"])
    shown = plant_outputs("ship-swaying", samples)
    late = {name: np.concatenate([np.zeros((1, 3)), shown[name][:-1]]) for name in ("delta_angle", "delta_velocity")}
    q_nb = in_process("qakf-improved", late)[:, :4]
    for k in range(4):
        np.testing.assert_array_equal(found[f"{prefix}estimator.q_nb[{k + 1}]"][1 : samples + 1], q_nb[:, k])
        # OMSimulator records the outputs of the system before it renews them
        np.testing.assert_array_equal(found[f"{prefix}q_nb_{k + 1}"][2 : samples + 1], q_nb[:-1, k])


def test_flags_pass_in_an_ssp(tmp_path):
    samples = 2000
    export_ssp("car-city-drive", "loosely-coupled", tmp_path / "car.ssp")
    found, said = simulated(tmp_path / "car.ssp", samples * INTERVAL, tmp_path)
    assert found, said
    columns = columns_for("loosely-coupled", samples)
    assert columns["gnss_valid"].sum() == 9
    late = {name: np.concatenate([np.zeros((1, *v.shape[1:])), v[:-1]]) for name, v in columns.items()}
    wanted = in_process("loosely-coupled", late)
    table = estimators.get("loosely-coupled").model.outputs
    for name in ("q_nb", "velocity_n", "latitude"):
        for element, place in zip(element_names(name, table[name].shape), range(*table.slice(name).indices(99)), strict=True):
            shown = found[f"car_city_drive.loop.estimator.{element}"][1 : samples + 1]
            np.testing.assert_array_equal(shown, wanted[:, place], err_msg=element)


def test_the_parameter_set_of_an_ssp_is_applied(tmp_path):
    export_ssp("ship-swaying", "qakf-improved", tmp_path / "loop.ssp", seed=5)
    with zipfile.ZipFile(tmp_path / "loop.ssp") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    text = files["resources/plant.ssv"].decode()
    assert SEED.format("5.0") in text
    files["resources/plant.ssv"] = text.replace(SEED.format("5.0"), SEED.format("77.0")).encode()
    with zipfile.ZipFile(tmp_path / "edited.ssp", "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    found, said = simulated(tmp_path / "edited.ssp", 1, tmp_path)
    assert found, said
    wanted = run_ssp(tmp_path / "loop.ssp", stop_time=1.0, parameters={"plant.seed": 77.0}).columns()["plant.delta_angle[1]"]
    np.testing.assert_array_equal(found["ship_swaying.loop.plant.delta_angle[1]"][1:201], wanted)

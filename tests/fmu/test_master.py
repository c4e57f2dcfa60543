"""`insenv fmu run loop.ssp`: in the order of the data, bit-identical to `insenv run`."""

import zipfile

import numpy as np
import pytest
from command_line import call, refused, strict
from fmu_tools import scratch

from insenv import run
from insenv.core.compile import find_compiler
from insenv.errors import InputError
from insenv.fmu import export_ssp, run_ssp

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler found")

DURATION = 20.0


@pytest.fixture(scope="module", params=(("ship-swaying", "qakf-improved", 2), ("car-city-drive", "loosely-coupled", 2)))
def system(request):
    """An SSP file, and the run that it must repeat."""
    scenario, id, _ = request.param
    path = scratch() / f"{scenario}.ssp"
    export_ssp(scenario, id, path)
    (result,) = run(scenario, [id], duration_s=DURATION).results
    return path, result


def test_the_outputs_are_bit_identical_to_those_of_a_run(system):
    path, result = system
    found = run_ssp(path, stop_time=DURATION)
    places, named = np.round(result.time / found.step).astype(int) - 1, found.named()
    assert len(places) > 100
    for name, values in result.outputs.items():
        np.testing.assert_array_equal(named[f"estimator.{name}"][places], values, err_msg=name)


def test_the_command(system, tmp_path):
    path, _ = system
    output = tmp_path / "out.csv"
    status, out, err = call("fmu", "run", path, "--stop", "1", "--every", "10", "--set", "plant.seed=5", "-o", output, "--json")
    assert status == 0, err
    assert strict(out)["steps"] == 200
    assert output.read_text().startswith("time,plant.")
    refused(call("fmu", "run", path, "--set", "planet.seed=5"), "planet.seed", "plant, estimator")
    refused(call("fmu", "run", path, "--input", output), "--input", "allowed is --input with an .fmu file")
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

"""One FMU of a plant and an estimator behind it: bit-identical to `insenv run`."""

import numpy as np
import pytest
from command_line import call, refused, strict
from fmu_tools import scratch

from insenv import run
from insenv.core.compile import find_compiler
from insenv.errors import InputError
from insenv.files.resources import scenario_folder
from insenv.fmu import export_fmu
from insenv.fmu import run as run_fmu

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler found")

DURATION = 20.0


@pytest.mark.parametrize(
    ("scenario", "id", "options"),
    (
        ("ship-swaying", "qakf-improved", {"fmi": 2}),
        ("ship-swaying", "q-method", {"fmi": 3, "arrays": False}),
        ("car-city-drive", "loosely-coupled", {"fmi": 3}),
    ),
)
def test_the_outputs_are_bit_identical_to_those_of_a_run(scenario, id, options):
    path = export_fmu(scenario, scratch() / f"{scenario}-{id}.fmu", estimator=id, **options)
    found = run_fmu(path, stop_time=DURATION)
    (result,) = run(scenario, [id], duration_s=DURATION).results
    places = np.round(result.time / found.step).astype(int) - 1
    assert len(places) > 100
    named = found.named()
    for name, values in result.outputs.items():
        np.testing.assert_array_equal(named[f"estimator.{name}"][places], values, err_msg=name)


def test_settings_of_both():
    settings = {"seed": 7, "estimator.latitude": 0.7, "estimator.arw_deg_sqrt_h": 0.01}
    path = export_fmu("ship-swaying", scratch() / "set.fmu", estimator="qakf-improved", settings=settings)
    from insenv.fmu.reading import read_description

    start = {v.name: v.start for v in read_description(path).modelVariables}
    assert float(start["parameters.seed"]) == 7.0
    assert float(start["estimator.parameters.latitude"]) == 0.7
    assert float(start["estimator.parameters.angle_random_walk"]) == pytest.approx(np.radians(0.01) / 60, rel=1e-15)
    with pytest.raises(InputError, match="no parameter 'latitud' in 'qakf-improved'"):
        export_fmu("ship-swaying", path, estimator="qakf-improved", settings={"estimator.latitud": 1.0})


def test_noises_of_the_estimator_are_tunable_and_the_plant_is_not():
    from insenv.fmu.reading import read_description

    path = export_fmu("car-city-drive", scratch() / "tunable.fmu", estimator="loosely-coupled")
    tunable = {v.name for v in read_description(path).modelVariables if v.variability == "tunable"}
    assert {"estimator.parameters.innovation_gate", "estimator.parameters.antenna_lever_arm[3]"} <= tunable
    assert all(name.startswith("estimator.") for name in tunable)


def test_what_cannot_be_a_loop_is_named(tmp_path):
    output = ("-o", tmp_path / "x.fmu")
    refused(call("fmu", "export", "car-city-drive", "-e", "qakf-improved", *output), "qakf-improved", "moves")
    refused(call("fmu", "export", "car-city-drive", "-e", "smoother", *output), "smoother", "from its end")
    refused(call("fmu", "export", "qakf", "-e", "qakf", *output), "allowed is a scenario and an estimator")
    text = (scenario_folder() / "ship-swaying.toml").read_text("utf-8")
    (tmp_path / "lossy.toml").write_text(text.replace("[imu]", "[imu]\ndrop_probability = 0.01"))
    refused(call("fmu", "export", tmp_path / "lossy.toml", "-e", "qakf-improved", *output), "loses inertial samples")
    assert not (tmp_path / "x.fmu").exists()


def test_the_command(tmp_path):
    status, out, err = call("fmu", "export", "ship-swaying", "-e", "q-method", "-o", tmp_path / "x.fmu", "--json")
    assert status == 0, err
    assert strict(out)["model"] == "ship-swaying-q-method"

"""kind = "fmu": an outside model as truth; here the outside model is an exported car, whose truth is known."""

import numpy as np
import pytest

import insenv
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.scenario import build

QUATERNION = [f"q_nb[{k}]" for k in (1, 2, 3, 4)]
OUTPUTS = {"latitude": "latitude", "longitude": "longitude", "height": "height", "quaternion": QUATERNION}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmu")


def car():
    table = insenv.load("car-city-drive").model_dump(mode="json")
    return insenv.load(
        {**table, "duration_s": 40.0, "rate_hz": 100.0, "imu": {}, "vehicle": {**table["vehicle"], "engine": []}}
    )


def scenario(path, **vehicle):
    values = {"kind": "fmu", "file": str(path), "outputs": OUTPUTS, "run_s": 40.0, "step_s": 0.1, **vehicle}
    return insenv.load({"title": "t", "rate_hz": 100.0, "vehicle": values})


def truth_of(loaded):
    plant = build(loaded, seed=car().seed, duration_s=39.0)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    return {name: np.array(values) for name, values in shown.items()}


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_track_is_that_of_the_fmu(fmi, folder):
    path = folder / f"car{fmi}.fmu"
    insenv.export_fmu(car(), path, fmi=fmi)
    ours, theirs = truth_of(scenario(path)), truth_of(car())
    for name, scale in (("latitude", 6.37e6), ("longitude", 6.37e6), ("height", 1.0)):
        assert scale * np.abs(ours[name] - theirs[name]).max() < 0.01, name
    assert np.abs(ours["velocity_n"] - theirs["velocity_n"]).max() < 0.2
    between = 2.0 * np.arccos(np.clip(np.abs(np.sum(ours["q_nb"] * theirs["q_nb"], axis=1)), 0.0, 1.0))
    assert np.degrees(between).max() < 0.2


def test_wrong_fmus_are_refused(folder):
    path = folder / "car2.fmu"
    insenv.export_fmu(car(), path, fmi=2)
    with pytest.raises(InputError, match="no variable 'altitude'"):
        scenario(path, outputs={**OUTPUTS, "height": "altitude"})
    with pytest.raises(InputError, match="roll, pitch and heading, or quaternion"):
        scenario(path, outputs={**OUTPUTS, "roll": "latitude"})
    with pytest.raises(InputError, match=r"none.fmu: file not found"):
        scenario(folder / "none.fmu")
    (folder / "no.fmu").write_text("no", encoding="utf-8")
    with pytest.raises(InputError, match=r"no.fmu: no FMU"):
        scenario(folder / "no.fmu")

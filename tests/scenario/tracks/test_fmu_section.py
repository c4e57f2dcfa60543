"""kind = "fmu": an outside model as truth; here the outside model is an exported car, whose truth is known."""

import numpy as np
import pytest
from closed_track import truth_of

import insenv
from insenv.base.errors import InputError

QUATERNION = [f"q_nb[{k}]" for k in (1, 2, 3, 4)]
VELOCITY = [f"velocity_n[{k}]" for k in (1, 2, 3)]
PLACE = {"latitude": "latitude", "longitude": "longitude", "height": "height"}
OUTPUTS = {**PLACE, "quaternion": QUATERNION}
RUN_S = 30.0


def car():
    """A car that waits for 10 s and then accelerates and turns."""
    table = insenv.load("car-city-drive").model_dump(mode="json")
    vehicle = {**table["vehicle"], "engine": [], "legs": [{"wait_s": 10.0}, *table["vehicle"]["legs"][1:]]}
    return insenv.load({**table, "duration_s": RUN_S, "rate_hz": 100.0, "imu": {}, "vehicle": vehicle})


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    return insenv.export_fmu(car(), tmp_path_factory.mktemp("fmu") / "car.fmu", fmi=3)


@pytest.fixture(scope="module")
def theirs():
    return truth_of(car(), RUN_S - 1.0, car().seed)[1]


def scenario(path, **vehicle):
    values = {"kind": "fmu", "file": str(path), "outputs": OUTPUTS, "run_s": RUN_S, "step_s": 0.1, **vehicle}
    return insenv.load({"title": "t", "rate_hz": 100.0, "vehicle": values})


def differences(loaded, theirs):
    """Largest differences of position (m), velocity (m/s) and attitude (deg), and the rows."""
    ours = truth_of(loaded, RUN_S - 1.0, car().seed)[1]
    scales = {"latitude": 6.37e6, "longitude": 6.37e6, "height": 1.0}
    position = max(scale * np.abs(ours[name] - theirs[name]).max() for name, scale in scales.items())
    between = 2.0 * np.arccos(np.clip(np.abs(np.sum(ours["q_nb"] * theirs["q_nb"], axis=1)), 0.0, 1.0))
    return position, np.abs(ours["velocity_n"] - theirs["velocity_n"]).max(), np.degrees(between).max(), ours


def test_the_track_is_that_of_the_fmu(exported, theirs):
    position, velocity, turned, own = differences(scenario(exported), theirs)
    assert position < 1e-3 and velocity < 0.01 and turned < 0.02
    position, velocity, _, _ = differences(scenario(exported, outputs={**OUTPUTS, "velocity": VELOCITY}), theirs)
    assert position < 1e-4 and velocity < 2.5e-3
    last = {**PLACE, "quaternion": [*QUATERNION[1:], QUATERNION[0]]}
    with pytest.raises(InputError, match=r"scalar of the quaternion first, by \d deg with it last: state .*order = 'xyzw'"):
        scenario(exported, outputs=last)
    stated = scenario(exported, outputs={**last, "quaternion_order": "xyzw"})
    assert np.array_equal(differences(stated, theirs)[-1]["q_nb"], own["q_nb"])
    assert not stated.notes[:-1]  # the last: the unit is perfect
    wrong = scenario(exported, outputs={**last, "quaternion_order": "wxyz"})
    assert "is vehicle.outputs.quaternion_order = 'wxyz' right?" in wrong.notes[0]


@pytest.mark.parametrize(("outputs", "step_s", "said"), [
    ({"height": "altitude"}, 0.1, "no variable 'altitude'"),
    ({"velocity": [VELOCITY[1], VELOCITY[0], VELOCITY[2]]}, 0.1, r"velocity (north|east) is"),
    ({}, 0.013, r"step_s = 0.013 s: allowed is a whole multiple of its own step, 0.01 s$"),
])  # fmt: skip
def test_wrong_outputs_and_steps_are_refused(outputs, step_s, said, exported, capfd):
    with pytest.raises(InputError, match=said):
        scenario(exported, outputs={**OUTPUTS, **outputs}, step_s=step_s)
    assert capfd.readouterr().out == ""  # the FMU's own words are no part of the output

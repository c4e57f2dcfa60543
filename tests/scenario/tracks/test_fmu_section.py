"""kind = "fmu": an outside model as truth, here an exported car; whether the scalar of quaternions comes first."""

import numpy as np
import pytest
from closed_track import truth_of

import insenv
from insenv import attitude
from insenv.base.errors import InputError
from insenv.scenario.tracks.fmu_section import contradictions, other_order

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


def flown(nose, roll):
    """Quaternions (n, 4) scalar first, velocity and acceleration of a flight at 60 m/s; nose: heading and pitch (n,), rad."""
    heading, pitch = nose
    direction = [np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), -np.sin(pitch)]
    velocity = 60.0 * np.column_stack(direction)
    q_nb = attitude.numeric.from_euler(roll, pitch, heading)
    return q_nb, velocity, np.gradient(velocity, TIME, axis=0)


TIME = np.arange(0.0, 60.0, 0.1)
ZERO = np.zeros_like(TIME)
FIGURES = {
    "loops": ((ZERO, 2.0 * np.pi * TIME / 15.0), ZERO), "rolls": ((ZERO, ZERO), 2.0 * np.pi * TIME / 6.0),
    "inverted for two thirds": ((ZERO, ZERO), np.where(TIME > 20.0, np.pi, 0.0)),
    "a circle upside down": ((2.0 * np.pi * TIME / 60.0, ZERO), ZERO + np.pi), "knife edge": ((ZERO, ZERO), ZERO + 0.5 * np.pi),
    "turns": ((2.0 * np.pi * TIME / 30.0, ZERO), ZERO + np.arctan(60.0 * 2.0 * np.pi / 30.0 / 9.81)),
}  # fmt: skip


@pytest.mark.parametrize("figure", FIGURES)
def test_aerobatics_are_no_wrong_order_and_a_wrong_order_is_none(figure):
    (heading, pitch), roll = FIGURES[figure]
    for course in np.radians(np.arange(0, 360, 15)):
        q_nb, velocity, acceleration = flown((heading + course, pitch), roll)
        assert other_order(contradictions(q_nb, "wxyz", velocity, acceleration), "wxyz") is None, course
        for moved, read, true in (([1, 2, 3, 0], "wxyz", "xyzw"), ([3, 0, 1, 2], "xyzw", "wxyz")):
            found = contradictions(q_nb[:, moved], read, velocity, acceleration)
            if figure in ("loops", "turns"):
                assert other_order(found, read) == true and other_order(found, true) is None, course

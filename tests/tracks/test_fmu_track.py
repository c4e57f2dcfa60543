"""kind = "fmu": an outside model as truth; here the outside model is an exported car, whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

import insenv
from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.scenario import build
from insenv.tracks.points import Points
from insenv.tracks.quaternion_order import contradictions, other_order
from insenv.tracks.shape import check_velocity, shaped

QUATERNION = [f"q_nb[{k}]" for k in (1, 2, 3, 4)]
OUTPUTS = {"latitude": "latitude", "longitude": "longitude", "height": "height", "quaternion": QUATERNION}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmu")


VELOCITY = [f"velocity_n[{k}]" for k in (1, 2, 3)]


def car():
    table = insenv.load("car-city-drive").model_dump(mode="json")
    return insenv.load(
        {**table, "duration_s": 100.0, "rate_hz": 100.0, "imu": {}, "vehicle": {**table["vehicle"], "engine": []}}
    )


def scenario(path, **vehicle):
    values = {"kind": "fmu", "file": str(path), "outputs": OUTPUTS, "run_s": 100.0, "step_s": 0.1, **vehicle}
    return insenv.load({"title": "t", "rate_hz": 100.0, "vehicle": values})


def truth_of(loaded):
    plant = build(loaded, seed=car().seed, duration_s=99.0)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    return {name: np.array(values) for name, values in shown.items()}


def closed_form(step_s, seconds=60.0):
    """Points of a motion in sines with their velocities, and its latitude, longitude, height and velocity at any time."""
    begin = np.radians([47.0, 11.0])

    def at(time):
        w = 2.0 * np.pi
        angles = begin + np.column_stack([300.0 * np.sin(w * time / 60.0), 2.0 * np.sin(w * time / 5.0)]) / 6.4e6
        rates = np.column_stack([5.0 * w * np.cos(w * time / 60.0), 0.4 * w * np.cos(w * time / 5.0)]) / 6.4e6
        height, climb = 500.0 + 0.1 * np.sin(w * time / 1.5), 0.1 * w / 1.5 * np.cos(w * time / 1.5)
        R_M, R_N = geodesy.numeric.radii(np.sin(angles[:, 0]))
        velocity = [(R_M + height) * rates[:, 0], (R_N + height) * np.cos(angles[:, 0]) * rates[:, 1], -climb]
        return np.column_stack([angles, height]), np.column_stack(velocity)

    time = np.arange(0.0, seconds + 0.5 * step_s, step_s)
    place, velocity = at(time)
    return Points("vehicle.fmu", time, *place.T, velocity=velocity), at


def apart(points, at):
    """Largest error of position (m) and velocity (m/s) of the track of some points, between them too."""
    shape = shaped(points, 0.1, None, "level")
    time = np.arange(0.0, points.time[-1], 0.005)
    place, velocity = at(time)
    latitude, longitude, height = (shape.spline.at(time)[:, :3] + shape.origin).T
    metres = np.array([6.4e6, 6.4e6, 1.0]) * (np.column_stack([latitude, longitude, height]) - place)
    R_M, R_N = geodesy.numeric.radii(np.sin(latitude))
    rates = shape.spline.at(time, 1)
    own = [(R_M + height) * rates[:, 0], (R_N + height) * np.cos(latitude) * rates[:, 1], -rates[:, 2]]
    return np.abs(metres).max(), np.abs(np.column_stack(own) - velocity).max()


def test_a_closed_form_with_its_velocities():
    """From its first point on: without the velocities nothing tells of the motion before it."""
    points, at = closed_form(0.1)
    position, velocity = apart(points, at)
    assert position < 1e-7 and velocity < 2e-6
    position, velocity = apart(replace(points, velocity=None), at)
    assert 1e-5 < position < 1e-3 and 1e-3 < velocity < 0.05


def test_small_contradictions_are_spread():
    """An Euler step of 10 ms leaves the velocity half a step ahead of the position: the truth stays near both."""
    points, at = closed_form(0.1)
    ahead = replace(points, velocity=at(points.time + 0.005)[1])
    position, velocity = apart(ahead, at)
    assert position < 1e-3 and velocity < 0.01


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda v: 3.6 * v, "velocity north is .* m/s at .* s, and .* m/s by the positions"),
        (lambda v: v[:, [1, 0, 2]], "check the order north, east, down, the unit"),
        (lambda v: v * [1.0, 1.0, -1.0], "velocity down is .* allowed is a difference of max_contradiction_mps = 0.05 m/s"),
        (lambda v: v * 1.003, "velocity north .* the Earth model"),
    ],
)
def test_velocities_that_contradict_the_positions_are_refused(wrong, message):
    points, _ = closed_form(0.1, 30.0)
    points = replace(points, velocity=wrong(points.velocity))
    with pytest.raises(InputError, match=message):
        check_velocity(points, shaped(points, 0.1, None, "level"), 0.05)


@pytest.mark.parametrize("fmi", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_the_velocities_of_the_fmu_are_those_of_the_track(fmi, folder):
    path = folder / f"moving{fmi}.fmu"
    insenv.export_fmu(car(), path, fmi=fmi)
    ours, theirs = truth_of(scenario(path, outputs={**OUTPUTS, "velocity": VELOCITY})), truth_of(car())
    for name, scale in (("latitude", 6.37e6), ("longitude", 6.37e6), ("height", 1.0)):
        assert scale * np.abs(ours[name] - theirs[name]).max() < 1e-4, name
    assert np.abs(ours["velocity_n"] - theirs["velocity_n"]).max() < 2.5e-3
    east_first = [VELOCITY[1], VELOCITY[0], VELOCITY[2]]
    with pytest.raises(InputError, match=r"velocity (north|east) is"):
        scenario(path, outputs={**OUTPUTS, "velocity": east_first})
    with pytest.raises(InputError, match=r"no variable 'velocity_n.4.'"):
        scenario(path, outputs={**OUTPUTS, "velocity": [*VELOCITY[:2], "velocity_n[4]"]})


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_track_is_that_of_the_fmu(fmi, folder):
    path = folder / f"car{fmi}.fmu"
    insenv.export_fmu(car(), path, fmi=fmi)
    ours, theirs = truth_of(scenario(path)), truth_of(car())
    for name, scale in (("latitude", 6.37e6), ("longitude", 6.37e6), ("height", 1.0)):
        assert scale * np.abs(ours[name] - theirs[name]).max() < 1e-3, name
    assert np.abs(ours["velocity_n"] - theirs["velocity_n"]).max() < 0.01
    between = 2.0 * np.arccos(np.clip(np.abs(np.sum(ours["q_nb"] * theirs["q_nb"], axis=1)), 0.0, 1.0))
    assert np.degrees(between).max() < 0.02


def test_a_quaternion_with_its_scalar_last_is_read_where_stated_and_refused_where_not(folder):
    path = folder / "order.fmu"
    insenv.export_fmu(car(), path, fmi=2)
    last = [*QUATERNION[1:], QUATERNION[0]]
    with pytest.raises(InputError, match=r"scalar of the quaternion first, by \d deg with it last: state .*order = 'xyzw'"):
        scenario(path, outputs={**OUTPUTS, "quaternion": last})
    stated = scenario(path, outputs={**OUTPUTS, "quaternion": last, "quaternion_order": "xyzw"})
    assert np.array_equal(truth_of(stated)["q_nb"], truth_of(scenario(path))["q_nb"])
    assert not stated.notes[:-1]  # the last: the unit is perfect
    wrong = scenario(path, outputs={**OUTPUTS, "quaternion": last, "quaternion_order": "wxyz"})
    assert "is vehicle.outputs.quaternion_order = 'wxyz' right?" in wrong.notes[0]


def flown(nose, roll):
    """Quaternions (n, 4) scalar first, velocity and acceleration of a flight at 60 m/s; nose: heading and pitch (n,), rad."""
    time = np.arange(len(roll)) * 0.1
    heading, pitch = nose
    direction = [np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), -np.sin(pitch)]
    velocity = 60.0 * np.column_stack(direction)
    q_nb = attitude.numeric.from_euler(roll, pitch, heading)
    return q_nb, velocity, np.gradient(velocity, time, axis=0)


TIME = np.arange(0.0, 60.0, 0.1)
ZERO = np.zeros_like(TIME)
FIGURES = {
    "loops": ((ZERO, 2.0 * np.pi * TIME / 15.0), ZERO),
    "rolls": ((ZERO, ZERO), 2.0 * np.pi * TIME / 6.0),
    "inverted for two thirds": ((ZERO, ZERO), np.where(TIME > 20.0, np.pi, 0.0)),
    "a circle upside down": ((2.0 * np.pi * TIME / 60.0, ZERO), ZERO + np.pi),
    "knife edge": ((ZERO, ZERO), ZERO + 0.5 * np.pi),
    "turns": ((2.0 * np.pi * TIME / 30.0, ZERO), ZERO + np.arctan(60.0 * 2.0 * np.pi / 30.0 / 9.81)),
}


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("course", np.radians(np.arange(0, 360, 15)))
def test_aerobatics_are_no_wrong_order_and_a_wrong_order_is_none(figure, course):
    (heading, pitch), roll = FIGURES[figure]
    q_nb, velocity, acceleration = flown((heading + course, pitch), roll)
    assert other_order(contradictions(q_nb, "wxyz", velocity, acceleration), "wxyz") is None
    if figure in ("loops", "turns"):
        found = contradictions(q_nb[:, [1, 2, 3, 0]], "wxyz", velocity, acceleration)
        assert other_order(found, "wxyz") == "xyzw" and other_order(found, "xyzw") is None
        found = contradictions(q_nb[:, [3, 0, 1, 2]], "xyzw", velocity, acceleration)
        assert other_order(found, "xyzw") == "wxyz" and other_order(found, "wxyz") is None


@pytest.mark.parametrize("course", np.radians(np.arange(0, 360, 15)))
def test_a_drone_that_flies_sideways_has_the_right_order(course):
    q_nb, velocity, acceleration = flown((ZERO + course, ZERO), ZERO)
    across = velocity @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for moved in (across, -across):
        assert other_order(contradictions(q_nb, "wxyz", moved, acceleration), "wxyz") is None


def test_wrong_fmus_are_refused(folder, capfd):
    path = folder / "car2.fmu"
    insenv.export_fmu(car(), path, fmi=2)
    with pytest.raises(InputError, match="no variable 'altitude'"):
        scenario(path, outputs={**OUTPUTS, "height": "altitude"})
    with pytest.raises(InputError, match="roll, pitch and heading, or quaternion"):
        scenario(path, outputs={**OUTPUTS, "roll": "latitude"})
    with pytest.raises(InputError, match="quaternion_order = 'xyzw' has no effect without quaternion"):
        scenario(
            path, outputs={name: OUTPUTS[name] for name in ("latitude", "longitude", "height")} | {"quaternion_order": "xyzw"}
        )
    with pytest.raises(InputError, match=r"none.fmu: file not found"):
        scenario(folder / "none.fmu")
    for key, count in (("velocity", "three"), ("quaternion", "four")):
        with pytest.raises(InputError, match=rf"{key} = .*: must be a list of {count} names of variables"):
            scenario(path, outputs={**OUTPUTS, key: ["a", "b"]})
    for step_s in (0.013, 0.005):
        with pytest.raises(InputError, match=rf"step_s = {step_s} s: allowed is a whole multiple of its own step, 0.01 s$"):
            scenario(path, step_s=step_s)
    assert capfd.readouterr().out == ""  # the FMU's own words are no part of the output
    (folder / "no.fmu").write_text("no", encoding="utf-8")
    with pytest.raises(InputError, match=r"no.fmu: no FMU"):
        scenario(folder / "no.fmu")

"""The surroundings of a moored ship: a steered sea, and a passing wave."""

import numpy as np
import pytest
from changed_scenario import changed

import insenv
from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.scenario import build, load


def steered(*commands):
    """A swaying ship with a perfect unit whose sea obeys `commands`."""
    known, vehicle = {"draw_errors": False}, {"steered_sea": True}
    return changed("ship-swaying", commands=list(commands), imu={"grade": "perfect"}, knowledge=known, vehicle=vehicle)


def test_the_motion_has_one_size_and_a_wave_lifts_and_heels_to_starboard():
    """Closed forms: three displacements and the roll of a sea that grows to twice its size; from 40 s on a wave of 2 m."""
    plant = build(steered({"at_s": 3.0, "sea": 2.0}, {"at_s": 40.0, "wave": 2.0}), duration_s=60.0, driven=True)
    runner, inputs = make_runner(plant.model, plant.parameters), plant.inputs(0, plant.samples)
    shown = plant.model.outputs.unpack(runner.run(plant.samples, inputs))
    names = ("latitude", "longitude", "height")
    start = [plant.parameters[f"start_{name}"] for name in names]
    moved = np.asarray(geodesy.numeric.ned_offset(*(shown[name] for name in names), *start))
    time, periods = shown["time"], np.array([7.0, 6.0, 8.0])
    waves = np.array([0.5, 0.5, 1.0]) * np.sin(2 * np.pi * time[:, None] / periods)
    size = np.hypot(*moved.T[:2]) / np.hypot(*waves.T[:2])
    clear = np.hypot(*waves.T[:2]) > 0.2
    before, last = clear & (time < 40.0), np.flatnonzero(clear)[-1]
    np.testing.assert_allclose(moved[before], (size[:, None] * waves)[before], atol=2e-3)
    assert size[clear][0] < 1.001 and 1.9 < size[last] < 2.0
    assert moved[last, 2] == pytest.approx(size[last] * waves[last, 2] - 2.0, abs=0.01)
    roll = attitude.numeric.to_euler(shown["q_nb"])[0][last]
    assert roll == pytest.approx(size[last] * np.radians(10.0) * waves[last, 2] + 2.0 * 0.03, abs=0.002)


def test_commands_move_the_ship_truly():
    """With a perfect unit free-inertial navigation follows a growing sea and a passing wave."""
    commands = {"at_s": 3.0, "sea": 2.0}, {"at_s": 8.0, "wave": 2.0}, {"at_s": 14.0, "wave": 0.0}
    report = insenv.run(steered(*commands), "wander-sins", duration_s=25.0)
    for channel in ("north_m", "east_m", "down_m"):
        assert np.max(np.abs(report.results[0].errors[channel])) < 1e-5
    under_way = load("ship-underway").vehicle
    assert under_way.steerable() is under_way, "it keeps its own commands"

"""The surroundings of a moored ship: a steered sea, and a passing wave."""

import numpy as np

import insenv
from insenv.core.runner import make_runner
from insenv.scenario import build, load


def steered(name, **further):
    values = load(name).model_dump(mode="json", exclude_unset=True)
    return {**values, **further, "vehicle": {**values["vehicle"], "steered_sea": True}}


def test_without_commands_the_run_is_the_same_to_the_bit():
    plain, other = (build(load(given), duration_s=4.0) for given in ("ship-irregular-sea", steered("ship-irregular-sea")))
    shown, same = (make_runner(plant.model, plant.parameters).run(plant.samples) for plant in (plain, other))
    assert other.model.inputs.size == 3 and shown.tobytes() == same.tobytes()


def test_commands_move_the_ship_truly():
    """With a perfect unit free-inertial navigation follows a growing sea and a passing wave."""
    commands = [{"at_s": 3.0, "sea": 2.0}, {"at_s": 8.0, "wave": 2.0}, {"at_s": 14.0, "wave": 0.0}]
    exact = {"imu": {"grade": "perfect"}, "knowledge": {"draw_errors": False}}
    report = insenv.run(steered("ship-swaying", commands=commands, **exact), "wander-sins", duration_s=25.0)
    time, height = report.truth.time, report.truth.height
    assert np.max(np.abs(height[time > 16.0] - height[0])) > 1.5  # twice the sway of 1 m
    for channel in ("north_m", "east_m", "down_m"):
        assert np.max(np.abs(report.results[0].errors[channel])) < 1e-5
    under_way = load("ship-underway").vehicle
    assert under_way.steerable() is under_way, "it keeps its own commands"

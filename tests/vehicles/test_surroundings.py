"""The surroundings of a moored ship: a steered sea, and a passing wave."""

import numpy as np
from changed_scenario import changed

import insenv
from insenv.scenario import load


def test_commands_move_the_ship_truly():
    """With a perfect unit free-inertial navigation follows a growing sea and a passing wave."""
    commands = [{"at_s": 3.0, "sea": 2.0}, {"at_s": 8.0, "wave": 2.0}, {"at_s": 14.0, "wave": 0.0}]
    known, steered = {"draw_errors": False}, {"steered_sea": True}
    scenario = changed("ship-swaying", commands=commands, imu={"grade": "perfect"}, knowledge=known, vehicle=steered)
    report = insenv.run(scenario, "wander-sins", duration_s=25.0)
    time, height = report.truth.time, report.truth.height
    assert np.max(np.abs(height[time > 16.0] - height[0])) > 1.5  # twice the sway of 1 m
    for channel in ("north_m", "east_m", "down_m"):
        assert np.max(np.abs(report.results[0].errors[channel])) < 1e-5
    under_way = load("ship-underway").vehicle
    assert under_way.steerable() is under_way, "it keeps its own commands"

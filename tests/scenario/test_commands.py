"""Commands of a scenario by time."""

import gymnasium
import numpy as np
import pytest

import insenv
from insenv.scenario import build, load

CAR = {**load("car-survey").model_dump(mode="json", exclude_unset=True), "duration_s": 10.0}
COMMANDS = ({"at_s": 0.5, "speed": 5.0}, {"at_s": 2.0, "yaw_rate": 0.1}, {"at_s": 2.0, "speed": 6.0})


def with_commands(*commands):
    return {**CAR, "commands": list(commands)}


def test_inputs_hold_until_the_next_entry():
    plant = build(load(with_commands(*COMMANDS)), driven=True)
    rate, inputs = plant.scenario.rate_hz, plant.model.inputs
    first, second = round(0.5 * rate), round(2.0 * rate)
    rows = plant.inputs(0, second + 10)
    named = inputs.unpack(rows)
    assert np.all(named["command_valid"] == (np.arange(second + 10) >= first))
    assert np.all(named["command_speed"][first:second] == 5.0) and np.all(named["command_speed"][second:] == 6.0)
    assert np.all(named["command_yaw_rate"][first:second] == 0.0) and np.all(named["command_yaw_rate"][second:] == 0.1)
    later = plant.inputs(first + 3, 40)  # in chunks as in one piece
    assert np.array_equal(later, rows[first + 3 : first + 43])


def test_run_follows_them():
    report = insenv.run(with_commands({"at_s": 1.0, "speed": 8.0, "acceleration": 2.0}), "loosely-coupled")
    speed = np.hypot(report.truth.velocity_n[-1, 0], report.truth.velocity_n[-1, 1])
    assert speed == pytest.approx(8.0, abs=0.1)
    assert any(note.startswith("no limit: limits are taken along the course of a scenario") for note in report.notes)


def test_wrong_entries_are_named_and_others_refuse_them():
    for entry, message in (
        ({"at_s": 1.0, "sped": 1.0}, r"commands\[0\]: unknown command 'sped'; did you mean 'speed'"),
        ({"at_s": 1.0, "speed": 1e3}, r"commands\[0\]: command_speed"),
    ):
        with pytest.raises(insenv.InputError, match=message):
            load(with_commands(entry))
    for use in (
        insenv.limit,
        lambda each: insenv.campaign(each, "loosely-coupled", 2),
        lambda each: gymnasium.make("insenv/VehicleNavigation-v0", scenario=each),
    ):
        with pytest.raises(insenv.InputError, match="nothing else does"):
            use(with_commands(*COMMANDS))

"""The constraint of the wheels where nothing is told of how the unit is mounted to them."""

from __future__ import annotations

import numpy as np
import pytest
from peers import package
from places import ROOT

import insenv
from insenv.estimators.fusion.odometer import UNTOLD_ARM
from insenv.scenario import build, load

N380 = ROOT / "examples" / "n380-car-position-only.toml"
AIDS = ["gnss", "zero_velocity", "non_holonomic"]


@pytest.mark.slow
def test_a_real_drive_has_its_heading_within_its_sigma():
    """The unit is turned by 2 deg against the wheels; taken as 0 the heading is 1.6 deg off, 9 stated sigmas."""
    package("onavdata")
    result = insenv.replay(N380, "fusion", settings={"fusion": {"aids": AIDS}}).results[0]
    moving = result.time >= 350.0
    heading, sigma = result.errors["heading_deg"][moving], result.sigma["heading_deg"][moving]
    assert abs(heading[-1]) < 2 * sigma[-1]  # at rest, at the end
    assert np.sqrt(np.nanmean((heading / sigma) ** 2)) < 1.0
    place = [np.sqrt(np.nanmean(result.errors[name][moving] ** 2)) for name in ("north_m", "east_m", "down_m")]
    assert np.all(np.array(place) < 0.33)
    mounting, stated = (np.degrees(result.outputs[f"odometer_mounting_error{end}"][-1]) for end in ("", "_estimate_sigma"))
    assert np.all(stated < 0.5) and abs(mounting[1] + 2.0) < 3 * stated[1]
    assert not any("does not fit" in note for note in result.notes)


def test_the_mounting_is_a_state_and_the_lever_arm_is_noise_where_neither_is_told():
    untold, told = (build(load(name), seed=1, duration_s=2.0) for name in ("car-city-drive", "car-odometer"))
    filter = insenv.fusion([], AIDS)
    assert float(untold.parameters_of(untold.adapted(filter))["non_holonomic_arm_sigma"]) == UNTOLD_ARM
    assert float(told.parameters_of(told.adapted(filter)).get("non_holonomic_arm_sigma", 0.0)) == 0.0
    chosen = insenv.run("car-city-drive", "fusion", duration_s=2.0, settings={"fusion": {"aids": AIDS}}).results[0]
    assert "odometer_mounting_error" in chosen.outputs
    exact, known = (insenv.run(name, filter, duration_s=2.0).results[0].notes for name in ("car-city-drive", "car-odometer"))
    assert any("use the state odometer_mounting_error" in note for note in exact)
    assert not any("nothing is told of how the unit is mounted" in note for note in known)

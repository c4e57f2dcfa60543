"""Fixes at their own time, against a motion in closed form: with a lever arm, and late."""

import earth_fixed
import numpy as np
import pytest
from changed_scenario import changed
from driven import fed, of_model
from earth_fixed import with_fixes

import insenv
from insenv.base.errors import InputError
from insenv.estimators import get
from insenv.scenario import build

ARM, MAST = np.array([2.0, -1.0, -3.0]), np.array([0.0, 0.0, -15.0])
FLIGHT = earth_fixed.Motion()
SWAY = earth_fixed.Motion(speed=5.0, swings=(), turns=((0.13, 0.785, 1.0, (1.0, 0.3, 0.0)), (0.05, 0.6, 0.4, (0.0, 1.0, 0.2))))
SURE = {
    "position_sigma": 1e-3, "velocity_sigma": 1e-4, "tilt_sigma": 1e-6, "heading_sigma": 1e-6, "gyro_bias_sigma": 1e-9,
    "accel_bias_sigma": 1e-7, "angle_random_walk": 0.0, "velocity_random_walk": 0.0, "standing_window": 0.0,
    "moving": 1.0, "coarse_time": 0.0, "update_interval": 0.1, "filter_interval": 0.5,
}  # fmt: skip


@pytest.mark.parametrize("id", ["loosely-coupled", "smoother", "aqe-ekf", "aqe-sukf", "ecef-kf"])
@pytest.mark.parametrize(("motion", "arm", "age", "place", "speed"), [
    (FLIGHT, ARM, 0.0, 1e-3, 2e-3),
    (FLIGHT, ARM, 0.0037, 1e-3, 2e-3),  # between two samples
    (FLIGHT, ARM, 0.2, 0.015, 0.05),
    (SWAY, MAST, 0.2, 0.015, 0.015),
])  # fmt: skip
def test_an_exact_fix_leaves_no_innovation(id, motion, arm, age, place, speed):
    """At 250 m/s, and on a mast of 15 m in sway: a time wrong by 0.2 s is 50 m, an arm that swings the wrong way 1 m/s.

    What is left: acceleration and angular acceleration are taken as constant over the age of the fix.
    """
    dt, model = 0.01, get(id).model
    columns, _ = with_fixes(motion, arm, 8.0, dt, {800: age})
    known = {**motion.start(), **{k.removeprefix("start_"): v for k, v in motion.start().items()}, **SURE}
    known["antenna_lever_arm"] = arm
    innovation = np.abs(fed(model, columns, of_model(model, known), "interpreter").outputs()["innovation"])
    assert 0.0 < innovation[-3:].max() < speed
    assert id == "ecef-kf" or 0.0 < innovation[:3].max() < place


def late(name, sensor, latency_s):
    """A scenario whose instrument measures every 4 s and delivers late."""
    return changed(name, **{sensor: {"interval_s": 4.0, "latency_s": latency_s}})


@pytest.mark.parametrize(("name", "sensor", "id", "allowed", "too_late"), [
    ("ship-dvl", "dvl", "fusion", 1.0, 1.5), ("car-odometer", "odometer", "fusion-smoother", 1.0, 3.0),
    ("car-city-drive", "gnss", "loosely-coupled", 1.0, 1.2), ("car-city-drive", "gnss", "aqe-sukf", 0.4, 1.0),
    ("ship-at-sea", "gnss", "velocity-integration", 0.9, 3.0),
])  # fmt: skip
def test_measurements_that_are_too_old_are_refused(name, sensor, id, allowed, too_late):
    plant = build(late(name, sensor, allowed))
    plant.parameters_of(plant.adapted(id))
    plant = build(late(name, sensor, too_late))
    with pytest.raises(InputError, match=rf"'{id}' uses measurements .* scenario '{name}' are up to {too_late:g} s old"):
        plant.parameters_of(plant.adapted(id))


def test_a_log_of_old_measurements_is_refused(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    log = insenv.record(late("ship-at-sea", "gnss", 3.0), duration_s=9.0)
    with pytest.raises(InputError, match=r"'fusion' uses measurements .* those of GNSS of the log are up to 3 s old"):
        insenv.replay(log, "fusion", start="stated")

"""Specific force against the velocities of the receiver: what a true and a wrong attitude leave of them."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scenario import changed
from places import ROOT
from simulated_log import simulated_log

from insenv import attitude, replay
from insenv.logs import load
from insenv.runs.velocity_changes import velocity_changes


def test_the_true_attitude_leaves_nothing_of_exact_velocities():
    gnss = {"grade": "rtk", "outlier_probability": 0.0, "velocity_noise_mps": 1e-4, "lever_arm_m": [-3.0, 1.0, -2.0]}
    log = simulated_log(changed("car-city-drive", imu={"grade": "perfect"}, gnss=gnss), duration_s=120.0)
    changes, true = velocity_changes(log), log.reference
    at = np.searchsorted(log.imu_time, changes.time)
    left = changes.left(attitude.numeric.from_euler(true.roll[at], true.pitch[at], true.heading[at]))
    assert len(at) == 118 and np.abs(left).max() < 5e-3
    level = replace(log.gnss, velocity_sigma=log.gnss.velocity_sigma * [1.0, 1.0, 1e6])
    assert velocity_changes(replace(log, gnss=level)).known.all(axis=0).tolist() == [True, True, False]


def test_a_reference_that_contradicts_the_log_is_named():
    log = load(ROOT / "examples" / "logs" / "plain.toml")
    for turned, late_s, left in ((0.0, 0.0, 0.121), (np.pi / 2, 0.0, 2.31), (0.0, 4.4, 1.29)):
        reference = replace(log.reference, time=log.reference.time + late_s, heading=log.reference.heading + turned)
        found = replay(replace(log, reference=reference), "loosely-coupled").results[0]
        assert [found.specific_force.estimate, found.specific_force.reference] == pytest.approx([0.121, left], rel=0.02)
        assert ("reference-contradicted" in {note.code for note in found.notes}) == (left > 1.0)

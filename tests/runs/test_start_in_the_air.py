"""The attitude where a log starts under way, by the specific force between two fixes and a magnetometer."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scenario import changed
from scipy.spatial.transform import Rotation
from standing_car import NOTHING, beyond, started

from insenv import record, replay
from insenv.base.errors import InputError
from insenv.logs.recorded import GnssFixes, RecordedLog
from insenv.runs.instrument_start import attitude_under_way

TURNING = {"legs": [{"turn_deg": 3600.0, "duration_s": 40.0}], "repeat_legs": True}


def flight(seed: int, duration_s: float = 8.0, **sections) -> RecordedLog:
    """A multirotor in the air, of which the log gives no start."""
    return started(record(changed("multirotor-hover", **sections), seed=seed, duration_s=duration_s), **NOTHING)


def errors_over_sigma(log: RecordedLog, first: int) -> list[float]:
    found, reference = attitude_under_way(log, first, 300.0), log.reference
    at = np.searchsorted(reference.time, log.imu_time[first] - log.dt[first])
    errors = found.roll - reference.roll[at], found.pitch - reference.pitch[at], found.heading.heading - reference.heading[at]
    sigmas = found.tilt_sigma, found.tilt_sigma, found.heading.sigma
    assert all(np.radians(2.9) < sigma < np.radians(10.0) for sigma in sigmas)
    return [float(np.angle(np.exp(1j * error))) / sigma for error, sigma in zip(errors, sigmas, strict=True)]


@pytest.mark.parametrize("vehicle", [{}, TURNING])
def test_the_attitude_in_the_air_is_as_good_as_stated(vehicle):
    """Eight seeds, hovering and turning at 90 deg/s, where level and reading are carried to the start."""
    ratios = np.array([errors_over_sigma(flight(seed, vehicle=vehicle), 150) for seed in range(300, 308)])
    assert np.abs(ratios).max() < 2.0 and (np.sqrt(np.mean(ratios**2, axis=0)) > 0.05).all()


def later(log: RecordedLog, by_s: float) -> RecordedLog:
    """The log with instruments that read nothing for a time from its begin on."""
    return replace(log, instruments=tuple(each.at(each.time > log.imu_time[0] + by_s) for each in log.instruments))


def test_a_reading_that_comes_after_half_a_turn_is_carried_back():
    assert np.abs(errors_over_sigma(later(flight(309, vehicle=TURNING), 2.0), 0)).max() < 2.0


def test_a_level_is_carried_back_over_a_roll():
    """The unit rolls from 20 deg back to level in the first half second, before fixes and readings show the attitude."""
    log = later(flight(310), 1.0)
    late = log.gnss.time > log.imu_time[0] + 1.0
    log = replace(log, gnss=GnssFixes(**{name: None if each is None else each[late] for name, each in vars(log.gnss).items()}))
    roll = np.radians(20.0) * np.clip(1.0 - np.append(0.0, log.imu_time - log.imu_time[0] + log.dt[0]) / 0.5, 0.0, 1.0)
    middle = (roll[:-1] + roll[1:]) / 2
    back = Rotation.from_rotvec(np.outer(-middle, [1.0, 0.0, 0.0]))
    rolled = replace(
        log,
        delta_angle=back.apply(log.delta_angle) + np.outer(np.diff(roll), [1.0, 0.0, 0.0]),
        delta_velocity=back.apply(log.delta_velocity),
    )
    plain, found = attitude_under_way(log, 0, 300.0), attitude_under_way(rolled, 0, 300.0)
    assert np.degrees(found.roll - plain.roll) == pytest.approx(20.0, abs=1.0)
    assert np.degrees([found.pitch - plain.pitch, found.heading.heading - plain.heading.heading]) == pytest.approx(0, abs=2.0)


def test_a_filter_starts_in_the_air():
    log = flight(311, 40.0)
    for id in ("fusion", "loosely-coupled"):
        result = replay(log, id).results[0]
        assert any("is that of the magnetometer where the mean specific force is up" in note for note in result.notes)
        for name in ("roll_deg", "pitch_deg", "heading_deg"):
            assert beyond(result, name, result.time > 0.0) < 0.02, (id, name)
        assert result.sigma["roll_deg"][0] > 2.9


def test_neither_fixes_without_velocity_nor_a_reading_that_comes_late_show_it():
    log = flight(312)
    without = replace(log, gnss=replace(log.gnss, velocity_n=None, velocity_sigma=None))
    for one in (without, later(log, 5.5)):
        assert attitude_under_way(one, 0, 300.0) is None
        with pytest.raises(InputError, match="the log does not begin at rest"):
            replay(one, "loosely-coupled")


def test_an_acceleration_hides_the_level():
    """2 m/s^2 turn the specific force by 12 deg."""
    log = flight(313)
    pushed = log.gnss.velocity_n + np.outer(log.gnss.time - log.gnss.time[0], [2.0, 0.0, 0.0])
    assert attitude_under_way(replace(log, gnss=replace(log.gnss, velocity_n=pushed)), 0, 300.0) is None

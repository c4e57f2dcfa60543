"""What fixes say of a barometer: moving air counts as noise, and noise as stated, a lag, a datum and outages do not."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scenario import changed

from insenv import record
from insenv.logs.barometric import disturbed, with_barometer_judged
from insenv.logs.recorded import GnssFixes, Readings

STATED, INTERVAL, SIGMA = 0.1, 0.1, 0.05


def fixes(down: np.ndarray, interval: float = 0.2, **more) -> GnssFixes:
    """Fixes with these downward velocities, and noise of `SIGMA`."""
    n, noise = len(down), SIGMA * np.random.default_rng(2).standard_normal(len(down))
    velocity = np.column_stack([np.zeros((n, 2)), down + noise])
    zero = np.zeros(n)
    shown = {"velocity_n": velocity, "velocity_sigma": np.full((n, 3), 0.5), **more}
    return GnssFixes(interval * np.arange(n), zero, zero, zero, np.ones((n, 3)), **shown)


def barometer(heights: np.ndarray) -> Readings:
    noisy = heights + STATED * np.random.default_rng(3).standard_normal(len(heights))
    return Readings("barometer", "BARO", INTERVAL * np.arange(len(heights)), noisy[:, None], ("barometer_height",))


def air(count: int, spread: float, lasting: float) -> np.ndarray:
    """First-order Gauss-Markov changes with a correlation time of half of `lasting` (s)."""
    kept, w, values = np.exp(-2 * INTERVAL / lasting), np.random.default_rng(4).standard_normal(count), np.zeros(count)
    for i in range(1, count):
        values[i] = kept * values[i - 1] + spread * np.sqrt(1 - kept**2) * w[i]
    return values


def climbing(count: int, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights and downward velocities of a vehicle that climbs and sinks at up to 3 m/s."""
    t = interval * np.arange(count)
    return 30.0 - 30.0 * np.cos(0.1 * t), -3.0 * np.sin(0.1 * t)


def test_moving_air_counts_as_noise():
    """0.6 m that last for 0.8 s are 1.7 m at 10 Hz."""
    height, _ = climbing(6000, INTERVAL)
    noise, said = disturbed(barometer(height + 57.0 + air(6000, 0.6, 0.8)), fixes(climbing(3000, 0.2)[1]), STATED, 0.0)
    assert noise == pytest.approx(0.6 * np.sqrt(0.8 / INTERVAL), rel=0.2)
    assert said.code == "barometer-disturbed" and "instead of 0.1 m" in said


def test_noise_as_stated_a_climb_a_datum_and_drift_do_not():
    height, down = climbing(6000, INTERVAL)[0], climbing(3000, 0.2)[1]
    assert disturbed(barometer(height + 57.0 + 1e-3 * np.arange(6000)), fixes(down), STATED, 0.0) is None
    assert disturbed(barometer(height + air(6000, 0.13, 0.8)), fixes(down), STATED, 0.0) is None  # not much beside 0.1 m


def test_a_stated_lag_does_not():
    """Half a second behind a height that changes by 3 m/s is 1.5 m."""
    time, down = INTERVAL * np.arange(6000), -9.0 * np.sin(0.9 * 0.2 * np.arange(3000))
    behind = barometer(10.0 - 10.0 * np.cos(0.9 * (time - 0.5)))
    assert disturbed(behind, fixes(down), STATED, 0.5) is None
    assert disturbed(behind, fixes(down), STATED, 0.0) is not None


def test_fixes_without_vertical_velocity_or_with_a_noisy_one_say_nothing():
    shaken = barometer(air(6000, 0.6, 2.0))
    assert disturbed(shaken, fixes(np.zeros(3000)), STATED, 0.0) is not None
    for without in ({"velocity_n": None, "velocity_sigma": None}, {"velocity_sigma": np.full((3000, 3), 1e3)}):
        assert disturbed(shaken, fixes(np.zeros(3000), **without), STATED, 0.0) is None
    noisy = 3.0 * np.random.default_rng(5).standard_normal((3000, 3))
    sigma = np.full((3000, 3), 3.0)
    assert disturbed(shaken, fixes(np.zeros(3000), velocity_n=noisy, velocity_sigma=sigma), STATED, 0.0) is None
    assert disturbed(shaken.at(shaken.time < 20.0), fixes(np.zeros(3000)), STATED, 0.0) is None  # too short


def test_outages_are_no_moving_air():
    """Over 15 s of each 20 s without fixes the way is a straight line, and the height is not."""
    (height, _), down, time = climbing(6000, INTERVAL), climbing(3000, 0.2)[1], INTERVAL * np.arange(6000)
    whole = fixes(down)
    kept = whole.time % 20.0 < 5.0
    cut = GnssFixes(**{name: None if each is None else each[kept] for name, each in vars(whole).items()})
    assert disturbed(barometer(height + 8.0 * np.sin(time) * (time % 20.0 > 5.2)), cut, STATED, 0.0) is None


def test_heights_that_are_all_the_same_are_left_out_where_the_vehicle_turns():
    log = record(changed("multirotor-hover"), seed=3, duration_s=20.0)
    stuck = replace(
        log, instruments=tuple(replace(each, values=0 * each.values + 480.0) if each.id == "barometer" else each
                               for each in log.instruments))  # fmt: skip
    swinging = stuck.delta_angle + np.sin(np.arange(len(log.dt)) / 300)[:, None] / 500
    left = with_barometer_judged(replace(stuck, delta_angle=swinging))
    assert "barometer" not in [each.id for each in left.instruments] and "barometer-stuck" in [each.code for each in left.notes]
    still = with_barometer_judged(replace(stuck, delta_angle=0 * stuck.delta_angle))
    assert "barometer" in [each.id for each in still.instruments]


@pytest.mark.parametrize("name", ["multirotor-hover", "car-city-drive"])
def test_a_simulated_log_stays_as_it_is(name):
    log = record(changed(name, barometer={"grade": "ms5611"}), seed=3, duration_s=100.0)
    judged = with_barometer_judged(log)
    assert judged.stated_errors == log.stated_errors and judged.notes == log.notes

"""The heading of a start by the motion: found, and checked where one is given."""

import re
from dataclasses import replace

import numpy as np
import pytest
from standing_car import HEADING, beyond, car_log, started

from insenv import attitude, geodesy, replay
from insenv.base.errors import InputError
from insenv.runs.heading_bank import _decided


def rtk(log):
    """With fixes as good as they say: 2 cm and 2 cm/s."""
    sigma = np.full(log.gnss.position_sigma.shape, 0.02)
    noise = np.random.default_rng(7).normal(size=(2, *sigma.shape)) * 0.02
    of, t = log.reference, log.gnss.time
    at = [np.interp(t, of.time, values) for values in (of.latitude, of.longitude, of.height)]
    place = dict(zip(("latitude", "longitude", "height"), geodesy.numeric.geodetic_from_ned_offset(noise[0], *at), strict=True))
    velocity = np.stack([np.interp(t, of.time, v) for v in of.velocity_n.T], axis=1) + noise[1]
    gnss = replace(log.gnss, **place, velocity_n=velocity, position_sigma=sigma, velocity_sigma=sigma)
    return replace(log, gnss=gnss, lever_arm_b=np.zeros(3))


@pytest.mark.parametrize(
    ("grade", "wrong", "duration_s"),
    [("consumer", (-20.0,), 70.0), pytest.param("tactical", (20.0, -60.0, 180.0), 150.0, marks=pytest.mark.slow)],
)
def test_a_heading_that_the_motion_contradicts_is_replaced(grade, wrong, duration_s):
    """With fixes of 2 cm a linear filter that keeps it ends 0.09 deg wrong in roll from 60 deg off, at a stated 0.006."""
    log = rtk(car_log(grade, duration_s))
    for error in wrong:
        found = replay(started(log, heading_deg=HEADING + error), ["loosely-coupled"]).results[0]
        assert "contradicts the motion" in found.notes[0] and "navigation starts with" in found.notes[0]
        for name in ("roll_deg", "pitch_deg", "heading_deg", "north_m", "vn_mps"):
            assert beyond(found, name, found.time > 40.0) < 0.01, (name, error)
        assert found.health.verdict == "consistent"
    right = replay(started(log, heading_deg=HEADING), ["loosely-coupled"]).results[0]
    assert not any("contradicts the motion" in note for note in right.notes)


def test_a_vehicle_that_moves_sideways_keeps_its_heading():
    """A drone flies in any direction: its course does not contradict the heading."""
    log = car_log("tactical", 50.0)
    # the unit's x axis points to the right side and 13 deg forward: between two headings of the bank
    turn = attitude.numeric.to_dcm(attitude.numeric.from_euler(0.0, 0.0, np.radians(77.0))).T
    log = replace(log, delta_angle=log.delta_angle @ turn.T, delta_velocity=log.delta_velocity @ turn.T)
    log = replace(log, lever_arm_b=turn @ log.lever_arm_b)
    found = replay(started(log, heading_deg=HEADING + 77.0), ["loosely-coupled"]).results[0]
    assert not any("navigation starts with" in note for note in found.notes)
    assert any("from the direction of travel: if this vehicle moves forward" in note for note in found.notes)
    assert found.errors["heading_deg"][-1] == pytest.approx(77.0, abs=1.0)  # the reference has that of the car
    assert found.sigma["heading_deg"][0] < 6.0


@pytest.mark.parametrize(("grade", "velocity"),
    [*(pytest.param(grade, True, marks=pytest.mark.slow) for grade in ("tactical", "consumer")),
     ("industrial", False)])  # fmt: skip
def test_the_motion_shows_the_heading_of_a_start(grade, velocity):
    """At rest for ten seconds, and under way; the sigma that is stated holds."""
    log = car_log(grade, 110.0)
    log = replace(log, description=log.description.model_copy(update={"vehicle_kind": "car"}))
    if not velocity:
        log = replace(log, gnss=replace(log.gnss, velocity_n=None, velocity_sigma=None))
    under_way = started(log, start_s=22.0, static_until_s=None)
    for one in (log, under_way):
        result = replay(one, ["loosely-coupled"]).results[0]
        note = next(note for note in result.notes if "twelve were started" in note)
        # the fixes together, none by itself
        assert float(re.search(r"fixes after (\S+) s", note)[1]) < (38.0 if one is log else 65.0)
        assert abs(result.errors["heading_deg"][0]) < 3.0 * result.sigma["heading_deg"][0] < 33.0
        assert all(beyond(result, name, result.time > 30.0) < 0.02 for name in ("roll_deg", "pitch_deg", "heading_deg"))


def test_the_bank_decides_by_a_margin_over_every_other_heading():
    ends = [{"q_nb": attitude.numeric.from_euler(0.0, 0.0, heading)} for heading in (0.5, 0.6, 2.0)]
    assert _decided(np.array([10.0, 11.0, 51.0]), 0, ends)
    assert not _decided(np.array([10.0, 11.0, 49.0]), 0, ends)


def test_what_stays_has_no_heading():
    """Half a minute at rest: every heading fits the fixes alike, and a given one is kept."""
    log = car_log("tactical", 30.0, wait_s=40.0)
    with pytest.raises(InputError, match="heading at the start: no instrument measures it"):
        replay(started(log, static_until_s=28.0), ["loosely-coupled"])
    kept = replay(started(log, static_until_s=28.0, heading_deg=HEADING + 40.0), ["loosely-coupled"]).results[0]
    assert kept.errors["heading_deg"][0] == pytest.approx(40.0, abs=1.0)

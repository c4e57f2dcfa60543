"""Errors at withheld fixes, of an estimate on a circle whose errors are known."""

import numpy as np
import pytest

from insenv import attitude, geodesy
from insenv.evaluation.outages import outages_of
from insenv.sensors.gnss import GnssFixes

ARM, DELAY, OFF = np.array([1.0, -2.0, -1.5]), 0.15, np.array([1.0, -2.0, 3.0])


def circle(t, off, drift, arm):
    """Rows of an estimate at 10 m/s and 0.1 rad/s, which is off and drifts from 20 s on, `arm` from the unit."""
    s, c, zero = np.sin(0.1 * t), np.cos(0.1 * t), 0 * t
    q_nb = attitude.numeric.from_euler(0.1, 0.5, 0.1 * t)
    way = 100.0 * np.stack([s, 1 - c, zero], axis=1) + off + drift * (t - 20.0)[:, None] + attitude.numeric.rotate(q_nb, arm)
    place = zip(("latitude", "longitude", "height"), geodesy.numeric.geodetic_from_ned_offset(way, 0.7, 0.2, 9.0), strict=True)
    return {**dict(place), "velocity_n": 10.0 * np.stack([c, s, zero], axis=1) + drift, "q_nb": q_nb}


def outages(drift=0.0, resumed=(30.0, 52.0), common=0.0, **more):
    time, at = np.arange(0.25, 60.0, 0.25), np.arange(0.0, 60.0) + 0.1
    rows = {"position_sigma": [3.0, 3.0, 3.0], "attitude_sigma": [0.4, 0.0, 0.5], **more}
    outputs = circle(time, OFF, drift, 0 * ARM) | {name: np.tile(row, (len(time), 1)) for name, row in rows.items()}
    latitude, longitude, height, *_ = circle(at - (DELAY if "gnss_delay" in more else 0.0), 0.0, 0.0, ARM).values()
    fixes = GnssFixes(at, latitude, longitude, height, np.full((60, 3), 4.0))
    told = {"antenna_lever_arm": 0 * ARM if "gnss_lever_arm" in more else ARM, "fix_common_sigma": common}
    return outages_of(time, outputs, fixes, np.array([[20.0, 30.0], [50.0, 52.0]]), np.array(resumed), told)


def test_errors_are_those_of_the_estimated_antenna_at_the_time_of_the_fix_and_a_drift_is_named():
    found = outages()
    for one in (*found.each, *outages(gnss_lever_arm=ARM, gnss_delay=DELAY).each):
        assert one.error == pytest.approx(np.tile(OFF, (10 if one.begin == 20.0 else 2, 1)), abs=2e-4)
    arm_sigma, of_two = np.array([2.0, 0.5, 0.1]), []
    for heading in (2.91, 2.91 - 0.1 * DELAY):
        C = attitude.numeric.to_dcm(attitude.numeric.from_euler(0.1, 0.5, heading))
        n, e, d = (C @ ARM) ** 2
        of_two.append(3.0**2 + 4.0**2 + np.array([0.25 * e, 0.16 * d + 0.25 * n, 0.16 * e]))
    assert found.each[0].sigma[-1] ** 2 == pytest.approx(of_two[0], rel=1e-4)
    more = outages(gnss_delay=DELAY, gnss_delay_estimate_sigma=0.3, gnss_lever_arm_estimate_sigma=arm_sigma)
    late = np.square([3.0 * np.cos(heading), 3.0 * np.sin(heading), 0.0])
    assert more.each[0].sigma[-1] ** 2 == pytest.approx(of_two[1] + C**2 @ arm_sigma**2 + late, rel=1e-3)
    assert [len(one.time) for one in outages(resumed=(29.2, np.inf)).each] == [9, 2]  # one record is after the next fix
    assert found.too_sure() == () and found.beyond == 0
    found, ends = outages(drift=3.0), np.array([3.0 + 3.0 * 9.1, 3.0 + 3.0 * 31.1])
    down = [found.each[0].statistics()[kind]["down_m"] for kind in ("end", "max", "ratio")]
    assert down == pytest.approx([ends[0], ends[0], ends[0] / found.each[0].sigma[-1, 2]], rel=1e-4)
    assert found.summary()["end"]["down_m"] == pytest.approx(np.sqrt(np.mean(ends**2)), rel=1e-4)
    assert ["the errors at the ends of the outages are 13.7 times" in note for note in found.too_sure()] == [True]
    assert found.beyond == 5 + 4 + 6 + 6  # north, east and down in the first outage, all in the second


def test_an_error_in_the_sigmas_of_estimate_and_fix_counts_once():
    """Of 5 m of the estimate and 4 m of a fix 2 m are the slow error of fixes, which may have changed: 5^2 - 2^2 + 4^2."""
    apart, alone = (outages(position_sigma=[5.0, 5.0, 5.0], common=c).each[0].sigma[-1] ** 2 for c in (2.0, 0.0))
    assert apart - alone == pytest.approx(np.full(3, -4.0))

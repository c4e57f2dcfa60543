"""A true gravity that the estimators do not share: deflection of the vertical and gravity disturbance."""

import numpy as np
import pytest

from insenv import geodesy
from insenv.runs.ensemble import ensemble

ARCSEC = np.pi / 180 / 3600


def parked(height_m=0.0, duration_s=120.0, rate_hz=50.0, **gravity):
    return {
        "title": "parked", "duration_s": duration_s, "rate_hz": rate_hz, "gravity": gravity,
        "start": {"latitude_deg": 45.0, "longitude_deg": 10.0, "height_m": height_m},
        "vehicle": {"kind": "car", "legs": [{"wait_s": 600.0}]},
    }  # fmt: skip


def test_an_alignment_levels_to_the_plumb_line():
    """A zenith 20 arcsec north of the ellipsoid's: nose up by as much for a vehicle that points north."""
    found = ensemble(parked(deflection_north_arcsec=20.0, deflection_east_arcsec=-10.0), ["analytic", "q-method"], [0])
    for id in ("analytic", "q-method"):
        roll, pitch, heading = found.attitude_errors_deg(id)[0, -1] * 3600
        assert abs(pitch - 20.0) < 0.3 and abs(roll - 10.0) < 0.3 and abs(heading + 10.0) < 0.5, id  # tan L = 1


def test_free_inertial_navigation_falls_by_what_its_gravity_lacks():
    """A disturbance of 50 mGal in the first 10 s: velocity 5 mm/s down, deflections as Schuler's beginning."""
    own = parked(disturbance_mgal=50.0, deflection_north_arcsec=20.0, duration_s=10.0)
    found = ensemble(own, ["wander-sins"], [0], tuning={"wander-sins": KNOWN})
    velocity = found.outputs["wander-sins"]["velocity_n"][0, -1]
    g = float(geodesy.numeric.normal_gravity(np.sin(np.pi / 4), 0.0))
    # the unit feels the plumb line's gravity, the computer takes out normal gravity
    assert np.allclose(velocity, [g * 20 * ARCSEC * 10.0, 0.0, -50e-5 * 10.0], rtol=1e-3, atol=3e-6)


KNOWN = {"start_latitude": np.pi / 4, "start_longitude": np.radians(10.0), "start_roll": 0.0, "start_pitch": 0.0,
         "start_heading": 0.0, "start_velocity_n": np.zeros(3), "start_height": 0.0}  # fmt: skip


def test_truth_and_estimators_share_normal_gravity_at_six_kilometres():
    """A perfect unit at rest at 6 km and 45 deg: the north component, 4.9e-5 m/s^2, is 1 arcsec of tilt."""
    ids = ["wander-sins", "q-method", "gyrocompass", "inertial-fir"]
    tuning = {"wander-sins": {**KNOWN, "start_height": 6000.0}}
    found = ensemble(parked(height_m=6000.0, duration_s=900.0, rate_hz=10.0), ids, [0], tuning=tuning)
    for id in ids:
        assert np.abs(found.attitude_errors_deg(id)[0, -1, :2]).max() * 3600 < 0.05, id
    assert found.truth["true_delta_velocity"][0, -1, 0] * 10.0 == pytest.approx(4.882e-5, rel=1e-3)

"""The three-axis turntable: where it turns, that it stays in place, and its limits."""

import numpy as np
import pytest
from driven import columns_of
from scipy.spatial.transform import Rotation

from insenv.base.errors import InputError
from insenv.scenario import build, load, parse
from insenv.vehicles.turntable import SETTLED, turning_time


def built(*legs, rate_hz=100.0, **keys):
    values = load("turntable-calibration").model_dump(mode="json", warnings=False, exclude_none=True)
    values |= {"vehicle": {"kind": "turntable", "legs": legs, **keys}, "imu": {"grade": "perfect"}}
    return build(parse({**values, "rate_hz": rate_hz, "duration_s": 20.0}, "table", "table"), seed=1)


def test_it_turns_to_the_angles_in_place():
    legs = [
        {"duration_s": 5.0, "roll_deg": 90.0, "rate_deg_s": 40.0},
        {"duration_s": 10.0, "pitch_deg": 340.0, "rate_deg_s": 60.0},
        {"duration_s": 5.0, "heading_deg": 30.0},
    ]
    found = columns_of(built(*legs))
    attitudes = Rotation.from_quat(found["q_nb"], scalar_first=True)
    expected = Rotation.from_euler("ZYX", [(0, 0, 90), (0, 340, 90), (30, 340, 90)], degrees=True)
    assert ((attitudes[[499, 1499, 1999]].inv() * expected).magnitude() < 5e-4).all()
    assert not found["velocity_n"].any() and np.ptp(found["latitude"]) == np.ptp(found["height"]) == 0.0
    assert np.degrees(np.linalg.norm(found["delta_angle"], axis=1).max() * 100.0) == pytest.approx(60.0, rel=0.01)


def test_a_turn_too_long_for_its_leg_is_refused():
    first, far = {"duration_s": 12.0, "pitch_deg": 5.0}, {"duration_s": 30.0, "pitch_deg": 180.0}
    assert built(first, far).model
    with pytest.raises(InputError, match=r"vehicle.legs\[0\]: duration_s = 12 .* turn by 175 deg"):
        built(first, far, repeat_legs=True)


@pytest.mark.parametrize("rate_hz", [100.0, 10.0])
@pytest.mark.parametrize(("turn", "rate"), [(0.5, 40.0), (15.0, 40.0), (90.0, 40.0), (360.0, 60.0)])
def test_the_time_of_a_turn_is_that_at_which_the_table_stands(turn, rate, rate_hz):
    found = columns_of(built({"duration_s": 30.0, "heading_deg": turn, "rate_deg_s": rate}, rate_hz=rate_hz))
    half = np.abs(np.arctan2(found["q_nb"][:, 3], found["q_nb"][:, 0])) % np.pi
    short = 2.0 * np.abs(half - np.radians(turn) / 2.0 % np.pi)
    stands = (np.flatnonzero(np.minimum(short, 2.0 * np.pi - short) > SETTLED)[-1] + 1) / rate_hz
    assert turning_time(np.radians(turn), np.radians(rate), 1.0 / rate_hz) == pytest.approx(stands, abs=0.05 + 1.0 / rate_hz)

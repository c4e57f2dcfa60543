"""Estimates that clients send: frames, stated accuracies, nonsense."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from streamed_vehicle import estimate

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.mavlink.score import Origin, estimate_of

NAN = float("nan")
ORIGIN = Origin(0.8, 0.2, 100.0, 1.7e9)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("ODOMETRY", {"child_frame_id": 8}, "child_frame_id = 8: allowed is 12 .* or 1"),
        ("ODOMETRY", {"q": [NAN, 0, 0, 0]}, "q_nb = .*: allowed are finite numbers"),
        ("ODOMETRY", {"x": 4.8e6}, "x, y, z = .*: allowed are finite distances from home"),
        ("ATTITUDE", {"yaw": 90.0}, "yaw = 90 rad: allowed is a finite angle"),
        ("ATTITUDE_QUATERNION", {"q1": 0.5}, "has the norm 0.5"),
        ("ATTITUDE_QUATERNION", {"repr_offset_q": [0.0, 1.0, 0.0, 0.0]}, "repr_offset_q = .*: allowed is none"),
        ("VISION_POSITION_ESTIMATE", {"z": NAN}, "x, y, z"),
    ],
)
def test_nonsense_is_refused_in_one_sentence(name, changes, message):
    with pytest.raises(InputError, match=message) as error:
        estimate_of(estimate(name, **changes), ORIGIN)
    assert "\n" not in str(error.value)


def test_velocities_are_read_in_the_frame_that_the_message_states():
    """Heading east: forward is east."""
    q = list(Rotation.from_euler("z", 90.0, degrees=True).as_quat(scalar_first=True))
    covariance = [4.0, 0, 0, 0, 0, 0, 9.0, 0, 0, 0, 0, 16.0, *[0] * 9]
    for frame, velocity, sigma in ((12, [0.0, 1.0, 0.0], (3.0, 2.0, 4.0)), (1, [1.0, 0.0, 0.0], (2.0, 3.0, 4.0))):
        found = estimate_of(estimate("ODOMETRY", q=q, child_frame_id=frame, velocity_covariance=covariance), ORIGIN)
        np.testing.assert_allclose(found.rows["velocity_n"], velocity, atol=1e-7)
        assert found.sigma == {name: pytest.approx(s) for name, s in zip(("vn_mps", "ve_mps", "vd_mps"), sigma, strict=True)}


def test_variances_are_those_of_the_diagonal_and_times_of_either_clock():
    """21 numbers: the upper triangle of 6 rows, whose diagonal stands at 0, 6, 11, 15, 18 and 20."""
    triangle = np.eye(6)[np.triu_indices(6)]
    triangle[triangle == 1.0] = [1.0, 4.0, 9.0, 0.01, 0.04, 0.09]
    stamps = (5_000_000, 1_700_000_000_000_000 + 5_000_000)  # of the simulation, and Unix time
    for stamp in stamps:
        odometry = estimate("ODOMETRY", time_usec=stamp, pose_covariance=list(triangle))
        vision = estimate("VISION_POSITION_ESTIMATE", usec=stamp, x=1.0, y=2.0, z=3.0, covariance=list(triangle))
        expected = (1.0, 2.0, 3.0, *np.degrees([0.1, 0.2, 0.3]))
        names = ("north_m", "east_m", "down_m", "roll_deg", "pitch_deg", "heading_deg")
        for found in (estimate_of(odometry, ORIGIN), estimate_of(vision, ORIGIN)):
            assert found.sigma == {name: pytest.approx(s) for name, s in zip(names, expected, strict=True)}
            assert found.time == pytest.approx(5.0, abs=1e-9)
            place = [float(found.rows[name]) for name in ("latitude", "longitude", "height")]
            np.testing.assert_allclose(
                np.ravel(geodesy.numeric.ned_offset(*place, 0.8, 0.2, 100.0)), [1.0, 2.0, 3.0], atol=1e-8
            )

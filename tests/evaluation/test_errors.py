"""Standard deviations by channel: misalignments about north and east seen as roll and pitch, against drawn attitudes."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insenv.evaluation.errors import ATTITUDE, stated_sigma, wrapped_deg
from insenv.evaluation.symbols import sigma_of


@pytest.mark.parametrize("heading_deg", [0.0, 35.0, 90.0, -150.0])
def test_stated_sigma_is_the_scatter_of_roll_pitch_and_heading(heading_deg):
    """A nearly level body whose attitude is off by rotations about north, east and down of known standard deviations."""
    rng, sigma = np.random.default_rng(1), np.array([1e-3, 4e-3, 9e-3])
    true = Rotation.from_euler("ZYX", [heading_deg, 0.5, -0.5], degrees=True)
    drawn = (Rotation.from_rotvec(rng.normal(size=(40_000, 3)) * sigma) * true).as_euler("ZYX", degrees=True)
    scatter = wrapped_deg(drawn - [heading_deg, 0.5, -0.5]).std(axis=0)[::-1]
    q_nb = true.as_quat(scalar_first=True)
    found = stated_sigma({"q_nb": q_nb[None], "attitude_sigma": sigma[None]})
    assert [found[name][0] for name in ATTITUDE] == pytest.approx(scatter, rel=0.03)
    named = type("Outputs", (), {"q_nb": ca.SX(ca.DM(q_nb)), "attitude_sigma": ca.SX(ca.DM(sigma))})()
    assert np.array(ca.DM(ca.evalf(sigma_of(ATTITUDE, named)))).ravel() == pytest.approx(scatter, rel=0.03)


def test_wrapped_angles():
    angles = np.array([-540.0, -180.0, -1.0, 0.0, 179.0, 180.0, 359.0])
    assert wrapped_deg(angles).tolist() == [-180.0, -180.0, -1.0, 0.0, 179.0, -180.0, -1.0]

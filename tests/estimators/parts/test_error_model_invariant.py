"""A correction turns the errors with the platform: no knowledge of heading without a cause."""

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from scipy.spatial.transform import Rotation

import insenv
from insenv.core import symmetric
from insenv.estimators.parts.error_model import TILT, covariance_after
from insenv.estimators.parts.kalman import Update


def test_what_is_unknown_about_the_vertical_of_the_platform_stays_so():
    """The platform is found 5 deg off level: the unknown heading is about its vertical before, and about the new one after."""
    psi = np.radians([4.0, -3.0, 0.0])
    before = Rotation.from_rotvec(psi).inv().apply([0.0, 0.0, 1.0])
    P = np.zeros((12, 12))
    P[TILT, TILT] = np.outer(before, before)
    P[TILT, 10] = P[10, TILT] = 0.1 * before
    update = Update((), ca.vertcat(ca.SX.zeros(6), psi, ca.SX.zeros(3)), symmetric.triangle(ca.SX(P)))
    after = np.array(ca.DM(symmetric.full(covariance_after(update, 12), 12)))
    wanted = np.zeros((12, 12))
    wanted[8, 8], wanted[8, 10], wanted[10, 8] = 1.0, 0.1, 0.1
    assert after == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("filter", ["loosely-coupled", "fusion"])
def test_a_parked_car_learns_no_heading_from_being_level(monkeypatch, filter):
    """The told attitude is 0.5 deg off level and 3 deg off in heading; zero velocities and fixes level the unit."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    for seed in (1, 2, 3):
        (result,) = insenv.run("car-city-drive", filter, seed=seed, duration_s=31.0).results
        assert result.sigma["heading_deg"][-1] > 0.9 * result.limit_sigma["heading_deg"][-1]
        assert abs(result.errors["heading_deg"][-1]) < 3 * result.sigma["heading_deg"][-1]


def test_a_heading_30_deg_off_is_found_while_driving():
    scenario = changed("car-unknown-heading", knowledge={"heading_sigma_deg": 30.0, "heading_error_deg": 30.0})
    found = [insenv.run(scenario, "loosely-coupled", seed=seed, duration_s=60.0).results[0] for seed in range(300, 308)]
    errors = np.abs([result.errors["heading_deg"][-1] for result in found])
    assert np.median(errors) < 0.4
    assert (errors < 3.5 * np.array([result.sigma["heading_deg"][-1] for result in found])).all()

"""What a rest says of the heading and the bias of the gyros."""

from dataclasses import replace

import numpy as np
import pytest
from standing_car import car_log

from insenv import attitude, geodesy, replay
from insenv.core import symmetric
from insenv.estimators import ImuDataSheet, Knowledge, get
from insenv.logs.rest import Rest
from insenv.runs.rest import start_at_rest

LATITUDE = np.radians(47.07)
POOR = ImuDataSheet(1e-6, 1e-4, np.radians(100.0) / 3600, 1e-2, 1e9, 1e9)
GOOD = ImuDataSheet(1e-9, 1e-4, np.radians(0.01) / 3600, 1e-2, 1e9, 1e9)


def rest(heading, bias, roll=0.02, pitch=-0.05, rate_sigma=1e-9):
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(roll, pitch, heading))
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(LATITUDE) + bias
    return Rest(rate, C_nb.T @ np.array([0.0, 0.0, -9.8]), np.full(3, rate_sigma), 0.0, 100.0, 0.0)


@pytest.mark.parametrize("heading", [-2.5, 0.3, 3.0])
def test_the_rest_tells_the_heading_of_good_gyros_and_the_bias_of_poor_ones(heading):
    level = (0.02, -0.05)
    bias = np.radians([0.005, -0.01, 0.008]) / 3600
    found = start_at_rest(rest(heading, bias), level, LATITUDE, heading + 0.1, np.radians(20.0), GOOD, 1e-6)
    assert abs(found.heading - heading) < 3 * found.heading_sigma < np.radians(0.3)
    bias = np.radians([50.0, -100.0, 80.0]) / 3600
    found = start_at_rest(rest(heading, bias), level, LATITUDE, heading, np.radians(1.0), POOR, 0.01)
    assert found.heading == pytest.approx(heading, abs=1e-3) and found.heading_sigma == pytest.approx(np.radians(1.0), rel=1e-2)
    np.testing.assert_allclose(found.gyro_bias, bias, atol=np.radians(0.3) / 3600)
    assert found.rest_share == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("age", "correlation"), [(0.0, 3600.0), (600.0, 3600.0), (600.0, 1e9)])
def test_a_bias_drifts_during_and_after_the_rest(age, correlation):
    """A Gauss-Markov bias b, seen as its mean over T: it differs from that at the start by 2 b^2 / tau (T / 3 + age)."""
    b = np.radians(100.0) / 3600
    unit = ImuDataSheet(1e-9, 1e-4, b, 1e-2, correlation, 1e9)
    seen = replace(rest(1.0, np.zeros(3)), age=age)
    found = start_at_rest(seen, (0.02, -0.05), LATITUDE, 1.0, 1e-5, unit, 1e-9)
    drifted = 2 * b**2 / correlation * (seen.duration / 3 + age) + seen.rate_sigma**2
    assert found.gyro_bias_error == pytest.approx(np.sqrt(drifted * b**2 / (b**2 + drifted)), rel=1e-3)


@pytest.mark.parametrize("id", ["loosely-coupled", "aqe-ekf"])
def test_the_bias_of_a_rest_shares_the_errors_of_the_attitude(id):
    """Draws of the start attitude: covariance of what is left of the bias, against the filter's."""
    sigma, tilt, angles = np.radians(5.0), np.radians(0.5), (0.1, -0.2, 1.0)
    estimator, earth = get(id), geodesy.numeric.earth_rate_n(LATITUDE)
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(*angles))
    known = Knowledge(
        LATITUDE, 0.0, 0.0, 0.01, roll=angles[0], pitch=angles[1], heading=angles[2], tilt_sigma=tilt, heading_sigma=sigma,
        gyro_bias_error=1e-9, rest_share=1.0, sensors=POOR,
    )  # fmt: skip
    model = estimator.model
    p = model.parameters.pack(estimator.parameters(known))
    state = model.state.unpack(np.asarray(model.kernels["start"].function(p, [])).ravel())
    n, gyro = (15, slice(9, 12)) if id == "loosely-coupled" else (16, slice(4, 7))
    stated = symmetric.full_array(state["covariance"], n)[gyro, gyro]

    turns = np.random.default_rng(3).normal(size=(4000, 3)) * [tilt, tilt, sigma]
    truth = np.array([attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(turn)) for turn in turns]) @ C_nb
    drawn = np.cov((C_nb.T @ earth - truth.transpose(0, 2, 1) @ earth).T)
    np.testing.assert_allclose(stated, drawn, atol=0.06 * drawn.max())
    largest = float(np.degrees(np.sqrt(np.max(np.diag(stated)))) * 3600)
    assert largest > 0.5  # deg/h, of a bias that the rest alone would know to 0.0002


def test_gyros_that_sense_the_earth_need_neither_heading_nor_motion():
    log = car_log("navigation", 29.0, seed=7, wait_s=29.0, calm=True)
    result = replay(log, ["loosely-coupled"]).results[0]
    assert abs(result.errors["heading_deg"][-1]) < 3 * result.sigma["heading_deg"][-1] < 1.5

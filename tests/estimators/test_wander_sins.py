"""The plain formulas of the airborne paper against the exact mechanization."""

import numpy as np
import pytest
from driven import fed, fed_outputs
from resting import samples

from insenv import geodesy
from insenv.bench import truth
from insenv.bench.truth import drift_ned
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.estimators.parts import applicability


def test_the_plain_form_is_of_first_order(monkeypatch):
    monkeypatch.setattr(truth, "DURATION_S", 120.0)
    coarse, fine = (drift_ned("car", rate, id="wander-sins-plain")[:2] for rate in (200.0, 400.0))
    assert (coarse / fine == pytest.approx(2.0, rel=0.2)) and coarse.max() > 100.0  # mm


@pytest.mark.parametrize("vehicle", ["ship", "car", pytest.param("aircraft", marks=pytest.mark.slow)])
def test_drift_with_a_perfect_unit_is_of_second_order(vehicle):
    """Below a millimetre; it falls at least with the square of the interval: 4 for second order, 8 for third."""
    assert drift_ned(vehicle, 200.0).max() < (0.1 if vehicle == "ship" else 1.0)  # mm
    coarse, fine = (drift_ned(vehicle, rate, disturbed=False).max() for rate in (50.0, 100.0))
    assert coarse / fine > 3.5


def test_only_the_papers_gravity_moves_the_plain_form_at_rest():
    """Its formula (5) differs from normal gravity: half the difference times the square of the time."""
    latitude, model = 0.8, get("wander-sins-plain").model
    runner = fed(model, samples([1.0, 0, 0, 0], latitude, 60.0, 0.02), {"start_latitude": latitude})
    gravities = geodesy.numeric.normal_gravity_paper, geodesy.numeric.normal_gravity
    paper, normal = (float(gravity(np.sin(latitude), 0.0)) for gravity in gravities)
    assert -runner.outputs()["height"] == pytest.approx((paper - normal) * 60.0**2 / 2, rel=0.01, abs=1e-4)


def test_height_diverges_with_the_stated_time_constant():
    """A millimetre at the start, at rest: cosh(t / 570 s) of it after half an hour and after an hour."""
    model, dt, latitude = get("wander-sins").model, 1.0, 0.5
    rate = geodesy.numeric.earth_rate_n(latitude)
    force = [0, 0, -float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0))]
    inputs = model.inputs.pack({"delta_angle": rate * dt, "delta_velocity": np.multiply(force, dt), "dt": dt})
    heights = []
    for height in (0.0, 1e-3):
        runner = make_runner(model, {"start_latitude": latitude, "start_height": height}, "interpreter")
        heights.append([])
        for _ in range(2):
            runner.run(1800, inputs, 0)
            heights[-1].append(runner.state["height"])
    grown = (np.array(heights[1]) - heights[0]) / 1e-3
    assert np.allclose(grown, np.cosh(np.array([1800.0, 3600.0]) / applicability.HEIGHT_TIME), rtol=0.02)


def test_the_plain_form_takes_the_mean_of_the_last_two_increments():
    """(7): a step of velocity in one sample arrives in two halves."""
    model, dt, latitude = get("wander-sins-plain").model, 0.01, 0.6
    columns = samples([1.0, 0, 0, 0], latitude, 6 * dt, dt)
    columns["delta_velocity"][3, 0] += 1.0
    north = fed_outputs(model, columns, {"start_latitude": latitude})["velocity_n"][:, 0]
    assert np.allclose(north, [0.0, 0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-4)

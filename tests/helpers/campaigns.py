"""Small campaigns for the tests of them."""

from dataclasses import replace

import numpy as np
from changed_scenario import changed

from insenv.studies.campaign import make_plan, parse_variation
from insenv.studies.campaign.presentation import campaign_arrays


def slow_ship(**imu):
    return changed("ship-swaying", rate_hz=20.0, imu=imu)


def small_plan(runs=40, **more):
    """Blocks of 8 runs, of 40 samples each."""
    plan = make_plan(slow_ship(), "analytic", runs, first_seed=3, duration_s=2.0, **more)
    return replace(plan, block_samples=1)


def same(first, second):
    """Whether two summaries are the same to the bit."""
    one, other = campaign_arrays(first), campaign_arrays(second)
    return one.keys() == other.keys() and all(np.array_equal(one[k], other[k], equal_nan=one[k].dtype.kind == "f") for k in one)


def car(**more):
    """A car with a receiver, at 20 Hz."""
    vehicle = {"engine": [], "legs": [{"wait_s": 60.0}]}
    return changed("car-city-drive", **{"rate_hz": 20.0, "gnss": {"epoch_offset_s": 0.0}, "vehicle": vehicle, **more})


def plan_of(*vary, runs=64, scenario=None, estimator="loosely-coupled", **more):
    variations = [parse_variation(text) for text in vary]
    scenario = car() if scenario is None else scenario
    return make_plan(scenario, estimator, runs, first_seed=5, duration_s=2.0, variations=variations, **more)

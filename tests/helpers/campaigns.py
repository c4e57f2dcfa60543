"""Small campaigns for the tests of them."""

import json
from dataclasses import replace

import numpy as np

from insenv.scenario import load
from insenv.studies.campaign import make_plan, parse_variation
from insenv.studies.campaign.presentation import campaign_arrays


def slow_ship(**imu):
    scenario = load("ship-swaying")
    return scenario.model_copy(update={"rate_hz": 20.0, "imu": scenario.imu.model_copy(update=imu)})


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
    data = json.loads(load("car-city-drive").model_dump_json())
    data["gnss"] |= {"epoch_offset_s": 0.0}
    data["vehicle"] |= {"engine": [], "legs": [{"wait_s": 60.0}]}
    return load(data | {"rate_hz": 20.0} | more)


def plan_of(*vary, runs=64, scenario=None, estimator="loosely-coupled", **more):
    variations = [parse_variation(text) for text in vary]
    scenario = car() if scenario is None else scenario
    return make_plan(scenario, estimator, runs, first_seed=5, duration_s=2.0, variations=variations, **more)

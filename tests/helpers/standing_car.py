"""A car that stands, drives off and turns, as a recorded log; and logs with another [initial]."""

from dataclasses import replace

import numpy as np
from simulated_log import simulated_log

from insenv.scenario import load

HEADING = 90.0
"""Of the car at rest, deg."""
WANDER = {"loosely-coupled": {"fix_wander_sigma_m": [1.5, 1.5, 3.05], "fix_wander_time_s": 60.0}}
"""Settings of the filter: the receiver's errors, as the simulation draws them."""

NOTHING = dict.fromkeys(
    ("latitude_deg", "longitude_deg", "height_m", "velocity_mps", "roll_deg", "pitch_deg", "heading_deg", "position_sigma_m",
     "velocity_sigma_mps", "tilt_sigma_deg", "heading_sigma_deg", "start_s")
)  # fmt: skip
"""Keys of [initial] with which a log says nothing of its start."""


def car(grade, wait_s=10.0, calm=False, outages=False):
    """The city drive at 100 Hz with a unit of this grade, which begins with `wait_s` at rest; calm: nothing rocks it there."""
    values = load("car-city-drive").model_dump(mode="json", exclude_unset=True)
    still = {"engine": [], "wind_roll_sigma_deg": 0.0, "wind_pitch_sigma_deg": 0.0} if calm else {}
    legs = [{"wait_s": wait_s}, *values["vehicle"]["legs"][1:]]
    gnss = {"outlier_probability": 0.0} | ({} if outages else {"outages_s": []})
    return load({
        **values, "rate_hz": 100.0, "imu": {**values["imu"], "grade": grade}, "gnss": {**values["gnss"], **gnss},
        "vehicle": {**values["vehicle"], **still, "legs": legs},
    })  # fmt: skip


def car_log(grade, duration_s, seed=5, *, wait_s=10.0, told=True, calm=False, outages=False, estimator=None, **initial):
    """Its log; told: the description has the grade; initial: keys of [initial] beside the time at rest."""
    sections = {"initial": {"static_until_s": wait_s, **initial}, **({"estimator": estimator} if estimator else {})}
    return simulated_log(car(grade, wait_s, calm, outages), seed, duration_s, grade if told else "", **sections)


def started(log, **initial):
    """The log with other values in [initial]."""
    values = {**log.description.initial.model_dump(), **initial}
    return replace(log, description=type(log.description).model_validate({**log.description.model_dump(), "initial": values}))


def beyond(result, name, late):
    """Share of the errors beyond three stated standard deviations."""
    return float(np.mean(np.abs(result.errors[name][late]) > 3 * result.sigma[name][late]))

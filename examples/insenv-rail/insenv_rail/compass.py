"""A compass: the heading of the vehicle, with white noise, a constant deviation and one that changes slowly."""

import casadi as ca

from insenv import Instrument, Row
from insenv.core.elementary import atan2
from insenv.sensors import units
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.instrument import Column, Estimated, constant, drift, white


def measure(motion, e, p):
    forward_n = motion.to_navigation(ca.SX([1.0, 0.0, 0.0]))
    return {"compass_heading": atan2(forward_n[1], forward_n[0]) + e.deviation + e.drift + e.noise}


COMPASS = Instrument(
    "compass",
    title="Compass",
    called="the compass",
    what="heading",
    causes="its deviation, and iron near it",
    values=(Row("compass_heading", "Heading of the forward axis, clockwise from north", "rad", lower=-20.0, upper=20.0),),
    terms=(
        white("compass_noise", "compass noise", "White noise of a reading", "rad"),
        constant("compass_deviation", "deviation", "compass deviation", "Constant error", "rad",
                 states=(Estimated("compass_deviation", "constant error of the compass"),)),
        drift("compass_drift", "drift", "compass drift", "Slowly changing error", "rad",
              states=(Estimated("compass_drift", "slowly varying error of the compass"),)),
    ),
    measure=measure,
    holds=("heading",),
    aid_parameters=("compass_noise",),
    angle=True,
    least_sigma={"compass_heading": 1e-3},
    columns=(Column("heading", "compass_heading", "heading, clockwise from north", units.ANGLE_UNITS, "deg", angle=True),),
    figures={
        "noise_deg": Figure("compass_noise", "deg"),
        "deviation_deg": Figure("compass_deviation", "deg"),
        "deviation_sigma_deg": Figure("compass_deviation_sigma", "deg"),
        "drift_sigma_deg": Figure("compass_drift_sigma", "deg"),
        "drift_time_s": Figure("compass_drift_time", "s"),
    },
    grades=by_name(
        Grade("perfect", "No errors"),
        Grade.of("boat", "Compass of a small boat", "the author's choice",
                 noise_deg=0.5, deviation_sigma_deg=2.0, drift_sigma_deg=0.5, drift_time_s=600.0),
    ),
    grade="boat",
    interval_s=0.1,
)  # fmt: skip

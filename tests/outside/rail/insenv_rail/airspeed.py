"""An airspeed sensor: the forward component of the velocity through air that moves, with a scale factor error."""

import casadi as ca

from insenv import Instrument, Row
from insenv.sensors import units
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.instrument import Column, Estimated, constant, drift, white

FIGURES = {
    "noise_mps": Figure("airspeed_noise", "m/s"),
    "scale_factor_percent": Figure("airspeed_scale_factor", "%", units.percent_to_one),
    "scale_factor_sigma_percent": Figure("airspeed_scale_factor_sigma", "%", units.percent_to_one),
    "wind_sigma_mps": Figure("airspeed_wind_sigma", "m/s"),
    "wind_time_s": Figure("airspeed_wind_time", "s"),
}
PITOT = {"noise_mps": 0.2, "scale_factor_sigma_percent": 2.0, "wind_sigma_mps": 3.0, "wind_time_s": 900.0}


def measure(motion, e, p):
    velocity = motion.body_velocity(ca.SX.zeros(3), ca.vertcat(e.wind, 0.0))
    return {"airspeed_speed": (1 + e.scale_factor) * velocity[0] + e.noise}


AIRSPEED = Instrument(
    "airspeed",
    title="Airspeed sensor",
    called="the airspeed sensor",
    what="forward airspeed",
    causes="its scale factor, and the sigma and the correlation time of the wind",
    values=(Row("airspeed_speed", "Forward component of the velocity through the air", "m/s", lower=-1e3, upper=1e3),),
    terms=(
        white("airspeed_noise", "airspeed noise", "White noise of an airspeed", "m/s"),
        constant("airspeed_scale_factor", "scale_factor", "airspeed scale factor", "Scale factor error",
                 states=(Estimated("airspeed_scale", "scale factor of the airspeed sensor"),)),
        drift("airspeed_wind", "wind", "wind", "Wind north and east", "m/s", (2,), "n",
              states=(Estimated("wind", "wind: north, east"),)),
    ),
    measure=measure,
    aid_parameters=("airspeed_noise",),
    least_sigma={"airspeed_speed": 1e-3},
    turned=True,
    columns=(Column("speed", "airspeed_speed", "airspeed", units.SPEED_UNITS, "m/s"),),
    figures=FIGURES,
    grades=by_name(
        Grade("perfect", "No errors"),
        Grade("pitot", "Pitot tube of a small aircraft", {"": "the author's choice; wind of a breezy day"}, PITOT),
    ),
    grade="pitot",
    interval_s=0.1,
)  # fmt: skip

"""A trolley that runs to and fro on a straight, level rail."""

from functools import lru_cache
from math import pi
from typing import Literal

import casadi as ca

from insenv import Row, Table, Vehicle, VehicleSection
from insenv.base.toml import Number, key
from insenv.vehicles.truth import PLACES


@lru_cache
def trolley() -> Vehicle:
    """Position along the rail A sin(w t), heading that of the rail."""
    return Vehicle(
        id="trolley",
        title="Trolley on a rail",
        parameters=Table(
            (
                Row("start_heading", "Heading of the rail", "rad"),
                Row("rail_amplitude", "Amplitude of the motion", "m"),
                Row("rail_angular_frequency", "Angular frequency of the motion", "rad/s"),
                Row("mean_roll", "Roll of the rail", "rad"),
                Row("mean_pitch", "Pitch of the rail", "rad"),
            )
        ),
        state=Table((Row("rail_phase", "Phase of the motion", "rad"),)),
        along=lambda p, x: [
            {"rail_phase": x.rail_phase + place * p.sample_interval * p.rail_angular_frequency} for place in PLACES
        ],
        derivative=lambda p, x: {"rail_phase": p.rail_angular_frequency},
        angles=lambda p, x: [p.mean_roll, p.mean_pitch, p.start_heading, x.rail_phase],
        velocity_n=lambda p, x, pairs: (
            p.rail_amplitude * p.rail_angular_frequency * pairs[3][1] * ca.vertcat(pairs[2][1], pairs[2][0], 0)
        ),
        start=lambda p: {"rail_phase": 0},
    )


class TrolleySection(VehicleSection):
    """A trolley on a straight, level rail."""

    kind: Literal["trolley"] = key(..., "what kind of vehicle")
    amplitude_m: Number = key(1.0, "amplitude of the motion along the rail", "m", ge=0, le=100)
    period_s: Number = key(10.0, "period of the motion", "s", gt=0.1, le=1e4)

    @property
    def in_place(self) -> bool:
        return self.amplitude_m <= 5.0

    def vehicle(self) -> Vehicle:
        return trolley()

    def rows(self, start) -> dict:
        return {"rail_amplitude": self.amplitude_m, "rail_angular_frequency": 2 * pi / self.period_s}

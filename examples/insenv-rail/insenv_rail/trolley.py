"""A trolley that runs to and fro on a straight, level rail, faster and slower on command."""

from functools import lru_cache
from math import pi
from typing import ClassVar, Literal

import casadi as ca

from insenv import Row, Table, Vehicle, VehicleSection
from insenv.base.toml import Number, key
from insenv.vehicles import Actions, VehicleTraits
from insenv.vehicles.script import Script, Tracker
from insenv.vehicles.section import action
from insenv.vehicles.truth import PLACES

SCRIPT = Script((Row("pace", "Angular frequency of the motion", "rad/s", lower=0.0, upper=10.0),))
PACE = Tracker(("pace", "pace_rate", "pace_second"), "Angular frequency of the motion", "rad/s")
ACTIONS = Actions(
    Table((action("pace", "Change of the angular frequency, 1 or -1 for a third of the start value"),)),
    lambda x, action: {"pace": (1.0 + action.pace / 3.0) * x.commanded_pace},
)


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
        )
        + SCRIPT.parameters,
        state=Table((Row("rail_phase", "Phase of the motion", "rad"),)) + PACE.state + SCRIPT.state,
        along=along,
        derivative=lambda p, x: {"rail_phase": x.pace, **PACE.derivative(x)},
        angles=lambda p, x: [p.mean_roll, p.mean_pitch, p.start_heading, x.rail_phase],
        velocity_n=lambda p, x, pairs: p.rail_amplitude * x.pace * pairs[3][1] * ca.vertcat(pairs[2][1], pairs[2][0], 0),
        start=lambda p: {
            "rail_phase": 0,
            "pace": p.rail_angular_frequency,
            **SCRIPT.start(p, {"pace": p.rail_angular_frequency}),
        },
        hold=lambda p, x, u: {**PACE.hold(x, p.sample_interval, x.commanded_pace, 1.0), **SCRIPT.count(p, x)},
        inputs=SCRIPT.inputs,
        steps=SCRIPT.steps,
    )


def along(p, x) -> list:
    """The state at the places of a sample."""
    times = [place * p.sample_interval for place in PLACES]
    return [{"rail_phase": x.rail_phase + PACE.integral(x, t), **PACE.along(x, t)} for t in times]


class TrolleySection(VehicleSection):
    """A trolley on a straight, level rail."""

    traits: ClassVar[VehicleTraits] = VehicleTraits(actions=ACTIONS, wheels=True, parks=True)

    kind: Literal["trolley"] = key(..., "what kind of vehicle")
    amplitude_m: Number = key(1.0, "amplitude of the motion along the rail", "m", ge=0, le=100)
    period_s: Number = key(10.0, "period of the motion", "s", gt=0.1, le=1e4)

    @property
    def in_place(self) -> bool:
        return self.amplitude_m <= 5.0

    def vehicle(self) -> Vehicle:
        return trolley()

    def rows(self, start) -> dict:
        return {
            "rail_amplitude": self.amplitude_m,
            "rail_angular_frequency": 2 * pi / self.period_s,
            "segments": SCRIPT.table([]),
            "segments_repeat": 0.0,
        }

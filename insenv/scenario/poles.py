"""How near a simulated vehicle comes to a pole.

Vehicles steer relative to north, and at a pole there is none: the truth divides by the cosine of the latitude.  Up to
`CLOSEST` it is exact (docs/truth.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.model import Model
from insenv.core.runner import make_runner
from insenv.geodesy import POLAR_RADIUS
from insenv.scenario.description import Scenario
from insenv.scenario.inputs import PREFIX, chunks
from insenv.scenario.plant import Plant
from insenv.vehicles.section import FASTEST_MPS

CLOSEST = 100.0
"""m"""

_SPEED = f"{PREFIX}speed"
_WHY = ", where no direction is north and vehicles, which steer relative to north, cannot be simulated"


def too_near(latitude: float) -> bool:
    """Whether a place at this latitude (rad) is within `CLOSEST` of a pole; so is what lies beyond it."""
    return bool(_distance(latitude) < CLOSEST)


def refusal(scenario: Scenario, latitude: float, time: float) -> InputError:
    """The error about a vehicle that is too near to a pole at a time (s), there at this latitude (rad)."""
    return InputError(
        f"{_where(scenario)}comes within {CLOSEST:g} m of the {_pole(latitude)} pole at {time:.4g} s{_WHY}: allowed is a "
        "course that stays away from it"
    )


def check_course(plant: Plant) -> None:
    """Raise `refusal` for a plant whose vehicle comes too near to a pole; it is simulated only if it can."""
    scenario = plant.scenario
    fastest = FASTEST_MPS if scenario.commands else scenario.vehicle.fastest_mps
    if scenario.vehicle.in_place or _out_of_reach(scenario, fastest * plant.duration_s):
        return
    runner = make_runner(plant.model, plant.parameters)
    for begin, count in chunks(plant.samples, 1):
        shown = plant.model.outputs.unpack(runner.run(count, plant.inputs(begin, count)))
        near = _distance(shown["latitude"]) < CLOSEST
        if near.any():
            first = int(np.argmax(near))
            raise refusal(scenario, float(shown["latitude"][first]), float(shown["time"][first]))


def check_reach(scenario: Scenario, model: Model, duration_s: float) -> None:
    """Raise `InputError` if a vehicle whose course is not known before can come too near to a pole.

    model: has the inputs of the plant.
    """
    steered = any(name.startswith(PREFIX) for name in model.inputs.names)
    fastest = FASTEST_MPS if steered else scenario.vehicle.fastest_mps
    if _SPEED in model.inputs:
        fastest = model.inputs[_SPEED].upper
    reach = fastest * duration_s
    if scenario.vehicle.in_place or _out_of_reach(scenario, reach):
        return
    start = np.radians(scenario.start.latitude_deg)
    raise InputError(
        f"{_where(scenario)}is {_distance(start) / 1000:.3g} km from the {_pole(start)} pole, and in {duration_s:g} s at up to "
        f"{fastest:g} m/s it may come within {CLOSEST:g} m of it{_WHY}: allowed is a start more than "
        f"{(reach + CLOSEST) / 1000:.3g} km away, or a shorter duration"
    )


def _out_of_reach(scenario: Scenario, way: float) -> bool:
    return bool(_distance(np.radians(scenario.start.latitude_deg)) - way > CLOSEST)


def _where(scenario: Scenario) -> str:
    name = f"scenario {scenario.name!r}" if scenario.name else "the scenario"
    return f"{name}, which starts at latitude_deg = {scenario.start.latitude_deg:.9g}, "


def _distance(latitude: Any) -> Any:
    """Way (m) along the meridian to the nearer pole; negative beyond it."""
    return (np.pi / 2 - np.abs(latitude)) * POLAR_RADIUS


def _pole(latitude: float) -> str:
    return "north" if latitude > 0 else "south"

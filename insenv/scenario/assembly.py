"""The plant: a vehicle's truth and its sensors as one model.

One advance is one inertial sample.  The outputs after it are the measurements, and the truth at the end of the sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from insenv.base.errors import InputError, naming
from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.tables import Row, Table
from insenv.sensors import GNSS, IMU, Sensor
from insenv.vehicles import Vehicle, truth_instant, truth_part

CLOCK = Part(
    parameters=Table(
        (SEED, Row("sample_interval", "Time from one inertial sample to the next", "s", start=0.005, lower=1e-4, upper=1.0))
    ),
    state=Table((STEP, Row("time", "Time since the start", "s"))),
    steps={"sample": Step(lambda p, x, u: {"step": x.step + 1, "time": (x.step + 1) * p.sample_interval})},
)

TRUTH = ("q_nb", "velocity_n", "latitude", "longitude", "height", "true_delta_angle", "true_delta_velocity")


def plant_model(vehicle: Vehicle, sensors: Sequence[Sensor] = (IMU, GNSS)) -> Model:
    """The plant of a vehicle with `sensors`; a sensor can use the rows of those before it.

    Outputs: `time`, the truth (`TRUTH`), and the outputs of each sensor (`Sensor.outputs`, `Sensor.truth`, `Sensor.derived`).
    """
    if not isinstance(vehicle, Vehicle):
        raise InputError(f"vehicle = {vehicle!r}: allowed is an insenv.Vehicle")
    with naming(f"vehicle {vehicle.id!r}"):
        instant = truth_instant(vehicle)
        parts = [truth_part(vehicle), CLOCK]
    state = sum((part.state for part in parts), Table())
    names: tuple[str, ...] = ("time", *TRUTH)
    for sensor in sensors:
        with naming(f"sensor {sensor.id!r}"):
            part = sensor.part(instant)
            if not isinstance(part, Part):
                raise InputError(f"part gave {part!r}: allowed is an insenv.core.compose.Part")
            parts.append(part)
            state += part.state
            names += tuple(state[name].name for name in (*sensor.outputs, *sensor.truth))
    derived = [(sensor.derived, sensor.derive) for sensor in sensors]
    outputs = sum((table for table, _ in derived), Table(tuple(state[name] for name in names)))

    def output(p: Any, x: Any) -> dict[str, Any]:
        shown = {name: getattr(x, name) for name in names}
        for _, derive in derived:
            shown |= derive(p, x) if derive is not None else {}
        return shown

    return merge(f"plant-{vehicle.id}", f"{vehicle.title}, with its sensors", parts, outputs, output)

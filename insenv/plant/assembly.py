"""The plant: a vehicle's truth, its inertial unit and its GNSS receiver as one model.

One advance is one inertial sample.  The outputs after it are what the sensors show and what is true at the sample's end.
"""

from __future__ import annotations

from typing import Any

from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.tables import Row, Table
from insenv.sensors import GNSS_STATE, IMU_STATE, gnss_part, imu_part
from insenv.sensors.imu import systematic_error
from insenv.vehicles import TRUTH_STATE, Vehicle, truth_instant, truth_part

CLOCK = Part(
    parameters=Table(
        (SEED, Row("sample_interval", "Time from one inertial sample to the next", "s", start=0.005, lower=1e-4, upper=1.0))
    ),
    state=Table((STEP, Row("time", "Time since the start", "s"))),
    steps={"sample": Step(lambda p, x, u: {"step": x.step + 1, "time": (x.step + 1) * p.sample_interval})},
)

TRUTH = ("q_nb", "velocity_n", "latitude", "longitude", "height")
IMU = ("delta_angle", "delta_velocity", "imu_valid", "gyro_bias_true", "accel_bias_true")
GNSS = (
    "gnss_valid",
    "gnss_age",
    "gnss_latitude",
    "gnss_longitude",
    "gnss_height",
    "gnss_position_sigma",
    "gnss_velocity_valid",
    "gnss_velocity_n",
    "gnss_velocity_sigma",
)


SENSOR_ERROR = Table((
    Row("delta_angle_error", "Error of the gyro increment, noise and counts left out", "rad", (3,), "b"),
    Row("delta_velocity_error", "Error of the accelerometer increment, noise and counts left out", "m/s", (3,), "b"),
))  # fmt: skip


def plant_model(vehicle: Vehicle, gnss: bool = True) -> Model:
    """The plant of a vehicle with an inertial unit and, if `gnss`, a receiver.

    Outputs: `time`; the truth (`TRUTH`, `true_delta_angle`, `true_delta_velocity`); the measured increments and biases
    (`IMU`); the fix delivered with this sample, if any (`GNSS`); what of the increments is error but no noise (`SENSOR_ERROR`).
    """
    parts = [truth_part(vehicle), CLOCK, imu_part()] + ([gnss_part(truth_instant(vehicle))] if gnss else [])
    state = CLOCK.state + TRUTH_STATE + IMU_STATE + (GNSS_STATE if gnss else Table())
    names = ("time", *TRUTH, "true_delta_angle", "true_delta_velocity", *IMU, *(GNSS if gnss else ()))
    outputs = Table(tuple(state[name] for name in names)) + SENSOR_ERROR

    def output(p: Any, x: Any) -> dict[str, Any]:
        shown = {name: getattr(x, name) for name in names}
        return shown | dict(zip(SENSOR_ERROR.names, systematic_error(p, x), strict=True))

    return merge(f"plant-{vehicle.id}", f"{vehicle.title}, with its sensors", parts, outputs, output)

"""A simulated drive as a recorded log, with the truth as its reference."""

from typing import Any

import numpy as np

from insenv import attitude
from insenv.core.runner import make_runner
from insenv.logs import GnssFixes, LogDescription, RecordedLog, Reference
from insenv.logs.inertial import Gaps
from insenv.scenario import build, load

IMU = {
    "file": "none", "time": 0, "gyro": [1, 2, 3], "accel": [4, 5, 6], "kind": "increment", "stamp": "interval_end",
    "gyro_unit": "rad", "accel_unit": "m/s", "axes": "FRD",
}  # fmt: skip


def simulated_log(
    scenario: Any, seed: int = 1, duration_s: float | None = None, grade: str = "", **sections: Any
) -> RecordedLog:
    """The log of a scenario: its samples, its fixes and its truth.

    grade: what the log says of the unit. sections: further sections of the description (`initial`, `estimator`).
    """
    scenario = load(scenario)
    plant = build(scenario, seed=seed, duration_s=duration_s)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    shown = {name: np.array(values) for name, values in shown.items()}
    dt = np.full(plant.samples, plant.sample_interval)
    time = np.cumsum(dt)
    roll, pitch, heading = attitude.numeric.to_euler(shown["q_nb"])
    arm = np.array(scenario.gnss.lever_arm_m if scenario.gnss else (0.0, 0.0, 0.0))
    gnss = None
    if scenario.gnss is not None:
        at = shown["gnss_valid"][:, 0] != 0 if shown["gnss_valid"].ndim > 1 else shown["gnss_valid"] != 0
        names = (
            "gnss_latitude",
            "gnss_longitude",
            "gnss_height",
            "gnss_position_sigma",
            "gnss_velocity_n",
            "gnss_velocity_sigma",
        )
        gnss = GnssFixes(time[at] - shown["gnss_age"][at].ravel(), *(shown[name][at] for name in names))
    description = LogDescription.model_validate({"title": "simulated", "imu": {**IMU, "grade": grade}, **sections})
    return RecordedLog(
        imu_time=time,
        delta_angle=shown["delta_angle"],
        delta_velocity=shown["delta_velocity"],
        dt=dt,
        bridged=np.zeros(plant.samples, bool),
        gaps=Gaps(),
        gnss=gnss,
        lever_arm_b=arm,
        reference=Reference(
            time, shown["latitude"], shown["longitude"], shown["height"], shown["velocity_n"], roll, pitch, heading
        ),
        sources=(),
        notes=(),
        description=description,
    )

"""A simulated drive as a recorded log, with the truth as its reference."""

from dataclasses import replace
from typing import Any

import numpy as np

from insenv import record
from insenv.logs import LogDescription, RecordedLog

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
    log = record(scenario, seed=seed, duration_s=duration_s)
    time, gnss = np.cumsum(log.dt), log.gnss
    if gnss is not None:  # stamped with their time of validity
        gnss = replace(gnss, time=time[np.searchsorted(log.imu_time, gnss.arrival)] - gnss.age, arrival=None, age=None)
    description = LogDescription.model_validate({"title": "simulated", "imu": {**IMU, "grade": grade}, **sections})
    return replace(
        log, imu_time=time, temperature=None, gnss=gnss, reference=replace(log.reference, time=time), description=description,
        unit=None, settings={}, instruments=(), stated_errors=description.gnss.stated_errors() if description.gnss else {},
    )  # fmt: skip

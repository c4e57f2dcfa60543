"""A simulated drive as the text files of a recorded log, described truly or not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from insenv.core.runner import make_runner
from insenv.scenario import build, load, parse

LEVER_ARM_M = (-1.2, 0.3, -1.0)
AGE_S = 0.05


def written_log(
    folder: Path,
    *,
    unit: str = "tactical",
    receiver: str = "rtk",
    seed: int = 1,
    duration_s: float = 240.0,
    grade: str = "tactical",
    lever_arm_m: tuple[float, float, float] = LEVER_ARM_M,
    time_offset_s: float = 0.0,
    scale_of_sigma: float = 1.0,
    odometer: float | None = None,
    barometer: float | None = None,
) -> Path:
    """Write the city drive at 100 Hz with fixes at 1 Hz, and its description.

    unit, receiver: grades that are simulated.  grade, lever_arm_m, time_offset_s, scale_of_sigma: what the description tells;
    the defaults are true.
    odometer, barometer: the log has these too: speeds times a factor, heights plus an offset (m).
    """
    values = load("car-city-drive").model_dump(exclude_unset=True)
    values |= {"rate_hz": 100.0, "imu": {"grade": unit}}
    values["gnss"] = {"grade": receiver, "interval_s": 1.0, "latency_s": AGE_S, "lever_arm_m": list(LEVER_ARM_M)}
    values.pop("estimator")
    values |= {id: {} for id, wrong in (("odometer", odometer), ("barometer", barometer)) if wrong is not None}
    plant = build(parse(values), seed=seed, duration_s=duration_s)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    time, fix = shown["time"], shown["gnss_valid"] != 0
    degrees = np.degrees(np.stack([shown["gnss_latitude"], shown["gnss_longitude"]], axis=1))
    _write(folder / "imu.csv", "t,gx,gy,gz,ax,ay,az", time, shown["delta_angle"], shown["delta_velocity"])
    sigmas = (scale_of_sigma * shown[f"gnss_{kind}_sigma"][fix] for kind in ("position", "velocity"))
    fixes = (
        time[fix] - shown["gnss_age"][fix],
        degrees[fix],
        shown["gnss_height"][fix],
        shown["gnss_velocity_n"][fix],
        *sigmas,
    )
    _write(folder / "gnss.csv", "t,lat,lon,h,vn,ve,vd,sn,se,sd,svn,sve,svd", *fixes)
    path = folder / "log.toml"
    path.write_text(f"""title = "a simulated drive"
[imu]
file = "imu.csv"
time = "t"
gyro = ["gx", "gy", "gz"]
accel = ["ax", "ay", "az"]
kind = "increment"
stamp = "interval_end"
gyro_unit = "rad"
accel_unit = "m/s"
axes = "FRD"
grade = "{grade}"
[gnss]
file = "gnss.csv"
time = "t"
latitude = "lat"
longitude = "lon"
height = "h"
position_unit = "deg"
velocity = ["vn", "ve", "vd"]
position_sigma = ["sn", "se", "sd"]
velocity_sigma = ["svn", "sve", "svd"]
lever_arm_m = {list(lever_arm_m)}
time_offset_s = {time_offset_s}
[initial]
static_until_s = 28.0
{_instruments(folder, shown, odometer, barometer)}
[estimator."loosely-coupled"]
rotation_error = 1.1e-3
thrust_error = 1.05e-3
""")
    return path


def _instruments(folder: Path, shown: Mapping[str, np.ndarray], odometer: float | None, barometer: float | None) -> str:
    """Write the files of the instruments; return their sections."""
    found = ""
    for id, value, factor, offset in (("odometer", "speed", odometer, 0.0), ("barometer", "height", 1.0, barometer)):
        if factor is None or offset is None:
            continue
        at = shown[f"{id}_new"] != 0
        _write(
            folder / f"{id}.csv",
            "t,v",
            shown["time"][at] - shown[f"{id}_age"][at],
            shown[f"{id}_{value}"][at] * factor + offset,
        )
        found += f'[{id}]\nfile = "{id}.csv"\ntime = "t"\n{value} = "v"\n' + "lever_arm_m = [0, 0, 0]\n" * (id == "odometer")
    return found


def _write(path: Path, names: str, *columns: np.ndarray) -> None:
    np.savetxt(path, np.column_stack(columns), fmt="%.17g", delimiter=",", header=names, comments="")

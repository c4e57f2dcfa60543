"""Write the CSV files of the example log: a simulated drive of a car, with its truth as the reference.

``python tools/plain_log.py`` in the repository rewrites them; tests/project/test_examples.py compares.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from insenv import attitude
from insenv.core.runner import make_runner
from insenv.scenario import build, load

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "logs"
G = 9.80665
SCENARIO: dict[str, Any] = {
    "title": "Plain CSV example",
    "duration_s": 120.0,
    "rate_hz": 50.0,
    "seed": 1,
    "start": {"latitude_deg": 45.0, "longitude_deg": 9.0, "height_m": 100.0, "heading_deg": 30.0},
    "vehicle": {
        "kind": "car",
        "legs": [
            {"wait_s": 30.0},
            {"accelerate_to_mps": 12.0},
            {"drive_s": 10.0},
            {"turn_deg": 90.0, "radius_m": 30.0},
            {"drive_s": 15.0},
            {"turn_deg": -90.0, "radius_m": 40.0},
            {"drive_s": 15.0},
            {"turn_deg": -90.0, "radius_m": 30.0},
            {"drive_s": 10.0},
            {"stop_s": 10.0},
        ],
    },
    "imu": {"grade": "tactical"},
    "gnss": {
        "grade": "perfect", "interval_s": 1.0, "position_noise_m": [0.5, 0.5, 1.0], "velocity_noise_mps": 0.05,
        "lever_arm_m": [0.4, 0.0, -1.2],
    },
}  # fmt: skip
REFERENCE_EVERY = 5


def files() -> dict[str, str]:
    """The text of each file by name."""
    plant = build(load(SCENARIO))
    outputs = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    shown = {name: np.array(values) for name, values in outputs.items()}
    rate_hz = 1.0 / plant.sample_interval
    time = np.arange(1, plant.samples + 1) / rate_hz
    gyro = np.degrees(shown["delta_angle"]) * rate_hz
    force = shown["delta_velocity"] * rate_hz / G
    right_forward_up = [1, 0, 2], np.array([1.0, 1.0, -1.0])
    gyro, force = (values[:, right_forward_up[0]] * right_forward_up[1] for values in (gyro, force))

    fixed = shown["gnss_valid"].ravel() != 0
    fix_time = (time - shown["gnss_age"].ravel())[fixed]
    place = _place(shown, "gnss_")[fixed]
    roll, pitch, heading = np.degrees(attitude.numeric.to_euler(shown["q_nb"]))
    at = slice(REFERENCE_EVERY - 1, None, REFERENCE_EVERY)
    angles = np.column_stack([roll, pitch, heading % 360.0])
    return {
        "plain-imu.csv": _csv(
            "time_s,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", ((time, 2), (gyro, 5), (force, 6))
        ),
        "plain-gnss.csv": _csv(
            "time_s,lat_deg,lon_deg,height_m,std_n,std_e,std_d,vn,ve,vd,std_vn,std_ve,std_vd",
            (
                (fix_time, 2), (place[:, :2], 9), (place[:, 2], 3), (shown["gnss_position_sigma"][fixed], 2),
                (shown["gnss_velocity_n"][fixed], 3), (shown["gnss_velocity_sigma"][fixed], 3),
            ),
        ),
        "plain-reference.csv": _csv(
            "time_s,lat_deg,lon_deg,height_m,vn,ve,vd,roll_deg,pitch_deg,heading_deg",
            (
                (time[at], 2), (_place(shown)[at, :2], 9), (_place(shown)[at, 2], 3), (shown["velocity_n"][at], 4),
                (angles[at], 4),
            ),
        ),
    }  # fmt: skip


def _place(shown: dict[str, Any], prefix: str = "") -> Any:
    latitude, longitude, height = (shown[f"{prefix}{name}"].ravel() for name in ("latitude", "longitude", "height"))
    return np.column_stack([np.degrees(latitude), np.degrees(longitude), height])


def _csv(head: str, columns: Iterable[tuple[Any, int]]) -> str:
    """Columns or blocks of columns, each with its number of decimals, below a header."""
    blocks = [(values.reshape(len(values), -1), decimals) for values, decimals in columns]
    lines = [head]
    for row in range(len(blocks[0][0])):
        # + 0.0: no minus before zero
        lines.append(",".join(f"{value + 0.0:.{places}f}" for values, places in blocks for value in values[row]))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for name, text in files().items():
        (FOLDER / name).write_text(text, encoding="utf-8")

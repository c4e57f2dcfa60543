"""A simulated drive as the text files of a recorded log, described truly or not."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from insenv import record
from insenv.logs.formats import csv_table, log_tables
from insenv.logs.formats.text_log import toml_text
from insenv.scenario import load, parse

LEVER_ARM_M = [-1.2, 0.3, -1.0]


def written_log(
    folder: Path,
    *,
    unit: str = "tactical",
    receiver: str = "rtk",
    duration_s: float = 240.0,
    grade: str = "tactical",
    scale_of_sigma: float = 1.0,
    odometer: float | None = None,
    barometer: float | None = None,
) -> Path:
    """Write the city drive at 100 Hz with fixes at 1 Hz, and its description.

    unit, receiver: grades that are simulated.  grade, scale_of_sigma: what the description states; the defaults are true.
    odometer, barometer: the log has these too: speeds times a factor, heights plus an offset (m).
    """
    values = load("car-city-drive").model_dump(exclude_unset=True)
    values |= {"rate_hz": 100.0, "imu": {"grade": unit}}
    values["gnss"] = {"grade": receiver, "interval_s": 1.0, "latency_s": 0.05, "lever_arm_m": LEVER_ARM_M}
    values.pop("estimator")
    values |= {id: {} for id, wrong in (("odometer", odometer), ("barometer", barometer)) if wrong is not None}
    log = record(parse(values), seed=1, duration_s=duration_s)
    assert log.gnss is not None and log.gnss.velocity_sigma is not None
    fixes = replace(  # stamped with their time of validity
        log.gnss,
        arrival=None,
        age=None,
        position_sigma=scale_of_sigma * log.gnss.position_sigma,
        velocity_sigma=scale_of_sigma * log.gnss.velocity_sigma,
    )
    columns = {"imu": log_tables.imu_columns(log), "gnss": log_tables.gnss_columns(fixes)}
    sections: dict[str, dict[str, Any]] = {
        "imu": {**log_tables.IMU, "grade": grade, "noise_in_motion": False},
        "gnss": {**log_tables.gnss_keys(fixes), "lever_arm_m": LEVER_ARM_M, "time_offset_s": 0.0, "wander_sigma_m": 0.0},
    }
    for each in log.instruments:
        wrong = {"odometer": (odometer, 0.0), "barometer": (1.0, barometer)}[each.id]
        shown = replace(each, arrival=None, age=None, values=each.values * wrong[0] + wrong[1])
        columns[each.id], sections[each.id] = log_tables.instrument_columns(shown), log_tables.instrument_keys(shown)
    if odometer is not None:
        sections["odometer"] = {**sections["odometer"], "lever_arm_m": [0.0, 0.0, 0.0]}
    for id, table in columns.items():
        (folder / f"{id}.csv").write_text(csv_table.csv_text(table), encoding="utf-8")
    description = {
        "title": "a simulated drive",
        **{id: {"file": f"{id}.csv", **keys} for id, keys in sections.items()},
        "initial": {"static_until_s": 28.0},
        "estimator": {"loosely-coupled": {"rotation_error": 1.1e-3, "thrust_error": 1.05e-3}},
    }
    path = folder / "log.toml"
    path.write_text(toml_text(description), encoding="utf-8")
    return path

"""What the parameters in a vehicle's log (PARAM_VALUE, PARM, initial_parameters) say of its sensors.

The lever arm of the antenna by the names of ArduPilot, PX4 and insenv. A log of insenv also has the data sheet of its inertial
unit (``S_...``) and the settings of its estimator (``E_...``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from insenv.core.tables import Array, Table
from insenv.estimators import ImuDataSheet, Knowledge, registered
from insenv.sensors.grades import elements
from insenv.sensors.imu_tables import IMU_PARAMETERS
from insenv.sensors.units import SHOWN

_ARMS = (
    ("S_ANT_LEV_ARM_", ""),
    ("GPS1_POS_", "INS_POS1_"),
    ("GPS_POS1_", "INS_POS1_"),
    ("EKF2_GPS_POS_", "EKF2_IMU_POS_"),
)
"""Names, without X, Y and Z, of the positions of antenna and inertial unit (m, FRD) from one point of the vehicle."""


MIN_COMMON = 0.8
"""Share of the parameters of an estimator and of a log that must be the same."""


def lever_arm(values: Mapping[str, float]) -> tuple[Array, str] | None:
    """Lever arm (3,) m, FRD, from the inertial unit to the antenna, and the names of its parameters; None if there is none.

    Zeros count as not set: autopilots have them until somebody measures.
    """
    for antenna, unit in _ARMS:
        if not all(f"{antenna}{axis}" in values for axis in "XYZ"):
            continue
        arm = np.array([values[f"{antenna}{axis}"] - (values.get(f"{unit}{axis}", 0.0) if unit else 0.0) for axis in "XYZ"])
        if np.isfinite(arm).all() and arm.any():
            return arm, f"{antenna}X, Y, Z" + (f" less {unit}X, Y, Z" if unit and f"{unit}X" in values else "")
    return None


def unit_rows(values: Mapping[str, float]) -> dict[str, Any] | None:
    """Parameter rows (SI) of insenv's inertial unit; None if the log is not insenv's, or its unit was not stated."""
    rows = _rows("S", IMU_PARAMETERS, values)
    return rows if set(rows) == {row.name for row, _, _ in elements("S", IMU_PARAMETERS, IMU_PARAMETERS.names)} else None


NOT_IN_A_LOG = frozenset({"rotation_error", "thrust_error", "fix_wander_sigma", "fix_wander_time"})
"""What a scenario knows of its sensors and a replay cannot find."""


def settings(values: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Parameter rows (SI) by the id of each estimator whose parameters are those in the log, but for a few of another version.

    Left out: what a start knows, and the data sheet, both of which a replay finds anew.
    """
    known = {each.name for kind in (Knowledge, ImuDataSheet) for each in fields(kind)} - NOT_IN_A_LOG
    logged = {name for name in values if name.startswith("E_")}
    by_id = {}
    for id, estimator in registered().items() if logged else ():
        table = estimator.model.parameters
        names = {name for _, _, name in elements("E", table, table.names)}
        if len(names & logged) < MIN_COMMON * len(names | logged):
            continue
        rows = _rows("E", table, values)
        by_id[id] = {name: row for name, row in rows.items() if name not in known and not name.startswith("start_")}
    return by_id


def _rows(prefix: str, table: Table, values: Mapping[str, float]) -> dict[str, Any]:
    """Those rows of a table of which the log has all elements, by their short names."""
    rows: dict[str, Any] = {}
    lacking = set()
    for row, place, name in elements(prefix, table, table.names):
        if name not in values or not np.isfinite(values[name]):
            lacking.add(row.name)
            continue
        _, to_si = SHOWN.get(row.unit, (row.unit, float))
        number = min(max(float(to_si(values[name])), row.lower), row.upper)
        flat = rows.setdefault(row.name, np.zeros(row.size))
        flat[place - table.slice(row.name).start] = number
    return {name: flat if table[name].shape else float(flat[0]) for name, flat in rows.items() if name not in lacking}

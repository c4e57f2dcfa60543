"""Parameters of a composition from what is known of the start and the unit."""

from __future__ import annotations

from collections.abc import Collection
from math import hypot, sqrt
from typing import Any

import numpy as np

from insenv.core.tables import Table
from insenv.estimators.contract import Knowledge
from insenv.estimators.fusion.odometer import UNTOLD_ARM
from insenv.sensors.instruments import TOLD


def untold_mounting(known: Knowledge) -> bool:
    """Whether nothing is told of how the inertial unit is mounted to the wheels."""
    return "odometer_lever_arm_b" not in known.instruments


def prepared(known: Knowledge, table: Table, states: Collection[str]) -> dict[str, Any]:
    """Parameter rows (SI, by name) of a filter that estimates `states`.

    What a state stands for is taken out of what a filter without it counts instead: out of the bias that gravity makes of a
    scale factor, a misalignment or a g-sensitivity, and out of the process noise of manoeuvres
    (`insenv.estimators.parts.motion_errors`).
    """
    rows, sheet = known.rows_of(table), known.sensors
    for name in TOLD.names:  # an error that is not told, of a state that was asked for, has the size that its row starts with
        if name in rows and not np.any(rows[name]) and table[name].flat_start().any():
            del rows[name]
    if untold_mounting(known) and "non_holonomic_arm_sigma" in table:
        rows["non_holonomic_arm_sigma"] = UNTOLD_ARM
    bare = {"gyro": {"gyro_g_sensitivity"}, "accel": {"accel_scale", "accel_misalignment"}}
    for triad, needed in bare.items():
        sigma = getattr(sheet, f"bare_{triad}_bias_sigma")
        if sigma > 0 and all(name in states or getattr(sheet, f"{name}_sigma") == 0 for name in needed):
            rows[f"{triad}_bias_sigma"] = sigma
            rows[f"{triad}_correlation_time"] = getattr(sheet, f"bare_{triad}_correlation_time")
    for triad, row in (("gyro", "rotation_error"), ("accel", "thrust_error")):
        named = (f"{triad}_scale", f"{triad}_misalignment")
        estimated = hypot(*(getattr(sheet, f"{name}_sigma") for name in named if name in states))
        rows[row] = sqrt(max(getattr(known, row) ** 2 - estimated**2, 0.0))
    return rows

"""Which states and aids a filter has where nobody says: by the unit, the instruments and the vehicle.

A state is worth its place if what it does exceeds a share of what the unit's white noise does in a minute: a scale factor or
a misalignment in a manoeuvre (`insenv.estimators.parts.motion_errors`), an error of an instrument if it is told at all. On a
turntable, which turns gravity from axis to axis, every error of the unit that is told is worth it.
"""

from __future__ import annotations

from collections.abc import Collection
from math import sqrt
from typing import Any

import numpy as np

from insenv.estimators.contract import TURNTABLE, Drive, Knowledge
from insenv.estimators.fusion.available import AIDS, OF_AID, OF_UNIT, STATES
from insenv.estimators.fusion.odometer import MOUNTING, NON_HOLONOMIC
from insenv.estimators.fusion.prepared import untold_mounting
from insenv.estimators.parts.motion_errors import COHERENT_ANGLE, COHERENT_SPEED

WORTH = 0.1
MINUTE = 60.0
FLOATING = ("ship", "multirotor")
"""Kinds of vehicle that never stand still."""
HOLDING = ("gnss", "dvl", "odometer")
"""Sensors, and their aids, that hold the horizontal velocity, also of a vehicle that is steered away."""
PARKED = ("car", "aircraft")
"""Kinds of vehicle that stand still where they stay in place."""
HOVERING = ("multirotor",)
"""Kinds of vehicle whose turns and accelerations are too small to show a scale factor or a misalignment."""


def aids_of(drive: Drive) -> tuple[str, ...]:
    """The aids of a drive: those of its instruments, and what the vehicle itself tells.

    Where nothing but rest holds the velocity of a vehicle that is known to stay, rest is not detected: detection asks whether
    the estimate agrees, and one that is 3 standard deviations off takes a parked vehicle for one that accelerates.
    """
    wheels = drive.vehicle == "car" and "odometer" in drive.sensors
    parked = bool(drive.in_place and drive.vehicle in PARKED and drive.sensors.isdisjoint(HOLDING))
    stays = drive.vehicle == TURNTABLE or parked
    own = {"zero_velocity": not stays and drive.vehicle not in FLOATING, "non_holonomic": wheels, "in_place": stays}
    return tuple(id for id, aid in AIDS.items() if own.get(id, bool(aid.sensors)) and set(aid.sensors) <= drive.sensors)


def states_of(known: Knowledge, drive: Drive, aids: Collection[str]) -> tuple[str, ...]:
    """The states, beside the biases, of a filter with these aids."""
    rows = known.rows
    found = told_of_unit(known) if drive.vehicle == TURNTABLE else _shown_by_manoeuvres(known, drive)
    for aid in aids:
        found += [state.name for state in OF_AID.get(aid, ()) if _told(rows, STATES[state.name].sigma)]
    if NON_HOLONOMIC.id in aids and untold_mounting(known):
        found.append(MOUNTING.name)
    return tuple(dict.fromkeys(found))


def told_of_unit(known: Knowledge) -> list[str]:
    """The states of the unit beside its biases whose standard deviation is told."""
    rows = known.rows
    return [state for state in OF_UNIT if _told(rows, STATES[state].sigma)]


def _shown_by_manoeuvres(known: Knowledge, drive: Drive) -> list[str]:
    sheet = known.sensors
    manoeuvre = {
        "gyro": COHERENT_ANGLE / max(sheet.angle_random_walk * sqrt(MINUTE), 1e-12),
        "accel": COHERENT_SPEED / max(sheet.velocity_random_walk * sqrt(MINUTE), 1e-12),
    }
    found: list[str] = []
    for triad, effect in manoeuvre.items():
        if drive.in_place or drive.vehicle in HOVERING:  # no manoeuvre shows them
            continue
        found += [
            f"{triad}_{error}"
            for error in ("scale", "misalignment")
            if getattr(sheet, f"{triad}_{error}_sigma") * effect > WORTH
        ]
    return found


def _told(rows: dict[str, Any], sigma: str) -> bool:
    return bool(np.any(np.asarray(rows.get(sigma, 0.0)) > 0.0))

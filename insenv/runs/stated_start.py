"""What [initial] of a log states of the start; and the start on a log of a vehicle that floats in place, without fixes.

Of the latter the place is that of [initial].  The velocity is that of the sway, the level that of the mean specific force of
the first seconds, which the sway bends by its acceleration over gravity.  The heading is unknown where [initial] does not give
it; `fusion` finds it by the Earth's rotation (`insenv.estimators.fusion.azimuth`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from insenv.base.keys import keys_of, rows_of
from insenv.base.remarks import Remark, declared
from insenv.estimators import Knowledge
from insenv.logs import RecordedLog
from insenv.logs.description import InitialSection
from insenv.logs.rest import rest_of
from insenv.vehicles import registry as vehicles

ROUNDED_PLACE = 100.0
"""m: of a horizontal position that [initial] gives without a standard deviation."""
LEVELLED_S = 2.0
"""s: of which the mean specific force gives the level; a ship rolls by degrees in a few seconds."""
SWAY_TILT = float(np.radians(6.0))
"""rad: of that level, by accelerations of the sway of 1 m/s^2 and by its rolling."""
SWAY_SPEED = 1.0
"""m/s: standard deviation of the velocity of the sway."""
FELT = ("dvl", "odometer")
"""Sensors beside GNSS that show a velocity, by which others start."""

KEYS = {each.row: key for key, each in keys_of(InitialSection).items()}
"""Keys of [initial] by the fields of `Knowledge`; a start "stated" needs all of them."""


def stated_of(log: RecordedLog) -> dict[str, Any]:
    """What [initial] gives, by the fields of `Knowledge`, SI."""
    return rows_of(log.description.initial)


UNKNOWN = (
    "start 'coarse' of a navigation estimator: the vehicle floats in place, and [initial] has no heading_deg: fusion finds the "
    "heading by the Earth's rotation, as alignments do; others need roll_deg, pitch_deg and heading_deg in [initial]"
)
"""The sentence why those who do not find the heading do not start."""
_MOORED = declared(
    "start-moored",
    "the log is of a vehicle that floats in place: the start has the position of [initial], the level of the first "
    f"{LEVELLED_S:g} s, and a heading {{heading}}",
)


def is_moored(log: RecordedLog) -> bool:
    """Whether a log says that its vehicle floats in place, and has no sensor that shows its velocity."""
    kind = log.description.vehicle_kind
    felt = log.gnss is not None or any(each.id in FELT for each in log.instruments)
    return bool(log.description.in_place and kind and vehicles.traits_of(kind).floats and not felt)


def swaying(log: RecordedLog, place: Knowledge, first: int, heading_sigma: float) -> tuple[Knowledge, Remark, str]:
    """The start where sample `first` begins, what is said of it, and the sentence why others do not start so, or "".

    place: of a vehicle in place.  heading_sigma: of a heading that [initial] gives without one, rad.  What [initial] gives goes
    before what is measured.
    """
    stated = stated_of(log)
    rows = np.arange(first, min(first + max(round(LEVELLED_S * log.rate_hz), 1), len(log.dt)))
    roll, pitch = rest_of(log, rows, first).level
    measured = {
        "position_sigma": np.full(3, ROUNDED_PLACE),
        "velocity_n": np.zeros(3),
        "velocity_sigma": np.full(3, SWAY_SPEED),
        "roll": roll,
        "pitch": pitch,
        "tilt_sigma": SWAY_TILT,
        "heading": 0.0,
        "heading_sigma": heading_sigma if "heading" in stated else np.pi,
    }
    known = replace(place, **{name: stated.get(name, value) for name, value in measured.items()})
    sure = "heading" in stated
    heading = f"known to {np.degrees(known.heading_sigma):.3g} deg" if sure else "that is not known"
    return known, _MOORED.filled(heading=heading), "" if sure else UNKNOWN

"""Whether a filter that finds rest by itself has taken a vehicle for a moving one that its log began at rest.

Detection of rest asks whether the estimate agrees (`insenv.estimators.parts.standing`).  Once the estimate is a few standard
deviations off it does not, and from then on nothing holds it.  A log that says that the vehicle stays in place needs none.
"""

from __future__ import annotations

import numpy as np

from insenv.estimators.fusion.presets import HOLDING, PARKED
from insenv.estimators.parts.rows import aid_health, reported_aids
from insenv.logs import RecordedLog
from insenv.logs.rest import rest_rows
from insenv.runs.follower import Array, Follower

AID = "zero_velocity"
LATEST_S = 30.0
"""Time without rest that is not noted: a vehicle moves for a while."""


def lost_rest(log: RecordedLog, follower: Follower, times: Array) -> tuple[str, ...]:
    """A sentence if of all aids only zero velocity would hold the velocity of an estimate, and is no longer used.

    times (records,): of the outputs, s of the log.
    """
    if log.gnss is not None or log.description.in_place is False or not len(rest_rows(log)):
        return ()
    outputs = follower.health_rows() if follower.estimator.reports_health else {}
    aids = reported_aids(outputs)
    if AID not in aids or not set(aids).isdisjoint(HOLDING):
        return ()
    count = np.ravel(outputs[aid_health(AID)[0]])
    last = float(times[np.argmax(count == count[-1])])
    if times[-1] - last < LATEST_S:
        return ()
    used = f"zero velocity is all that holds this velocity, and was last used at {last:.4g} s" if count[-1] else (
        "zero velocity is all that would hold this velocity, and was never used"
    )  # fmt: skip
    return (
        f"{used}: the filter takes the vehicle to move. If it is parked, say so: in_place = true, and vehicle_kind = "
        f"{' or '.join(map(repr, PARKED))}",
    )

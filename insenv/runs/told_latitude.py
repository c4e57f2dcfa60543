"""Whether a log without fixes contradicts the latitude that is told of it: a wrong one makes a wrong heading of small sigma.

At rest the gyros measure the rotation of the Earth, OMEGA_IE cos(latitude) about north and -OMEGA_IE sin(latitude) about down.
On the move only a filter can tell: its innovations are smaller with the latitude of the same size in the other hemisphere,
where the rotation about north is the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.base.errors import InsenvError
from insenv.estimators import Estimator, Knowledge
from insenv.estimators.parts.rows import aid_health, reported_aids
from insenv.estimators.velocity_integration.source import finds_north
from insenv.logs import RecordedLog
from insenv.logs.rest import LEAST_REST, STEADY_S, rest_of, rest_rows
from insenv.runs.follower import Follower
from insenv.runs.simulated import follower_of

Array = NDArray[np.float64]

FAR = 8.0
"""Standard deviations by which a mean rate at rest may differ: its own is the scatter of few means."""
FITTING = 1.5
"""Largest mean square of test ratios of a filter that fits: of another wrong latitude neither hemisphere does."""
LESS = 50.0
"""Sum of squared test ratios by which the other hemisphere must do better; at times when neither can tell, it differs by 2."""


def at_rest(log: RecordedLog, first: int, latitude: float) -> tuple[str, ...]:
    """A sentence if the mean rate of a log at rest, without fixes, cannot be that of the Earth at a latitude (rad).

    first: the sample that navigation starts with.
    """
    rows = rest_rows(log)
    if log.gnss is not None or len(rows) < LEAST_REST or log.dt[rows].sum() < STEADY_S:
        return ()
    rest, bias = rest_of(log, rows, first), log.sensors(in_place=True).gyro_bias_sigma
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(*rest.level, 0.0))
    rate_n, scatter = C_nb @ rest.rate, np.sqrt(C_nb**2 @ rest.rate_sigmas**2)
    measured = np.array([np.hypot(rate_n[0], rate_n[1]), rate_n[2]])
    allowed = FAR * np.hypot([max(scatter[0], scatter[1]), scatter[2]], bias)
    # if its size is not that of the Earth's, the gyros are worse than they are said to be
    of_earth = abs(np.hypot(*measured) - geodesy.OMEGA_IE) <= allowed.max()
    if not of_earth or np.all(np.abs(measured - geodesy.numeric.earth_rate_n(latitude)[[0, 2]]) <= allowed):
        return ()
    found = float(np.arctan2(-measured[1], measured[0]))
    return (
        f"the gyros at rest contradict the latitude, {named(latitude)}: the rotation of the Earth that they measure is that at "
        f"about {named(found, digits=2)}",
    )


@dataclass
class OtherHemisphere:
    """A filter that runs along with one that is told a latitude (rad), in the other hemisphere; None: it could tell nothing."""

    latitude: float
    follower: Follower | None

    @classmethod
    def started(
        cls, log: RecordedLog, estimator: Estimator, known: Knowledge, rows: Mapping[str, Any], every: int
    ) -> OtherHemisphere:
        """Beside the estimator that starts on a log with what is `known`; rows, every: as for `follower_of`.

        Only without fixes, and only with gyros that find north: the innovations of others hardly depend on the hemisphere.
        """
        north = bool(finds_north(known.sensors.gyro_bias_sigma, known.latitude))
        if log.gnss is not None or not north or not estimator.reports_health:
            return cls(known.latitude, None)
        parameters = estimator.parameters(replace(known, latitude=-known.latitude), rows=rows)
        return cls(known.latitude, follower_of(estimator, parameters, every))

    def follow(self, columns: dict[str, Array], count: int) -> None:
        """As `Follower.follow`; a filter that diverges tells nothing."""
        if self.follower is None:
            return
        try:
            self.follower.follow(columns, count)
        except InsenvError:
            self.follower = None

    def contradiction(self, told: Follower) -> tuple[str, ...]:
        """A sentence if `told`, the filter with the latitude that is told, fits the log less well."""
        if self.follower is None:
            return ()
        (here, _), (there, count) = misfit(told.health_rows()), misfit(self.follower.health_rows())
        if here - there <= LESS or there > FITTING * count:
            return ()
        return (
            f"the latitude, {named(self.latitude)}, does not fit the log: the squared test ratios of this filter sum up to "
            f"{here:.0f} with it, and to {there:.0f} with {named(-self.latitude)}; its sign is wrong",
        )


def misfit(outputs: Mapping[str, Array]) -> tuple[float, float]:
    """Sum of the squared test ratios of a run's measurements, refused ones too, and their number."""
    sums = np.zeros(2)
    for id in reported_aids(outputs):
        used, used_count, refused, refused_count = (float(np.sum(outputs[name][-1])) for name in aid_health(id)[2:])
        sums += used + refused, used_count + refused_count
    return float(sums[0]), float(sums[1])


def named(latitude: float, digits: int = 4) -> str:
    """A latitude (rad) with its hemisphere."""
    return f"{abs(np.degrees(latitude)):.{digits}g} deg {'N' if latitude >= 0 else 'S'}"

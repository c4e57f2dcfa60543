"""What a recorded log contradicts, or cannot show, of what is stated of it: its latitude, its place, a standstill that was "
"missed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.remarks import Remark, clock, declared, remark
from insenv.core.tables import Array
from insenv.estimators import Estimator
from insenv.estimators.fusion.family import held
from insenv.estimators.parts.rows import aid_health, reported_aids
from insenv.logs import RecordedLog
from insenv.logs.rest import LEAST_REST, REST_WINDOW_S, STEADY_S, rest_of, rest_rows, rest_until, shows_travel
from insenv.runs.follower import Follower
from insenv.sensors.gnss import COMMON
from insenv.vehicles import registry as vehicles

LATITUDE_SIGMAS = 8.0
"""Standard deviations by which a mean rate at rest may differ: its own is the scatter of few means."""
ZERO_VELOCITY = "zero_velocity"
LATEST_REST_S = 30.0
"""Time without rest that is not noted: a vehicle moves for a while."""


def latitude_text(latitude: float, digits: int = 4) -> str:
    """A latitude (rad) with its hemisphere."""
    return f"{abs(np.degrees(latitude)):.{digits}g} deg {'N' if latitude >= 0 else 'S'}"


@remark(
    "latitude-contradicted",
    "the gyros at rest contradict the latitude, {stated}: the rotation of the Earth that they measure is that at about "
    "{measured}",
)
def latitude_at_rest(log: RecordedLog, first: int, latitude: float) -> dict[str, Any] | None:
    """The mean rate of a log at rest, without fixes, cannot be that of the Earth at a latitude (rad).

    At rest the gyros measure OMEGA_IE cos(latitude) about north and -OMEGA_IE sin(latitude) about down.  On the move no single
    filter shows it: with a wrong sign each innovation passes its gate and the mean NIS is within its bounds.

    first: the sample that navigation starts with.
    """
    rows = rest_rows(log)
    if log.gnss is not None or len(rows) < LEAST_REST or log.dt[rows].sum() < STEADY_S:
        return None
    rest, bias = rest_of(log, rows, first), log.sensors(in_place=True).gyro_bias_sigma
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(*rest.level, 0.0))
    rate_n, scatter = C_nb @ rest.rate, np.sqrt(C_nb**2 @ rest.rate_sigmas**2)
    measured = np.array([np.hypot(rate_n[0], rate_n[1]), rate_n[2]])
    allowed = LATITUDE_SIGMAS * np.hypot([max(scatter[0], scatter[1]), scatter[2]], bias)
    # if its size is not that of the Earth's, the gyros are worse than they are said to be
    of_earth = abs(np.hypot(*measured) - geodesy.OMEGA_IE) <= allowed.max()
    if not of_earth or np.all(np.abs(measured - geodesy.numeric.earth_rate_n(latitude)[[0, 2]]) <= allowed):
        return None
    about = float(np.arctan2(-measured[1], measured[0]))
    return {"stated": latitude_text(latitude), "measured": latitude_text(about, digits=2)}


@remark(
    "noise-in-motion",
    "in motion the samples have more white noise than the unit's data sheet says: {noise}. The cause is vibration, or "
    "motion faster than the samples; estimators are tuned to it{instead}",
)
def noise_in_motion(log: RecordedLog) -> dict[str, Any] | None:
    """The white noise of the log in motion exceeds that of its unit."""
    raised, stated = log.raised_noise, log.sensors(in_place=True)
    figures = {
        "angle_random_walk": ("gyros", "deg/sqrt(h)", np.degrees(60.0), stated.angle_random_walk),
        "velocity_random_walk": ("accelerometers", "m/s/sqrt(h)", 60.0, stated.velocity_random_walk),
    }
    said = [
        f"{triad} {float(np.max(raised[row])) * factor:.2g} {unit} instead of {sheet * factor:.2g}"
        for row, (triad, unit, factor, sheet) in figures.items()
        if row in raised
    ]
    instead = "" if log.is_flight else " ([imu] noise_in_motion = false: to the data sheet)"
    return {"noise": ", ".join(said), "instead": instead} if said else None


_NO_PLACE_SHOWN = declared(
    "latitude-unseen",
    "nothing in the log shows whether the vehicle is at latitude {latitude}; elsewhere the heading is wrong",
)
_NO_STANDSTILL_SHOWN = declared(
    "place-unseen",
    "an alignment in place on a log without fixes: nothing in it shows whether the vehicle stays where it is, at latitude "
    "{latitude}, and the estimate is wrong if it moves or is elsewhere",
)


def unseen(log: RecordedLog, estimator: Estimator, begin_s: float, latitude: float) -> tuple[Remark, ...]:
    """Nothing shows whether the vehicle of an alignment is at that latitude (rad), and stays in place."""
    end_s, stated = float(log.imu_time[-1]), latitude_text(latitude)
    if estimator.motion == "moving" and log.gnss is None:
        return (_NO_PLACE_SHOWN.filled(latitude=stated),)
    if estimator.motion != "in place" or shows_travel(log, begin_s, end_s):
        return ()
    dt = log.dt[:, None]
    until = rest_until(log.imu_time, log.delta_angle / dt, log.delta_velocity / dt, log.gnss, begin_s)
    if until is not None and end_s - until < 2 * REST_WINDOW_S:
        return ()
    return (_NO_STANDSTILL_SHOWN.filled(latitude=stated),)


@remark(
    "standstill-missed",
    "{used}: the filter assumes that the vehicle moves. If it is parked, say so: in_place = true, and vehicle_kind = {kinds}",
)
def standstill_missed(log: RecordedLog, follower: Follower, times: Array) -> dict[str, Any] | None:
    """Of all aids only zero velocity would hold the velocity of an estimate, and it is no longer used.

    Detection of rest asks whether the estimate agrees (`insenv.estimators.fusion.zero_velocity`).  Once the estimate is a few
    standard deviations off it does not, and from then on nothing holds it.  A log that says that the vehicle stays in place
    needs none.

    times (records,): of the outputs, s of the log.
    """
    if log.gnss is not None or log.description.in_place is False or not len(rest_rows(log)):
        return None
    outputs = follower.health_rows() if follower.estimator.reports_health else {}
    aids = reported_aids(outputs)
    if ZERO_VELOCITY not in aids or held(aids):
        return None
    count = np.ravel(outputs[aid_health(ZERO_VELOCITY)[0]])
    last = float(times[np.argmax(count == count[-1])])
    if times[-1] - last < LATEST_REST_S:
        return None
    kinds = " or ".join(repr(kind) for kind in vehicles.names() if vehicles.traits_of(kind).parks)
    if not count[-1]:
        return {"used": "zero velocity is all that would hold this velocity, and was never used", "kinds": kinds}
    return {"used": f"zero velocity is all that holds this velocity, and was last used at {clock(last, 4)} s", "kinds": kinds}


@remark(
    "fixes-common-error",
    "nothing says which part of the error of the fixes changes slowly: the stated sigma of the position contains {sigma} m "
    "(N, E, D), an error that all fixes may share; wander_sigma_m in [gnss] (gnss_wander_sigma_m for a flight log) states it",
)
def common_error(log: RecordedLog) -> dict[str, Any] | None:
    """The fixes are taken to have a part of their errors in common, because nothing states their slow error."""
    common = log.stated_errors.get(COMMON.name)
    return None if common is None else {"sigma": ", ".join(f"{each:.2g}" for each in common)}


LATE_SIGMAS, LATE_S = 5.0, 0.02
"""A delay of fixes is said from so many standard deviations and so many seconds on."""


@remark(
    "fixes-delayed",
    "the fixes are valid {size:.2g} s {side} than the log says (1 sigma {sigma:.1g} s): this filter corrects "
    "it; time_offset_s = {offset:.2g} in [gnss] (gnss_time_offset_s for a flight log) corrects it for all estimators",
)
def fixes_delayed(log: RecordedLog, outputs: Mapping[str, Array]) -> dict[str, Any] | None:
    """The time of validity of the fixes is not that of the log.  outputs: of a filter, by name (records, ...)."""
    if "gnss_delay_estimate_sigma" not in outputs or log.gnss is None:
        return None
    delay, sigma = (float(np.ravel(outputs[name])[-1]) for name in ("gnss_delay", "gnss_delay_estimate_sigma"))
    if abs(delay) < max(LATE_SIGMAS * sigma, LATE_S):
        return None
    section = log.description.gnss
    offset = (0.0 if section is None else section.time_offset_s) - delay
    return {"size": abs(delay), "side": "earlier" if delay > 0 else "later", "sigma": sigma, "offset": offset}

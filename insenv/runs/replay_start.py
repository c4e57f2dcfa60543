"""Initial knowledge of the estimators of a recorded log: from the log itself, or from its reference solution.

From the log: roll and pitch from the mean specific force while the vehicle stands, heading from gyros that sense the
Earth's rotation (`insenv.runs.rest`) or from the motion (`insenv.runs.heading_bank`).  Under way: position and velocity from
the fix at the start, the attitude from the motion too, or unknown.

The standard deviations are those of the log's [initial], or else those stated here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.base.remarks import Remark, clock, declared, remark
from insenv.core.tables import Array
from insenv.estimators import Estimator, Knowledge
from insenv.logs import GnssFixes, RecordedLog
from insenv.logs.declared_units import rest_hint
from insenv.logs.rest import LEAST_REST, REST_SPEED, REST_WINDOW_S, rest_of, rest_rows, travel
from insenv.runs.heading_bank import attitude_by_motion, heading_of, shown_remark, started_with
from insenv.runs.instrument_start import attitude_under_way, heading_at_rest
from insenv.runs.log_remarks import latitude_text
from insenv.runs.rest import RestStart, gyrocompass_sigma, start_at_rest
from insenv.runs.stated_start import KEYS, ROUNDED_PLACE, is_moored, stated_of, swaying
from insenv.sensors.gnss import ARM
from insenv.vehicles import registry as vehicles

STARTS = ("coarse", "reference", "stated")
"""Sources of the initial state: the log alone, its reference solution (of navigation), or its [initial]."""
ON_ITS_BACK = 0.5  # share of gravity that points down at rest
LEVEL_SIGMA = float(np.radians(0.5))  # of stated roll and pitch
HEADING_SIGMA = float(np.radians(5.0))  # of a stated heading
REST_VELOCITY_SIGMA = 0.05  # m/s
ANY_SPEED = 30.0  # m/s: standard deviation of the velocity of a vehicle under way whose fixes have none
SURE_SPEED = 3.0  # m/s: of a fix, above which a vehicle does not stand whatever its inertial unit shows
PUSH = 3.0  # m/s^2: acceleration of a vehicle under way between the start and the fix next to it
PLACE_SIGMAS = 4.0  # by which a stated position and the fixes may differ: 3 are exceeded by 1 in 90 right ones
PLACE = ("latitude", "longitude", "height")
WITH_FIXES = "the start is that of the fixes"
EARLY = 0.1  # s: a stated time this much before the first sample is that of the sample, rounded
REFERENCE_SIGMAS = {
    "position_sigma": np.full(3, 3.0),
    "velocity_sigma": np.full(3, 0.5),
    "tilt_sigma": float(np.radians(1.0)),
    "heading_sigma": float(np.radians(5.0)),
}
"""Of a reference solution that says nothing of its errors (m, m/s, rad): a vehicle's own estimate is wrong by degrees."""


def rounding(time_s: float) -> float:
    """By how much two times (s) may differ that are the same: sums of steps round, and Unix times to 2e-7 s."""
    return float(1e-9 + 4.0 * np.spacing(abs(time_s)))


def start_time(log: RecordedLog, start: str) -> float:
    """Start of the estimators, s: the log's start_s, or the first sample (that the reference covers, if used).

    Raises `InputError` where [initial] gives a state that may be of another time, because the log is used from a later one on.
    """
    start_s = log.description.initial.start_s
    first = float(log.imu_time[0] - log.dt[0])
    if start != "reference":
        _check_time_of_state(log, first)
    if start_s is not None or start != "reference" or log.reference is None:
        return first if start_s is None else start_s
    return max(first, float(log.reference.time[0]))


def _begin(log: RecordedLog, first: int) -> float:
    """Time (s) at which sample `first` begins."""
    return float(log.imu_time[first] - log.dt[first])


def _check_time_of_state(log: RecordedLog, first: float) -> None:
    """Raise `InputError` unless the state in [initial] is of the time at which the used part begins (`first`, s), or later."""
    initial, cut = log.description.initial, log.description.start_s
    keys = [KEYS[name] for name in stated_of(log) if not name.endswith("_sigma")]
    if not keys or log.description.in_place:
        return
    state = f"the state in [initial] ({', '.join(keys)})"
    if initial.start_s is None and cut is not None and cut > first - EARLY:
        raise InputError(
            f"start_s = {clock(cut)} s leaves out the samples before it, and the time of {state} is not stated: allowed is "
            "[initial] start_s, from which navigation starts with this state, or a start from the log, without these keys"
        )
    if initial.start_s is not None and initial.start_s < first - EARLY:
        raise InputError(
            f"[initial] start_s = {clock(initial.start_s)} s: {state} is of that time, and the log is used from {clock(first)} "
            "s on: allowed is that time or a later one"
        )


@dataclass(frozen=True)
class Start:
    """What is known where a replay starts, and sentences about it.

    refusal: the sentence why nobody starts so who does not find the attitude (`Estimator.finds_attitude`); empty: all may.
    """

    knowledge: Knowledge
    notes: tuple[Remark, ...] = ()
    refusal: str = ""


def initial_knowledge(log: RecordedLog, estimator: Estimator, start: str, first: int) -> Start:
    """Knowledge of the estimator where sample `first` begins; `start` is one of `STARTS`.

    Raises `InputError` if the log lacks what it needs, also if the vehicle is too slow to find the heading.
    """
    if start == "stated":
        return Start(_as_stated(log), _far_from_fix(log, first, "estimators start with it all the same"))
    if start == "reference":
        return Start(_from_reference(log, first))
    if not estimator.navigates:
        return _place(log, estimator.motion != "moving", first)
    if is_moored(log):
        place = _place(log, True, first)
        known, note, refusal = swaying(log, place.knowledge, first, HEADING_SIGMA)
        return Start(known, (*place.notes, note), refusal)
    return _from_log(log, first) if _stands(log, first) else _under_way(log, first)


def _known(log: RecordedLog, in_place: bool, **state: Any) -> Knowledge:
    """The state, by the fields of `Knowledge`, with what the log says of its unit and its instruments."""
    return Knowledge(
        sample_interval=float(np.median(log.dt)),
        **state,
        **log.motion_errors(),
        instruments={**log.stated_errors, ARM.name: log.lever_arm_b},
        sensors=log.sensors(in_place=in_place),
    )


def _sigmas(stated: dict[str, Any], **otherwise: Any) -> dict[str, Any]:
    """The standard deviations that [initial] states, or else the defaults by name (m, m/s, rad)."""
    return {name: stated.get(name, value) for name, value in otherwise.items()}


def _place(log: RecordedLog, in_place: bool, first: int) -> Start:
    """The place, which is all that an alignment needs of the start, and the heading if the log's [initial] gives one."""
    stated, gnss = stated_of(log), log.gnss
    far = _far_from_fix(log, first, WITH_FIXES)
    if "latitude" in stated and "longitude" in stated and not far:
        place = {"height": 0.0, **{name: stated[name] for name in PLACE if name in stated}}
    elif gnss is not None:
        place = dict(zip(PLACE, _fix_place(gnss, _fix_at(gnss, _begin(log, first))), strict=True))
    else:
        raise InputError("alignment needs the place: [initial] latitude_deg, longitude_deg and height_m, or [gnss]")
    known = _known(
        log,
        in_place,
        **place,
        heading=stated.get("heading", 0.0),
        **({} if in_place else _bias_at_rest(log, first, place["latitude"])),
        **_sigmas(stated, heading_sigma=HEADING_SIGMA if "heading" in stated else np.pi, tilt_sigma=np.pi),
    )
    return Start(known, far)


def _bias_at_rest(log: RecordedLog, first: int, latitude: float) -> dict[str, Any]:
    """The gyro bias of a log that begins at rest, in any heading, and its error: of the mean, by that of the attitude, which is
    not used further, and by the drift until the end of the log.

    Empty without a rest, and for gyros whose bias the data sheet states better.
    """
    rows = _rest_rows(log, first)
    if len(rows) < LEAST_REST:
        return {}
    rest, sensors = rest_of(log, rows, first), log.sensors(in_place=True)
    tilt_sigma, earth = rest.tilt_sigma(sensors), geodesy.numeric.earth_rate_n(latitude)
    start = start_at_rest(rest, rest.level, latitude, 0.0, np.pi, sensors, tilt_sigma)
    by_attitude = start.rest_share * np.hypot(start.heading_sigma * earth[0], tilt_sigma * geodesy.OMEGA_IE)
    left = float(log.imu_time[-1] - log.imu_time[first])
    drift = sensors.gyro_bias_sigma * np.sqrt(2 * left / sensors.gyro_correlation_time)
    error = float(np.linalg.norm([start.gyro_bias_error, by_attitude, drift]))
    return {} if error >= sensors.gyro_bias_sigma else {"gyro_bias": start.gyro_bias, "gyro_bias_error": error}


def _fix_at(gnss: GnssFixes, time: float) -> int:
    """Number of the fix next to a time (s)."""
    return int(np.argmin(np.abs(gnss.time - time)))


def _fix_place(gnss: GnssFixes, at: int) -> tuple[float, float, float]:
    """Latitude, longitude (rad) and height (m) of a fix."""
    return float(gnss.latitude[at]), float(gnss.longitude[at]), float(gnss.height[at])


def _far_from_fix(log: RecordedLog, first: int, then: str) -> tuple[Remark, ...]:
    """[initial] gives a place that contradicts the fix nearest to where sample `first` begins."""
    gnss = log.gnss
    if gnss is None:
        return ()
    begin = _begin(log, first)
    at = _fix_at(gnss, begin)
    speed = 0.0 if gnss.velocity_n is None else float(np.hypot(*gnss.velocity_n[at, :2]))
    moved = speed * abs(float(gnss.time[at]) - begin)
    return _far_note(log, _fix_place(gnss, at), gnss.position_sigma[at], "the fix at the start", then, moved)


def _as_stated(log: RecordedLog) -> Knowledge:
    """The state that [initial] gives, with its standard deviations.  Raises `InputError` if one is missing."""
    stated = stated_of(log)
    missing = [key for name, key in KEYS.items() if name not in stated]
    if missing:
        raise InputError(f"start 'stated': [initial] lacks {', '.join(missing)}")
    span = float(log.imu_time[0]), float(log.imu_time[-1])
    in_place = travel(log, *span) is None and (log.description.in_place or False)
    return _known(log, in_place, **stated)


def _from_reference(log: RecordedLog, first: int) -> Knowledge:
    """State of the reference solution where sample `first` begins."""
    reference = log.reference
    if reference is None or reference.roll is None or reference.velocity_n is None or reference.latitude is None:
        raise InputError("start 'reference': the log's [reference] must give position, velocity and attitude")
    time = _begin(log, first)
    if not reference.time[0] - rounding(time) <= time <= reference.time[-1] + rounding(time):
        raise InputError(
            f"start 'reference' at {time:.3f} s: the reference covers {reference.time[0]:.3f} to {reference.time[-1]:.3f} s"
        )
    row = int(np.argmin(np.abs(reference.time - time)))
    assert reference.pitch is not None and reference.heading is not None
    assert reference.longitude is not None and reference.height is not None
    return _known(
        log,
        False,
        latitude=float(reference.latitude[row]),
        longitude=float(reference.longitude[row]),
        height=float(reference.height[row]),
        velocity_n=reference.velocity_n[row],
        roll=float(reference.roll[row]),
        pitch=float(reference.pitch[row]),
        heading=float(reference.heading[row]),
        **_sigmas(stated_of(log), **REFERENCE_SIGMAS),
    )


def _stands(log: RecordedLog, first: int) -> bool:
    """Whether the vehicle stands where sample `first` begins, by the rest of the log or by the fix there."""
    gnss, begin = log.gnss, _begin(log, first)
    if log.rest is None:
        return False
    inside = log.rest[0] - REST_WINDOW_S <= begin <= log.rest[1] + REST_WINDOW_S
    if gnss is None or gnss.velocity_n is None:
        return True
    speed = float(np.hypot(*gnss.velocity_n[_fix_at(gnss, begin), :2]))
    return speed <= (SURE_SPEED if inside else REST_SPEED)  # a steady drive on a straight road looks like a rest


def _shows_attitude(log: RecordedLog, at_rest: bool = False) -> bool:
    """Whether the motion may show the attitude.  Positions alone do not tell waves or wind from a heading, nor a ship's start
    from one at rest.
    """
    gnss, kind = log.gnss, log.description.vehicle_kind
    if gnss is None or gnss.velocity_n is not None:
        return gnss is not None
    if kind is None:
        return at_rest
    traits = vehicles.traits_of(kind)
    return not traits.floats if at_rest else traits.wheels


_UNDER_WAY = declared("start-under-way", "{where}: the start has {source}; its level is {level}, its heading is {heading}")


def _under_way(log: RecordedLog, first: int) -> Start:
    """Position and velocity of the fix next to where sample `first` begins, and of the attitude what [initial] gives.

    Without fixes the position is that of [initial], for a log that has a Doppler log.  Raises `InputError` without both.
    """
    stated, gnss, begin = stated_of(log), log.gnss, _begin(log, first)
    where, rest = f"the vehicle moves at {clock(begin)} s, where navigation starts", ""
    if log.rest is None:
        where, rest = "the log does not begin at rest", rest_hint(log)
        rest += "; if it contains a time at rest, give its limits by [initial] static_from_s and static_until_s"
    if gnss is None:
        where += ", and there are no fixes"
    refusal = (
        f"start 'coarse' of a navigation estimator: {where}{rest}. Under way fusion finds the attitude by fixes with a "
        "velocity, or by a Doppler log, if neither magnetometer nor heading is among its aids; others need a magnetometer "
        "or two antennas beside fixes with a velocity, and a start at which it accelerates little, or roll_deg, pitch_deg and "
        f"heading_deg in [initial]{_hint(stated)}"
    )
    if gnss is None and all(each.id != "dvl" for each in log.instruments):
        raise InputError(refusal)
    place, velocity, velocity_sigma = _place(log, False, first), np.zeros(3), np.full(3, ANY_SPEED)
    source = f"the position of [initial], latitude {latitude_text(place.knowledge.latitude)}"
    position_sigma = np.full(3, ROUNDED_PLACE)
    if gnss is not None:
        at = _fix_at(gnss, begin)
        gap = abs(float(gnss.time[at]) - begin)
        if gnss.velocity_n is not None:
            velocity = gnss.velocity_n[at]
            velocity_sigma = gap * PUSH + (np.ones(3) if gnss.velocity_sigma is None else gnss.velocity_sigma[at])
        way = gap * float(max(np.hypot(*velocity[:2]), velocity_sigma[:2].max())) + float(np.linalg.norm(log.lever_arm_b))
        position_sigma = gnss.position_sigma[at] + way
        source = f"position{' and velocity' * (gnss.velocity_n is not None)} of the fix at {clock(gnss.time[at])} s"
    levelled = "roll" in stated and "pitch" in stated
    known = replace(
        place.knowledge,
        velocity_n=stated.get("velocity_n", velocity),
        roll=stated.get("roll", 0.0),
        pitch=stated.get("pitch", 0.0),
        **_sigmas(
            stated,
            position_sigma=position_sigma,
            velocity_sigma=velocity_sigma,
            tilt_sigma=LEVEL_SIGMA if levelled else np.pi,
        ),
    )
    shown = _shows_attitude(log) and not (levelled and "heading" in stated)
    answer = attitude_by_motion(log, first, replace(known, heading_sigma=np.pi)) if shown else None
    of_motion: tuple[Remark, ...] = ()
    if answer is not None:
        known = replace(
            known,
            tilt_sigma=answer.tilt_sigma,
            heading_sigma=known.heading_sigma if "heading" in stated else answer.heading_sigma,
            **{name: stated.get(name, getattr(answer, name)) for name in ("roll", "pitch", "heading")},
        )
        refusal, of_motion = "", (answer.remark(),)
    elif not levelled and "heading" not in stated:
        read = attitude_under_way(log, first, known.height)
        if read is not None:
            known = replace(known, roll=read.roll, pitch=read.pitch, tilt_sigma=read.tilt_sigma)
            known = replace(known, heading=read.heading.heading, heading_sigma=started_with(read.heading))
            refusal, of_motion = "", (shown_remark(read.heading),)
    level, heading = (
        "unknown" if sigma >= np.pi else f"known to {np.degrees(sigma):.3g} deg"
        for sigma in (known.tilt_sigma, known.heading_sigma)
    )
    note = _UNDER_WAY.filled(where=where, source=source, level=level, heading=heading)
    return Start(known, (*place.notes, *of_motion, note), "" if levelled and "heading" in stated else refusal)


def _from_log(log: RecordedLog, first: int) -> Start:
    """Attitude and gyro bias from the log alone, for a start at rest where sample `first` begins."""
    stated, rows = stated_of(log), _rest(log, first)
    rest, sensors = rest_of(log, rows, first), log.sensors(in_place=True)
    latitude, longitude, height, position_sigma, far = _rest_position(log, rows)
    roll, pitch = (stated.get(name, measured) for name, measured in zip(("roll", "pitch"), rest.level, strict=True))
    if "roll" not in stated and rest.force[2] > ON_ITS_BACK * np.linalg.norm(rest.force):
        raise InputError(
            f"start 'coarse': at rest the specific force points down ({rest.force[2]:+.3g} m/s2 on the down axis; upright it "
            "is -9.8): axes or accel_axes of [imu] are wrong; if the vehicle lies on its back, [initial] roll_deg = 180 says so"
        )
    sigmas = _sigmas(
        stated,
        position_sigma=position_sigma,
        velocity_sigma=np.full(3, REST_VELOCITY_SIGMA),
        tilt_sigma=LEVEL_SIGMA if stated.keys() & {"roll", "pitch"} else rest.tilt_sigma(sensors),
        heading_sigma=HEADING_SIGMA,
    )
    if far:
        sigmas["position_sigma"] = position_sigma  # the stated one is that of the stated place
    tilt_sigma, heading = sigmas["tilt_sigma"], 0.0
    of_motion: tuple[Remark, ...] = ()
    gyros_show_heading = gyrocompass_sigma(rest, latitude, sensors, tilt_sigma) < HEADING_SIGMA
    if "heading" not in stated and gyros_show_heading:
        sigmas["heading_sigma"] = np.pi
    elif sigmas["heading_sigma"] < np.pi:
        level = start_at_rest(rest, (roll, pitch), latitude, 0.0, np.pi, sensors, tilt_sigma)
        begun = _known(
            log,
            False,
            **dict(zip(PLACE, (latitude, longitude, height), strict=True)),
            roll=roll,
            pitch=pitch,
            # the place is that of the antenna
            **{**sigmas, "heading_sigma": np.pi, "position_sigma": position_sigma + float(np.linalg.norm(log.lever_arm_b))},
            gyro_bias=level.gyro_bias,
            gyro_bias_error=level.gyro_bias_error,
        )
        # rocking in place shows nothing of a heading, and a linearised filter takes it to: the bank begins where the rest ends
        leaves = max(first, int(np.searchsorted(log.imu_time[:-1], log.rest[1] - REST_WINDOW_S)) if log.rest else first)
        answer = attitude_by_motion(log, leaves, begun) if _shows_attitude(log, at_rest=True) else None
        shown = heading_at_rest(log, (roll, pitch), tilt_sigma, height)
        heading, sigmas["heading_sigma"], of_motion = heading_of(stated, sigmas["heading_sigma"], answer, shown)
    start = start_at_rest(rest, (roll, pitch), latitude, heading, sigmas["heading_sigma"], sensors, tilt_sigma)

    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(roll, pitch, start.heading))
    place = geodesy.numeric.geodetic_from_ned_offset(-(C_nb @ log.lever_arm_b), latitude, longitude, height)
    known = _known(
        log,
        False,
        **dict(zip(PLACE, map(float, place), strict=True)),
        velocity_n=stated.get("velocity_n", np.zeros(3)),
        roll=roll,
        pitch=pitch,
        heading=start.heading,
        **{**sigmas, "heading_sigma": start.heading_sigma},
        gyro_bias=start.gyro_bias,
        gyro_bias_error=start.gyro_bias_error,
        rest_share=start.rest_share,
    )
    return Start(known, (*far, *of_motion, *_heading_conflict(start, heading)))


@remark(
    "heading-contradicted",
    "the heading {stated:.4g} deg differs by {apart:.3g} deg from that of the gyros at rest, more than both allow: navigation "
    "starts with {heading:.4g} deg, 1 sigma {sigma:.2g} deg; the heading is wrong, or the vehicle does not stand still, or the "
    "unit is worse than its grade",
)
def _heading_conflict(start: RestStart, heading: float) -> dict[str, Any] | None:
    """A stated heading (rad) that the gyros at rest contradict."""
    if not start.conflict:
        return None
    stated, apart = np.degrees(heading), np.degrees(abs(start.conflict))
    sigma = np.degrees(start.heading_sigma)
    return {"stated": stated, "apart": apart, "heading": np.degrees(start.heading), "sigma": sigma}


def _rest(log: RecordedLog, first: int) -> NDArray[np.intp]:
    """Samples at rest, by the log's [initial]: those before the start, or all if fewer than 100 are before it."""
    assert log.rest is not None
    rest = _rest_rows(log, first)
    if len(rest) < LEAST_REST:
        raise InputError(
            f"[initial] static_from_s = {log.rest[0]:g} s to static_until_s = {log.rest[1]:g} s: {len(rest)} samples; "
            f"{LEAST_REST} are needed"
        )
    return rest


def _rest_rows(log: RecordedLog, first: int) -> NDArray[np.intp]:
    """The samples of `_rest`; none or few if there is no such rest."""
    rest = rest_rows(log)
    before = rest[rest < first]
    return before if len(before) >= LEAST_REST else rest


def _hint(stated: dict[str, Any]) -> str:
    """End of a message to who has stated the whole initial state."""
    return "; start 'stated' starts from the state in [initial]" if stated.keys() == KEYS.keys() else ""


def _rest_position(log: RecordedLog, rest: NDArray[np.intp]) -> tuple[float, float, float, Array, tuple[Remark, ...]]:
    """Position of the antenna at rest (rad, rad, m), its sigma (3, m), and notes: the mean of the fixes, or [initial]."""
    gnss, stated = log.gnss, stated_of(log)
    if gnss is not None:
        still = (gnss.time >= log.imu_time[rest[0]]) & (gnss.time <= log.imu_time[rest[-1]])
        if still.any():
            latitude, longitude, height = (float(v[still].mean()) for v in (gnss.latitude, gnss.longitude, gnss.height))
            sigma = gnss.position_sigma[still].mean(axis=0)
            far = _far_note(log, (latitude, longitude, height), sigma, "the fixes at rest", WITH_FIXES)
            return latitude, longitude, height, sigma, far
    if not stated.keys() >= set(PLACE):
        raise InputError("no fix while the vehicle stands: [initial] must give latitude_deg, longitude_deg and height_m")
    return stated["latitude"], stated["longitude"], stated["height"], np.ones(3), ()


@remark(
    "place-contradicted",
    "the place in [initial], latitude_deg = {latitude:g} and longitude_deg = {longitude:g}, is {size} ({sigmas:.3g} sigma) "
    "from {of_fixes}: {then}",
)
def _far_note(
    log: RecordedLog, fixed: tuple[float, float, float], sigma: Array, of_fixes: str, then: str, moved: float = 0.0
) -> dict[str, Any] | None:
    """[initial] gives a place that contradicts `of_fixes`, `fixed` (rad, rad, m) with `sigma` (3, m).

    then: what is done about it.  moved: way between the two (m), of a vehicle that travels.
    """
    initial = log.description.initial
    if initial.latitude_deg is None or initial.longitude_deg is None:
        return None
    stated_place = float(np.radians(initial.latitude_deg)), float(np.radians(initial.longitude_deg)), fixed[2]
    north, east, _ = geodesy.numeric.ned_offset(*stated_place, *fixed)
    stated = (ROUNDED_PLACE, ROUNDED_PLACE) if initial.position_sigma_m is None else initial.position_sigma_m[:2]
    both = float(np.hypot(max(stated), max(sigma[:2])))
    apart = max(float(np.hypot(north, east)) - float(np.linalg.norm(log.lever_arm_b)) - moved, 0.0)
    if apart <= PLACE_SIGMAS * both:
        return None
    size = f"{apart / 1000:.3g} km" if apart >= 1000 else f"{apart:.3g} m"
    place = {"latitude": initial.latitude_deg, "longitude": initial.longitude_deg}
    return {**place, "size": size, "sigmas": apart / both, "of_fixes": of_fixes, "then": then}

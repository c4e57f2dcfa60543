"""The sections of a description and the findings on which their keys rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.core.tables import Array
from insenv.studies.describe.agreement import ARM, log_ratio
from insenv.studies.describe.finding import Confidence, Finding, UnclearError, listed
from insenv.studies.describe.fixes import Fixes, scatter
from insenv.studies.describe.inertial import ACCEL_NAMES, GYRO_NAMES, Choice
from insenv.studies.describe.matching import OTHER_DELAYS, START_DELAYS, SURE, Agreed, agreed, check_sure, explained
from insenv.studies.describe.mounting import LIKELY, Mounting, axes_text, lying, mounting, mounting_angles
from insenv.studies.describe.tables import LogTable, stated_unit
from insenv.studies.describe.vehicle import kind_of, traits_of

WIDENED = 3.0
"""Factor on the formal sigmas of delay and lever arm: scale factors and misalignments are not among the errors that are
estimated."""
DRIFTED, LEAST_DRIFT_S = 9.0, 0.01
"""Formal sigmas and time (s) by which a clock must drift over half of the log to be corrected."""
MOUNTED_SIGMAS, MOUNTED_DEG = 5.0, 5.0
"""Standard deviations and angle (deg) from which a unit in a car is not mounted along its axes; biases of 40 mg look like
2.3 deg, and more in a heading."""
KNOWN_ARM_M = 0.3
"""Widened sigma (m) of a component of the lever arm from which the file asks for it."""
OPEN_ARM_M = 2.0
"""Standard deviation (m) that is stated of a component of the lever arm that the motion does not show better: it is left 0."""
SLOW_ERROR_M = (1.5, 1.5, 3.0)
"""Slowly changing error (m; N, E, D) of a receiver without corrections that states no sigma: its scatter does not show it."""


def with_fixes(
    imu: LogTable, choices: Sequence[Choice], table: LogTable, candidates: Sequence[Fixes]
) -> tuple[dict[str, Any], list[Finding]]:
    """The keys by section and the findings of a log with fixes.  Raises `UnclearError` where it leaves them open."""
    fixes, agreed = _agreeing(imu, choices, candidates)
    if agreed.choice.sign < 0 and fixes.velocity is None:
        raise UnclearError(
            f"{imu.file}, {table.file}: either the accelerometers show minus the force or latitude and longitude are "
            "exchanged: fixes without a velocity do not tell"
        )
    mount = mounting(agreed, imu)
    vehicle = kind_of(traits_of(agreed, mount, fixes.track), mount.steadiness)
    keys: dict[str, Any] = {} if vehicle.value is None else {"vehicle_kind": vehicle.value}
    keys["imu"] = _imu_keys(imu, agreed.choice, mount.C_bs)
    findings = [*fixes.findings, *_inertial_findings(imu, agreed, mount), vehicle]
    C_bs, angles = mount.C_bs, mounting_angles(mount)
    if vehicle.value == "car" and np.abs(angles).max() > max(MOUNTED_DEG, MOUNTED_SIGMAS * np.degrees(mount.heading_sigma)):
        C_bs = mount.exact
        keys["imu"]["mounting_angles_deg"] = [round(float(each), 1) for each in angles]
        said = "a car moves where it points and is level on the mean: the unit is turned by these angles"
        findings.append(Finding("imu.mounting_angles_deg", keys["imu"]["mounting_angles_deg"], said))
    gnss: dict[str, Any] = {"file": _file(table), **table.layout}
    if not np.isfinite(table.values[:, [table.time, fixes.latitude, fixes.longitude, fixes.height]]).all():
        gnss["skip_empty"] = True
        findings.append(Finding("gnss.skip_empty", True, "rows without a fix have empty columns"))
    gnss |= {"time": table.refs[table.time], "time_unit": table.time_unit}
    findings += _clock(agreed, fixes, keys["imu"], gnss)
    gnss |= {name: table.refs[getattr(fixes, name)] for name in ("latitude", "longitude", "height")}
    gnss["position_unit"] = fixes.unit
    white, speed = scatter(fixes.track, agreed.fit.residual[agreed.pairs.valid])
    findings += _sigma_findings(table, fixes, white, speed, gnss)
    findings.append(_lever_arm(agreed, C_bs, gnss))
    gnss["delay_sigma_s"] = round(float(np.clip(WIDENED * agreed.delay_sigma, 0.002, 0.5)), 3)
    keys["imu"], keys["gnss"] = _unless_fixed(imu, keys["imu"]), _unless_fixed(table, gnss)
    return keys, findings


def _lever_arm(agreed: Agreed, C_bs: Array, gnss: dict[str, Any]) -> Finding:
    """Adds the lever arm and its standard deviation to `gnss`: 0 where the motion does not show it."""
    arm = C_bs @ agreed.fit.errors[ARM]
    sigma = WIDENED * np.sqrt(np.diag(C_bs @ agreed.fit.covariance[ARM, ARM] @ C_bs.T))
    gnss["lever_arm_m"] = [round(float(x), 2) if s < OPEN_ARM_M else 0.0 for x, s in zip(arm, sigma, strict=True)]
    gnss["lever_arm_sigma_m"] = [round(float(np.clip(s, 0.02, OPEN_ARM_M)), 2) for s in sigma]
    estimate = ", ".join(f"{x:.2f} +- {s:.2f}" for x, s in zip(arm, sigma, strict=True))
    said = f"turns show the antenna at {estimate} m forward, right, down"
    which = [axis for axis, s in zip(("forward", "right", "down"), sigma, strict=True) if s >= KNOWN_ARM_M]
    if not which:
        return Finding("gnss.lever_arm_m", gnss["lever_arm_m"], said)
    said += f"; {listed(which)} to less than {KNOWN_ARM_M:g} m is not seen in this log: measure it"
    return Finding("gnss.lever_arm_m", gnss["lever_arm_m"], said, "open")


def _clock(agreed: Agreed, fixes: Fixes, imu: dict[str, Any], gnss: dict[str, Any]) -> list[Finding]:
    """Adds what brings samples and fixes to one clock to their keys: a drifting clock of the unit, or a delay of the fixes."""
    sigma = WIDENED * agreed.delay_sigma
    late = (
        f"the fixes are those of {1e3 * abs(agreed.delay):.0f} ms {'before' if agreed.delay > 0 else 'after'} their stamps "
        f"(sigma {1e3 * sigma:.0f} ms, by turns and accelerations)"
    )
    middle, half = fixes.track.middle
    if abs(agreed.drift) > max(DRIFTED * agreed.drift_sigma, LEAST_DRIFT_S):
        rate = agreed.drift / half
        imu["time_scale"], imu["time_offset_s"] = 1.0 + rate, round(agreed.delay - rate * middle, 4)
        said = (
            f"against the fixes the clock of the samples drifts by {1e6 * rate:.0f} ppm, {2e3 * agreed.drift:.0f} ms over the "
            f"log (sigma {2e3 * WIDENED * agreed.drift_sigma:.0f} ms); in the middle {late}"
        )
        return [Finding(f"imu.{name}", imu[name], said) for name in ("time_scale", "time_offset_s")]
    if abs(agreed.delay) > sigma:
        gnss["time_offset_s"] = round(-agreed.delay, 4)
        return [Finding("gnss.time_offset_s", gnss["time_offset_s"], late)]
    return [Finding("gnss.delay_sigma_s", None, f"{late}, not more than by chance: they are taken as on time")]


def _agreeing(imu: LogTable, choices: Sequence[Choice], candidates: Sequence[Fixes]) -> tuple[Fixes, Agreed]:
    """The one of what the fixes may be with which the samples agree.  Raises `UnclearError`."""
    for delays in (START_DELAYS, OTHER_DELAYS):
        ends = [(each, agreed(imu, choices, each.track, delays)) for each in candidates]
        ends.sort(key=lambda end: end[1].left)
        if explained(ends[0][1], ends[0][0].track):
            break
    fixes, best = ends[0]
    others = [end for end in ends[1:] if end[0].places != fixes.places]
    if others and (apart := _apart(best, others[0][1])) < SURE:
        names = " or ".join(f"columns {each.latitude}, {each.longitude} in {each.unit}" for each in (fixes, others[0][0]))
        raise UnclearError(
            f"latitude and longitude are {names}: both fit about alike (log-likelihood {apart:.3g} apart, {SURE:g} are needed)"
        )
    check_sure(best, imu, fixes.track)
    upside_down = [end for end in ends[1:] if end[0].places == fixes.places]
    if not upside_down:
        return fixes, best
    apart = _apart(best, upside_down[0][1])
    if apart < SURE:  # the direction that its name says, or down
        stated = next(each for each in candidates if each.places == fixes.places)
        return next(end for end in ends if end[0] is stated)
    return fixes.vertical_shown(f"the samples show it: the other direction fits worse by {apart:.0f} in log-likelihood"), best


def _apart(better: Agreed, worse: Agreed) -> float:
    """Logarithm of the likelihood ratio of two ways to read the fixes."""
    return log_ratio(worse.left, better.left, better.independent)


def _file(table: LogTable) -> str | list[str]:
    return list(table.files) if len(table.files) > 1 else table.file


def _unless_fixed(table: LogTable, keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys without those that the format of the file fixes."""
    return {name: value for name, value in keys.items() if name not in table.fixed or table.fixed[name] != value}


def _imu_keys(imu: LogTable, choice: Choice, C_bs: Array) -> dict[str, Any]:
    gyro, order = list(choice.triads.gyro), choice.order
    if np.linalg.det(order) < 0:  # the keys allow no left-handed gyros: the same with two columns exchanged
        gyro[0], gyro[1] = gyro[1], gyro[0]
        order = order[:, [1, 0, 2]]
    keys = {
        "file": _file(imu),
        **imu.layout,
        "time": imu.refs[imu.time],
        "time_unit": imu.time_unit,
        "gyro": [imu.refs[column] for column in gyro],
        "accel": [imu.refs[column] for column in choice.triads.accel],
        "kind": choice.kind,
        "stamp": "interval_end",
        "gyro_unit": choice.gyro_unit,
        "accel_unit": choice.accel_unit,
        "axes": axes_text(C_bs @ order),
    }
    return keys if choice.plain else {**keys, "accel_axes": axes_text(choice.sign * C_bs)}


def _inertial_findings(imu: LogTable, agreed: Agreed, mount: Mounting) -> list[Finding]:
    choice, names = agreed.choice, agreed.choice.triads
    by_name = "by their names" if names.named else "by their place"
    gravity = _gravity(imu, choice) + _contradicted(imu, names.accel, ACCEL_NAMES, choice.accel_unit)
    gyro = (
        f"columns {listed(map(imu.label, names.gyro))} are gyros {by_name}; with these units and axes turned specific forces "
        f"and velocities of the fixes agree but for {100 * agreed.left:.2g} % of the squared changes of velocity; "
    )
    if np.isfinite(agreed.unit_margin):
        gyro += f"the next choice of units or columns is worse by {agreed.unit_margin:.0f} in log-likelihood"
    else:
        gyro += "no other unit is plausible"
    gyro += _contradicted(imu, names.gyro, GYRO_NAMES, choice.gyro_unit)
    sample = f"{1e3 * imu.interval:.3g} ms"
    stamp = f"a shift of up to one sample ({sample}) is part of the delay of the fixes, which is found with it"
    gaps = np.diff(imu.seconds)
    gaps = gaps[gaps > 1.5 * imu.interval]
    rate = f"{1 / imu.interval:.5g} Hz by the median step; "
    if len(gaps):
        rate += f"{len(gaps)} steps are longer than 1.5 samples, the longest {gaps.max():.3g} s"
    else:
        rate += "no step is longer than 1.5 samples"
    return [
        Finding("imu.gyro", [imu.refs[c] for c in names.gyro], gyro),
        Finding("imu.accel", [imu.refs[c] for c in names.accel], gravity),
        Finding("imu.kind", choice.kind, gravity),
        Finding("imu.gyro_unit", choice.gyro_unit, gyro),
        Finding("imu.accel_unit", choice.accel_unit, gravity),
        Finding("imu.stamp", "interval_end", stamp, "assumed"),
        _axes(agreed, mount, by_name),
        Finding("imu.rate_hz", None, rate),
    ]


def _gravity(imu: LogTable, choice: Choice) -> str:
    """On the unit of the accelerometers."""
    columns = choice.triads.accel
    size = float(np.nanmedian(np.linalg.norm(imu.values[:, columns], axis=1)))
    over = " over a sample" if choice.kind == "increment" else ""
    return f"the median size of columns {listed(map(imu.label, columns))} is {size:.5g}, gravity in {choice.accel_unit}{over}"


def _axes(agreed: Agreed, mount: Mounting, by_name: str) -> Finding:
    """On the axes of the unit."""
    choice, value = agreed.choice, axes_text(mount.C_bs)
    down = f"in the attitudes that fit, down is {mount.down_off:.2g} deg from its axis"
    if choice.plain and agreed.margin > SURE:
        order = (
            f"x, y, z of gyros and accelerometers are the same {by_name}, and the next order fits worse by {agreed.margin:.0f} "
            "in log-likelihood"
        )
    elif choice.plain:
        order = f"x, y, z of gyros and accelerometers are the same {by_name}, and another order fits about as well"
    elif choice.same_axes:
        order = (
            f"the accelerometers show minus the specific force: the other sign fits worse by {agreed.sign_margin:.0f} in "
            "log-likelihood"
        )
    else:
        order = (
            "the axes of the gyros are not those of the accelerometers by name or place: that fits worse by more than "
            f"{SURE:g} in log-likelihood"
        )
    if mount.forward_seen:
        ahead = f"the vehicle moves {mount.forward_off:.2g} deg from the forward axis (steadiness {mount.steadiness:.2f})"
        return Finding("imu.axes", value, f"{down} and {ahead}; {order}")
    taken = "the axis next to the mean of them" if mount.steadiness > LIKELY else "the first level axis of the sensor"
    unseen = (
        "which way is forward is not seen in this log, because the vehicle moves in all directions (steadiness "
        f"{mount.steadiness:.2f}): {taken} is taken for it"
    )
    return Finding("imu.axes", value, f"{down}; {order}; {unseen}", "assumed")


def _contradicted(table: LogTable, columns: Sequence[int], units: Mapping[str, str], unit: str) -> str:
    said = stated_unit(table.names[columns[0]], dict(units))
    return f"; their names say {said}, which the numbers contradict" if said and said != unit else ""


def _sigma_findings(table: LogTable, fixes: Fixes, white: Array, speed: Array | None, gnss: dict[str, Any]) -> list[Finding]:
    """Adds the keys on velocity and standard deviations to `gnss`."""
    by_name: Confidence = "named" if table.named else "assumed"
    findings = []
    if fixes.position_sigma is not None:
        gnss["position_sigma"] = [table.refs[c] for c in fixes.position_sigma]
        stated = np.nanmedian(table.values[:, fixes.position_sigma], axis=0)
        said = f"the columns say {_numbers(stated)} m in the median; from fix to fix they scatter by {_numbers(white)} m"
        findings.append(Finding("gnss.position_sigma", gnss["position_sigma"], said, by_name))
    else:
        whole = np.hypot(_rounded(white), SLOW_ERROR_M)  # not rounded as much, which would lose a small white part
        gnss["position_sigma_m"], gnss["wander_sigma_m"] = [float(f"{each:.7g}") for each in whole], list(SLOW_ERROR_M)
        said = f"no columns state it: the scatter of the fixes from one to the next, {_numbers(white)} m, and the slow part"
        slow = (
            "errors of minutes do not show in the scatter: those of a receiver without corrections; with RTK 0, and "
            f"position_sigma_m {_numbers(white)}"
        )
        findings.append(Finding("gnss.position_sigma_m", gnss["position_sigma_m"], said))
        findings.append(Finding("gnss.wander_sigma_m", gnss["wander_sigma_m"], slow, "assumed"))
    if fixes.velocity is None:
        return findings
    gnss["velocity"] = [table.refs[c] for c in fixes.velocity]
    gnss |= {"velocity_vertical": "up"} if fixes.vertical == "up" else {}
    if fixes.velocity_sigma is not None and not fixes.track.velocity_lag:
        gnss["velocity_sigma"] = [table.refs[c] for c in fixes.velocity_sigma]
        said = "by their names" if table.named else "the columns after those of the velocity"
        return [*findings, Finding("gnss.velocity_sigma", gnss["velocity_sigma"], said, by_name)]
    assert speed is not None
    gnss["velocity_sigma_mps"] = _rounded(speed)
    said = "what the samples leave of the changes of velocity"
    said += "" if not fixes.track.velocity_lag else ", and what the lag of the velocities changes"
    return [*findings, Finding("gnss.velocity_sigma_mps", gnss["velocity_sigma_mps"], said)]


def _rounded(values: Array) -> list[float]:
    return [float(f"{each:.2g}") for each in values]


def _numbers(values: Array) -> str:
    return ", ".join(f"{each:.2g}" for each in values)


def without_fixes(imu: LogTable, choices: Sequence[Choice]) -> tuple[dict[str, Any], list[Finding]]:
    """By gravity and names alone.  Raises `UnclearError` where these say too little."""
    stated = [stated_unit(imu.names[choice.triads.gyro[0]], GYRO_NAMES) for choice in choices]
    left = [choice for choice, said in zip(choices, stated, strict=True) if said == choice.gyro_unit] or list(choices)
    if len({choice.units for choice in left}) > 1:
        raise UnclearError(
            f"{imu.file}: without fixes nothing shows whether the gyros are in "
            f"{' or '.join(dict.fromkeys(choice.gyro_unit for choice in left))}, and no name says so; "
            f"{len({choice.units for choice in choices})} choices of columns and units are plausible"
        )
    choice = left[0]
    C_bs, off = lying(imu, choice)
    axes = (
        f"gravity is {off:.2g} deg from the down axis; which way is forward is not seen in this log: the first level axis of "
        "the sensor is taken for it"
    )
    findings = [
        Finding("imu.gyro_unit", choice.gyro_unit, "no fixes: by the name, or the only plausible unit", "named"),
        Finding("imu.accel_unit", choice.accel_unit, _gravity(imu, choice)),
        Finding("imu.axes", axes_text(C_bs), axes, "assumed"),
        Finding("imu.stamp", "interval_end", "without fixes nothing shows it, and nothing depends on it", "assumed"),
        Finding("gnss", None, "no file has latitude and longitude", "open"),
    ]
    return {"imu": _unless_fixed(imu, _imu_keys(imu, choice, C_bs))}, findings


def of_flight(file: str, keys: Mapping[str, Any], findings: Sequence[Finding]) -> tuple[dict[str, Any], list[Finding]]:
    """The description of a flight log and its findings: what replay takes from the log itself is left to it.

    Raises `UnclearError` if the axes of the unit are not those by which the log is read.
    """
    said = {finding.key: finding for finding in findings}
    axes = said["imu.axes"]
    if axes.confidence == "measured" and axes.value != "FRD":
        raise UnclearError(
            f"{file}: its unit is mounted with axes {axes.value}, and a flight log is read as FRD: insenv replay {file} "
            "--out DIR --log writes it as text files, whose description has the key axes"
        )
    gnss = keys.get("gnss", {})
    made = {"flight": file, **{name: keys[name] for name in ("vehicle_kind",) if name in keys}}
    findings = [replace(each, key=_FLIGHT_KEYS.get(each.key, each.key)) for each in findings]
    if any(gnss.get("lever_arm_m", ())):
        made["lever_arm_m"] = gnss["lever_arm_m"]
    else:  # the one that the log's parameters say
        findings = [replace(each, value=None) if each.key == "lever_arm_m" else each for each in findings]
    made |= {"gnss_time_offset_s": gnss["time_offset_s"]} if "time_offset_s" in gnss else {}
    return made, findings


_FLIGHT_KEYS = {"gnss.lever_arm_m": "lever_arm_m", "gnss.time_offset_s": "gnss_time_offset_s"}
"""Keys of the description of a flight log for those of the sections."""

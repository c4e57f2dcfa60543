"""The sections of a description and the findings on which their keys rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.logs.units import Array
from insenv.studies.describe.agreement import ARM, log_ratio
from insenv.studies.describe.finding import Finding, UnclearError, listed
from insenv.studies.describe.fixes import Fixes, scatter
from insenv.studies.describe.inertial import ACCEL_NAMES, GYRO_NAMES, Choice
from insenv.studies.describe.matching import OTHER_DELAYS, START_DELAYS, SURE, Agreed, agreed, check_sure, explained
from insenv.studies.describe.mounting import Mounting, axes_text, lying, mounting, mounting_angles
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
    fixes, found = _agreeing(imu, choices, candidates)
    mount = mounting(found, imu)
    findings = [*fixes.findings, *_inertial_findings(imu, found, mount)]
    if found.choice.sign < 0 and fixes.velocity is None:
        raise UnclearError(
            f"{imu.file}, {table.file}: either the accelerometers show minus the force or latitude and longitude are "
            f"exchanged: "
            "fixes without a velocity do not tell"
        )
    vehicle = kind_of(traits_of(found, mount, fixes.track), mount.steadiness)
    findings.append(vehicle)
    keys: dict[str, Any] = {} if vehicle.value is None else {"vehicle_kind": vehicle.value}
    keys["imu"] = _imu_keys(imu, found.choice, mount.C_bs)
    angles, C_bs = mounting_angles(mount), mount.C_bs
    if vehicle.value == "car" and np.abs(angles).max() > max(MOUNTED_DEG, MOUNTED_SIGMAS * np.degrees(mount.heading_sigma)):
        keys["imu"]["mounting_angles_deg"] = [round(float(each), 1) for each in angles]
        C_bs = mount.exact
        findings.append(
            Finding(
                "imu.mounting_angles_deg",
                keys["imu"]["mounting_angles_deg"],
                "a car moves where it points and is level on the mean: the unit is turned by these angles",
            )
        )
    gnss: dict[str, Any] = {"file": list(table.files) if len(table.files) > 1 else table.file, **table.layout}
    if not np.isfinite(table.values[:, [table.time, fixes.latitude, fixes.longitude, fixes.height]]).all():
        gnss["skip_empty"] = True
        findings.append(Finding("gnss.skip_empty", True, "rows without a fix have empty columns"))
    gnss |= {"time": table.refs[table.time], "time_unit": table.time_unit}
    sigma = WIDENED * found.delay_sigma
    findings += _clock(found, fixes, sigma, keys["imu"], gnss)
    gnss |= {name: table.refs[getattr(fixes, name)] for name in ("latitude", "longitude", "height")}
    gnss["position_unit"] = fixes.unit
    white, speed = scatter(fixes.track, found.fit.residual[found.pairs.valid])
    findings += _sigma_findings(table, fixes, white, speed, gnss)
    arm, arm_sigma = C_bs @ found.fit.errors[ARM], WIDENED * np.sqrt(np.diag(C_bs @ found.fit.covariance[ARM, ARM] @ C_bs.T))
    used = arm_sigma < OPEN_ARM_M
    gnss["lever_arm_m"] = [round(float(value), 2) if each else 0.0 for value, each in zip(arm, used, strict=True)]
    gnss["lever_arm_sigma_m"] = [round(float(np.clip(value, 0.02, OPEN_ARM_M)), 2) for value in arm_sigma]
    seen = arm_sigma < KNOWN_ARM_M
    gnss["delay_sigma_s"] = round(float(np.clip(sigma, 0.002, 0.5)), 3)
    which = [axis for axis, each in zip(("forward", "right", "down"), seen, strict=True) if not each]
    estimate = ", ".join(f"{value:.2f} +- {each:.2f}" for value, each in zip(arm, arm_sigma, strict=True))
    findings.append(
        Finding("gnss.lever_arm_m", gnss["lever_arm_m"], f"turns show the antenna at {estimate} m forward, right, down"
                + (f"; {' and '.join(which)} to less than {KNOWN_ARM_M:g} m is not seen in this log: measure "
                   f"it" if which else ""),
                "open" if which else "measured")
    )  # fmt: skip
    keys["gnss"] = _unless_fixed(table, gnss)
    return keys, findings


def _clock(found: Agreed, fixes: Fixes, sigma: float, imu: dict[str, Any], gnss: dict[str, Any]) -> list[Finding]:
    """Adds what brings samples and fixes to one clock to their keys: a drifting clock of the unit, or a delay of the fixes."""
    middle, half = fixes.track.middle
    if abs(found.drift) > max(DRIFTED * found.drift_sigma, LEAST_DRIFT_S):
        rate = found.drift / half
        imu["time_scale"], imu["time_offset_s"] = 1.0 + rate, round(found.delay - rate * middle, 4)
        said = (
            f"against the fixes the clock of the samples drifts by {1e6 * rate:.0f} ppm, {1e3 * 2 * found.drift:.0f} ms "
            f"over the log (sigma "
            f"{1e3 * 2 * WIDENED * found.drift_sigma:.0f} ms, by turns and accelerations)"
        )
        return [Finding("imu.time_scale", imu["time_scale"], said), Finding("imu.time_offset_s", imu["time_offset_s"], said)]
    when = "before" if found.delay > 0 else "after"
    late = (
        f"the fixes are those of {1e3 * abs(found.delay):.0f} ms {when} their stamps (sigma {1e3 * sigma:.0f} ms, by "
        f"turns and accelerations)"
    )
    if abs(found.delay) > WIDENED * found.delay_sigma:
        gnss["time_offset_s"] = round(-found.delay, 4)
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


def _unless_fixed(table: LogTable, keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys without those that the format of the file fixes."""
    return {name: value for name, value in keys.items() if name not in table.fixed or table.fixed[name] != value}


def _imu_keys(imu: LogTable, choice: Choice, C_bs: Array) -> dict[str, Any]:
    gyro, order = list(choice.triads.gyro), choice.order
    if np.linalg.det(order) < 0:  # the keys allow no left-handed gyros: the same with two columns exchanged
        gyro[0], gyro[1] = gyro[1], gyro[0]
        order = order[:, [1, 0, 2]]
    keys = {
        "file": list(imu.files) if len(imu.files) > 1 else imu.file,
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
    return _unless_fixed(imu, keys if choice.plain else {**keys, "accel_axes": axes_text(choice.sign * C_bs)})


def _inertial_findings(imu: LogTable, found: Agreed, mount: Mounting) -> list[Finding]:
    choice = found.choice
    by_name = "by their names" if choice.triads.named else "by their place"
    size = float(np.nanmedian(np.linalg.norm(imu.values[:, choice.triads.accel], axis=1)))
    gravity = (
        f"the median size of columns {listed(map(imu.label, choice.triads.accel))} is {size:.5g}, gravity in "
        f"{choice.accel_unit}"
    )
    gravity += " over a sample" if choice.kind == "increment" else ""
    fit = (
        f"with these units and axes turned specific forces and velocities of the fixes agree but for "
        f"{100 * found.left:.2g} % of the squared changes of velocity"
    )
    other = (
        "no other unit is plausible"
        if not np.isfinite(found.unit_margin)
        else f"the next choice of units or columns is worse by {found.unit_margin:.0f} in log-likelihood"
    )
    gyro = f"columns {listed(map(imu.label, choice.triads.gyro))} are gyros {by_name}; {fit}; {other}"
    gyro += _contradicted(imu, choice.triads.gyro, GYRO_NAMES, choice.gyro_unit)
    gravity += _contradicted(imu, choice.triads.accel, ACCEL_NAMES, choice.accel_unit)
    axes = f"in the attitudes that fit, down is {mount.down_off:.2g} deg from its axis" + (
        f" and the vehicle moves {mount.forward_off:.2g} deg from the forward axis (steadiness {mount.steadiness:.2f})"
        if mount.forward_seen
        else ""
    )
    order = f"; x, y, z of gyros and accelerometers are the same {by_name}"
    order += (
        f", and the next order fits worse by {found.margin:.0f} in log-likelihood"
        if found.margin > SURE
        else ", and another order fits about as well"
    )
    if choice.sign < 0 and choice.same_axes:
        order = (
            f"; the accelerometers show minus the specific force: the other sign fits worse by "
            f"{found.sign_margin:.0f} in log-likelihood"
        )
    elif not choice.plain:
        order = (
            f"; the axes of the gyros are not those of the accelerometers by name or place: that fits worse by more "
            f"than {SURE:g} in log-likelihood"
        )
    findings = [
        Finding("imu.gyro", [imu.refs[c] for c in choice.triads.gyro], gyro),
        Finding("imu.accel", [imu.refs[c] for c in choice.triads.accel], gravity),
        Finding("imu.kind", choice.kind, gravity),
        Finding("imu.gyro_unit", choice.gyro_unit, gyro),
        Finding("imu.accel_unit", choice.accel_unit, gravity),
        Finding(
            "imu.stamp", "interval_end",
            f"a shift of up to one sample ({1e3 * imu.interval:.3g} ms) is not told from the delay of the fixes, which "
            f"is found with it", "assumed",
        ),
    ]  # fmt: skip
    if mount.forward_seen:
        findings.append(Finding("imu.axes", axes_text(mount.C_bs), axes + order))
    else:
        findings.append(
            Finding("imu.axes", axes_text(mount.C_bs),
                    f"{axes}{order}; which way is forward is not seen in this log, because the vehicle moves in all "
                    f"directions (steadiness {mount.steadiness:.2f}): "
                    "the first level axis of the sensor is taken for it", "assumed")
        )  # fmt: skip
    gaps = np.diff(imu.seconds)
    gaps = gaps[gaps > 1.5 * imu.interval]
    lost = (
        f"{len(gaps)} steps are longer than 1.5 samples, the longest {gaps.max():.3g} s"
        if len(gaps)
        else "no step is longer than 1.5 samples"
    )
    findings.append(Finding("imu.rate_hz", None, f"{1 / imu.interval:.5g} Hz by the median step; {lost}"))
    return findings


def _contradicted(table: LogTable, columns: Sequence[int], units: Mapping[str, str], found: str) -> str:
    said = stated_unit(table.names[columns[0]], dict(units))
    return f"; their names say {said}, which the numbers contradict" if said and said != found else ""


def _sigma_findings(table: LogTable, fixes: Fixes, white: Array, speed: Array | None, gnss: dict[str, Any]) -> list[Finding]:
    """Adds the keys on velocity and standard deviations to `gnss`."""
    shown = ", ".join(f"{each:.2g}" for each in white)
    findings = []
    if fixes.position_sigma is not None:
        gnss["position_sigma"] = [table.refs[c] for c in fixes.position_sigma]
        stated = np.nanmedian(table.values[:, fixes.position_sigma], axis=0)
        says = ", ".join(f"{each:.2g}" for each in stated)
        findings.append(Finding("gnss.position_sigma", gnss["position_sigma"], f"the columns say {says} m in the "
                                                                               f"median; from fix to fix they scatter "
                                                                               f"by {shown} m",
                                "named" if table.named else "assumed"))  # fmt: skip
    else:
        gnss["position_sigma_m"] = [float(f"{each:.2g}") for each in white]
        gnss["wander_sigma_m"] = list(SLOW_ERROR_M)
        findings += [
            Finding("gnss.position_sigma_m", gnss["position_sigma_m"], "no columns state it: the scatter of the fixes "
                                                                       "from one to the next"),
            Finding("gnss.wander_sigma_m", gnss["wander_sigma_m"], "errors that last for minutes do not show in the "
                                                                   "scatter: those of a receiver without corrections; 0 "
                                                                   "for one with RTK",
                    "assumed"),
        ]  # fmt: skip
    if fixes.velocity is not None:
        gnss["velocity"] = [table.refs[c] for c in fixes.velocity]
        if fixes.vertical == "up":
            gnss["velocity_vertical"] = "up"
        if fixes.velocity_sigma is not None and not fixes.track.velocity_lag:
            gnss["velocity_sigma"] = [table.refs[c] for c in fixes.velocity_sigma]
            findings.append(
                Finding(
                    "gnss.velocity_sigma",
                    gnss["velocity_sigma"],
                    "the columns after those of the velocity" if not table.named else "by their names",
                    "named" if table.named else "assumed",
                )
            )
        else:
            assert speed is not None
            gnss["velocity_sigma_mps"] = [float(f"{each:.2g}") for each in speed]
            findings.append(
                Finding(
                    "gnss.velocity_sigma_mps",
                    gnss["velocity_sigma_mps"],
                    "what the samples leave of the changes of velocity"
                    + ("" if fixes.velocity_sigma is None else ", and what the lag of the velocities changes"),
                )
            )
    return findings


def without_fixes(imu: LogTable, choices: Sequence[Choice]) -> tuple[dict[str, Any], list[Finding]]:
    """By gravity and names alone.  Raises `UnclearError` where these say too little."""
    units = {choice.units for choice in choices}
    stated = [stated_unit(imu.names[choice.triads.gyro[0]], GYRO_NAMES) for choice in choices]
    left = [choice for choice, said in zip(choices, stated, strict=True) if said == choice.gyro_unit] or list(choices)
    if len({choice.units for choice in left}) > 1:
        raise UnclearError(
            f"{imu.file}: without fixes nothing shows whether the gyros are in "
            f"{' or '.join(dict.fromkeys(choice.gyro_unit for choice in left))}, and no name says so; "
            f"{len(units)} choices of columns and units are plausible"
        )
    choice = left[0]
    C_bs, off = lying(imu, choice)
    findings = [
        Finding("imu.gyro_unit", choice.gyro_unit, "no fixes: by the name, or the only plausible unit", "named"),
        Finding("imu.accel_unit", choice.accel_unit, "the median size of the accelerometers' columns is gravity in this unit"),
        Finding("imu.axes", axes_text(C_bs), f"gravity is {off:.2g} deg from the down axis; which way is forward is not "
                                             f"seen in this log: the first level axis of the sensor is taken for "
                                             f"it", "assumed"),
        Finding("imu.stamp", "interval_end", "without fixes nothing shows it, and nothing depends on it", "assumed"),
        Finding("gnss", None, "no file has latitude and longitude", "open"),
    ]  # fmt: skip
    return {"imu": _imu_keys(imu, choice, C_bs)}, findings


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
    made |= {"lever_arm_m": gnss["lever_arm_m"]} if any(gnss.get("lever_arm_m", ())) else {}
    made |= {"gnss_time_offset_s": gnss["time_offset_s"]} if "time_offset_s" in gnss else {}
    moved = {"gnss.lever_arm_m": "lever_arm_m", "gnss.time_offset_s": "gnss_time_offset_s"}
    return made, [replace(each, key=moved.get(each.key, each.key)) for each in findings]

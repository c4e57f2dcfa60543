"""Which table of a log has the inertial samples and which the fixes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from insenv.logs.units import ANGLE_UNITS
from insenv.studies.describe.finding import Finding, UnclearError, listed
from insenv.studies.describe.fixes import fixes_of, positions
from insenv.studies.describe.inertial import Triads, triads_of
from insenv.studies.describe.tables import FIX_RATES, IMU_RATES, LogTable, beside, with_time

FEWER = 3.0
"""Factor by which a table has fewer rows than that of the samples, if it is not another one with samples."""


def inertial_table(tables: Sequence[LogTable]) -> tuple[LogTable, list[Triads], tuple[Finding, ...]]:
    """The table with gyros and accelerometers and its time, what its columns may be, and what is found of the time.

    Raises `UnclearError` if there is none, or if there are several.
    """
    candidates, why = [], []
    for table in tables:
        if "imu" not in table.roles:
            why.append(f"{table.file}: fixes alone, by its format")
            continue
        try:
            timed, _ = with_time(replace(table, role="imu"), IMU_RATES)
        except UnclearError as error:
            why.append(str(error))
            continue
        triads = triads_of(timed, timed.times, timed.interval)
        if triads:
            # of two tables the one with positions has the fixes, unless it has far more rows
            candidates.append((bool(positions(timed)), -len(timed.values), table, triads))
        else:
            why.append(
                f"{table.file}: no two sets of three columns are gyros and accelerometers: one whose size is that of gravity "
                "in m/s2, g, mg or m/s per sample, and another of rates or increments"
            )
    candidates = candidates or [(False, 0, table, triads) for table, triads in _joined(tables)]
    if not candidates:
        raise UnclearError("\n".join(("no file holds inertial samples:", *why)) if len(why) != 1 else why[0])
    candidates.sort(key=lambda each: each[:2])
    if len(candidates) > 1 and candidates[0][0] == candidates[1][0] and candidates[0][1] > FEWER * candidates[1][1]:
        raise UnclearError(
            f"{candidates[0][2].file} and {candidates[1][2].file} both hold inertial samples: describe one of them at a time"
        )
    _, _, table, triads = candidates[0]
    named = [column for each in triads for column in (*each.gyro, *each.accel)] if table.named else ()
    timed, of_time = with_time(replace(table, role="imu"), IMU_RATES, named)
    return timed, triads_of(timed, timed.times, timed.interval), of_time


def _joined(tables: Sequence[LogTable]) -> list[tuple[LogTable, list[Triads]]]:
    """Two files side by side, of which one has the gyros and one the accelerometers.

    Raises `UnclearError` for files without times of one name: a description cannot join them.
    """
    made = []
    usable = [table for table in tables if "imu" in table.roles and not table.flight]
    for place, one in enumerate(usable):
        for other in usable[place + 1 :]:
            try:
                timed = [with_time(replace(each, role="imu"), IMU_RATES)[0] for each in (one, other)]
            except UnclearError:
                continue
            whole = beside(*timed)
            triads = [each for each in triads_of(whole, whole.times, whole.interval) if _across(each, one.values.shape[1])]
            if not triads:
                continue
            if one.names[timed[0].time] != other.names[timed[1].time] or not one.named:
                raise UnclearError(
                    f"{one.file} and {other.file} hold gyros and accelerometers, but a description joins files by a time "
                    f"column of one name: {one.label(timed[0].time)} and {other.label(timed[1].time)}"
                )
            made.append((whole, triads))
    return made


def _across(triads: Triads, width: int) -> bool:
    return max(triads.gyro) < width <= min(triads.accel) or max(triads.accel) < width <= min(triads.gyro)


def fix_table(tables: Sequence[LogTable], imu: LogTable) -> tuple[LogTable | None, tuple[Finding, ...]]:
    """The table with fixes and its time, None if there is none; and what is found of the time, and of files that are not used.

    Raises `UnclearError` if there are several, or none on the clock of the samples.
    """
    candidates: list[tuple[bool, LogTable, tuple[Finding, ...]]] = []
    unused: dict[str, str] = {}
    for table in tables:
        unused[table.file] = f"not used: no columns are latitude and longitude in {listed(ANGLE_UNITS)}"
        if "gnss" not in table.roles:
            continue
        if table.values is imu.values:
            said: tuple[Finding, ...] = (
                Finding("gnss.time", table.refs[imu.time], "fixes and samples stand in one table"),
                Finding("gnss.time_unit", imu.time_unit, "as that of the samples"),
            )
            candidates.append((True, replace(imu, role="gnss"), said))
            continue
        try:
            candidates.append((False, *with_time(replace(table, role="gnss"), FIX_RATES, clock=imu.span)))
        except UnclearError as error:
            unused[table.file] = f"not used: {error}"
    candidates = sorted((each for each in candidates if positions(each[1])), key=lambda each: each[0])
    unused = {file: why for file, why in unused.items() if file not in (*imu.files, *(each[1].file for each in candidates))}
    if not candidates:
        return None, tuple(Finding(f"file {file}", None, why, "open") for file, why in unused.items())
    if len(candidates) > 1 and not candidates[1][0]:
        raise UnclearError(
            f"{candidates[0][1].file} and {candidates[1][1].file} both hold positions: leave out the file of the reference "
            "(docs/logs.md)"
        )
    same, table, said = candidates[0]
    if not same:
        table, joined = _with_velocity(table, tables, imu)
        unused = {file: why for file, why in unused.items() if file not in table.files}
        said = (*said, *joined)
    findings = tuple(Finding(f"file {file}", None, why, "open") for file, why in unused.items())
    (begin, end), (first, last) = table.span, imu.span
    if min(end, last) - max(begin, first) <= 0:
        raise UnclearError(
            f"{table.file} and {imu.file} do not share a clock: {begin:.6g} to {end:.6g} s, and {first:.6g} to {last:.6g} s; "
            "time_offset_s of one of them has to be known"
        )
    return table, (*said, *findings)


def _with_velocity(table: LogTable, tables: Sequence[LogTable], imu: LogTable) -> tuple[LogTable, tuple[Finding, ...]]:
    """The fixes beside the velocities of another file with the same times, if they have none of their own."""
    if not table.named or any(fixes.velocity for fixes in fixes_of(table)):
        return table, ()
    name = table.names[table.time]
    for other in tables:
        if other.file in (table.file, *imu.files) or "gnss" not in other.roles or name not in other.names:
            continue
        timed = replace(other, role="gnss", time=other.names.index(name), time_unit=table.time_unit)
        if not np.array_equal(timed.seconds, table.seconds):
            continue
        joined = beside(table, timed)
        if any(fixes.velocity for fixes in fixes_of(joined)):
            said = f"the velocities have the times of the positions, column {table.label(table.time)}"
            return joined, (Finding("gnss.file", list(joined.files), said),)
    return table, ()


def no_unit(imu: LogTable, triads: Sequence[Triads]) -> UnclearError:
    """Of gyros that change as in no unit."""
    gyro = imu.values[:, triads[0].gyro]
    return UnclearError(
        f"{imu.file}: columns {listed(map(imu.label, triads[0].gyro))} never change, or change as in no unit of a gyro (the "
        f"largest is {float(np.nanmax(np.abs(gyro))):.4g}): nothing shows their unit"
    )

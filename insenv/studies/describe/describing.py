"""`describe`: the description of a log that nobody has described, from its files alone."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.toml import validated
from insenv.logs import RecordedLog
from insenv.logs.formats import is_flight_log
from insenv.logs.instruments import description_class
from insenv.logs.noise import densities_in_motion, in_motion
from insenv.logs.text import build
from insenv.logs.units import Array
from insenv.studies.describe.finding import Finding, UnclearError, listed
from insenv.studies.describe.fixes import Fixes, fixes_of, positions
from insenv.studies.describe.inertial import Triads, choices_of, triads_of
from insenv.studies.describe.sections import with_fixes, without_fixes
from insenv.studies.describe.text_tables import FIX_RATES, IMU_RATES, LogTable, beside, read_file, with_time
from insenv.studies.describe.written import description_text

SUFFIXES = (".csv", ".txt", ".dat", ".tsv", ".asc", ".gz", ".zip")
"""Ends of the names of files that are looked at in a folder."""
FEWER = 3.0
"""Factor by which a file has fewer rows than that of the samples, if it is not another one with samples."""


@dataclass(frozen=True, eq=False)
class Described:
    """A log and what was found in it: keys of the description by section, findings, text of the TOML file."""

    title: str
    keys: Mapping[str, Any]
    findings: tuple[Finding, ...]
    text: str


def describe(
    paths: Sequence[str | Path], *, folder: str | Path = ".", title: str = "", progress: Callable[[str], None] | None = None
) -> Described:
    """The description of a log in text files.

    paths: its files, or one folder with them; folder: where the description will stand, from which it names the files; title:
    of the log, by default the name of the first file.

    Raises `UnclearError`, an `InputError`, where the log leaves open what a description must say.
    """
    tell = progress or (lambda text: None)
    files = _files([Path(path) for path in paths])
    findings: list[Finding] = []
    tables = []
    for path in files:
        tell(f"reading {path.name}")
        table, said = read_file(path, Path(os.path.relpath(path, folder)).as_posix())
        tables.append(table)
        findings += said
    imu, triads = _inertial_table(tables)
    imu, of_time = with_time(
        replace(imu, role="imu"), IMU_RATES, [c for each in triads for c in (*each.gyro, *each.accel)] if imu.named else ()
    )
    findings += of_time
    interval = imu.interval
    triads = triads_of(imu, imu.times, interval)
    choices = list(choices_of(imu, triads, interval))
    if not choices:
        raise UnclearError(_no_unit(imu, triads, interval))
    fixed = _fix_table(tables, imu)
    if fixed is None:
        keys, alone = without_fixes(imu, choices)
        findings += alone
    else:
        table, of_table, candidates = fixed
        tell("comparing samples and fixes")
        keys, of_both = with_fixes(imu, choices, table, candidates)
        findings += [*of_table, *of_both]
    name = title or Path(files[0]).name.split(".")[0]
    roles = {**dict.fromkeys(imu.files or (imu.file,), "imu"), **({fixed[0].file: "gnss"} if fixed else {})}
    findings = [
        replace(each, key=f"{roles[file]}.delimiter") if (file := each.key.removesuffix(".delimiter")) in roles else each
        for each in findings
    ]
    findings += _of_the_loaded({"title": name, **keys}, Path(folder))
    where = " ".join(Path(os.path.relpath(path, folder)).as_posix() for path in files)
    text = description_text(name, f"insenv describe {where}", keys, findings)
    return Described(name, keys, tuple(findings), text)


def _files(paths: Sequence[Path]) -> list[Path]:
    """The files that are named, or those of a folder."""
    found: list[Path] = []
    for path in paths:
        if is_flight_log(path):
            raise InputError(f"{path}: a flight log needs no description: `insenv replay {path} -e fusion`")
        if path.suffix == ".toml":
            raise InputError(f"{path}: a description already: `insenv replay {path} -e fusion`")
        inside = sorted(each for each in path.iterdir() if each.suffix.lower() in SUFFIXES) if path.is_dir() else [path]
        if not inside:
            raise InputError(f"{path}: no file in this folder ends in {listed(SUFFIXES)}")
        found += inside
    return found


def _inertial_table(tables: Sequence[LogTable]) -> tuple[LogTable, list[Triads]]:
    """The table with gyros and accelerometers.  Raises `UnclearError` if there is none, or if there are several."""
    found, why = [], []
    for table in tables:
        try:
            timed, _ = with_time(replace(table, role="imu"), IMU_RATES)
        except UnclearError as error:
            why.append(str(error))
            continue
        triads = triads_of(timed, [timed.time], timed.interval)
        if triads:
            found.append((bool(positions(timed)), -len(timed.values), table, triads))
        else:
            why.append(
                f"{table.file}: no two sets of three columns are gyros and accelerometers: one whose size is that of "
                f"gravity in m/s2, g, mg or m/s per sample, and "
                "another of rates or increments"
            )
    if not found:
        found = [(False, 0, table, triads) for table, triads in _joined(tables)]
    if not found:
        raise UnclearError("no file holds inertial samples:\n" + "\n".join(why))
    found.sort(key=lambda each: each[:2])
    if len(found) > 1 and found[0][0] == found[1][0] and found[0][1] > FEWER * found[1][1]:
        raise UnclearError(
            f"{found[0][2].file} and {found[1][2].file} both hold inertial samples: describe one of them at a time"
        )
    return found[0][2], found[0][3]


def _joined(tables: Sequence[LogTable]) -> list[tuple[LogTable, list[Triads]]]:
    """Two files side by side, of which one has the gyros and one the accelerometers.

    Raises `UnclearError` for columns of both that have one name: a description cannot tell them apart.
    """
    made = []
    for place, one in enumerate(tables):
        for other in tables[place + 1 :]:
            try:
                timed = [with_time(replace(each, role="imu"), IMU_RATES)[0] for each in (one, other)]
            except UnclearError:
                continue
            whole = beside(*timed)
            triads = [each for each in triads_of(whole, whole.times, whole.interval) if _across(each, one.values.shape[1])]
            if not triads:
                continue
            same = sorted((set(one.names) & set(other.names)) - {one.names[timed[0].time], ""})
            if same:
                raise UnclearError(
                    f"{one.file} and {other.file} both have columns {listed(map(repr, same))}: of joined files a description "
                    "names columns by their names alone; rename them in one file"
                )
            if one.names[timed[0].time] != other.names[timed[1].time] or not one.named:
                raise UnclearError(
                    f"{one.file} and {other.file} hold gyros and accelerometers, but a description joins files by a time "
                    f"column of one name: {one.label(timed[0].time)} and {other.label(timed[1].time)}"
                )
            made.append((whole, triads))
    return made


def _across(triads: Triads, width: int) -> bool:
    return max(triads.gyro) < width <= min(triads.accel) or max(triads.accel) < width <= min(triads.gyro)


def _no_unit(imu: LogTable, triads: Sequence[Triads], interval: float) -> str:
    gyro = imu.values[:, triads[0].gyro]
    return (
        f"{imu.file}: columns {listed(map(imu.label, triads[0].gyro))} never change, or change as in no unit of a gyro "
        f"(the largest is {float(np.nanmax(np.abs(gyro))):.4g}): nothing shows their unit"
    )


def _fix_table(tables: Sequence[LogTable], imu: LogTable) -> tuple[LogTable, tuple[Finding, ...], list[Fixes]] | None:
    """The table with fixes, its findings, and what its columns may be; None if no table has any."""
    found = []
    for table in tables:
        same = table.file == imu.file
        try:
            timed, said = (replace(imu, role="gnss"), ()) if same else with_time(replace(table, role="gnss"), FIX_RATES)
        except UnclearError:
            continue
        if positions(timed):
            found.append((same, timed, said))
    if not found:
        return None
    found.sort(key=lambda each: each[0])
    if len(found) > 1 and not found[1][0]:
        raise UnclearError(
            f"{found[0][1].file} and {found[1][1].file} both hold positions: leave out the file of the reference (docs/logs.md)"
        )
    _, table, said = found[0]
    if table.file == imu.file:
        said = (
            Finding("gnss.time", table.refs[table.time], "fixes and samples stand in one file"),
            Finding("gnss.time_unit", table.time_unit, "as that of the samples"),
        )
    overlap = min(np.nanmax(table.seconds), np.nanmax(imu.seconds)) - max(np.nanmin(table.seconds), np.nanmin(imu.seconds))
    if overlap <= 0:
        raise UnclearError(
            f"{table.file} and {imu.file} do not share a clock: {np.nanmin(table.seconds):.6g} to "
            f"{np.nanmax(table.seconds):.6g} s, and "
            f"{np.nanmin(imu.seconds):.6g} to {np.nanmax(imu.seconds):.6g} s; time_offset_s of one of them has to be known"
        )
    return table, said, fixes_of(table)


# What the log shows once it can be loaded.


def _of_the_loaded(keys: Mapping[str, Any], folder: Path) -> list[Finding]:
    """The noise and the class of the unit, and the time at rest.  Raises `InsenvError` if the description does not load, a
    fault of this module."""
    try:
        log = build(validated(description_class(), dict(keys), "description"), folder.resolve())
    except UnclearError:
        raise
    except InputError as error:
        raise InputError(f"the log can be described but not used as it is: {error}") from None
    assumed = log.assumed
    raised = densities_in_motion(log, in_motion(log, *_speeds(log)))
    moving = ""
    if raised["angle_random_walk"] > 0:
        arw, vrw = np.degrees(raised["angle_random_walk"]) * 60.0, raised["velocity_random_walk"] * 60.0
        moving = f"; in motion the noise is {arw:.2g} deg/sqrt(h), {vrw:.2g} m/s/sqrt(h)"
    findings = [Finding("imu.grade", None, f"{assumed.remark if assumed else 'the description states it'}{moving}", "open")]
    if log.rest is None:
        return [*findings, Finding("initial.static_until_s", None, "the log does not begin at rest")]
    begin, end = log.rest
    return [
        *findings,
        Finding(
            "initial.static_until_s",
            None,
            f"the vehicle is at rest from {begin:.10g} to {end:.10g} s, which replay sees by itself",
        ),
    ]


def _speeds(log: RecordedLog) -> tuple[Array, Array]:
    if log.gnss is None or log.gnss.velocity_n is None:
        return np.zeros(0), np.zeros(0)
    return log.gnss.time, np.hypot(*log.gnss.velocity_n[:, :2].T)

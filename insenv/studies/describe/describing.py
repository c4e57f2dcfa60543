"""`describe`: the description of a log that nobody has described, from its files alone; how it is written and printed."""

from __future__ import annotations

import os
import shlex
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.output import check_output_file, write_unless_other
from insenv.core.tables import Array
from insenv.logs import RecordedLog
from insenv.logs.formats.text_log import toml_text
from insenv.logs.loading import load_data
from insenv.logs.noise import densities_in_motion, in_motion
from insenv.logs.units import ANGLE_UNITS
from insenv.report import Document, Report, run_document
from insenv.report.document import Block, Line, Listing
from insenv.sensors.units import HOUR
from insenv.studies.describe.finding import Described, Finding, UnclearError, listed
from insenv.studies.describe.fixes import fixes_of, positions
from insenv.studies.describe.inertial import Triads, choices_of, triads_of
from insenv.studies.describe.sections import of_flight, with_fixes, without_fixes
from insenv.studies.describe.sources import files_of, tables_of
from insenv.studies.describe.tables import FIX_RATES, IMU_RATES, LogTable, beside, with_time
from insenv.vehicles.registry import traits_of


def describe(
    paths: Sequence[str | Path], *, folder: str | Path = ".", title: str = "", progress: Callable[[str], None] | None = None
) -> Described:
    """The description of a log.

    paths: its files, or one folder with them; folder: where the description will stand, from which it names the files; title:
    of the log, by default the name of the first file.

    Raises `UnclearError`, an `InputError`, where the log leaves open what a description must say.
    """
    tell = progress or (lambda text: None)
    files, tables = [], []
    skipped: list[Finding] = []
    for path, in_folder in files_of([Path(path) for path in paths]):
        tell(f"reading {path.name}")
        try:
            tables += tables_of(path, _relative(path, folder))
        except InputError as error:
            if not in_folder:
                raise
            skipped.append(Finding(f"file {path.name}", None, f"not a part of the log: {error}", "open"))
            continue
        files.append(path)
    if not tables:
        raise InputError("\n".join(finding.evidence for finding in skipped))
    keys, findings = _keys_and_findings(tables, tell)
    name = title or files[0].name.split(".")[0]
    if tables[0].flight:
        keys, findings = of_flight(tables[0].files[0], keys, findings)
    findings = [*findings, *_of_the_loaded({"title": name, **keys}, Path(folder)), *skipped]
    text = description_text(name, "insenv describe " + shlex.join(_relative(path, folder) for path in files), keys, findings)
    return Described(name, keys, tuple(findings), text)


def _relative(path: Path, folder: str | Path) -> str:
    """A path as the description names it."""
    return Path(os.path.relpath(path, folder)).as_posix()


def _keys_and_findings(tables: Sequence[LogTable], tell: Callable[[str], None]) -> tuple[dict[str, Any], list[Finding]]:
    """The keys of a description by section, and what they rest on."""
    imu, triads, of_imu = inertial_table(tables)
    choices = list(choices_of(imu, triads, imu.interval))
    if not choices:
        raise no_unit(imu, triads)
    table, of_fixes = fix_table(tables, imu)
    if table is None:
        keys, findings = without_fixes(imu, choices)
        return keys, [*of_imu, *of_fixes, *findings]
    tell("comparing samples and fixes")
    keys, findings = with_fixes(imu, choices, table, fixes_of(table))
    return keys, [*of_imu, *of_fixes, *findings]


# What the log shows once it can be loaded.


def _of_the_loaded(keys: Mapping[str, Any], folder: Path) -> list[Finding]:
    """The noise and the class of the unit, and the time at rest.  Raises `InputError` for a log that replay does not take."""
    try:
        log = load_data(dict(keys), folder.resolve(), "description")
    except UnclearError:
        raise
    except InputError as error:
        raise InputError(f"the log can be described but not used as it is: {error}") from None
    assumed = log.assumed
    flies = traits_of(log.description.vehicle_kind).flies
    raised = densities_in_motion(log, in_motion(log, *_speeds(log)), flies)
    moving = ""
    if raised["angle_random_walk"] > 0:
        arw, vrw = np.degrees(raised["angle_random_walk"]) * HOUR**0.5, raised["velocity_random_walk"] * HOUR**0.5
        moving = f"; in motion the noise is {arw:.2g} deg/sqrt(h), {vrw:.2g} m/s/sqrt(h)"
    grade = Finding("imu.grade", None, f"{assumed.remark if assumed else 'the log states it'}{moving}", "open")
    if log.rest is None:
        return [grade, Finding("initial.static_until_s", None, "the log does not begin at rest")]
    begin, end = log.rest
    at_rest = f"the vehicle is at rest from {begin:.10g} to {end:.10g} s, which replay sees by itself"
    return [grade, Finding("initial.static_until_s", None, at_rest)]


def _speeds(log: RecordedLog) -> tuple[Array, Array]:
    if log.gnss is None or log.gnss.velocity_n is None:
        return np.zeros(0), np.zeros(0)
    return log.gnss.time, np.hypot(*log.gnss.velocity_n[:, :2].T)


# The description that is written, its keys in sections, each below the sentence on which it rests; and what is printed.

WIDTH = 112
_MARKS = {"measured": "", "named": "by its name: ", "assumed": "assumed: ", "open": "not seen in this log: "}


def description_text(title: str, command: str, keys: Mapping[str, Any], findings: Sequence[Finding]) -> str:
    """The TOML text.  keys: of the description, by section; findings: by key, "imu.axes"; what is left open is asked at its
    place."""
    said = {finding.key: finding for finding in findings}
    lines = [
        f"# Written by `{command}`.  Above each key stands what it rests on; look at what is marked",
        "# `assumed` and `not seen in this log`.  Keys: docs/logs.md.",
        "",
    ]
    lines += _section("", {"title": title, **{k: v for k, v in keys.items() if not isinstance(v, Mapping)}}, said)
    for name, section in keys.items():
        if isinstance(section, Mapping):
            lines += ["", f"[{name}]", *_section(f"{name}.", section, said)]
    left = [
        finding
        for finding in findings
        if finding.value is None and (finding.key.partition(".")[0] not in keys and "." in finding.key)
    ]
    lines += [""] * bool(left)
    for finding in left:
        lines += _comment(f"{_MARKS[finding.confidence]}{finding.key}: {finding.evidence}")
    return "\n".join(lines) + "\n"


def _section(prefix: str, keys: Mapping[str, Any], said: Mapping[str, Finding]) -> list[str]:
    lines: list[str] = []
    above: set[str] = set()
    for name, value in keys.items():
        finding = said.get(prefix + name)
        if finding is not None:
            sentence = f"{_MARKS[finding.confidence]}{finding.evidence}"
            lines += [] if sentence in above else _comment(sentence)
            above.add(sentence)
        lines.append(toml_text({name: value}).strip())
    for key, finding in said.items():
        section, _, name = key.rpartition(".")
        if (f"{section}." if section else "") == prefix and name not in keys and finding.value is None:
            lines += _comment(f"{_MARKS[finding.confidence]}{name}: {finding.evidence}")
    return lines


def _comment(sentence: str) -> list[str]:
    return textwrap.wrap(sentence, WIDTH, initial_indent="# ", subsequent_indent="#   ", break_long_words=False)


# What is printed and kept of a described log.


NAME = "description"


def write(described: Described, path: Path) -> None:
    """Write the description.  Raises `InputError` for another file of that name, which a user may have edited."""
    check_output_file(path, ".toml")
    write_unless_other(path, described.text.encode())


def document(described: Described, path: Path | None = None, report: Report | None = None) -> Document:
    """What is printed and kept: the findings, and the run of the description, if there was one."""
    values = {
        "title": described.title,
        "description": dict(described.keys),
        "findings": [finding.as_json() for finding in described.findings],
        "written": None if path is None else str(path),
        "run": None if report is None else dict(run_document(report).values),
    }
    return Document(NAME, values, partial(_blocks, described, path, report), {f"{described.title}.toml": described.text})


def _blocks(described: Described, path: Path | None, report: Report | None) -> Iterator[Block]:
    rows, shown = [], set()
    for finding in described.findings:
        value = "" if finding.value is None else _text(finding.value)
        evidence = finding.evidence if finding.evidence not in shown else "the same"
        shown.add(finding.evidence)
        rows.append((f"{finding.key}\n{value}" if value else finding.key, finding.confidence, evidence))
    yield Listing(("key and value", "rests on", "evidence"), rows)
    yield Line()
    left = [finding.key for finding in described.findings if finding.confidence in ("open", "assumed")]
    if left:
        yield Line(f"not seen in this log, so look at: {', '.join(left)}", "yellow")
    if path is not None:
        yield Line(f"written: {path}")
    if report is not None:
        yield Line()
        yield from run_document(report).blocks()


def _text(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


# Which table of a log has the inertial samples and which the fixes.

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

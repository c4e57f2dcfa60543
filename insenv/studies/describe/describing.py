"""`describe`: the description of a log that nobody has described, from its files alone."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.logs import RecordedLog
from insenv.logs.loading import load_data
from insenv.logs.noise import densities_in_motion, in_motion
from insenv.sensors.units import HOUR
from insenv.studies.describe.finding import Described, Finding, UnclearError
from insenv.studies.describe.fixes import fixes_of
from insenv.studies.describe.inertial import choices_of
from insenv.studies.describe.roles import fix_table, inertial_table, no_unit
from insenv.studies.describe.sections import of_flight, with_fixes, without_fixes
from insenv.studies.describe.sources import files_of, tables_of
from insenv.studies.describe.tables import LogTable
from insenv.studies.describe.written import description_text
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
    flies = traits_of(log.description.vehicle_kind).airspeed
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

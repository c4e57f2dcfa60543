"""Starts under way on public logs: the heading that `fusion` finds first, beside the log's reference.

    python tools/starts.py [LOG ...] [--data FOLDER]

LOG: names of `insenv prove`; without one, the flights.  The alignment (`insenv.estimators.every_heading`) begins every 30 s of
the part in which the vehicle is faster than 3 m/s, and knows nothing of the attitude; a start counts where it states 7 deg or
less.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from insenv import attitude
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.estimators import Knowledge
from insenv.estimators.every_heading import MODEL, prepare
from insenv.estimators.fusion.unknown_start import HEADING_BOUND
from insenv.logs import RecordedLog
from insenv.logs.instruments import sample_columns
from insenv.scenario.inputs import input_rows
from insenv.sensors.gnss import ARM
from insenv.studies.proof import public_logs

EVERY_S, SLOWEST, LONGEST_S = 30.0, 3.0, 200.0
HEADER = "| flight | found | after, median (90 %) [s] | heading, rms (stated) [deg] | largest | level, rms (stated) |"


def found(log: RecordedLog, columns: dict[str, Array], first: int) -> tuple[float, ...] | None:
    """Time (s), errors of roll, pitch and heading and their sigmas (deg) of a start at a sample; None: none is found."""
    assert log.gnss is not None and log.reference is not None
    fix = int(np.flatnonzero(columns["gnss_valid"][first:])[0]) + first
    known = Knowledge(
        latitude=float(columns["gnss_latitude"][fix]),
        longitude=float(columns["gnss_longitude"][fix]),
        height=float(columns["gnss_height"][fix]),
        sample_interval=float(np.median(log.dt)),
        tilt_sigma=np.pi,
        sensors=log.sensors(in_place=False),
        instruments={**log.stated_errors, ARM.name: log.lever_arm_b},
        **log.motion_errors(),
    )
    part = {name: column[first:] for name, column in columns.items()}
    inputs, passed = input_rows(MODEL, part, len(part["dt"])), np.cumsum(part["dt"])
    runner, begin = make_runner(MODEL, prepare(known)), 0
    for at in map(int, np.flatnonzero(part["gnss_valid"])):
        if passed[at] > LONGEST_S:
            return None
        outputs = MODEL.outputs.unpack(runner.run(at + 1 - begin, inputs[begin : at + 1], at + 1 - begin)[-1])
        begin = at + 1
        if outputs["attitude_sigma"].max() < HEADING_BOUND:
            reference, time = log.reference, log.imu_time[first + at]
            names = ("roll", "pitch", "heading")
            truth = np.array([np.interp(time, reference.time, np.unwrap(getattr(reference, name))) for name in names])
            error = np.array(attitude.numeric.to_euler(outputs["q_nb"])) - truth
            error = (error + np.pi) % (2 * np.pi) - np.pi
            return passed[at], *np.degrees(error), *np.degrees(outputs["attitude_sigma"])
    return None


def row(name: str, folder: Path) -> str:
    """The line of a log."""
    log = public_logs()[name].load(folder)
    columns, _ = sample_columns(log, slice(0, None))
    fixes = np.flatnonzero(columns["gnss_valid"])
    fast = fixes[np.linalg.norm(columns["gnss_velocity_n"][fixes, :2], axis=1) > SLOWEST]
    begins = np.arange(log.imu_time[fast[0]] + 20.0, log.imu_time[fast[-1]] - 60.0, EVERY_S)
    firsts = [int(np.searchsorted(log.imu_time, time)) for time in begins]
    firsts = [first for first in firsts if fixes[np.searchsorted(fixes, first)] in fast]
    starts = [found(log, columns, first) for first in firsts]
    results = np.array([start for start in starts if start is not None])
    time, level, heading = results[:, 0], results[:, 1:3], results[:, 3]
    rms = [np.sqrt(np.mean(each**2)) for each in (heading, results[:, 6], level, results[:, 4:6])]
    return (
        f"| {name} | {len(results)} of {len(starts)} | {np.median(time):.0f} ({np.quantile(time, 0.9):.0f}) | {rms[0]:.1f} "
        f"({rms[1]:.1f}) | {np.abs(heading).max():.1f} | {rms[2]:.1f} ({rms[3]:.1f}) |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", metavar="LOG")
    parser.add_argument("--data", type=Path, default=Path("."))
    chosen = parser.parse_args()
    print(f"{HEADER}\n{'|---' * HEADER.count(' | ')}|---|")
    for name in chosen.logs or [name for name in public_logs() if name.startswith("umn-")]:
        print(row(name, chosen.data), flush=True)

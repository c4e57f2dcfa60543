"""Seven recorded flights of small aircraft: errors of an estimator beside what it states (docs/logs.md, Vibration).

    pip install onavdata==0.2.5
    python tools/flights.py                         # fusion, grade autopilot
    python tools/flights.py -e fusion-smoother -g consumer
    python tools/flights.py --outages every=120,length=30    # drift in outages, beside what is stated

The reference is the filter of the data set on the same sensors, good to about a degree.
"""

from __future__ import annotations

import argparse
import io
import tempfile
import zipfile
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

import insenv
from insenv.base.errors import InsenvError
from insenv.logs.description import LogDescription
from insenv.logs.recorded import RecordedLog
from insenv.logs.text import build

FOLDER = "data/2014-09-09 UofMN Conservancy 7 UAV Flights/Processed and Parsed Data"
COLUMNS = {
    "imu": ("t", "ax", "ay", "az", "gx", "gy", "gz"),
    "gnss": ("t", "lat", "lon", "h", "vn", "ve", "vd"),
    "reference": ("t", "yaw", "pitch", "roll"),
}
"""Of the files of a log."""
LOG: dict[str, Any] = {
    "vehicle_kind": "aircraft",
    "imu": {
        "accel": COLUMNS["imu"][1:4], "gyro": COLUMNS["imu"][4:], "kind": "rate", "stamp": "instant", "gyro_unit": "rad/s",
        "accel_unit": "m/s2", "axes": "FRD",
    },
    "gnss": {
        "latitude": "lat", "longitude": "lon", "height": "h", "position_unit": "deg", "position_sigma_m": (2.5, 2.5, 5.0),
        "lever_arm_m": (0.0, 0.0, 0.0), "velocity": COLUMNS["gnss"][4:], "velocity_sigma_mps": (0.3, 0.3, 0.5),
    },
    "reference": {"roll": "roll", "pitch": "pitch", "heading": "yaw", "attitude_unit": "rad"},
}  # fmt: skip
"""The description of a log, without its files and the grade of its unit."""


def table(flight: Any, name: str) -> np.ndarray:
    """One file of a flight, (rows, columns)."""
    with zipfile.ZipFile(io.BytesIO((flight / f"{name}.txt.zip").read_bytes())) as archive:
        return np.genfromtxt(io.BytesIO(archive.read(archive.namelist()[0])), delimiter=",", skip_header=1)


def written(flight: Any, folder: Path, grade: str) -> RecordedLog:
    """The log with the samples, the fixes (rows repeat the last one until the next) and the reference, by way of files."""
    accel, gyro, place, velocity, angles = (
        table(flight, name) for name in ("accel_data", "gyro_data", "gps_traj_data", "gps_velocity_data", "nav_attitude_data")
    )
    fixes = np.hstack([place, velocity[:, 1:]])
    fresh = np.append(True, np.any(np.diff(fixes[:, 1:], axis=0) != 0, axis=1)) & np.isfinite(fixes).all(axis=1)
    parts = {"imu": np.hstack([accel, gyro[:, 1:]]), "gnss": fixes[fresh], "reference": angles}
    values: dict[str, Any] = {**LOG, "title": flight.name}
    for name, rows in parts.items():
        header = ",".join(COLUMNS[name])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
        values[name] = {**LOG[name], "file": f"{name}.csv", "time": "t"}
    values["imu"] |= {"grade": grade} if grade else {}
    return build(LogDescription.model_validate(values), folder)


def row(log: RecordedLog, estimator: str, name: str) -> str:
    """Errors and stated sigmas, rms, of the last two thirds of a flight, and the share of the errors beyond three sigmas."""
    result = insenv.replay(log, estimator).results[0]
    late = result.time > result.time[0] + (result.time[-1] - result.time[0]) / 3
    channels = [f"{angle}_deg" for angle in ("roll", "pitch", "heading")]
    error, sigma = (np.stack([values[each][late] for each in channels]) for values in (result.errors, result.sigma))
    size, stated = (", ".join(f"{np.sqrt(np.mean(each**2)):.2f}" for each in values) for values in (error, sigma))
    beyond = ", ".join(f"{100 * share:.0f}" for share in np.mean(np.abs(error) > 3 * sigma, axis=1))
    verdict = result.health.verdict if result.health else ""
    delay = f"{float(np.ravel(result.outputs['gnss_delay'])[-1]):.3f}" if "gnss_delay" in result.outputs else ""
    return f"| {name} | {size} | {stated} | {beyond} % | {delay} | {verdict} |"


def drift(log: RecordedLog, estimator: str, name: str, outages: str) -> str:
    """Errors in outages, rms over them but for the largest, stated sigmas, ratios, and what the velocities leave."""
    result = insenv.replay(log, estimator, outages=outages).results[0]
    lost, force = result.outages, result.specific_force
    assert lost is not None and force is not None and force.reference is not None
    found = lost.summary()
    shown = ("horizontal_m", "down_m")
    cells = [", ".join(f"{found[kind][each]:.3g}" for kind in ("end", "max", "stated")) for each in shown]
    ratios = [*(found["ratio"][each] for each in shown), float(np.sqrt(np.mean(lost.ratios**2)))]
    cells += [", ".join(f"{ratio:.2f}" for ratio in ratios), f"{lost.beyond} of {lost.ratios.size}"]
    return f"| {name} | {len(lost.each)} | {' | '.join(cells)} | {force.estimate:.2f}, {force.reference:.2f} |"


DRIFT_HEADER = (
    "| flight | outages | horizontal: end, max, stated, m | down: end, max, stated, m | ratio at the ends: horizontal, down; "
    "of all | beyond 3 sigma | m/s2, of the reference |",
    "|---|---|---|---|---|---|---|",
)


def lines(estimator: str = "fusion", grade: str = "autopilot", outages: str = "") -> Iterator[str]:
    """The table, line by line."""
    header = ("| flight | error, deg | stated | beyond 3 sigma | fixes late by, s | verdict |", "|---|---|---|---|---|---|")
    yield from DRIFT_HEADER if outages else header
    for flight in sorted((resources.files("onavdata") / FOLDER).iterdir(), key=lambda each: each.name):
        with tempfile.TemporaryDirectory() as folder:
            log = written(flight, Path(folder), grade)
            try:
                yield drift(log, estimator, flight.name, outages) if outages else row(log, estimator, flight.name)
            except InsenvError as error:
                yield f"| {flight.name} | {error} |" + " |" * (5 if outages else 4)


def of_page() -> Iterator[str]:
    """The lines of the tables in docs/logs.md."""
    yield from lines()
    yield from lines(outages="every=120,length=30")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-e", "--estimator", default="fusion")
    parser.add_argument("-g", "--grade", default="autopilot", help="of the inertial unit; '' for none")
    parser.add_argument("--outages", default="", metavar="every=S,length=S", help="drift where fixes are withheld")
    given = parser.parse_args()
    for line in lines(given.estimator, given.grade, given.outages):
        print(line, flush=True)


if __name__ == "__main__":
    main()

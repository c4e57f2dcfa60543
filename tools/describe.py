"""Descriptions of simulated logs that `insenv describe` writes, against what was simulated (docs/logs.md).

    python tools/describe.py                        # the table: seeds 7001 to 7144, half an hour
    python tools/describe.py --seeds 1-24 -v        # others, a line for each log
    python tools/describe.py --real                 # real logs (pip install onavdata==0.2.5)

Each log is a car, an aircraft, a ship or a multirotor with a unit, a receiver, axes, units, delay, lever arm, names and order
of columns, separator and clock drawn from its seed; of 144 seeds each kind of drive meets each of the 24 axis sets.  A
description is right if the samples and fixes that it loads are those that were simulated, in body axes, at their times, and its
sigmas, lever arm and kind of vehicle are right or left open in words; the table says how many leave forward open.  It was
developed on seeds below 7000.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from importlib import resources
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np

import insenv
from insenv.export import record
from insenv.logs import GnssFixes, RecordedLog, load
from insenv.logs.formats.text_log import toml_text
from insenv.scenario import load as load_scenario
from insenv.studies.describe import UnclearError, describe

FIRST_SEED, LAST_SEED = 7001, 7144
AXIS_SETS = [
    matrix
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
    if np.linalg.det(matrix := np.array([[signs[i] * (order[i] == j) for j in range(3)] for i in range(3)], float)) > 0
]
"""The 24 right-handed C_sb."""
UNITS = (  # kind, gyro unit, in SI, accelerometer unit, in SI; of increments times the interval
    ("rate", "rad/s", 1.0, "m/s2", 1.0),
    ("rate", "deg/s", np.pi / 180, "m/s2", 1.0),
    ("rate", "deg/s", np.pi / 180, "g", 9.80665),
    ("rate", "rad/s", 1.0, "mg", 9.80665e-3),
    ("increment", "rad", 1.0, "m/s", 1.0),
    ("increment", "deg", np.pi / 180, "m/s", 1.0),
)
CLOCKS = (
    ("s", 1.0, 0.0),
    ("s", 1.0, 1.7163e9),
    ("ms", 1e-3, 0.0),
    ("ms", 1e-3, 1.7163e9),
    ("us", 1e-6, 0.0),
    ("us", 1e-6, 1.7163e9),
    ("ns", 1e-9, 0.0),
)
NAMES = (
    ("time", "gyro_{}", "accel_{}", "xyz"),
    ("timestamp", "g{}", "a{}", "xyz"),
    ("t", "angular_velocity.{}", "linear_acceleration.{}", "xyz"),
    ("Time", "Gyr{}", "Acc{}", "XYZ"),
    ("sow", "w{}", "f{}", "xyz"),
    ("time [s]", "gyro {} [deg/s]", "acc {} [m/s2]", "xyz"),
)
"""Names of the time, the gyros, the accelerometers; the last one is wrong about most units."""
FIXES = (
    ("time", "lat lon height", "vn ve vd", "sn se sd"),
    ("timestamp", "latitude longitude altitude", "vel_n vel_e vel_d", "std_n std_e std_u"),
    ("t", "Lat Lng Alt", "VN VE VU", "sigma_n sigma_e sigma_d"),
    ("GPSTime", "lat_deg lon_deg h_ell", "v_east v_north v_up", "sdn sde sdu"),
)
LEGS: dict[str, tuple[str, float, list[dict[str, Any]]]] = {
    "car": ("car-city-drive", 300.0, []),
    "aircraft": (
        "aircraft-survey",
        300.0,
        [
            {"wait_s": 20.0},
            {"speed_mps": 8.0},
            {"turn_deg": 110.0, "bank_deg": 3.0},
            {"speed_mps": 48.0, "acceleration_mps2": 3.0},
            {"climb_to_m": 500.0, "climb_mps": 4.0},
            {"turn_deg": 120.0, "bank_deg": 25.0},
            {"fly_s": 20.0},
            {"turn_deg": -200.0, "bank_deg": 30.0},
            {"speed_mps": 60.0, "acceleration_mps2": 1.0},
            {"fly_s": 15.0},
            {"turn_deg": 90.0, "bank_deg": 20.0},
            {"fly_s": 60.0},
        ],
    ),
    "ship": ("ship-underway", 600.0, []),
    "multirotor": (
        "multirotor-hover",
        200.0,
        [
            {"hover_s": 10.0},
            {"fly_s": 10.0, "climb_mps": 2.0},
            {"fly_s": 12.0, "forward_mps": 8.0},
            {"turn_deg": 90.0, "duration_s": 6.0},
            {"fly_s": 10.0, "right_mps": -6.0},
            {"fly_s": 10.0, "forward_mps": 10.0},
            {"turn_deg": -150.0, "duration_s": 8.0},
            {"fly_s": 10.0, "forward_mps": -5.0},
            {"hover_s": 10.0},
        ],
    ),
}


@dataclass(frozen=True)
class Case:
    """A simulated log in files, and what was drawn."""

    seed: int
    kind: str
    log: RecordedLog
    files: dict[str, str]
    words: str
    has_velocity: bool
    lever: np.ndarray


class Draw:
    """Choices by a seed."""

    def __init__(self, seed: int) -> None:
        self.number = np.random.default_rng([seed, 20261126])

    def one(self, choices: Any) -> Any:
        """One of several."""
        return choices[int(self.number.integers(len(choices)))]

    def chance(self, share: float) -> bool:
        """Whether it happens."""
        return bool(self.number.random() < share)


def drive(seed: int, kind: str, draw: Draw) -> tuple[RecordedLog, np.ndarray, str]:
    """The log of a simulated drive, its lever arm, and what was drawn; some begin under way."""
    name, duration, legs = LEGS[kind]
    values = load_scenario(name).model_dump(mode="json", exclude_unset=True)
    for key in ("estimator", "magnetometer", "barometer", "odometer"):
        values.pop(key, None)
    values["vehicle"].pop("engine", None)  # whose sinusoid needs 200 Hz
    if legs:
        values["vehicle"]["legs"] = legs
    size = {"ship": 3.0, "multirotor": 0.2}.get(kind, 1.0)
    lever = np.round(size * draw.number.uniform([-2, -1, -2], [2, 1, 0.2]), 2)
    noise = draw.one(((0.02, 0.02), (0.4, 0.05), (1.5, 0.1))[: 2 if kind == "ship" else 3])
    interval = draw.one((1.0, 1.0, 0.5, 0.2, 0.1))
    values["gnss"] = {
        "interval_s": interval,
        "position_noise_m": [noise[0], noise[0], 2 * noise[0]],
        "velocity_noise_mps": [noise[1]] * 3,
        "wander_sigma_m": [0.0] * 3,
        "latency_s": 0.0,
        "lever_arm_m": lever.tolist(),
    }
    rate, grade = draw.one((50.0, 100.0, 100.0, 200.0)), draw.one(("tactical", "industrial", "autopilot", "consumer"))
    log = record(load_scenario({**values, "rate_hz": rate, "imu": {"grade": grade}}), seed=seed, duration_s=duration)
    begin = log.imu_time[0] + (60.0 if draw.chance(0.3) else 0.0)
    log = part(log, begin)
    words = f"{kind} from {begin:.0f} s, {grade} {rate:g} Hz, fixes {1 / interval:g} Hz {noise[0]:g} m, arm {lever}"
    return log, lever, words


def part(log: RecordedLog, begin: float) -> RecordedLog:
    """The log from a time on."""
    assert log.gnss is not None
    late, fixed, gnss = log.imu_time >= begin, log.gnss.time >= begin, log.gnss
    fixes = GnssFixes(
        gnss.time[fixed], gnss.latitude[fixed], gnss.longitude[fixed], gnss.height[fixed], gnss.position_sigma[fixed],
        None if gnss.velocity_n is None else gnss.velocity_n[fixed],
        None if gnss.velocity_sigma is None else gnss.velocity_sigma[fixed],
    )  # fmt: skip
    samples = {name: getattr(log, name)[late] for name in ("imu_time", "delta_angle", "delta_velocity", "dt", "bridged")}
    return replace(log, gnss=fixes, reference=None, **samples)


def case(seed: int) -> Case:
    """The log of a seed."""
    draw = Draw(seed)
    kind = ("car", "aircraft", "ship", "car", "aircraft", "multirotor")[seed % 6]
    log, lever, words = drive(seed, kind, draw)
    assert log.gnss is not None and log.gnss.velocity_n is not None
    C_sb = AXIS_SETS[(seed // 6 + 4 * (seed % 6)) % 24]
    units, clock, delay = draw.one(UNITS), draw.one(CLOCKS), draw.one((0.0, 0.0, 0.05, 0.12, 0.3, -0.08))
    has_velocity, has_sigma = draw.chance(0.8) or kind == "ship", draw.chance(0.6)
    header, separator = draw.chance(0.7), draw.one((",", ",", ";", "\t", " "))
    epoch = clock[2] or float(draw.number.uniform(0, 500))
    span = log.dt[:, None] if units[0] == "rate" else 1.0
    names, fix_names, angle = draw.one(NAMES), draw.one(FIXES), draw.one((1.0, 180 / np.pi, 180 / np.pi, 180 / np.pi))
    separator = "," if " " in "".join(names) and separator == " " else separator
    whole = clock[0] in ("us", "ns")
    imu: Columns = {names[0]: ("time", (log.imu_time + epoch) / clock[1])}
    for pattern, values in ((names[1], log.delta_angle / units[2]), (names[2], log.delta_velocity / units[4])):
        imu |= {pattern.format(axis): ("", each) for axis, each in zip(names[3], (values / span @ C_sb.T).T, strict=True)}
    if draw.chance(0.4):
        imu["temperature"] = ("", 30.0 + np.round(np.cumsum(draw.number.normal(0, 0.01, len(log.dt))), 2))
    if draw.chance(0.3):
        imu["count"] = ("", np.arange(len(log.dt), dtype=float))
    place, gnss = [each.split() for each in fix_names[1:]], log.gnss
    fixes: Columns = {fix_names[0]: ("time", (gnss.time + delay + epoch) / clock[1])}
    fixes |= {
        n: ("angle", v) for n, v in zip(place[0], (gnss.latitude * angle, gnss.longitude * angle, gnss.height), strict=True)
    }
    if has_velocity and gnss.velocity_n is not None:
        shown = {
            "n": gnss.velocity_n[:, 0],
            "e": gnss.velocity_n[:, 1],
            "d": gnss.velocity_n[:, 2],
            "u": -gnss.velocity_n[:, 2],
        }
        fixes |= {name: ("", shown[name.lower().removeprefix("vel_").removeprefix("v").lstrip("_")[0]]) for name in place[1]}
    if has_sigma:
        fixes |= {name: ("", each) for name, each in zip(place[2], gnss.position_sigma.T, strict=True)}
    if draw.chance(0.5):
        fixes["satellites"] = ("", draw.number.integers(7, 14, len(gnss.time)).astype(float))
    if header and draw.chance(0.7):
        imu, fixes = ({key: table[key] for key in draw.number.permutation(list(table))} for table in (imu, fixes))
    elif not header and draw.chance(0.5):
        order = list(imu)
        imu = {key: imu[key] for key in (order[0], *order[4:7], *order[1:4], *order[7:])}
    files = {name: text(table, separator, header, whole) for name, table in (("imu.csv", imu), ("gnss.csv", fixes))}
    words += (
        f" {'v ' if has_velocity else ''}{'sigma ' if has_sigma else ''}{'rad ' if angle == 1 else ''}{delay:g} s late, "
        f"{units[1]} {units[3]}, {clock[0]} {epoch:g}, {names[1] if header else 'no names'} {separator!r}"
    )
    return Case(seed, kind, log, files, words, has_velocity, lever)


Columns = dict[str, tuple[str, np.ndarray]]
"""What a column is, for its digits, and its values, by name."""


def text(table: Columns, separator: str, header: bool, whole: bool) -> str:
    """A table as text.  whole: whether stamps are whole numbers."""
    columns = []
    for kind, values in table.values():
        if kind == "time":
            columns.append(
                [str(each) for each in np.rint(values).astype(np.int64)] if whole else [f"{each:.6f}" for each in values]
            )
        else:
            columns.append([f"{each:.12f}" if kind == "angle" else f"{each:.10g}" for each in values])
    rows = [separator.join(row) for row in zip(*columns, strict=True)]
    return "\n".join([*([separator.join(table)] if header else []), *rows]) + "\n"


def judged(one: Case, folder: Path) -> tuple[str, str]:
    """ "recovered", "forward open", "refused" or "wrong", and why."""
    for name, text in one.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    try:
        made = describe([folder / name for name in one.files], folder=folder)
    except UnclearError as error:
        return "refused", str(error).splitlines()[0]
    (folder / "log.toml").write_text(made.text, encoding="utf-8")
    log, true = load(folder / "log.toml"), one.log
    assert log.gnss is not None and true.gnss is not None
    said = {finding.key: finding for finding in made.findings}
    gnss = made.keys["gnss"]
    faults = []
    shift = float(np.median(log.imu_time - true.imu_time)) if len(log.imu_time) == len(true.imu_time) else np.nan
    forward_open = said["imu.axes"].confidence == "assumed"
    if np.isnan(shift):
        return "wrong", f"{len(log.imu_time)} samples of {len(true.imu_time)}"
    for what, found, truth in (
        ("gyros", log.delta_angle, true.delta_angle),
        ("accelerometers", log.delta_velocity, true.delta_velocity),
    ):
        off = ((found - truth) / true.dt[:, None])[:, 2 if forward_open else 0 :]  # down is right, and forward is level
        if np.abs(off).max() > 1e-6 + 1e-3 * np.abs(truth / true.dt[:, None]).max():
            faults.append(f"{what} off by {np.abs(off).max():.3g}")
    if len(log.gnss.time) != len(true.gnss.time):
        faults.append(f"{len(log.gnss.time)} fixes of {len(true.gnss.time)}")
    else:
        place = max(
            np.abs(log.gnss.latitude - true.gnss.latitude).max(), np.abs(log.gnss.longitude - true.gnss.longitude).max()
        )
        if place > 1e-9 or np.abs(log.gnss.height - true.gnss.height).max() > 1e-3:
            faults.append("positions")
        late = float(np.median(log.gnss.time - shift - true.gnss.time))
        if abs(late) > 3 * gnss["delay_sigma_s"]:
            faults.append(f"fixes {late:.3f} s late, stated {gnss['delay_sigma_s']:g}")
        if one.has_velocity != (log.gnss.velocity_n is not None):
            faults.append("no velocity")
        elif log.gnss.velocity_n is not None and true.gnss.velocity_n is not None:
            level = 3 if said["gnss.velocity_vertical"].confidence != "assumed" else 2
            if np.abs(log.gnss.velocity_n - true.gnss.velocity_n)[:, :level].max() > 1e-3:
                faults.append("velocities")
        # the slow part is assumed, and said to be: the scatter is what the log shows
        assumed = np.array(gnss.get("wander_sigma_m", 0.0))
        scatter = np.sqrt(np.maximum(log.gnss.position_sigma**2 - assumed**2, 0.0))
        ratio = np.median(scatter / true.gnss.position_sigma, axis=0)
        if np.any((ratio < 0.5) | (ratio > 2.0)):
            faults.append(f"sigmas {np.round(ratio, 2)} times the true ones")
    if not forward_open:
        apart = np.abs(np.array(gnss["lever_arm_m"]) - one.lever) / np.array(gnss["lever_arm_sigma_m"])
        if np.any(apart > 3):
            faults.append(f"lever arm {gnss['lever_arm_m']}, stated {gnss['lever_arm_sigma_m']}, true {one.lever}")
    kind = made.keys.get("vehicle_kind")
    if kind not in (None, one.kind):
        faults.append(f"kind {kind}")
    left_open = [
        key
        for key, finding in said.items()
        if finding.confidence in ("open", "assumed") and key in ("vehicle_kind", "gnss.lever_arm_m", "gnss.velocity_vertical")
    ]
    if faults:
        return "wrong", "; ".join(faults)
    return "forward open" if forward_open else "recovered", f"open: {', '.join(left_open)}" if left_open else ""


def lines(seeds: Iterable[int], each: bool = False) -> Iterator[str]:
    """The table, line by line."""
    counts: dict[str, Counter[str]] = {}
    for seed in seeds:
        one = case(seed)
        with tempfile.TemporaryDirectory() as folder:
            verdict, why = judged(one, Path(folder))
        counts.setdefault(one.kind, Counter())[verdict] += 1
        if each or verdict == "wrong":
            yield f"{seed} {verdict}: {why} ({one.words})"
    verdicts = ("recovered", "forward open", "refused", "wrong")
    yield from (f"| vehicle | logs | {' | '.join(verdicts)} |", "|---|---|---|---|---|---|")
    for kind, count in (*counts.items(), ("all", sum(counts.values(), Counter()))):
        yield f"| {kind} | {count.total()} | {' | '.join(str(count[each]) for each in verdicts)} |"


# Real logs.

UMN = "data/2014-09-09 UofMN Conservancy 7 UAV Flights/Processed and Parsed Data"
N380 = "data/HGuide n380"
FILES = {
    UMN: ("accel_data.txt.zip", "gyro_data.txt.zip", "gps_traj_data.txt.zip", "gps_velocity_data.txt.zip"),
    N380: ("n380-imu-nav.csv.zip", "n380-gnss-pvt.csv.zip"),
}
"""The files of each log of the package onavdata that are given to describe, by folder."""
REFERENCES: dict[str, dict[str, Any]] = {
    UMN: {
        "file": "nav_attitude_data.txt.zip", "time": "time", "roll": "nav_roll", "pitch": "nav_pitch", "heading": "nav_yaw",
    },
    N380: {
        "file": "n380-attitude.csv.zip", "time": "SystemTov", "keep_where": {"InsGnssBIT.InsMode": 4},
        "roll": "EulerAttitude[0]", "pitch": "EulerAttitude[1]", "heading": "EulerAttitude[2]",
    },
}  # fmt: skip
"""The solution in the same folder, with which the attitude is compared; describe does not see it."""


def real_logs() -> Iterator[tuple[str, list[Path], dict[str, Any]]]:
    """Name, files and reference of each log of onavdata."""
    for folder, names in FILES.items():
        for log in sorted((resources.files("onavdata") / folder).iterdir(), key=lambda each: each.name):
            if log.is_dir():
                reference = {**REFERENCES[folder], "file": str(log / REFERENCES[folder]["file"]), "attitude_unit": "rad"}
                yield log.name, [Path(str(log / name)) for name in names], reference


def real_lines(logs: Iterable[tuple[str, list[Path], dict[str, Any]]]) -> Iterator[str]:
    """What is found in real logs, and the run of the description: its attitude less the reference's, sigma, verdict."""
    yield "| log | kind | axes, units | fixes late by, ms | lever arm, m | attitude, deg | stated | health |"
    yield "|---|---|---|---|---|---|---|---|"
    for name, files, reference in logs:
        with tempfile.TemporaryDirectory() as folder:
            try:
                made = describe(files, folder=folder)
            except UnclearError as error:
                yield f"| {name} | refused: {str(error).splitlines()[0]} |" + " |" * 6
                continue
            keys = made.keys
            path = Path(folder) / "log.toml"
            path.write_text(made.text + toml_text({"reference": reference} if reference else {}), encoding="utf-8")
            result = insenv.replay(path, "fusion").results[0]
        late = result.time > result.time[0] + (result.time[-1] - result.time[0]) / 3
        channels = [f"{angle}_deg" for angle in ("roll", "pitch", "heading")]
        of_attitude = [[values[each][late] for each in channels if each in values] for values in (result.errors, result.sigma)]
        sizes = [", ".join(f"{np.sqrt(np.mean(each**2)):.2g}" for each in values) for values in of_attitude]
        imu, gnss = keys["imu"], keys["gnss"]
        arm = ", ".join(f"{x:g} ± {s:g}" for x, s in zip(gnss["lever_arm_m"], gnss["lever_arm_sigma_m"], strict=True))
        offset = 0.0 - 1e3 * gnss.get("time_offset_s", 0.0)
        cells = (
            name, keys.get("vehicle_kind", "open"), f"{imu['axes']}, {imu['gyro_unit']}, {imu['accel_unit']}",
            f"{offset:.0f} ± {1e3 * gnss['delay_sigma_s']:.0f}", arm, *sizes, result.health.verdict if result.health else "",
        )  # fmt: skip
        yield f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", default=f"{FIRST_SEED}-{LAST_SEED}", help="first and last, or several with commas")
    parser.add_argument("-v", "--each", action="store_true", help="a line for each log")
    parser.add_argument("--real", action="store_true", help="the real logs of onavdata instead")
    given = parser.parse_args()
    if given.real:
        for line in real_lines(real_logs()):
            print(line, flush=True)
        return
    parts = [part.partition("-") for part in given.seeds.split(",")]
    seeds = [seed for first, _, last in parts for seed in range(int(first), int(last or first) + 1)]
    for line in lines(seeds, given.each):
        print(line, flush=True)


if __name__ == "__main__":
    main()

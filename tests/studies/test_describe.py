"""`insenv describe`: what it finds in logs that are known, what it refuses, what it writes."""

import dataclasses
from pathlib import Path

import describe as tool
import numpy as np
import pytest
import scipy.io
import tomllib
from command_line import call, strict
from places import ROOT

import insenv
from insenv import geodesy
from insenv.logs import load
from insenv.logs.units import axes_matrix
from insenv.studies.describe import UnclearError, describe, fixes
from insenv.studies.describe.agreement import Track, Windows, pairs_of
from insenv.studies.describe.inertial import gyro_units, kind_of_name
from insenv.studies.describe.sources import text_table
from insenv.studies.describe.tables import FIX_RATES, IMU_RATES, with_time

PLAIN = ROOT / "examples" / "logs"
FILES = ("plain-imu.csv", "plain-gnss.csv")


def rows_of(name):
    """Header and values of a file of the plain log."""
    lines = (PLAIN / name).read_text("utf-8").splitlines()
    return lines[0].split(","), np.array([[float(field) for field in line.split(",")] for line in lines[1:]])


def write(folder: Path, name: str, values: np.ndarray, header: list[str] | None = None, separator: str = ",") -> Path:
    lines = [separator.join(header)] if header else []
    lines += [separator.join(f"{value:.12g}" for value in row) for row in values]
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.slow
def test_simulated_logs_are_recovered_or_refused_and_none_is_wrong():
    """A part of the table of docs/logs.md: cars, aircraft, ships, multirotors; all interfaces of files, units, axes, clocks."""
    *wrong, last = [line for line in tool.lines(range(6001, 6013)) if not line.startswith(("| vehicle", "|---"))]
    logs, recovered, forward_open, refused, false = [int(cell) for cell in last.split("|")[2:7]]
    assert (logs, false) == (12, 0) and recovered + forward_open >= 11 and refused <= 1, (wrong, last)


def as_csv(folder):
    return [PLAIN / name for name in FILES]


def as_arrays(folder):
    for name, array in zip("ab", (rows_of(name)[1] for name in FILES), strict=True):
        np.save(folder / f"{name}.npy", array)
    return [folder]


def as_structure(folder):
    (_, imu), (_, gnss) = (rows_of(name) for name in FILES)
    unit = {"t": imu[:, 0], "gyro": imu[:, 1:4], "acc": imu[:, 4:7]}
    receiver = {"t": gnss[:, 0], "lla": gnss[:, 1:4], "vel": gnss[:, 7:10]}
    scipy.io.savemat(folder / "log.mat", {"imu": unit, "gps": receiver})
    return [folder / "log.mat"]


@pytest.mark.parametrize("written", [as_csv, pytest.param(as_arrays, marks=pytest.mark.slow), as_structure])
def test_the_plain_log_is_described_as_its_own_description_says(tmp_path, written):
    """Columns, units, axes, clock and vehicle of a log that stands beside its description, without a word of it."""
    made = describe(written(tmp_path), folder=tmp_path)
    stated = tomllib.loads((PLAIN / "plain.toml").read_text("utf-8"))
    columns = {"imu": "time gyro accel", "gnss": "time latitude longitude height position_sigma velocity velocity_sigma"}
    for section, facts in (("imu", "kind stamp gyro_unit accel_unit axes"), ("gnss", "position_unit")):
        for key in (facts + " " + columns[section] if written is as_csv else facts).split():
            assert made.keys[section][key] == stated[section][key], key
    assert len(made.keys["gnss"]["velocity"]) == 3
    apart = np.array(made.keys["gnss"]["lever_arm_m"]) - stated["gnss"]["lever_arm_m"]
    assert np.all(np.abs(apart) < 3 * np.array(made.keys["gnss"]["lever_arm_sigma_m"]))
    assert made.keys["vehicle_kind"] == "car" and tomllib.loads(made.text)["imu"] == made.keys["imu"]


@pytest.mark.parametrize("names", [("breite", "laenge", "hoehe"), ("lat_deg", "lon_deg", "hoehe")])
def test_names_in_words_that_are_not_known_say_no_less_than_none(tmp_path, names):
    samples, fixes = as_csv(tmp_path)
    header, rows = fixes.read_text("utf-8").split("\n", 1)
    for old, new in zip(("lat_deg", "lon_deg", "height_m"), names, strict=True):
        header = header.replace(old, new)
    (tmp_path / "fixes.csv").write_text(f"{header}\n{rows}", encoding="utf-8")
    made = describe([samples, tmp_path / "fixes.csv"], folder=tmp_path)
    assert tuple(made.keys["gnss"][name] for name in ("latitude", "longitude", "height")) == names
    assert made.keys["gnss"]["position_unit"] == "deg" and made.keys["imu"]["axes"] == "RFU"
    (found,) = (each for each in made.findings if each.key == "gnss.height")
    assert found.confidence == "assumed"


@pytest.mark.slow
def test_a_flight_log_gets_what_it_does_not_say(tmp_path):
    """A ROS bag of the plain log, whose axes are known: kind of vehicle and delay, in the form of flight logs."""
    log = load(PLAIN / "plain.toml")
    gnss = dataclasses.replace(log.gnss, time=log.gnss.time + 0.2)
    paths = insenv.write(None, tmp_path, ["bag"], log=dataclasses.replace(log, gnss=gnss), name="drive")
    made = describe([paths[0].parent], folder=tmp_path)
    assert made.keys["vehicle_kind"] == "car" and "imu" not in made.keys
    assert -0.4 < made.keys["gnss_time_offset_s"] < -0.1
    (tmp_path / "log.toml").write_text(made.text, encoding="utf-8")
    assert load(tmp_path / "log.toml").description.vehicle_kind == "car"


@pytest.mark.slow
def test_accelerometers_that_show_minus_the_force_and_gyros_in_another_order(tmp_path):
    """An aircraft, whose turns and climbs tell all orders and signs apart: both are found, and the samples loaded are right."""
    one = tool.case(16)
    header, *rows = [line.split(",") for line in one.files["imu.csv"].splitlines()]
    for place in (header.index(name) for name in ("accel_x", "accel_y", "accel_z")):
        for row in rows:
            row[place] = row[place].removeprefix("-") if row[place].startswith("-") else f"-{row[place]}"
    header = [{"gyro_x": "gyro_y", "gyro_y": "gyro_x"}.get(name, name) for name in header]
    one.files["imu.csv"] = "\n".join(",".join(row) for row in [header, *rows]) + "\n"
    assert tool.judged(one, tmp_path)[0] == "recovered"


def test_columns_without_names_turned_axes_and_late_fixes(tmp_path):
    """The plain log again: no headers, gyros after accelerometers, axes in another order, mg, ms, fixes 0.2 s late."""
    (_, imu), (_, gnss) = (rows_of(name) for name in FILES)
    gyro, accel = imu[:, 1:4], 1000.0 * imu[:, 4:7]
    write(tmp_path, "a.txt", np.column_stack([1000.0 * imu[:, 0], accel[:, [2, 0, 1]], gyro[:, [2, 0, 1]]]), separator=" ")
    write(tmp_path, "b.txt", np.column_stack([1000.0 * (gnss[:, 0] + 0.2), gnss[:, 1:10]]), separator=" ")
    made = describe([tmp_path], folder=tmp_path)
    keys = made.keys["imu"]
    found = [keys[name] for name in ("accel_unit", "gyro_unit", "time_unit", "accel", "gyro")]
    assert found == ["mg", "deg/s", "ms", [1, 2, 3], [4, 5, 6]]
    assert np.array_equal(axes_matrix(keys["axes"]), axes_matrix("RFU")[:, [2, 0, 1]]) and "accel_axes" not in keys
    late, whole = (made.keys["gnss"].get(key, 0.0) for key in ("time_offset_s", "position_sigma_m"))
    assert abs(late + 0.2) < 3 * made.keys["gnss"]["delay_sigma_s"] < 0.4 and np.all(np.greater(whole, (1.5, 1.5, 3.0)))
    (tmp_path / "log.toml").write_text(made.text, encoding="utf-8")
    assert np.median(load(tmp_path / "log.toml").delta_velocity[:500, 2]) == pytest.approx(-9.80665 * 0.02, rel=0.01)


def test_files_with_equal_names_are_never_silently_the_same_columns(tmp_path):
    """Gyros and accelerometers in two files, positions and velocities in two: joined, and x, y, z named with their files."""
    (_, imu), (names, gnss) = (rows_of(name) for name in FILES)
    accel = np.column_stack([imu[:, 0] + 0.003, imu[:, 4:7]])[:-1]
    rows = {"gyro": imu[:, :4], "accel": accel}
    files = [write(tmp_path, f"{name}.csv", each, ["time_s", *"xyz"]) for name, each in rows.items()]
    parts = (("place", [0, 1, 2, 3]), ("speed", [0, 7, 8, 9]))
    files += [write(tmp_path, f"{name}.csv", gnss[:, part], [names[k] for k in part]) for name, part in parts]
    made = describe(files, folder=tmp_path)
    assert made.keys["imu"]["file"] == ["gyro.csv", "accel.csv"] and made.keys["imu"]["axes"] == "RFU"
    assert (made.keys["imu"]["gyro"], made.keys["imu"]["accel"]) == tuple(
        [f"{name}.csv:{axis}" for axis in "xyz"] for name in ("gyro", "accel")
    )
    assert made.keys["gnss"]["file"] == ["place.csv", "speed.csv"] and made.keys["gnss"]["velocity"] == names[7:10]
    (tmp_path / "log.toml").write_text(made.text, encoding="utf-8")
    assert load(tmp_path / "log.toml").delta_velocity[:500, 2].mean() == pytest.approx(-9.80665 * 0.02, rel=0.01)


def test_names_that_contradict_the_numbers_do_not_decide(tmp_path):
    """Vertical velocities named up that are down are said to be, and latitude and longitude named the wrong way are refused."""
    header, gnss = rows_of(FILES[1])
    gnss[:, 3] += 20.0 * np.sin(gnss[:, 0] / 20.0)  # a hilly road, whose slope the samples of the plain log do not feel
    gnss[:, 9] -= np.cos(gnss[:, 0] / 20.0)
    write(tmp_path, "gnss.csv", gnss, ["vu" if name == "vd" else name for name in header])
    made = describe([PLAIN / FILES[0], tmp_path / "gnss.csv"], folder=tmp_path)
    said = {finding.key: finding for finding in made.findings}
    assert said["gnss.velocity_vertical"].value == "down" and "contradicts" in said["gnss.velocity_vertical"].evidence
    swapped = [{"lat_deg": "lon_deg", "lon_deg": "lat_deg"}.get(name, name) for name in header[:7]]
    write(tmp_path, "gnss.csv", gnss[:, :7], swapped)
    with pytest.raises(UnclearError, match=r"two orders fit about alike|latitude and longitude are exchanged"):
        describe([PLAIN / FILES[0], tmp_path / "gnss.csv"], folder=tmp_path)


LAYOUTS = (
    (["t;x", "1.0;2", "2.0;3"], (";", 1, ("t", "x"))),
    (["% made by me", "t\tx", "s\tm", "1\t2", "2\t3"], ("tab", 3, ("t [s]", "x [m]"))),
    (["1 2 3", "2 3 4"], ("space", None, ("", "", ""))),
    (["some words, of which some, with commas", "a,b,c,d", *["1,2,3,4"] * 9], (",", 2, ("a", "b", "c", "d"))),
)


@pytest.mark.parametrize(("lines", "layout"), LAYOUTS)
def test_separator_and_names(tmp_path, lines, layout):
    """The layout of a file, with a line of units below the names, words above, or no names."""
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    table = text_table("a.csv", (tmp_path / "a.csv").read_bytes(), "a.csv")
    assert (table.layout["delimiter"], table.layout.get("header_rows"), table.names) == layout


CLOCKS = [(step, IMU_RATES, unit) for step, unit in ((0.01, "s"), (10.0, "ms"), (5e3, "us"), (1e7, "ns"))]


@pytest.mark.parametrize(("step", "rates", "unit"), [*CLOCKS, (1e3, FIX_RATES, "ms")])
def test_the_rate_shows_the_unit_of_the_time(tmp_path, step, rates, unit):
    """Beside a counter of rows, which increases too; a name of another unit is said to be contradicted."""
    begin = 1.7e9 / {"s": 1}.get(unit, 1e-3)
    path = write(tmp_path, "a.csv", np.column_stack([np.arange(50.0), begin + step * np.arange(50)]), ["n", "time_h"])
    table, findings = with_time(text_table("a.csv", path.read_bytes(), "a.csv"), rates)
    assert (table.time, table.time_unit) == (1, unit) and {each.key for each in findings} >= {".time", ".time_unit"}


def test_what_names_and_sizes_say_of_gyros():
    """Names of many loggers, and units by what a vehicle can turn."""
    names = {"gyro": ("angular_velocity.", "gyro_ [rad/s]", "w"), "accel": ("Acc (m/s2)", "f"), "other": ("mag",)}
    assert all(kind_of_name(name) == kind for kind, each in names.items() for name in each)
    turning = np.column_stack([np.linspace(-30.0, 30.0, 500)] * 3)
    assert [unit for unit, _ in gyro_units(turning, "rate", 0.01)] == ["deg/s"]
    assert [unit for unit, _ in gyro_units(turning / 60.0, "rate", 0.01)] == ["rad/s", "deg/s"]


def test_whole_numbers_of_a_receiver_and_heights_that_are_not_in_metres(tmp_path):
    """Latitude and longitude in 1e-7 deg are read to the digit; heights in mm, which no key states, are refused."""
    header, gnss = rows_of(FILES[1])
    gnss[:, 1:3] = np.rint(gnss[:, 1:3] * 1e7)
    write(tmp_path, "gnss.csv", gnss, header)
    made = describe([PLAIN / FILES[0], tmp_path / "gnss.csv"], folder=tmp_path)
    assert made.keys["gnss"]["position_unit"] == "1e-7 deg"
    (tmp_path / "log.toml").write_text(made.text, encoding="utf-8")
    assert load(tmp_path / "log.toml").gnss.latitude == pytest.approx(np.radians(rows_of(FILES[1])[1][:, 1]), abs=1e-9)
    gnss[:, 3] *= 1000.0
    write(tmp_path, "gnss.csv", gnss, header)
    with pytest.raises(UnclearError, match="not in metres"):
        describe([PLAIN / FILES[0], tmp_path / "gnss.csv"], folder=tmp_path)


REFUSED = (
    ("slow.csv", "nothing shows whether the gyros are in rad/s or deg/s"), ("comma.csv", "decimal commas"),
    ("plain-imu.csv later.csv", "do not share a clock"), ("plain.toml", "a TOML file: allowed"),
    ("none.csv", "file not found"), ("empty.csv", "the file is empty"),
    ("nothing", "no log in this folder: looked for flight logs, .csv"), ("one.csv", "one column"),
    ("few.csv", "rows of numbers = 2: a log has 10 or more"),
    ("parked-imu.csv parked-gnss.csv", "in which the fixes move: nothing shows units and axes"),
    ("bytes.csv", "neither a text table nor of a format"), ("bytes.npy", "not a file of NumPy"),
    ("bytes.bag", "not readable as a ROS bag"), ("bytes.ulg plain-imu.csv", "a flight log beside other files"),
    ("plain-imu.csv -o imu.txt", "allowed is a name that ends in .toml"), ("plain-imu.csv -o nothing.toml", "it is a folder"),
    ("plain-imu.csv --run-out results", "allowed with -o LOG.toml"),
)  # fmt: skip


def test_what_is_wrong_or_left_open_is_refused_in_one_sentence(tmp_path, monkeypatch):
    """Logs that leave open what a description must say, no logs, outputs that cannot be written; nothing is left."""
    (header, imu), (names, gnss) = (rows_of(name) for name in FILES)
    for name in (*FILES, "plain.toml"):
        (tmp_path / name).write_bytes((PLAIN / name).read_bytes())
    write(tmp_path, "slow.csv", imu / np.array([1.0, 40.0, 40.0, 40.0, 1.0, 1.0, 1.0]), header)
    write(tmp_path, "later.csv", gnss + 1e6 * np.eye(1, 13), names)
    write(tmp_path, "parked-imu.csv", imu[:1400], header)
    write(tmp_path, "parked-gnss.csv", gnss[:28], names)
    write(tmp_path, "one.csv", imu[:, :1])
    write(tmp_path, "few.csv", imu[:2], header)
    (tmp_path / "comma.csv").write_text("t;x\n1,5;2,5\n1,6;2,6\n", encoding="utf-8")
    for name in ("nothing", "nothing.toml"):
        (tmp_path / name).mkdir()
    (tmp_path / "empty.csv").touch()
    for suffix in ("csv", "npy", "bag", "ulg"):
        (tmp_path / f"bytes.{suffix}").write_bytes(bytes(range(256)) * 9)
    monkeypatch.chdir(tmp_path)
    before = set(tmp_path.rglob("*"))
    for arguments, words in REFUSED:
        status, out, err = call("describe", *arguments.split())
        assert status == 2 and words in err and not out and "Traceback" not in err and err.count("\n") <= 2, (arguments, err)
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.slow
def test_the_command_writes_runs_and_does_not_overwrite(tmp_path):
    """One JSON document with the findings and the run; the same file again; another content stays."""
    log, pages, files = tmp_path / "drive.toml", tmp_path / "results", [PLAIN / name for name in FILES]
    status, out, err = call("describe", *files, "-o", log, "--run-out", pages, "--no-figure", "--json")
    found = strict(out)
    assert status == 0, err
    assert {"key", "value", "evidence", "confidence"} == set(found["findings"][0])
    assert found["run"]["results"][0]["estimator"] == "fusion" and list(pages.iterdir())
    log.write_text(log.read_text("utf-8") + "# mine\n", encoding="utf-8")
    status, _, err = call("describe", *files, "-o", log, "--no-run")
    assert status == 2 and "not overwritten" in err and log.read_text("utf-8").endswith("# mine\n")


@pytest.mark.parametrize(("interval", "count"), [(0.1, 10), (0.2, 5), (1.0, 1)])
def test_the_mean_of_several_positions_is_spread_in_time_as_they_are(interval, count):
    """Blur: the length of the even mean with the variance in time of that of `count` positions."""
    t = interval * np.arange(round(60.0 / interval))
    windows = Windows(np.zeros(1), 0.05, np.zeros((1, 1200, 3)), np.zeros((1, 1200, 3)))
    found = pairs_of(windows, Track(t, 0.7 + 1e-6 * t, 0.2 + 0.0 * t, 9.0 + 0.0 * t))
    assert (found.blur * windows.step) ** 2 / 12 == pytest.approx(np.var(t[:count]), abs=1e-12)
    assert found.width * windows.step == pytest.approx(0.5)  # of a velocity over one second


@pytest.mark.parametrize("lag", [0.0, 0.143, -0.087])
def test_the_lag_of_velocities_is_found_between_two_steps_of_those_that_are_tried(lag):
    t = np.arange(0.0, 60.0, 0.1)
    way = 40.0 * np.column_stack([np.sin(0.5 * t), np.sin(0.3 * t), 0 * t])
    late = 40.0 * np.column_stack([0.5 * np.cos(0.5 * (t - lag)), 0.3 * np.cos(0.3 * (t - lag)), 0 * t])
    place = geodesy.numeric.geodetic_from_ned_offset(way, 0.7, 0.2, 9.0)
    assert fixes._velocity_lag(Track(t, *place, late))[0] == pytest.approx(lag, abs=1e-3)

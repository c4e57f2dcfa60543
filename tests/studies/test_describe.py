"""`insenv describe`: what it finds in logs that are known, what it refuses, what it writes."""

from pathlib import Path

import describe as tool
import numpy as np
import pytest
import tomllib
from command_line import call, strict
from places import ROOT

from insenv.logs import load
from insenv.logs.units import axes_matrix
from insenv.studies.describe import UnclearError, describe
from insenv.studies.describe.inertial import gyro_units, kind_of_name
from insenv.studies.describe.tables import FIX_RATES, IMU_RATES, with_time
from insenv.studies.describe.text_layout import text_table

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
    *wrong, last = [line for line in tool.lines(range(5001, 5013)) if not line.startswith(("| vehicle", "|---"))]
    counts = [int(cell) for cell in last.split("|")[2:6]]
    assert counts[0] == 12 and counts[1] >= 11 and counts[3] == 0, (wrong, last)


def test_the_plain_log_is_described_as_its_own_description_says(tmp_path):
    """Columns, units, axes, clock and vehicle of a log that stands beside its description, without a word of it."""
    made = describe([PLAIN / name for name in FILES], folder=tmp_path)
    stated = tomllib.loads((PLAIN / "plain.toml").read_text("utf-8"))
    for section in ("imu", "gnss"):
        found = {
            key: value
            for key, value in made.keys[section].items()
            if key in stated[section] and key not in ("file", "lever_arm_m")
        }
        assert found == {key: stated[section][key] for key in found}
        assert {"time", "axes" if section == "imu" else "velocity_sigma"} <= set(found)
    apart = np.array(made.keys["gnss"]["lever_arm_m"]) - stated["gnss"]["lever_arm_m"]
    assert np.all(np.abs(apart) < 3 * np.array(made.keys["gnss"]["lever_arm_sigma_m"]))
    assert made.keys["vehicle_kind"] == "car" and tomllib.loads(made.text)["imu"] == made.keys["imu"]


@pytest.mark.slow
def test_accelerometers_that_show_minus_the_force_and_gyros_in_another_order(tmp_path):
    """An aircraft, whose turns and climbs tell all orders and signs apart: both are found, and the samples loaded are right."""
    one = tool.case(4)
    header, *rows = [line.split(",") for line in one.files["imu.csv"].splitlines()]
    for place in (header.index(name) for name in ("fx", "fy", "fz")):
        for row in rows:
            row[place] = row[place].removeprefix("-") if row[place].startswith("-") else f"-{row[place]}"
    header = [{"wx": "wy", "wy": "wx"}.get(name, name) for name in header]
    one.files["imu.csv"] = "\n".join(",".join(row) for row in [header, *rows]) + "\n"
    assert tool.judged(one, tmp_path)[0] == "right"


def test_columns_without_names_turned_axes_and_late_fixes(tmp_path):
    """The plain log again: no headers, gyros after accelerometers, axes in another order, mg, ms, fixes 0.2 s late."""
    _, imu = rows_of(FILES[0])
    _, gnss = rows_of(FILES[1])
    gyro, accel = imu[:, 1:4], 1000.0 * imu[:, 4:7]
    write(tmp_path, "a.txt", np.column_stack([1000.0 * imu[:, 0], accel[:, [2, 0, 1]], gyro[:, [2, 0, 1]]]), separator=" ")
    write(tmp_path, "b.txt", np.column_stack([1000.0 * (gnss[:, 0] + 0.2), gnss[:, 1:10]]), separator=" ")
    made = describe([tmp_path], folder=tmp_path)
    keys = made.keys["imu"]
    assert (keys["accel_unit"], keys["gyro_unit"], keys["time_unit"]) == ("mg", "deg/s", "ms")
    assert keys["accel"] == [1, 2, 3] and keys["gyro"] == [4, 5, 6]
    assert np.array_equal(axes_matrix(keys["axes"]), axes_matrix("RFU")[:, [2, 0, 1]]) and "accel_axes" not in keys
    late = -made.keys["gnss"].get("time_offset_s", 0.0)
    assert abs(late - 0.2) < 3 * made.keys["gnss"]["delay_sigma_s"] < 0.4
    (tmp_path / "log.toml").write_text(made.text, encoding="utf-8")
    assert np.median(load(tmp_path / "log.toml").delta_velocity[:500, 2]) == pytest.approx(-9.80665 * 0.02, rel=0.01)


def test_files_with_equal_names_are_never_silently_the_same_columns(tmp_path):
    """Gyros in one file and accelerometers in another: joined by their names, and refused where both are called x, y, z."""
    header, imu = rows_of(FILES[0])
    accel = np.column_stack([imu[:, 0] + 0.003, imu[:, 4:7]])[:-1]
    for names, others in ((header[:4], [header[0], *header[4:7]]), (["time_s", *"xyz"], ["time_s", *"xyz"])):
        files = [write(tmp_path, "gyro.csv", imu[:, :4], names), write(tmp_path, "accel.csv", accel, others)]
        if names == header[:4]:
            keys = describe([*files, PLAIN / FILES[1]], folder=tmp_path).keys["imu"]
            assert keys["file"] == ["gyro.csv", "accel.csv"] and keys["axes"] == "RFU"
            assert (keys["gyro"], keys["accel"]) == (header[1:4], header[4:7])
    with pytest.raises(UnclearError, match="both have columns 'x', 'y', 'z'"):
        describe([*files, PLAIN / FILES[1]], folder=tmp_path)


def test_names_that_contradict_the_numbers_do_not_decide(tmp_path):
    """Vertical velocities named up that are down are said to be, and latitude and longitude named the wrong way are refused."""
    header, gnss = rows_of(FILES[1])
    gnss[:, 3] += 20.0 * np.sin(gnss[:, 0] / 20.0)  # a hilly road, whose slope the samples of the plain log do not feel
    gnss[:, 9] -= np.cos(gnss[:, 0] / 20.0)
    renamed = ["vu" if name == "vd" else name for name in header]
    write(tmp_path, "gnss.csv", gnss, renamed)
    made = describe([PLAIN / FILES[0], tmp_path / "gnss.csv"], folder=tmp_path)
    said = {finding.key: finding for finding in made.findings}
    assert said["gnss.velocity_vertical"].value == "down" and "contradicts" in said["gnss.velocity_vertical"].evidence
    swapped = [{"lat_deg": "lon_deg", "lon_deg": "lat_deg"}.get(name, name) for name in header[:7]]
    write(tmp_path, "gnss.csv", gnss[:, :7], swapped)
    with pytest.raises(UnclearError, match=r"two orders fit about alike|latitude and longitude are exchanged"):
        describe([PLAIN / FILES[0], tmp_path / "gnss.csv"], folder=tmp_path)


@pytest.mark.parametrize(
    ("lines", "layout"),
    [
        (["t;x", "1.0;2", "2.0;3"], (";", 1, ("t", "x"))),
        (["% made by me", "t\tx", "s\tm", "1\t2", "2\t3"], ("tab", 3, ("t [s]", "x [m]"))),
        (["1 2 3", "2 3 4"], ("space", None, ("", "", ""))),
        (["some words, of which some, with commas", "a,b,c,d", *["1,2,3,4"] * 9], (",", 2, ("a", "b", "c", "d"))),
    ],
)
def test_separator_and_names(tmp_path, lines, layout):
    """The layout of a file, with a line of units below the names, words above, or no names."""
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    table = text_table("a.csv", (tmp_path / "a.csv").read_bytes(), "a.csv")
    assert (table.layout["delimiter"], table.layout.get("header_rows"), table.names) == layout


@pytest.mark.parametrize(
    ("step", "rates", "unit"),
    [
        (0.01, IMU_RATES, "s"),
        (10.0, IMU_RATES, "ms"),
        (5000.0, IMU_RATES, "us"),
        (1e7, IMU_RATES, "ns"),
        (1000.0, FIX_RATES, "ms"),
    ],
)
def test_the_rate_shows_the_unit_of_the_time(tmp_path, step, rates, unit):
    """Beside a counter of rows, which increases too; a name of another unit is said to be contradicted."""
    write(
        tmp_path,
        "a.csv",
        np.column_stack([np.arange(50.0), 1.7e9 / {"s": 1}.get(unit, 1e-3) + step * np.arange(50)]),
        ["n", "time_h"],
    )
    table, findings = with_time(text_table("a.csv", (tmp_path / "a.csv").read_bytes(), "a.csv"), rates)
    assert (table.time, table.time_unit) == (1, unit) and {each.key for each in findings} >= {".time", ".time_unit"}


def test_what_names_and_sizes_say_of_gyros():
    """Names of many loggers, and units by what a vehicle can turn."""
    names = {
        "angular_velocity.": "gyro",
        "gyro_ [rad/s]": "gyro",
        "w": "gyro",
        "Acc (m/s2)": "accel",
        "f": "accel",
        "mag": "other",
        "Q": "",
    }
    assert {name: kind_of_name(name) for name in names} == names | {"Q": kind_of_name("Q")}
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


def test_what_the_log_leaves_open_is_refused_in_one_sentence(tmp_path):
    """No fixes and no unit; decimal commas; two clocks; a flight log; a description."""
    header, imu = rows_of(FILES[0])
    slow = imu.copy()
    slow[:, 1:4] /= 40.0
    write(tmp_path, "slow.csv", slow, header)
    for name, text in (("comma.csv", "t;x\n1,5;2,5\n1,6;2,6\n"), ("a.ulg", "x")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    _, gnss = rows_of(FILES[1])
    gnss[:, 0] += 1e6
    write(tmp_path, "later.csv", gnss, rows_of(FILES[1])[0])
    for files, words in (
        (["slow.csv"], "nothing shows whether the gyros are in rad/s or deg/s"),
        (["comma.csv"], "decimal commas"),
        (["a.ulg"], "a flight log needs no description"),
        ([PLAIN / "plain.toml"], "a description already"),
        ([PLAIN / FILES[0], "later.csv"], "do not share a clock"),
        (["later.csv"], "no file holds inertial samples"),
    ):
        status, out, err = call("describe", *(tmp_path / file for file in files))
        assert status == 2 and words in err and not out, err


def test_the_command_writes_runs_and_does_not_overwrite(tmp_path):
    """One JSON document with the findings and the run; the same file again; another content stays."""
    log, pages = tmp_path / "drive.toml", tmp_path / "results"
    files = [PLAIN / name for name in FILES]
    status, out, err = call("describe", *files, "-o", log, "--out", pages, "--no-figure", "--json")
    found = strict(out)
    assert status == 0, err
    assert {"key", "value", "evidence", "confidence"} == set(found["findings"][0])
    assert found["run"]["results"][0]["estimator"] == "fusion" and list(pages.iterdir())
    log.write_text(log.read_text("utf-8") + "# mine\n", encoding="utf-8")
    status, _, err = call("describe", *files, "-o", log, "--no-run")
    assert status == 2 and "not overwritten" in err and log.read_text("utf-8").endswith("# mine\n")

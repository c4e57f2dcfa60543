"""Results in the formats of other tools, each read by the usual reader of its format."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from command_line import call

import insenv
from insenv.errors import InputError


@pytest.fixture(scope="module")
def report() -> Any:
    return insenv.run("car-city-drive", ["loosely-coupled", "wander-sins"], seed=4, duration_s=30.0)


def test_csv_has_truth_estimate_errors_sigma_and_limit(tmp_path: Path, report: Any) -> None:
    paths = insenv.write(report, tmp_path, "csv")
    assert [path.name for path in paths] == ["car-city-drive-loosely-coupled.csv", "car-city-drive-wander-sins.csv"]
    table = pandas.read_csv(paths[0])
    result = report.results[0]
    np.testing.assert_array_equal(table["time_s"], result.time)
    for name in ("heading_deg", "north_m", "vd_mps"):
        np.testing.assert_array_equal(table[f"error_{name}"], result.errors[name])
        np.testing.assert_array_equal(table[f"sigma_{name}"], result.sigma[name])
        np.testing.assert_array_equal(table[f"limit_{name}"], result.limit_sigma[name])
    turned = table["estimate_heading_deg"] - table["truth_heading_deg"]
    np.testing.assert_allclose((turned + 180.0) % 360.0 - 180.0, table["error_heading_deg"], atol=1e-9)
    north = np.radians(table["estimate_latitude_deg"] - table["truth_latitude_deg"]) * 6.37e6
    np.testing.assert_allclose(north, table["error_north_m"], rtol=0.01, atol=1e-3)
    np.testing.assert_allclose(-(table["estimate_height_m"] - table["truth_height_m"]), table["error_down_m"], atol=1e-3)
    np.testing.assert_allclose(table["estimate_vn_mps"] - table["truth_vn_mps"], table["error_vn_mps"], atol=1e-12)


def test_gpx_is_read_by_gpxpy(tmp_path: Path, report: Any) -> None:
    import gpxpy

    (path,) = insenv.write(report, tmp_path, "gpx")
    document = gpxpy.parse(path.read_text(encoding="utf-8"))
    assert [track.name for track in document.tracks] == ["truth", "loosely-coupled", "wander-sins"]
    points = document.tracks[0].segments[0].points
    np.testing.assert_allclose([p.latitude for p in points], np.degrees(report.truth.latitude), atol=1e-12)
    np.testing.assert_allclose([p.longitude for p in points], np.degrees(report.truth.longitude), atol=1e-12)
    np.testing.assert_allclose([p.elevation for p in points], report.truth.height, atol=1e-9)
    seconds = [(p.time - points[0].time).total_seconds() for p in points]
    np.testing.assert_allclose(seconds, report.truth.time - report.truth.time[0], atol=1e-6)


def test_kml_is_valid_and_read_by_fastkml(tmp_path: Path, report: Any) -> None:
    import fastkml

    (path,) = insenv.write(report, tmp_path, "kml")
    document = fastkml.KML.parse(path, strict=True, validate=True).features[0]
    assert [mark.name for mark in document.features] == ["truth", "loosely-coupled", "wander-sins"]
    track = document.features[0].kml_geometry
    points = np.array([item.coord.coords[0] for item in track.track_items])
    np.testing.assert_allclose(points[:, 0], np.degrees(report.truth.longitude), atol=1e-9)
    np.testing.assert_allclose(points[:, 1], np.degrees(report.truth.latitude), atol=1e-9)
    np.testing.assert_allclose(points[:, 2], report.truth.height, atol=1e-4)
    heading = [item.angle.heading for item in track.track_items]
    np.testing.assert_allclose(heading, report.truth.euler_deg()[:, 2] % 360.0, atol=1e-4)
    assert {(item.angle.tilt, item.angle.roll) for item in track.track_items} == {(0.0, 0.0)}


def test_what_has_no_positions_is_refused(tmp_path: Path) -> None:
    log = insenv.record("ship-swaying", duration_s=10.0)
    from dataclasses import replace

    aligned = insenv.replay(replace(log, reference=None), "q-method", start="stated")
    for name in ("gpx", "kml"):
        with pytest.raises(InputError, match="neither truth nor estimate has positions"):
            insenv.write(aligned, tmp_path, name)
    assert not list(tmp_path.iterdir())


def test_wrong_calls_are_refused(tmp_path: Path, report: Any) -> None:
    with pytest.raises(InputError, match="formats: unknown name 'gxp'; did you mean 'gpx'"):
        insenv.write(report, tmp_path, ["gxp"])
    with pytest.raises(InputError, match="format 'log' needs a RecordedLog"):
        insenv.write(report, tmp_path, "log")
    with pytest.raises(InputError, match="allowed is a Report or a RecordedLog"):
        insenv.write("car-city-drive", tmp_path, "csv")  # type: ignore[arg-type]


def test_a_missing_package_is_named(tmp_path: Path, report: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "gpxpy", None)
    with pytest.raises(InputError, match="gpxpy, which is not installed: pip install"):
        insenv.write(report, tmp_path, "gpx")


def test_the_command_writes_beside_the_results_and_the_log_replays(tmp_path: Path) -> None:
    out = tmp_path / "out"
    flags = ("--no-figure", "--csv", "--gpx", "--kml", "--log", "--json")
    status, text, _ = call("run", "car-city-drive", "--duration", "20", "--out", out, *flags)
    files = [Path(path).name for path in json.loads(text)["files"]]
    assert status == 0
    assert {"car-city-drive.npz", "car-city-drive.gpx", "car-city-drive.kml", "car-city-drive-log.toml"} <= set(files)
    assert all((out / name).exists() for name in files)
    again, log = tmp_path / "again", out / "car-city-drive-log.toml"
    flags = ("--start", "stated", "--out", again, "--no-figure", "--log", "--json")
    status, text, _ = call("replay", log, "-e", "loosely-coupled", *flags)
    assert status == 0 and json.loads(text)["results"][0]["estimator"] == "loosely-coupled"
    first, second = out / "car-city-drive-log-imu.csv", again / "car-city-drive-log-log-imu.csv"
    assert first.read_bytes() == second.read_bytes(), "a log that is read and written again is the same"
    status, _, errors = call("run", "car-city-drive", "--gpx")
    assert status == 2 and "--gpx writes files: --out DIR names their folder" in errors

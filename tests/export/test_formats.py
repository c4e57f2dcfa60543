"""Results in the formats of other tools, by the usual readers."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest
from command_line import call

import insenv
from insenv.base.errors import InputError
from insenv.export import to_dataframes


@pytest.fixture(scope="module")
def report():
    return insenv.run("car-city-drive", ["loosely-coupled", "wander-sins"], seed=4, duration_s=10.0)


def test_csv_has_truth_estimate_errors_sigma_and_limit(tmp_path, report):
    paths = insenv.write(report, tmp_path, "csv")
    assert [path.name for path in paths] == ["car-city-drive-loosely-coupled.csv", "car-city-drive-wander-sins.csv"]
    table, result = pandas.read_csv(paths[0]), report.results[0]
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


def test_data_frames_hold_the_samples_of_a_log():
    log = insenv.record("car-city-drive", duration_s=2.0)
    frames = to_dataframes(log)
    assert set(frames) == {"imu", "gnss", "reference"}
    np.testing.assert_array_equal(frames["imu"]["delta_angle_y_rad"], log.delta_angle[:, 1])
    np.testing.assert_array_equal(frames["imu"].index, log.imu_time)


def test_gpx_is_read_by_gpxpy(tmp_path, report):
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


def test_kml_is_valid_and_read_by_fastkml(tmp_path, report):
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


@pytest.mark.parametrize(("noise", "semi_major", "orientation"), [
    ([0.01, 0.03, 0.05], 1, 90.0),  # the larger one is east
    ([0.03, 0.01, 0.05], 0, 0.0),
])  # fmt: skip
def test_nmea_is_read_by_pynmea2(tmp_path, noise, semi_major, orientation):
    import pynmea2

    scenario = {
        "title": "South and west", "duration_s": 20.0,
        "start": {"latitude_deg": -33.5, "longitude_deg": -70.001, "height_m": 520.0, "heading_deg": 200.0},
        "vehicle": {"kind": "car", "legs": [{"accelerate_to_mps": 12.0}]},
        "gnss": {"grade": "rtk", "interval_s": 0.2, "position_noise_m": noise},
    }  # fmt: skip
    log = insenv.record(scenario)
    fixes, (path,) = log.gnss, insenv.write(log, tmp_path, "nmea")
    lines = path.read_bytes().decode("ascii").split("\r\n")
    sentences = [pynmea2.parse(line, check=True) for line in lines if line]
    kinds = {kind: [s for s in sentences if s.sentence_type == kind] for kind in ("GGA", "RMC", "VTG", "GST")}
    assert {kind: len(each) for kind, each in kinds.items()} == dict.fromkeys(kinds, len(fixes.time))
    for kind in ("GGA", "RMC"):
        np.testing.assert_allclose([s.latitude for s in kinds[kind]], np.degrees(fixes.latitude), atol=1e-9)
        np.testing.assert_allclose([s.longitude for s in kinds[kind]], np.degrees(fixes.longitude), atol=1e-9)
    np.testing.assert_allclose([float(s.altitude) for s in kinds["GGA"]], fixes.height, atol=6e-4)
    assert {float(s.geo_sep) for s in kinds["GGA"]} == {0.0} and {s.gps_qual for s in kinds["GGA"]} == {1}
    seconds = [s.timestamp.minute * 60 + s.timestamp.second + s.timestamp.microsecond * 1e-6 for s in kinds["RMC"]]
    np.testing.assert_allclose(seconds, fixes.time, atol=5.1e-4)
    speed = np.hypot(*fixes.velocity_n[:, :2].T)
    np.testing.assert_allclose([s.spd_over_grnd * 1852 / 3600 for s in kinds["RMC"]], speed, atol=5e-4)
    np.testing.assert_allclose([s.spd_over_grnd_kmph / 3.6 for s in kinds["VTG"]], speed, atol=5e-4)
    assert kinds["RMC"][-1].true_course == pytest.approx(200.0, abs=1.0)
    np.testing.assert_allclose([s.std_dev_latitude for s in kinds["GST"]], fixes.position_sigma[:, 0], atol=6e-4)
    np.testing.assert_allclose([s.std_dev_longitude for s in kinds["GST"]], fixes.position_sigma[:, 1], atol=6e-4)
    np.testing.assert_allclose([s.std_dev_altitude for s in kinds["GST"]], fixes.position_sigma[:, 2], atol=6e-4)
    # NMEA 0183: the orientation is that of the semi-major axis, in degrees from true north
    for axis, column in (("major", semi_major), ("minor", 1 - semi_major)):
        shown = [getattr(s, f"std_dev_{axis}") for s in kinds["GST"]]
        np.testing.assert_allclose(shown, fixes.position_sigma[:, column], atol=6e-4, err_msg=axis)
    assert {s.orientation for s in kinds["GST"]} == {orientation}


def test_rerun_reads_its_recording(tmp_path, report):
    chunk = pytest.importorskip("rerun.chunk")
    log = insenv.record("car-city-drive", seed=4, duration_s=10.0)
    (path,) = insenv.write(report, tmp_path, "rerun", log=log)
    found = {}
    for each in chunk.RrdReader(str(path)).stream().to_chunks():
        found.setdefault(each.entity_path, []).append(each.to_record_batch())
    result = report.results[0]
    for kind, each in {"error": result.errors, "sigma": result.sigma, "limit": result.limit_sigma}.items():
        batches = found[f"/{kind}/loosely-coupled/north_m"]
        np.testing.assert_allclose([s.total_seconds() for s in column(batches, "time")], result.time, atol=2e-6)
        np.testing.assert_array_equal([s[0] for s in column(batches, "Scalars:scalars")], each["north_m"])
    rates = np.array(column(found["/imu/gyro"], "Scalars:scalars"))
    np.testing.assert_allclose(rates, log.delta_angle / log.dt[:, None])
    places = np.array(column(found["/map/truth"], "GeoPoints:positions"))[:, 0]
    np.testing.assert_allclose(places[:, 0], np.degrees(report.truth.latitude), atol=1e-12)
    way = np.array(column(found["/world/truth"], "Transform3D:translation"))[:, 0]
    assert way[-1, 1] / 6.37e6 == pytest.approx(report.truth.latitude[-1] - report.truth.latitude[0], abs=3e-8)


def column(batches, name):
    return [value for batch in batches for value in batch.column(batch.schema.names.index(name)).to_pylist()]


def test_what_cannot_be_written_is_named(tmp_path, report, monkeypatch):
    log = insenv.record("ship-swaying", duration_s=10.0)
    aligned = insenv.replay(replace(log, reference=None), "q-method", start="stated")
    for what, formats, said in (
        (aligned, "gpx", "neither truth nor estimate has positions"),
        (report, ["gxp"], "formats: unknown name 'gxp'"),
        (report, "log", "format 'log' needs a RecordedLog"),
    ):
        with pytest.raises(InputError, match=said):
            insenv.write(what, tmp_path, formats)
    monkeypatch.setitem(sys.modules, "gpxpy", None)
    with pytest.raises(InputError, match="format 'gpx' needs gpxpy, which is not installed: pip install"):
        insenv.write(report, tmp_path, "gpx")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_beside_the_results(tmp_path):
    out = tmp_path / "out"
    flags = ("--no-figure", "--gpx", "--kml", "--log", "--json")
    status, text, _ = call("run", "car-city-drive", "--duration", "5", "--out", out, *flags)
    files = {Path(path).name for path in json.loads(text)["files"]}
    assert status == 0 and {"car-city-drive.gpx", "car-city-drive.kml"} <= files <= {path.name for path in out.iterdir()}

"""Files of tracks: GPX, KML, NMEA, logs and results."""

import numpy as np
import pytest
from changed_scenario import changed
from closed_track import closed_form, scenario, truth_of
from places import ROOT

import insenv
from insenv.base.errors import InputError
from insenv.logs.formats import nmea
from insenv.report import OutputFolder, write_files

PLAIN = ROOT / "examples" / "logs"


@pytest.fixture(scope="module")
def report():
    return insenv.run(changed("car-city-drive", rate_hz=60.0), "loosely-coupled", duration_s=10.0)


def test_one_of_several_tracks_is_named(tmp_path, report):
    """What `insenv run --gpx --kml` writes: the truth and an estimate."""
    insenv.write(report, tmp_path, ["gpx", "kml"], name="two")

    def track(path, which):
        return scenario(path, rate_hz=400.0, vehicle={"track": which} if which is not None else {}).vehicle

    for path in (tmp_path / "two.gpx", tmp_path / "two.kml"):
        first, truth, other, by_number = (track(path, which) for which in (None, "truth", "loosely-coupled", 1))
        assert np.array_equal(first.shape.points, truth.shape.points)
        assert not np.array_equal(other.shape.points, truth.shape.points)
        assert np.array_equal(by_number.shape.points, other.shape.points)
        with pytest.raises(InputError, match=r"vehicle.track = 'trth': no such track in .*did you mean 'truth'"):
            track(path, "trth")


@pytest.mark.slow
def test_results_and_logs_are_tracks(tmp_path, report):
    (npz, *_) = write_files(report, OutputFolder(tmp_path / "run"), figure=False).paths
    loaded = scenario(npz)
    assert loaded.duration_s == pytest.approx(10.0, abs=0.5)
    time, shown = truth_of(loaded)
    again = np.interp(time + report.truth.time[0], report.truth.time, report.truth.latitude)
    assert 6.37e6 * np.abs(shown["latitude"].ravel() - again).max() < 0.05
    loaded, reference = scenario(PLAIN / "plain.toml"), insenv.logs.load(PLAIN / "plain.toml").reference
    time, shown = truth_of(loaded, 60.0)
    again = np.interp(time + reference.time[0], reference.time, reference.longitude)
    assert 6.37e6 * np.abs(shown["longitude"].ravel() - again).max() < 0.2


def test_the_data_of_a_log_are_part_of_its_fingerprint(tmp_path):
    """The description alone is the same for two drives."""
    for file in PLAIN.glob("plain*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    plain = tmp_path / "plain.toml"
    first, data = scenario(plain), plain.with_name("plain-reference.csv")
    lines = data.read_text(encoding="utf-8").splitlines(keepends=True)
    data.write_text("".join(lines[:-20]), encoding="utf-8")
    second = scenario(plain)
    assert first.vehicle.sha256 != second.vehicle.sha256 and second.duration_s < first.duration_s
    with pytest.raises(InputError, match="the file has changed"):
        insenv.load(first.model_dump(mode="json"))


def gga(time, latitude, longitude, height):
    """A sentence GGA with its checksum; the geoid is 48 m above the ellipsoid."""

    def angle(value, digits):
        whole = int(np.degrees(value))
        return f"{whole:0{digits}d}{(np.degrees(value) - whole) * 60.0:010.7f}"

    clock = f"{int(time) // 3600 % 24:02d}{int(time) // 60 % 60:02d}{time % 60:05.2f}"
    text = f"GPGGA,{clock},{angle(latitude, 2)},N,{angle(longitude, 3)},E,1,08,0.9,{height - 48.0:.3f},M,48.0,M,,"
    return f"${text}*{np.bitwise_xor.reduce(np.frombuffer(text.encode(), np.uint8)):02X}"


TIME = np.arange(0.0, 60.0)


def check_same(path):
    at, shown = truth_of(scenario(path, rate_hz=20.0), 58.0)
    true = closed_form(at)
    assert 6.37e6 * np.abs(shown["latitude"].ravel() - true[:, 0]).max() < 0.02
    assert np.abs(shown["height"].ravel() - true[:, 2]).max() < 0.02


def test_nmea_over_midnight(tmp_path):
    path = tmp_path / "t.nmea"
    lines = [gga(86370.0 + t, *row[:3]) for t, row in zip(TIME, closed_form(TIME), strict=True)]
    lines.insert(3, "$GPGSV,1,1,00*79")
    path.write_text("\n".join(lines), encoding="ascii")
    check_same(path)
    lines[10] = lines[10].replace("E,1", "E,2")
    path.write_text("\n".join(lines), encoding="ascii")
    with pytest.raises(InputError, match=r"line 11: .*checksum"):
        scenario(path)


def test_nmea_counts_every_midnight():
    """Five days: the sentences have the time of the day alone."""
    time = np.arange(0.0, 5 * 86400.0, 7 * 3600.0)
    lines = "\n".join(gga(at, 0.8, 0.2, 100.0) for at in time)
    (track,) = nmea.read("t.nmea", lines.encode())
    np.testing.assert_allclose(track.time - track.time[0], time)


KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark><gx:Track>{}</gx:Track>'
    "</Placemark></kml>"
)


def test_kml(tmp_path):
    path, rows = tmp_path / "t.kml", closed_form(TIME)
    whens = "".join(f"<when>2026-01-01T00:00:{int(t):02d}Z</when>" for t in TIME)
    coords = "".join(f"<gx:coord>{np.degrees(b):.9f} {np.degrees(a):.9f} {h:.3f}</gx:coord>" for a, b, h, *_ in rows)
    path.write_text(KML.format(whens + coords), encoding="utf-8")
    check_same(path)
    path.write_text(KML.format(coords), encoding="utf-8")
    with pytest.raises(InputError, match="0 times for 60 places"):
        scenario(path)

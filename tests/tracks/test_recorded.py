"""kind = "recorded": tracks through CSV, GPX, logs and results, against closed forms and simulated drives."""

import json
import re

import numpy as np
import pytest
from places import ROOT

import insenv
from insenv import geodesy
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.report import OutputFolder, write_files
from insenv.scenario import build, reseeded

LATITUDE, LONGITUDE = np.radians(45.0), np.radians(7.0)


def closed_form(time):
    """Latitude, longitude (rad), height (m), roll, pitch, heading (rad) of a smooth track that is no spline."""
    w = 2.0 * np.pi
    return np.column_stack([
        LATITUDE + 2000.0 / 6.37e6 * np.sin(w * time / 300.0),
        LONGITUDE + 3000.0 / 6.37e6 * (1.0 - np.cos(w * time / 400.0)),
        300.0 + 50.0 * np.sin(w * time / 120.0),
        np.radians(10.0) * np.sin(w * time / 20.0),
        np.radians(5.0) * np.sin(w * time / 25.0),
        np.radians(170.0) + np.radians(100.0) * np.sin(w * time / 200.0),
    ])  # fmt: skip


def write_csv(path, time, values, names="latitude,longitude,height,roll,pitch,heading"):
    table = values.copy()
    table[:, :2] = np.degrees(table[:, :2])
    table[:, 3:] = np.degrees(table[:, 3:])
    np.savetxt(path, np.column_stack([time, table]), fmt="%.15g", delimiter=",", header=f"time,{names}", comments="")


ATTITUDE = {"roll": "roll", "pitch": "pitch", "heading": "heading"}


def scenario(path, **more):
    vehicle = {"kind": "recorded", "file": str(path), **more.pop("vehicle", {})}
    return insenv.load({"title": "t", "rate_hz": 100.0, "vehicle": vehicle, **more})


def truth_of(loaded, duration_s=None, every=1):
    plant = build(loaded, seed=1, duration_s=duration_s)
    runner = make_runner(plant.model, plant.parameters)
    shown = plant.model.outputs.unpack(runner.run(plant.samples))
    return (np.arange(plant.samples) + 1) * plant.sample_interval, {name: np.array(values) for name, values in shown.items()}


@pytest.fixture(scope="module")
def csv(tmp_path_factory):
    path = tmp_path_factory.mktemp("track") / "track.csv"
    time = np.arange(0.0, 620.5, 0.5)
    write_csv(path, time, closed_form(time))
    return path


def test_a_closed_form_through_csv(csv):
    loaded = scenario(csv, vehicle={"columns": ATTITUDE})
    assert loaded.duration_s == 620.0
    assert loaded.start.latitude_deg == pytest.approx(45.0, abs=1e-8)
    time, shown = truth_of(loaded, 120.0)
    true = closed_form(time)
    north = 6.37e6 * (shown["latitude"].ravel() - true[:, 0])
    east = 6.37e6 * np.cos(LATITUDE) * (shown["longitude"].ravel() - true[:, 1])
    apart = np.abs(np.column_stack([north, east, shown["height"].ravel() - true[:, 2]])).max(axis=1)
    assert apart.max() < 2e-4 and apart[time > 3.0].max() < 5e-6  # at the begin nothing before it tells of the curvature
    step = 1e-3
    rate = (closed_form(time + step) - closed_form(time - step)) / (2.0 * step)
    R_M, R_N = geodesy.numeric.radii(np.sin(true[:, 0]))
    speed = [(R_M + true[:, 2]) * rate[:, 0], (R_N + true[:, 2]) * np.cos(true[:, 0]) * rate[:, 1], -rate[:, 2]]
    assert np.abs(shown["velocity_n"] - np.column_stack(speed))[time > 3.0].max() < 1e-5
    roll, pitch, heading = insenv.attitude.numeric.to_euler(shown["q_nb"])
    turned = np.column_stack([roll - true[:, 3], pitch - true[:, 4], np.angle(np.exp(1j * (heading - true[:, 5])))])
    assert np.abs(turned).max() < 2e-4 and np.abs(turned)[time > 3.0].max() < 5e-6


def test_a_perfect_unit_drifts_less_than_a_millimetre_in_ten_minutes(csv):
    perfect = {"draw_errors": False, "tilt_sigma_deg": 0.001, "heading_sigma_deg": 0.001}
    loaded = scenario(csv, vehicle={"columns": ATTITUDE}, duration_s=600.0, knowledge=perfect)
    (result,) = insenv.run(loaded, "wander-sins").results
    worst = {name: float(np.abs(error).max()) for name, error in result.errors.items()}
    assert max(worst[name] for name in ("north_m", "east_m", "down_m")) < 1e-3, worst
    assert max(worst[name] for name in ("vn_mps", "ve_mps", "vd_mps")) < 1e-5, worst


def test_every_runner_gives_the_same_bits(csv):
    loaded = scenario(csv, vehicle={"columns": ATTITUDE}, imu={"grade": "tactical"}, gnss={"grade": "spp"}, rate_hz=20.0)
    plant = build(loaded, seed=3, duration_s=20.0)
    native = np.array(make_runner(plant.model, plant.parameters, "native").run(plant.samples))
    interpreted = np.array(make_runner(plant.model, plant.parameters, "interpreter").run(plant.samples))
    assert native.tobytes() == interpreted.tobytes()
    vectors = np.array([plant.model.parameters.pack(each.parameters) for each in reseeded(plant, [3, 4])])
    batch = make_batch(plant.model, 2, vectors, backend="native")
    every = np.array(batch.run(plant.samples, every=1))
    assert every[0].tobytes() == native.tobytes()


GPX = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'


def write_gpx(path, time, values, digits=7):
    points = []
    for t, (latitude, longitude, height) in zip(time, values[:, :3], strict=True):
        stamp = f"2026-01-01T{int(t) // 3600:02d}:{int(t) // 60 % 60:02d}:{t % 60:06.3f}Z"
        place = f'lat="{np.degrees(latitude):.{digits}f}" lon="{np.degrees(longitude):.{digits}f}"'
        points.append(f"<trkpt {place}><ele>{height:.2f}</ele><time>{stamp}</time></trkpt>")
    path.write_text(GPX + "\n".join(points) + "</trkseg></trk></gpx>", encoding="utf-8")


def test_a_closed_form_through_gpx(tmp_path):
    time = np.arange(0.0, 300.0)
    write_gpx(tmp_path / "t.gpx", time, closed_form(time), digits=9)
    at, shown = truth_of(scenario(tmp_path / "t.gpx"), 290.0)
    true = closed_form(at)
    north = 6.37e6 * (shown["latitude"].ravel() - true[:, 0])
    assert np.abs(north).max() < 0.02
    course = np.arctan2(*np.gradient(true[:, :2] * [1.0, np.cos(LATITUDE)], axis=0).T[::-1])
    heading = insenv.attitude.numeric.to_euler(shown["q_nb"])[2]
    fast = np.hypot(*shown["velocity_n"][:, :2].T) > 10.0
    assert np.abs(np.angle(np.exp(1j * (heading - course))))[fast].max() < np.radians(0.5)


def test_heights_that_are_missing_are_noted_or_refused(tmp_path):
    time = np.arange(0.0, 100.0)
    write_gpx(tmp_path / "t.gpx", time, closed_form(time))
    text = (tmp_path / "t.gpx").read_text(encoding="utf-8")
    (tmp_path / "t.gpx").write_text(re.sub("<ele>.*?</ele>", "", text, count=1), encoding="utf-8")
    with pytest.raises(InputError, match="point 1 has no height, others have one"):
        scenario(tmp_path / "t.gpx")
    (tmp_path / "t.gpx").write_text(re.sub("<ele>.*?</ele>", "", text), encoding="utf-8")
    loaded = scenario(tmp_path / "t.gpx", vehicle={"height_offset_m": 50.0})
    assert loaded.vehicle.notes == ("t.gpx has no heights: the track is at height_offset_m above the ellipsoid",)
    assert loaded.start.height_m == pytest.approx(50.0)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """The truth of a simulated drive through a city, with stops and turns: time (s) and rows, at 10 Hz."""
    loaded = insenv.load({**insenv.load("car-city-drive").model_dump(mode="json"), "rate_hz": 100.0})
    time, shown = truth_of(loaded, 300.0)
    return time[9::10], {name: values[9::10] for name, values in shown.items()}


def test_one_of_several_tracks_is_named(tmp_path):
    """What `insenv run --gpx --kml` writes: the truth and an estimate."""
    pytest.importorskip("gpxpy")
    report = insenv.run("car-city-drive", "loosely-coupled", duration_s=10.0)
    insenv.write(report, tmp_path, ["gpx", "kml"], name="two")
    for path in (tmp_path / "two.gpx", tmp_path / "two.kml"):
        first = scenario(path)
        note = f"{path.name} has the tracks 'truth', 'loosely-coupled': the first is taken; vehicle.track chooses another"
        assert note in first.notes
        truth, other = (
            scenario(path, rate_hz=400.0, vehicle={"track": "truth"}),
            scenario(path, rate_hz=400.0, vehicle={"track": "loosely-coupled"}),
        )
        assert not truth.vehicle.notes and np.array_equal(first.vehicle.shape.points, truth.vehicle.shape.points)
        assert not np.array_equal(other.vehicle.shape.points, truth.vehicle.shape.points)
        by_number = scenario(path, rate_hz=400.0, vehicle={"track": 1})
        assert np.array_equal(by_number.vehicle.shape.points, other.vehicle.shape.points)
        with pytest.raises(InputError, match=r"vehicle.track = 'trth': no such track in .*did you mean 'truth'\?"):
            scenario(path, rate_hz=400.0, vehicle={"track": "trth"})
        with pytest.raises(
            InputError, match=r"vehicle.track = 2: .* has the tracks 'truth', 'loosely-coupled', numbered from 0"
        ):
            scenario(path, rate_hz=400.0, vehicle={"track": 2})


def test_a_track_of_one_hertz_does_not_ring(drive, tmp_path):
    """A drive as GPX once a second, to a centimetre: velocity and acceleration between the points are those of the drive."""
    time, true = drive
    second = np.isclose(time % 1.0, 0.0, atol=1e-6) | np.isclose(time % 1.0, 1.0, atol=1e-6)
    place = np.column_stack([true[name].ravel()[second] for name in ("latitude", "longitude", "height")])
    write_gpx(tmp_path / "t.gpx", time[second], place)
    at, shown = truth_of(scenario(tmp_path / "t.gpx", rate_hz=50.0), 290.0)
    offset = time[second][0]
    apart = shown["velocity_n"] - np.column_stack([np.interp(at + offset, time, true["velocity_n"][:, k]) for k in range(3)])
    inner = (at > 3.0) & (at < 287.0)
    assert np.sqrt(np.mean(apart[inner, :2] ** 2)) < 0.15
    resting = np.interp(at + offset, time, (np.hypot(*true["velocity_n"][:, :2].T) > 0.01).astype(float)) == 0.0
    settled = resting & inner & ~np.isin(np.arange(len(at)), np.flatnonzero(~resting)[:, None] + np.arange(-150, 151))
    assert settled.any() and np.abs(apart[settled, :2]).max() < 0.1
    ours = np.linalg.norm(np.gradient(shown["velocity_n"][:, :2], at, axis=0), axis=1)[inner]
    theirs = np.linalg.norm(np.gradient(true["velocity_n"][:, :2], time, axis=0), axis=1)
    assert ours.max() < 1.3 * theirs.max()


def test_the_result_of_a_run_is_a_track(tmp_path):
    report = insenv.run("car-city-drive", "loosely-coupled", duration_s=40.0)
    (npz, *_) = write_files(report, OutputFolder(tmp_path), figure=False).paths
    loaded = scenario(npz)
    assert loaded.duration_s == pytest.approx(40.0, abs=0.5)
    time, shown = truth_of(loaded)
    again = np.interp(time + report.truth.time[0], report.truth.time, report.truth.latitude)
    assert 6.37e6 * np.abs(shown["latitude"].ravel() - again).max() < 0.05


def test_the_result_of_a_replay_has_no_truth(tmp_path):
    report = insenv.replay(ROOT / "examples" / "logs" / "plain.toml", "loosely-coupled")
    (npz, *_) = write_files(report, OutputFolder(tmp_path), figure=False).paths
    with pytest.raises(InputError, match="a replay has no truth") as caught:
        scenario(npz)
    assert "allowed is the result of a simulated run, or the log itself" in str(caught.value)


def test_a_log_is_a_track(tmp_path):
    loaded = scenario(ROOT / "examples" / "logs" / "plain.toml")
    log = insenv.logs.load(ROOT / "examples" / "logs" / "plain.toml")
    time, shown = truth_of(loaded)
    again = np.interp(time + log.reference.time[0], log.reference.time, log.reference.longitude)
    assert 6.37e6 * np.abs(shown["longitude"].ravel() - again).max() < 0.2


def test_a_log_of_files_of_different_lengths_is_a_track_with_a_note(tmp_path):
    for file in (ROOT / "examples" / "logs").glob("plain*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    header, *lines = [line.split(",") for line in (tmp_path / "plain-reference.csv").read_text(encoding="utf-8").splitlines()]
    for name, columns, count in (("place", slice(1, 4), 1200), ("more", slice(4, None), 700)):
        text = "\n".join(",".join([row[0], *row[columns]]) for row in [header, *lines[:count]])
        (tmp_path / f"{name}.csv").write_text(text + "\n", encoding="utf-8")
    description = (tmp_path / "plain.toml").read_text(encoding="utf-8")
    files = 'file = ["place.csv", "more.csv"]'
    (tmp_path / "plain.toml").write_text(description.replace('file = "plain-reference.csv"', files), encoding="utf-8")
    loaded = scenario(tmp_path / "plain.toml")
    assert loaded.duration_s < 70.0
    assert loaded.notes[0].startswith("reference: joined by time: 700 rows have the same time in ")
    for text, message in (("", r"more.csv: the file is empty$"), ("time_s,vn\n", r"more.csv: no data rows")):
        (tmp_path / "more.csv").write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=message):
            scenario(tmp_path / "plain.toml")
    wrong = description.replace('file = "plain-reference.csv"', 'file = ""')
    (tmp_path / "plain.toml").write_text(wrong, encoding="utf-8")
    with pytest.raises(InputError, match=r"^[^\n]*reference.file = '': must be a path[^\n]*$"):
        scenario(tmp_path / "plain.toml")


# --- refusals ------------------------------------------------------------------------------------------


def rows(count=100):
    time = np.arange(float(count))
    return time, closed_form(time)


def refused(tmp_path, message, time, values, **vehicle):
    write_csv(tmp_path / "t.csv", time, values)
    with pytest.raises(InputError, match=message):
        scenario(tmp_path / "t.csv", vehicle=vehicle)


def test_a_gap_is_named(tmp_path):
    time, values = rows()
    keep = (time < 30) | (time > 45)
    refused(tmp_path, "no points between 29 s and 46 s: a gap of 17 s, allowed max_gap_s = 10 s$", time[keep], values[keep])


def test_a_gap_of_many_knots_is_named(tmp_path):
    time, values = rows(1000)
    keep = (time < 100) | (time > 400)
    message = r"a gap of 302 s with knots every 1 s: allowed are 200 knots in a gap, with a knot_s of 1.51 s or more"
    refused(tmp_path, message, time[keep], values[keep], max_gap_s=400.0)


def test_a_jump_is_named(tmp_path):
    time, values = rows()
    values[60:, 0] += 100.0 / 6.37e6
    refused(tmp_path, "a jump near (59|60) s: .* m/s2 over a second, allowed max_acceleration_mps2 = 20", time, values)


def test_time_that_goes_back_is_named(tmp_path):
    time, values = rows()
    time[50] = 40.0
    refused(tmp_path, "time goes from 49 s to 40 s at point 51", time, values)


def test_few_points_are_refused(tmp_path):
    refused(tmp_path, "5 points: allowed is 8 or more", *(each[:5] for each in rows()))


def test_two_of_three_angles_are_refused(tmp_path):
    message = r"vehicle\.columns: no heading: allowed are columns of roll, pitch and heading"
    refused(tmp_path, message, *rows(), columns={"roll": "roll", "pitch": "pitch"})
    refused(tmp_path, "no track|vehicle.track = 'a': allowed with .gpx and .kml", *rows(), track="a")


def test_radians_as_degrees_are_refused(tmp_path):
    refused(tmp_path, "check position_unit", *rows(), columns={"position_unit": "rad"})


def test_a_missing_column_is_named(tmp_path):
    refused(tmp_path, "'lat'", *rows(), columns={"latitude": "lat"})


def test_a_run_longer_than_the_track_is_refused(tmp_path):
    time, values = rows()
    write_csv(tmp_path / "t.csv", time, values)
    with pytest.raises(InputError, match=r"^scenario: duration_s = 120 s: the track lasts 99 s$"):
        scenario(tmp_path / "t.csv", duration_s=120.0)
    with pytest.raises(InputError, match="allowed is up to 99 s, the duration of the track"):
        build(scenario(tmp_path / "t.csv"), duration_s=100.0)


def test_few_samples_are_refused(tmp_path):
    time, values = rows()
    write_csv(tmp_path / "t.csv", time, values)
    with pytest.raises(InputError, match=r"knots every 0.1 s with samples every 0.5 s"):
        scenario(tmp_path / "t.csv", rate_hz=2.0, vehicle={"knot_s": 0.1})
    values[:, 5] = 1.5 * time
    write_csv(tmp_path / "t.csv", time, values)
    with pytest.raises(InputError, match=r"rotation of 0.\d+ rad in a sample: allowed is 0.25 rad"):
        scenario(tmp_path / "t.csv", rate_hz=4.0, vehicle={"columns": ATTITUDE})


def test_another_start_is_refused(tmp_path):
    time, values = rows()
    write_csv(tmp_path / "t.csv", time, values)
    with pytest.raises(InputError, match=r"start\.latitude_deg = 46: the track begins at 45"):
        scenario(tmp_path / "t.csv", start={"latitude_deg": 46.0, "longitude_deg": 7.0})


def test_a_file_that_has_changed_is_refused(tmp_path):
    time, values = rows()
    write_csv(tmp_path / "t.csv", time, values)
    dumped = json.loads(json.dumps(scenario(tmp_path / "t.csv").model_dump(mode="json")))
    insenv.load(dumped)
    write_csv(tmp_path / "t.csv", time, values + 1e-9)
    with pytest.raises(InputError, match="the file has changed"):
        insenv.load(dumped)


def test_the_data_of_a_log_are_part_of_its_fingerprint(tmp_path):
    """The description alone is the same for two drives."""
    for file in (ROOT / "examples" / "logs").glob("plain*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    first = scenario(tmp_path / "plain.toml")
    data = tmp_path / "plain-reference.csv"
    lines = data.read_text(encoding="utf-8").splitlines(keepends=True)
    data.write_text("".join(lines[:-20]), encoding="utf-8")
    second = scenario(tmp_path / "plain.toml")
    assert first.vehicle.sha256 != second.vehicle.sha256
    assert second.duration_s < first.duration_s
    with pytest.raises(InputError, match="the file has changed"):
        insenv.load(first.model_dump(mode="json"))
    data.unlink()
    with pytest.raises(InputError, match=r"plain-reference.csv: file not found"):
        scenario(tmp_path / "plain.toml")


def test_a_file_beside_a_scenario(tmp_path):
    time, values = rows()
    write_csv(tmp_path / "t.csv", time, values)
    (tmp_path / "s.toml").write_text('title = "t"\n[vehicle]\nkind = "recorded"\nfile = "t.csv"\n', encoding="utf-8")
    assert insenv.load(tmp_path / "s.toml").duration_s == 99.0
    (tmp_path / "s.toml").write_text('title = "t"\n[vehicle]\nkind = "recorded"\nfile = "none.csv"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"none.csv: file not found"):
        insenv.load(tmp_path / "s.toml")


def test_a_misspelt_kind_is_named_first(tmp_path):
    """Whether [start] and duration_s are missing depends on it."""
    with pytest.raises(InputError) as caught:
        scenario("drive.gpx", vehicle={"kind": "record"})
    message = str(caught.value)
    assert message.startswith("scenario: vehicle.kind = 'record': must be one of 'ship', 'car', 'aircraft'")
    assert message.endswith("; did you mean 'recorded'?") and len(message.splitlines()) == 1


@pytest.mark.parametrize(("name", "text"), [("t.gpx", "no xml"), ("t.xyz", "a"), ("t.csv", "")])
def test_files_that_are_no_tracks(name, text, tmp_path):
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=name):
        scenario(tmp_path / name)


# --- other formats -------------------------------------------------------------------------------------


def gga(time, latitude, longitude, height):
    """A sentence GGA with its checksum; the geoid is 48 m above the ellipsoid."""

    def angle(value, digits):
        whole = int(np.degrees(value))
        return f"{whole:0{digits}d}{(np.degrees(value) - whole) * 60.0:010.7f}"

    clock = f"{int(time) // 3600 % 24:02d}{int(time) // 60 % 60:02d}{time % 60:05.2f}"
    text = f"GPGGA,{clock},{angle(latitude, 2)},N,{angle(longitude, 3)},E,1,08,0.9,{height - 48.0:.3f},M,48.0,M,,"
    return f"${text}*{np.bitwise_xor.reduce(np.frombuffer(text.encode(), np.uint8)):02X}"


def check_same(loaded, time, tolerance=0.02):
    at, shown = truth_of(loaded, float(time[-1] - time[0]) - 1.0)
    true = closed_form(at)
    assert 6.37e6 * np.abs(shown["latitude"].ravel() - true[:, 0]).max() < tolerance
    assert np.abs(shown["height"].ravel() - true[:, 2]).max() < tolerance


def test_nmea_over_midnight(tmp_path):
    time = np.arange(0.0, 100.0)
    lines = [gga(86370.0 + t, *row[:3]) for t, row in zip(time, closed_form(time), strict=True)]
    lines.insert(3, "$GPGSV,1,1,00*79")
    (tmp_path / "t.nmea").write_text("\n".join(lines), encoding="ascii")
    check_same(scenario(tmp_path / "t.nmea"), time)
    lines[10] = lines[10].replace("E,1", "E,2")
    (tmp_path / "t.nmea").write_text("\n".join(lines), encoding="ascii")
    with pytest.raises(InputError, match=r"line 11: .*checksum"):
        scenario(tmp_path / "t.nmea")


KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark><gx:Track>{}</gx:Track>'
    "</Placemark></kml>"
)


def test_kml(tmp_path):
    time = np.arange(0.0, 100.0)
    whens = "".join(f"<when>2026-01-01T00:{int(t) // 60:02d}:{int(t) % 60:02d}Z</when>" for t in time)
    coords = "".join(
        f"<gx:coord>{np.degrees(b):.9f} {np.degrees(a):.9f} {h:.3f}</gx:coord>" for a, b, h, *_ in closed_form(time)
    )
    (tmp_path / "t.kml").write_text(KML.format(whens + coords), encoding="utf-8")
    check_same(scenario(tmp_path / "t.kml"), time)
    (tmp_path / "t.kml").write_text(KML.format(coords), encoding="utf-8")
    with pytest.raises(InputError, match="0 times for 100 places"):
        scenario(tmp_path / "t.kml")
    (tmp_path / "t.kml").write_text("<!DOCTYPE a []><kml/>", encoding="utf-8")
    with pytest.raises(InputError, match="declares a document type"):
        scenario(tmp_path / "t.kml")

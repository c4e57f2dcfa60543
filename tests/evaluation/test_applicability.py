"""Notes of `run` and `replay` on gyros or places that do not allow gyrocompassing; a real log at rest."""

import importlib.util

import numpy as np
import pytest
from places import ROOT

from insenv import geodesy, replay, run
from insenv.errors import InputError
from insenv.estimators import registered
from insenv.report import document
from insenv.scenario import load

PRINTED = [id for id in registered() if id.endswith("-printed")]
"""Forms of the papers, for comparison: they say so beside every result, and do not count as aligned."""
ALIGNMENTS = [e.id for e in registered().values() if e.kind == "alignment" and not e.aided and e.id not in PRINTED]
n380 = pytest.mark.skipif(importlib.util.find_spec("onavdata") is None, reason="onavdata is not installed")


def notes(scenario, ids=None, duration_s=2.0, latitude_deg=None, **imu):
    """Notes of a short run on what its estimate can mean, by estimator; not the one that the run is short."""
    loaded = load(scenario)
    start = loaded.start if latitude_deg is None else loaded.start.model_copy(update={"latitude_deg": latitude_deg})
    loaded = loaded.model_copy(update={"imu": loaded.imu.model_copy(update=imu), "start": start})
    return {r.estimator: lasting(r.notes) for r in run(loaded, ids or ALIGNMENTS, duration_s=duration_s).results}


def lasting(said):
    passing = ("too short", "the start heading is known to", "the errors are larger than this estimator states")
    return tuple(note for note in said if not note.startswith(passing))


def test_consumer_gyros_cannot_find_north():
    for id, said in notes("ship-swaying", grade="consumer").items():
        assert len(said) == 1 and said[0].startswith("not applicable for heading: a gyro error of"), id


def test_a_printed_form_says_what_it_is_for_and_what_the_unit_does_not_allow():
    alignments = [id for id in PRINTED if registered()[id].kind == "alignment"]
    assert len(alignments) == 3
    for id, said in notes("ship-swaying", alignments, grade="consumer").items():
        assert said[0].startswith("not applicable for heading: a gyro error of"), id
        assert said[-1].startswith("the paper's filter as printed, for comparison with it"), id


def test_a_marine_unit_finds_north_in_minutes():
    assert notes("ship-swaying", ["q-method"], duration_s=300.0) == {"q-method": ()}
    # 0.15 deg/sqrt(h): 6.4 deg/h over two seconds, 0.5 deg/h over five minutes, of 13.0 deg/h
    noisy = {"grade": "perfect", "gyro_arw_deg_sqrt_h": 0.15}
    assert notes("ship-swaying", ["q-method"], duration_s=2.0, **noisy)["q-method"][0].startswith("heading is good to 28 deg")
    assert notes("ship-swaying", ["q-method"], duration_s=300.0, **noisy) == {"q-method": ()}


@pytest.mark.parametrize(
    ("gyro_deg_h", "note"), [(0.5, None), (3.0, "heading is good to 13 deg only"), (20.0, "not applicable for heading")]
)
def test_gyros_are_compared_with_the_horizontal_earth_rate(gyro_deg_h, note):
    """15.04 cos 30 = 13.0 deg/h."""
    perfect = {"grade": "perfect", "gyro_bias_sigma_deg_h": gyro_deg_h}
    found = notes("ship-swaying", ["gyrocompass"], **perfect)["gyrocompass"]
    assert [n.startswith(note) for n in found] == ([] if note is None else [True])


def test_near_a_pole():
    unit = {"grade": "perfect", "gyro_bias_sigma_deg_h": 0.01, "accel_bias_sigma_ug": 50.0}
    assert notes("ship-swaying", ["analytic"], latitude_deg=-88.0, **unit)["analytic"] == ()
    place, doubt = notes("ship-swaying", ["analytic"], latitude_deg=89.98, **unit)["analytic"]
    assert place.startswith("0.02 deg (2.23 km) from a pole")
    assert "heading" in doubt and "deg/h at 89.98 deg" in doubt


def test_levelling_errors_count_at_high_latitude():
    unit = {"grade": "perfect", "accel_bias_sigma_ug": 5000.0}
    (said,) = notes("ship-swaying", ["analytic"], latitude_deg=88.0, **unit)["analytic"]
    assert said == "heading is good to 8.2 deg only: the accelerometers level to 0.29 deg, at 88 deg of latitude"


def test_navigation_needs_no_earth_rate():
    """The notes that there are tell that the scenario counts the scale factors of a better unit."""
    said = notes("car-city-drive", ["loosely-coupled", "wander-sins"], grade="consumer")
    assert not said["wander-sins"]
    assert [note.partition(" = ")[0] for note in said["loosely-coupled"]] == ["rotation_error", "thrust_error"]


def log_at_rest(folder, imu="", estimator=""):
    n, dt = 1000, 0.1
    rate = geodesy.numeric.earth_rate_n(np.radians(30.0))
    rows = np.column_stack([np.arange(1, n + 1) * dt, np.tile(rate * dt, (n, 1)), np.zeros((n, 2)), np.full(n, -9.79 * dt)])
    np.savetxt(folder / "imu.csv", rows, delimiter=",", header="t,gx,gy,gz,ax,ay,az", comments="")
    path = folder / "log.toml"
    path.write_text(
        f'title = "at rest"\n[imu]\n{imu}\nfile = "imu.csv"\ntime = "t"\n'
        'gyro = ["gx", "gy", "gz"]\naccel = ["ax", "ay", "az"]\n'
        'kind = "increment"\nstamp = "interval_end"\ngyro_unit = "rad"\naccel_unit = "m/s"\naxes = "FRD"\n'
        f"[initial]\nlatitude_deg = 30.0\nlongitude_deg = 114.0\nheight_m = 20.0\n{estimator}"
    )
    return path


def test_the_accuracy_of_the_unit_of_a_log(tmp_path):
    unknown = replay(log_at_rest(tmp_path), ["q-method"])
    assert [note for note in unknown.notes if "class 'consumer', because the log has less than any unit" in note]
    (note,) = unknown.results[0].notes
    assert note.startswith("not applicable for heading: a gyro error of 3.6")
    consumer = replay(log_at_rest(tmp_path, 'grade = "consumer"'), ALIGNMENTS)
    for result in consumer.results:
        assert [note.startswith("not applicable for heading") for note in lasting(result.notes)] == [True], result.estimator
        heading = result.sigma["heading_deg"][-1]
        assert heading > 90, result.estimator
    assert "not applicable" in str(document(consumer, [])["results"][0]["notes"])
    tuned = '[estimator."q-method"]\ngyro_bias_deg_h = 3.0\naccel_bias_ug = 100.0\narw_deg_sqrt_h = 0.001'
    (note,) = replay(log_at_rest(tmp_path, estimator=tuned), ["q-method"]).results[0].notes
    assert note.startswith("heading is good to 13 deg only")


def test_an_unknown_grade_is_an_error(tmp_path):
    with pytest.raises(InputError, match="tacticle"):
        replay(log_at_rest(tmp_path, 'grade = "tacticle"'), ["q-method"])


@pytest.fixture(scope="module")
def n380_at_rest(tmp_path_factory):
    """Results on the n380 log at rest, with the engine running and people in the car; sensors as for KF-GINS."""
    text = (ROOT / "examples/n380-car.toml").read_text()
    text = text[: text.index("[evaluation]")].replace("start_s = 150.0", "start_s = 43.0")
    text = text.replace("[imu]", 'start_s = 42.0\nstop_s = 161.0\n\n[imu]\ngrade = "n380"', 1)
    path = tmp_path_factory.mktemp("log") / "n380.toml"
    path.write_text(text)
    return {r.estimator: r for r in replay(path, ALIGNMENTS).results}


@n380
@pytest.mark.parametrize("id", ALIGNMENTS)
def test_errors_on_a_real_log_are_within_the_stated_sigma(id, n380_at_rest):
    """Two minutes at rest, gyro biases of 42, 112 and -49 deg/h: the heading is unobservable, and each estimator notes it;
    roll and pitch are within four times their stated sigma from 60 s on.
    """
    result = n380_at_rest[id]
    assert any(note.startswith("not applicable for heading") for note in result.notes)
    late = result.time > 103.0
    for channel in ("roll_deg", "pitch_deg", "heading_deg"):
        assert (np.abs(result.errors[channel][late]) < 4 * result.sigma[channel][late]).all(), channel
    assert result.sigma["heading_deg"][-1] > 90


def test_an_alignment_whose_sigmas_do_not_hold_on_a_turntable_says_so():
    """Roll and pitch of ecef-kf were eight of its sigmas off, the heading of q-method three, without a word."""
    ids = ("ecef-kf", "inertial-fir", "gyrocompass", "q-method", "qakf", "qakf-improved")
    turned = {result.estimator: result.notes for result in run("turntable-indexing", ids, duration_s=400).results}
    for id in ids:
        assert any("the vehicle is a turntable" in note for note in turned[id]), id
    still = run("car-parked", ids, duration_s=100).results
    assert not any("turntable" in note for result in still for note in result.notes)

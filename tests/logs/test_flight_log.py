"""Flight logs: what a simulated flight writes in each format comes back."""

import copy
import gzip
import random
from dataclasses import replace

import numpy as np
import pytest
from flight_drive import UNDULATION, WRITERS, described, drive, telemetry, ulog

from insenv import attitude, geodesy, replay
from insenv.base.errors import InputError
from insenv.logs import GnssFixes, load

FIX = ("time", "latitude", "longitude", "height", "position_sigma", "velocity_n", "velocity_sigma")
# how finely each format writes: position of fixes (m: north or east, height), velocity (m/s)


@pytest.mark.parametrize("kind", WRITERS)
def test_the_samples_and_fixes_of_a_flight_come_back(kind, tmp_path):
    own = drive()
    log = load(described(WRITERS[kind](own, tmp_path / f"flight.{kind}")))
    # increments in single precision
    np.testing.assert_allclose(log.imu_time, own.time_us * 1e-6, rtol=0, atol=1e-9)
    samples = np.hstack([log.delta_angle, log.delta_velocity])
    np.testing.assert_allclose(samples, own.increments, rtol=1.2e-7, atol=1e-13)
    assert log.gaps.count == 0
    # how finely each format writes fixes: degrees, height (m), velocity (m/s)
    degrees, height, speed = {"tlog": (1e-7, 1e-3, 1e-2), "BIN": (1e-7, 1e-2, 1e-6), "ulg": (1e-12, 1e-9, 1e-6)}[kind]
    half = np.radians(degrees) / 2 + 2e-16
    exact = GnssFixes(*(np.array([getattr(fix, name) for _, fix in own.fixes]) for name in FIX))
    bounds = (1e-6, half, half, height / 2 + 1e-9, 5.1e-3, speed / 2 + 1e-5, 5.1e-3)
    for name, bound in zip(FIX, bounds, strict=True):
        np.testing.assert_allclose(getattr(log.gnss, name), getattr(exact, name), rtol=0, atol=bound, err_msg=name)


@pytest.mark.parametrize("kind", WRITERS)
def test_the_reference_in_a_log_and_its_replay(kind, tmp_path):
    path = WRITERS[kind](drive(), tmp_path / f"flight.{kind}")
    log = load(path)
    reference = log.reference
    rows = np.rint(reference.time / drive().interval).astype(int) - 1
    truth = {name: values[rows] for name, values in drive().truth.items()}
    height = UNDULATION if kind == "BIN" else 0.0  # ArduPilot's logs do not tell the undulation
    places = [truth["latitude"], truth["longitude"], truth["height"] - height]
    metres = geodesy.numeric.ned_offset(reference.latitude, reference.longitude, reference.height, *places)
    assert np.abs(metres).max() < 0.02
    np.testing.assert_allclose(reference.velocity_n, truth["velocity_n"], atol=0.0051)
    q = attitude.numeric.from_euler(reference.roll, reference.pitch, reference.heading)
    turned = attitude.numeric.multiply(attitude.numeric.conjugate(q), truth["q_nb"])
    assert 2 * np.abs(turned[:, 1:]).max() < np.radians(0.01)
    assert any("own estimate" in note for note in log.notes) == (kind != "tlog")  # HIL_STATE_QUATERNION is a simulator's truth
    report = replay(log, "loosely-coupled", start="reference")
    rms = {name: np.sqrt(np.mean(errors**2)) for name, errors in report.results[0].errors.items()}
    assert len(report.notes) >= 3 and rms["north_m"] < 3.0 and rms["roll_deg"] < 1.0


@pytest.mark.parametrize("kind", ["ulg", "tlog"])
def test_unix_time_stamps_keep_their_microseconds(kind, tmp_path):
    path, own = tmp_path / f"flight.{kind}", drive()
    if kind == "ulg":
        ulog(own, path, start_us=1_700_000_000_000_000)
    else:
        late = copy.deepcopy(own.messages)
        for message in (each for group in late for each in group if hasattr(each, "time_usec")):
            message.time_usec += 1_700_000_000_000_000
        telemetry(replace(own, messages=late), path)
    log = load(path)
    assert log.imu_time[0] == 0.0 and any("Unix time" in note for note in log.notes)
    np.testing.assert_allclose(np.diff(log.imu_time), own.interval, rtol=0, atol=1e-12)
    assert log.gnss.time[0] == pytest.approx(own.fixes[0][1].time - own.interval, abs=2e-6)


@pytest.mark.parametrize("kind", WRITERS)
def test_files_cut_anywhere_or_garbled_end_in_words(kind, tmp_path):
    short = replace(drive(), messages=drive().messages[:400], increments=drive().increments[:400])
    whole = WRITERS[kind](short, tmp_path / f"whole.{kind}").read_bytes()
    draw, path = random.Random(1), tmp_path / f"flight.{kind}"
    for trial in range(25):
        data = bytearray(whole[: draw.randrange(len(whole))])
        for _ in range(trial % 3 * 20 if data else 0):
            data[draw.randrange(len(data))] = draw.randrange(256)
        path.write_bytes(data)
        try:
            assert np.isfinite(load(path).delta_velocity).all()
        except InputError as error:
            assert path.name in str(error)
    packed = path.with_suffix(f".{kind}.gz")
    packed.write_bytes(gzip.compress(whole))
    assert len(load(packed).imu_time) == 400

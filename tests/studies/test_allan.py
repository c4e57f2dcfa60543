"""`insenv allan`: the Allan deviation and its fit against noise of known figures, its warnings, and what it writes."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from changed_scenario import changed
from command_line import call, refused, strict
from scipy.signal import lfilter
from simulated_log import IMU, simulated_log

import insenv
from insenv.base.errors import InputError
from insenv.logs import RecordedLog
from insenv.logs.description import LogDescription
from insenv.logs.inertial import Gaps
from insenv.studies.allan import AXES, sensor_noise
from insenv.studies.allan_result import grade_text
from insenv.studies.noise_terms import FLICKER, MARKOV, QUANTIZATION, TIME, WALK, WHITE, curve, fit, spectrum, total
from insenv.studies.rest import part_of

RATE = 20.0
RATES = {"kind": "rate", "gyro_unit": "rad/s", "accel_unit": "m/s2"}


def white(generator, count, density, rate=RATE):
    return density * np.sqrt(rate) * generator.standard_normal(count)


def markov(generator, count, sigma, time, rate=RATE):
    decay = np.exp(-1.0 / (rate * time))
    drive = sigma * np.sqrt(1.0 - decay**2) * generator.standard_normal(count)
    drive[0] = sigma * generator.standard_normal()
    return lfilter([1.0], [1.0, -decay], drive)


def log_of(rates, rate=RATE, title="a unit", **imu):
    """A log of rates (n, 6) of a unit at rest, in rad/s and m/s^2."""
    count, interval = len(rates), 1.0 / rate
    dt = np.full(count, interval)
    description = LogDescription.model_validate({"title": title, "imu": {**IMU, **RATES, **imu}})
    empty = {"gnss": None, "lever_arm_b": np.zeros(3), "reference": None, "sources": (), "notes": ()}
    return RecordedLog(
        imu_time=np.arange(1, count + 1) * interval, delta_angle=rates[:, :3] * interval,
        delta_velocity=rates[:, 3:] * interval, dt=dt, bridged=np.zeros(count, bool), gaps=Gaps(), description=description,
        **empty,
    )  # fmt: skip


def unit_rates(generator, count, arw=1e-4, vrw=1e-3, rate=RATE):
    rates = np.hstack([white(generator, (count, 3), arw, rate), white(generator, (count, 3), vrw, rate)])
    return rates + [0, 0, 5e-5, 0.02, 0, -9.8]


def test_deviation_by_its_definition():
    generator = np.random.default_rng(1)
    rate = white(generator, 5000, 0.3) + np.cumsum(white(generator, 5000, 1e-3)) / RATE + 7.0
    found = curve(rate, 1.0 / RATE)
    angle = np.concatenate([[0.0], np.cumsum(rate - rate.mean())]) / RATE
    for tau, deviation in zip(found.tau, found.deviation, strict=True):
        m = round(tau * RATE)
        second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
        assert deviation == pytest.approx(np.sqrt(np.mean(second**2) / 2.0) / tau, rel=1e-9)


def test_variances_are_the_integrals_of_the_spectra():
    """By IEEE Std 952, eq. C.3, and the variance of a Gauss-Markov bias also where its closed form cancels."""
    frequency = np.geomspace(1e-7, 1e4, 400001)
    for tau in (1.0, 30.0, 3000.0):
        window = 2.0 * np.sin(np.pi * frequency * tau) ** 4 / (np.pi * frequency * tau) ** 2
        for term in ({WHITE: 0.3}, {FLICKER: 0.2}, {WALK: 0.1}, {MARKOV: 0.5, TIME: 300.0}):
            value = np.trapezoid(spectrum(term, 1.0 / RATE, frequency) * window * frequency, np.log(frequency))
            assert float(total(term, np.array(tau))) == pytest.approx(value, rel=2e-3), term
    small = total({MARKOV: 1.0, TIME: 300.0}, np.array([0.2999, 0.3001]))
    assert small[1] / small[0] == pytest.approx(0.3001 / 0.2999, rel=1e-5)


CASES = {
    "white": ({WHITE: 0.2}, (WHITE,)),
    "walk": ({WHITE: 0.12, WALK: 0.02}, (WHITE, WALK)),
    "counts": ({WHITE: 1.0, QUANTIZATION: 0.15 / 12**0.5}, (WHITE, QUANTIZATION)),
    "bias": ({WHITE: 2.0, MARKOV: 3.0, TIME: 100.0}, (WHITE, MARKOV, TIME)),
}


BIAS = {WHITE: 1.0, MARKOV: 0.37, TIME: 100.0}
BEGINNING = 0.37 * (2.0 / 100.0) ** 0.5
"""The random walk with which this bias begins."""


def noise_of(true, generator, count):
    """NumPy's noise of these figures, which knows nothing of insenv."""
    rate = white(generator, count, true[WHITE])
    if WALK in true:
        rate = rate + np.cumsum(white(generator, count, true[WALK])) / RATE
    if MARKOV in true:
        rate = rate + markov(generator, count, true[MARKOV], true[TIME])
    if QUANTIZATION in true:
        step = 12**0.5 * true[QUANTIZATION]
        rate = np.diff(np.round(np.cumsum(rate) / RATE / step) * step, prepend=0.0) * RATE
    return rate


@pytest.mark.parametrize("case", [pytest.param(case, marks=pytest.mark.slow if case != "white" else ()) for case in CASES])
def test_terms_of_known_noise(case):
    """The terms are recognised, white noise is within 3 %, and the bounds hold the true figures in most of 6 series."""
    true, names = CASES[case]
    generator = np.random.default_rng(7)
    found = [fit(curve(noise_of(true, generator, int(3600 * RATE)), 1.0 / RATE)) for _ in range(6)]
    assert sum(tuple(each.figures) == names for each in found) >= 4
    assert all(abs(each.figures[WHITE].value / true[WHITE] - 1.0) < 0.03 for each in found)
    for name in names:
        held = [each.figures[name].low <= true[name] <= each.figures[name].high for each in found if name in each.figures]
        assert np.mean(held) >= 0.6, name  # 0.95 are expected: fewer than 4 of 6 by chance in 0.1 % of the cases


def test_samples_at_instants_have_the_noise_of_the_unit():
    """Means by the trapezoidal rule, as a log with stamp = "instant" has them, give the samples back; others are told of."""
    samples = unit_rates(np.random.default_rng(3), 20001)
    log = log_of(0.5 * (samples[1:] + samples[:-1]), stamp="instant")
    part = part_of(log)
    assert np.all(np.abs(part.rates - samples[1:]).max(axis=0) < 4.0 * samples.std(axis=0) / 20000**0.5)
    assert insenv.allan(log).triads[0].terms.figures[WHITE].value == pytest.approx(1e-4, rel=0.01)
    doubled = np.repeat(samples[:10001], 2, axis=0)
    assert any(
        "repeat the one before" in each
        for each in part_of(log_of(0.5 * (doubled[1:] + doubled[:-1]), stamp="instant")).warnings
    )
    bridged = replace(log, bridged=np.arange(20000) % 50 == 0)
    assert any("interpolated" in warning for warning in part_of(bridged).warnings)


@pytest.mark.slow
def test_bounds_hold_in_as_many_logs_as_they_say():
    """48 logs of half an hour; figures of 200 are on the page."""
    held = []
    for seed in range(48):
        found = fit(curve(noise_of(BIAS, np.random.default_rng(90000 + seed), 36000), 1.0 / RATE)).figures
        true = {**BIAS, WALK: BEGINNING}
        held += [found[name].low <= true[name] <= found[name].high for name in true if name in found]
    assert 0.9 < np.mean(held) < 0.995  # 0.95 of about 120, within 2.5 standard deviations


def test_bounds_of_a_walk_hold_that_with_which_a_bias_begins():
    """Where a Gauss-Markov bias fits better than the walk, by less than it has to: without that the bound is 0.3 % too low."""
    walk = fit(curve(noise_of(BIAS, np.random.default_rng(90031), 18000), 1.0 / RATE)).figures[WALK]
    assert walk.low < BEGINNING < walk.high


def test_a_slow_bias_that_a_log_cannot_tell_from_a_walk_has_no_upper_bound():
    generator = np.random.default_rng(4)
    found = fit(curve(white(generator, 20000, 0.1) + markov(generator, 20000, 3.0, 500.0), 1.0 / RATE)).figures
    assert np.isinf(found[TIME].high) and np.isinf(found[MARKOV].high)
    assert 0.0 < found[MARKOV].low < 3.0 and 0.0 < found[TIME].low < 500.0


def test_flicker_is_its_floor():
    """Noise with the spectrum floor^2 / (2 ln 2 f), by the Fourier transform."""
    generator, count = np.random.default_rng(5), int(7200 * RATE)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE)
    shape = np.zeros(len(frequency))
    shape[1:] = np.sqrt(4.0 / (2.0 * np.log(2.0)) / frequency[1:] * RATE / 2.0)
    pink = np.fft.irfft(np.fft.rfft(generator.standard_normal(count)) * shape, count)
    found = fit(curve(pink + white(generator, count, 10.0), 1.0 / RATE))
    assert found.slow == (FLICKER,)
    assert found.figures[FLICKER].low <= 2.0 <= found.figures[FLICKER].high


@pytest.mark.slow
def test_a_grade_of_the_catalogue_comes_back():
    """The bounds of each figure: below and above, of noise made by NumPy."""
    rest = [
        changed("static-ecef", duration_s=7200.0, rate_hz=50.0, imu={"grade": grade}) for grade in ("industrial", "perfect")
    ]
    unit, perfect = (insenv.allan(simulated_log(each, 1)) for each in rest)
    grade = unit.grade()
    assert perfect.triads[0].terms is None and "gyro x" in str(perfect.warnings)
    assert not unit.warnings and grade.gyro_arw_deg_sqrt_h == pytest.approx(0.3, rel=0.02)
    assert all(QUANTIZATION not in triad.terms.figures for triad in unit.triads)
    # of a bias of 300 s, 2 h show 24 correlation times: 20 % for each axis, 12 % for three
    assert grade.gyro_instability_deg_h == pytest.approx(6.25, rel=0.4)
    assert grade.accel_instability_ug == pytest.approx(100.0, rel=0.4)


@pytest.mark.parametrize(("size", "length"), [(0.01, 10), (0.3, 1), (1.0, 10), (0.3, 100)])
def test_figures_that_knocks_make_are_not_trusted(size, length):
    """One knock made 1.21 deg/sqrt(h) of 0.34, within 1 %, and a bias instability of 330 deg/h of none."""
    rates = unit_rates(np.random.default_rng(2), 40000)
    rates[20000 : 20000 + length, 0] += size
    found = sensor_noise("gyro x", rates[:, 0], 1.0 / RATE)
    assert any("knocks" in warning for warning in found.warnings) and len(set(found.warnings)) == len(found.warnings)
    assert size < 0.1 or (found.distrust and found.distrust in found.warnings)


@pytest.mark.parametrize("quantum", [0.001, 0.002])
def test_jumps_of_a_coarse_quantum_are_no_knocks(quantum):
    rates = unit_rates(np.random.default_rng(2), 40000)[:, 0]
    assert not sensor_noise("gyro x", np.round(rates / quantum) * quantum, 1.0 / RATE).distrust
    angles = np.round(np.cumsum(rates) / quantum) * quantum
    assert not sensor_noise("gyro x", np.diff(angles), 1.0 / RATE).distrust


def test_a_low_pass_filter_is_recognised_and_left_out():
    generator = np.random.default_rng(2)
    noise = lfilter([0.2], [1.0, -0.8], white(generator, 100000, 1e-4, 100.0))
    found = sensor_noise("gyro x", noise, 0.01)
    assert "a low-pass filter" in found.warnings[0]
    assert found.terms.figures[WHITE].value == pytest.approx(1e-4, rel=0.05)


def moving(rates, begin, end):
    rates = rates.copy()
    time = np.arange(end - begin) / RATE
    rates[begin:end, 2] += 0.3 * np.sin(time)
    rates[begin:end, 3] += 1.0 * np.sin(0.7 * time)
    return rates


def test_the_longest_rest_is_used():
    rates = moving(unit_rates(np.random.default_rng(2), 8000), 0, 2000)
    found = insenv.allan(log_of(rates))
    assert found.part.begin_s == pytest.approx(100.0, abs=3.0) and found.part.end_s == pytest.approx(400.0, abs=2.0)
    assert "without motion in a log of 400 s" in found.warnings[0]
    assert found.axes[2].terms.figures[WHITE].value == pytest.approx(1e-4, rel=0.05)


def test_no_rest_is_refused_and_a_named_part_is_warned_of():
    log = log_of(moving(unit_rates(np.random.default_rng(2), 8000), 0, 8000))
    with pytest.raises(InputError, match="no 10 s without motion"):
        insenv.allan(log)
    found = insenv.allan(log, from_s=100.0, to_s=200.0)
    assert "the vehicle moves" in found.warnings[0]
    assert "# measured" not in grade_text(found)


@pytest.mark.slow
def test_the_command(tmp_path, monkeypatch):
    """A grade of a log in a file, which the log then takes."""
    monkeypatch.chdir(tmp_path)
    log = (
        'title = "a rest"\n[imu]\nfile = "rest.csv"\n'
        'time = "t"\ngyro = ["gx", "gy", "gz"]\naccel = ["ax", "ay", "az"]\nkind = "rate"\n'
        'stamp = "interval_end"\ngyro_unit = "rad/s"\naccel_unit = "m/s2"\naxes = "FRD"\n'
    )
    Path("rest.toml").write_text(log, encoding="utf-8")
    rows = np.column_stack([np.arange(1, 2001) / 50.0, unit_rates(np.random.default_rng(2), 2000, rate=50.0)])
    np.savetxt("rest.csv", rows, delimiter=",", header="t,gx,gy,gz,ax,ay,az", comments="", fmt="%.9g")
    status, out, _ = call("allan", "rest.toml", "--grade-out", "unit.toml", "--out", "out")
    assert status == 0 and "only the noise is measured; all else is assumed" in out
    refused(call("allan", "rest.toml", "--grade-out", "rest.toml"), "'rest.toml' exists and is not a grade file")
    assert Path("rest.toml").read_text("utf-8") == log
    assert {path.name for path in Path("out").iterdir()} == {"allan.json", "unit.toml", "allan.html", "allan.png", "allan.svg"}
    found = strict(Path("out/allan.json").read_text("utf-8"))
    assert [axis["name"] for axis in found["axes"]] == list(AXES)
    assert found["axes"][0]["arw_deg_sqrt_h"] == pytest.approx(np.degrees(1e-4) * 60.0, rel=0.1)
    assert found["axes"][3]["vrw_ug_sqrt_hz"] == pytest.approx(1e-3 / 9.80665e-6, rel=0.1)
    low, high = found["axes"][0]["confidence"]["arw_deg_sqrt_h"]
    assert low < np.degrees(1e-4) * 60.0 < high
    Path("rest.toml").write_text(log + 'grade = "unit.toml"\n', encoding="utf-8")
    assert insenv.logs.load("rest.toml").sensors(in_place=True).angle_random_walk == pytest.approx(1e-4, rel=0.1)


@pytest.mark.slow
def test_white_noise_that_its_bounds_do_not_tell_from_none_is_not_seen():
    """The rounding of positions alone: every fit has a white noise, and these samples have none."""
    counted = np.diff(np.random.default_rng(1).uniform(-0.5, 0.5, 36001)) * RATE
    found = fit(curve(counted, 1.0 / RATE))
    for name, figure in found.figures.items():
        assert figure.low > 0.0, name
    assert WHITE not in found.figures and 0.0 < found.upper[WHITE] < 0.02
    rates = np.column_stack([counted * 1e-6] * 3 + [counted * 1e-3] * 3) + [0, 0, 5e-5, 0.02, 0, -9.8]
    unit = insenv.allan(log_of(rates))
    assert "accel_vrw_ug_sqrt_hz" not in unit.grade().figures() and unit.grade().accel_quantum_m_s > 0.0
    assert "# Not seen: accel_vrw_ug_sqrt_hz above" in grade_text(unit)


@pytest.mark.slow
def test_noise_that_vibration_hides_is_not_written_as_measured():
    """The accelerometers get the noise of the assumed class; the gyros, which are not disturbed, theirs."""
    rates = unit_rates(np.random.default_rng(2), 40000)
    rates[:, 4] += 0.02 * np.sin(2.0 * np.pi * 0.8 * np.arange(40000) / RATE)
    unit = insenv.allan(log_of(rates))
    grade, text = unit.grade(), grade_text(unit)
    assert grade.gyro_arw_deg_sqrt_h == pytest.approx(np.degrees(1e-4) * 60.0, rel=0.05)
    assert re.search(r"^gyro_arw_deg_sqrt_h = .*# measured, ", text, re.MULTILINE)
    assert not re.search(r"^accel_.*# measured", text, re.MULTILINE)
    assert "# Not trusted, and so the noise of the accelerometers is assumed too: accel y: the noise terms" in text
    assert grade.parameters()["velocity_random_walk"] == pytest.approx(unit.assumed.parameters()["velocity_random_walk"])
    assert not any(key.startswith("accel") for key in grade.sources)
    assert [each["trusted"] for each in unit.as_json()["triads"]] == [True, False]


def test_samples_that_show_no_noise_are_not_written_as_without_noise():
    """A gyro whose noise is below its resolution, or one that is switched off."""
    rates = unit_rates(np.random.default_rng(1), 6000)
    rates[:, :3] = [0.0, 0.0, 1e-4]
    unit = insenv.allan(log_of(rates))
    assert unit.grade().gyro_arw_deg_sqrt_h == unit.assumed.gyro_arw_deg_sqrt_h > 0.0
    assert "# Not trusted, and so the noise of the gyros is assumed too: the samples are constant" in grade_text(unit)

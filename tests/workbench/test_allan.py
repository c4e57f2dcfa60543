"""`insenv allan`: the Allan deviation and its fit against noise of known figures, its warnings, and the grade file."""

import io
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, refused, strict
from rich.console import Console
from scipy.signal import lfilter

import insenv
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.logs import RecordedLog
from insenv.logs.description import LogDescription
from insenv.logs.inertial import Gaps
from insenv.scenario import build
from insenv.sensors import IMU_GRADES
from insenv.sensors.grade_file import grade_of, toml_text
from insenv.workbench.allan import AXES, SCALES, sensor_noise
from insenv.workbench.allan_deviation import curve
from insenv.workbench.allan_report import grade_text, tables
from insenv.workbench.noise_terms import FLICKER, MARKOV, QUANTIZATION, TIME, WALK, WHITE, fit, markov_variance

RATE = 20.0
IMU = {
    "file": "none", "time": 0, "gyro": [1, 2, 3], "accel": [4, 5, 6], "kind": "rate", "stamp": "interval_end",
    "gyro_unit": "rad/s", "accel_unit": "m/s2", "axes": "FRD",
}  # fmt: skip


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
    description = LogDescription.model_validate({"title": title, "imu": {**IMU, **imu}})
    empty = {"gnss": None, "lever_arm_b": np.zeros(3), "reference": None, "sources": (), "notes": ()}
    return RecordedLog(
        imu_time=np.arange(1, count + 1) * interval,
        delta_angle=rates[:, :3] * interval,
        delta_velocity=rates[:, 3:] * interval,
        dt=dt,
        bridged=np.zeros(count, bool),
        gaps=Gaps(),
        description=description,
        **empty,
    )


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


def test_markov_variance_by_its_spectrum():
    """Against the numerical integral of the spectrum of IEEE Std 952, eq. C.3, and where the closed form cancels."""
    frequency = np.geomspace(1e-7, 1e4, 400001)
    for tau in (1.0, 30.0, 300.0, 3000.0):
        power = 4.0 * 300.0 / (1.0 + (2.0 * np.pi * frequency * 300.0) ** 2)
        window = 2.0 * np.sin(np.pi * frequency * tau) ** 4 / (np.pi * frequency * tau) ** 2
        value = np.trapezoid(power * window * frequency, np.log(frequency))
        assert float(markov_variance(np.array(tau), 300.0)) == pytest.approx(value, rel=2e-3)
    small = markov_variance(np.array([0.2999, 0.3001]), 300.0)
    assert small[1] / small[0] == pytest.approx(0.3001 / 0.2999, rel=1e-5)


CASES = {
    "white": ({WHITE: 0.2}, (WHITE,)),
    "walk": ({WHITE: 0.12, WALK: 0.02}, (WHITE, WALK)),
    "counts": ({WHITE: 1.0, QUANTIZATION: 0.15 / 12**0.5}, (WHITE, QUANTIZATION)),
    "bias": ({WHITE: 2.0, MARKOV: 3.0, TIME: 100.0}, (WHITE, MARKOV, TIME)),
}


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


@pytest.mark.parametrize(("seed", "time"), [(4, 500.0), (3, 2000.0)])
def test_a_slow_bias_that_a_log_cannot_tell_from_a_walk_has_no_upper_bound(seed, time):
    """Up to the longest time the fit follows a walk without end; past it, it is worse for no reason of the curve."""
    generator = np.random.default_rng(seed)
    found = fit(curve(white(generator, 20000, 0.1) + markov(generator, 20000, 3.0, time), 1.0 / RATE)).figures
    if time == 500.0 or MARKOV in found:
        assert np.isinf(found[TIME].high) and np.isinf(found[MARKOV].high)
        assert 0.0 < found[MARKOV].low < 3.0 and 0.0 < found[TIME].low < time
    else:
        assert found[WALK].low <= 3.0 * np.sqrt(2.0 / time) <= found[WALK].high


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


# --- the catalogue -------------------------------------------------------------------------------------


def simulated(grade, seed, duration_s=7200.0, rate=50.0):
    """Rates (n, 6) of a unit of a grade at rest."""
    table = insenv.load("static-ecef").model_dump(mode="json")
    table |= {"duration_s": duration_s, "rate_hz": rate, "imu": {"grade": grade}}
    plant = build(insenv.load(table), seed=seed)
    runner = make_runner(plant.model, plant.parameters)
    shown, part = [], 20000
    for _ in range(plant.samples // part):
        rows = plant.model.outputs.unpack(runner.run(part))
        shown.append(np.hstack([rows["delta_angle"], rows["delta_velocity"]]) * rate)
    return np.concatenate(shown)


def measured(grade, seed):
    """The unit, whose white noise is within 10 % of the grade's, and whether each bound of its biases holds the truth."""
    unit, held = insenv.allan(log_of(simulated(grade, seed), 50.0)), []
    rows = IMU_GRADES[grade].parameters()
    for triad in unit.triads:
        kind = triad.kind
        density = rows["angle_random_walk" if kind == "gyro" else "velocity_random_walk"]
        sigma, time = rows[f"{kind}_instability_sigma"], rows[f"{kind}_instability_time"]
        if not np.any(density):
            assert triad.terms is None and f"{kind} x" in str(unit.warnings)
            continue
        figures = triad.terms.figures
        assert figures[WHITE].value == pytest.approx(float(density), rel=0.1)
        assert QUANTIZATION not in figures
        walk = sigma * np.sqrt(2.0 / time)  # what such a bias is over times much shorter than its correlation time
        if not sigma:
            held.append(not triad.terms.slow)
        elif MARKOV in figures:
            held.append(figures[MARKOV].low <= sigma <= figures[MARKOV].high)
            held.append(figures[TIME].low <= time <= figures[TIME].high)
        elif WALK in figures:
            held.append(figures[WALK].low <= walk <= figures[WALK].high)
        else:
            held.append(FLICKER not in figures and walk <= triad.terms.upper[WALK])
    return unit, held


@pytest.mark.slow
def test_every_grade_of_the_catalogue_comes_back():
    found = {grade: measured(grade, 1) for grade in IMU_GRADES}
    known = [one for _, each in found.values() for one in each]
    assert len(known) > 20
    assert np.count_nonzero(np.logical_not(known)) <= 4, found  # of 30 bounds of 95 %, more than 4 fail in 2 % of the cases
    unit = found["industrial"][0]
    grade = unit.grade()
    assert not unit.warnings and grade.gyro_arw_deg_sqrt_h == pytest.approx(0.3, rel=0.02)
    # of a bias of 300 s, 2 h show 24 correlation times: 20 % for each axis, 12 % for three
    assert grade.gyro_instability_deg_h == pytest.approx(6.25, rel=0.4)
    assert grade.accel_instability_ug == pytest.approx(100.0, rel=0.4)
    assert np.mean([one for seed in range(10, 18) for one in measured("industrial", seed)[1]]) >= 0.8


# --- warnings and refusals -----------------------------------------------------------------------------


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


def vibrating(generator):
    rates = unit_rates(generator, 40000)
    rates[:, 4] += 0.02 * np.sin(2.0 * np.pi * 0.8 * np.arange(40000) / RATE)
    return rates


def test_vibration_is_told_of_the_axis_that_vibrates():
    rates = vibrating(np.random.default_rng(2))
    assert any("do not explain" in warning for warning in sensor_noise("accel y", rates[:, 4], 1.0 / RATE).warnings)
    assert not sensor_noise("gyro y", rates[:, 1], 1.0 / RATE).warnings


def test_a_low_pass_filter_is_recognised_and_left_out():
    generator = np.random.default_rng(2)
    noise = lfilter([0.2], [1.0, -0.8], white(generator, 100000, 1e-4, 100.0))
    found = sensor_noise("gyro x", noise, 0.01)
    assert "filtered" in found.warnings[0]
    assert found.terms.figures[WHITE].value == pytest.approx(1e-4, rel=0.05)


@pytest.mark.slow
def test_repeated_and_missing_samples_are_told():
    rates = np.repeat(unit_rates(np.random.default_rng(2), 20000), 2, axis=0)
    assert any("repeat the one before" in warning for warning in insenv.allan(log_of(rates)).warnings)
    log = log_of(unit_rates(np.random.default_rng(2), 20000))
    bridged = np.zeros(20000, bool)
    bridged[::50] = True
    assert any("interpolated" in warning for warning in insenv.allan(replace(log, bridged=bridged)).warnings)


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
    for given, message in (
        ({}, "no 10 s without motion"),
        ({"from_s": 10.0, "to_s": 12.0}, "allowed is 1000 samples and 10 s"),
        ({"from_s": 10.0, "to_s": 2.0}, "ends after it begins"),
    ):
        with pytest.raises(InputError, match=message):
            insenv.allan(log, **given)
    found = insenv.allan(log, from_s=100.0, to_s=200.0)
    assert "the vehicle moves" in found.warnings[0]
    told, grade = " ".join(str(line) for line in tables(found)), grade_text(found)
    assert "100 s in motion from 100 s on" in told and "without motion" not in told
    assert "100 s in motion of" in grade and "# measured" not in grade


# --- the grade file ------------------------------------------------------------------------------------


def test_a_grade_file_holds_a_grade(tmp_path):
    for grade in IMU_GRADES.values():
        (tmp_path / "unit.toml").write_text(toml_text(grade), encoding="utf-8")
        found = grade_of(str(tmp_path / "unit.toml"))
        assert (found.name, found.title, found.sources) == ("unit", grade.title, grade.sources)
        for row, value in grade.parameters().items():
            assert np.allclose(found.parameters()[row], value, rtol=1e-5), row


SCENARIO = (
    'title = "t"\nduration_s = 5.0\n[start]\nlatitude_deg = 45.0\nlongitude_deg = 0.0\n[vehicle]\nkind = "car"\n'
    '[imu]\ngrade = "unit.toml"\n'
)


def test_a_grade_file_beside_a_scenario(tmp_path):
    grade = IMU_GRADES["tactical"]
    (tmp_path / "unit.toml").write_text(toml_text(grade), encoding="utf-8")
    (tmp_path / "s.toml").write_text(SCENARIO, encoding="utf-8")
    scenario = insenv.load(tmp_path / "s.toml")
    rows = scenario.imu.rows(200.0)
    assert rows["angle_random_walk"] == pytest.approx(grade.parameters()["angle_random_walk"])
    (tmp_path / "unit.toml").unlink()  # from here on the scenario holds the figures
    assert pickle.loads(pickle.dumps(scenario)).imu.rows(200.0)["accel_range"] == rows["accel_range"]
    own = scenario.model_dump(mode="json")
    own["imu"]["accel_vrw_ug_sqrt_hz"] = 20.0  # another way to state the noise replaces the one of the file
    assert insenv.load(own).imu.rows(200.0)["velocity_random_walk"] == pytest.approx(20 * 9.80665e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "s.toml: imu.grade: .*unit.toml: file not found"),
        ("", "the file is empty"),
        ("gyro_arw_deg_sqrt_h = 0.1", "title is missing"),
        ('title = "x"\ngyro_arw_deg_h = 0.1', "gyro_arw_deg_h: unknown key; did you mean 'gyro_"),
        ('title = "x"\nfoo = 1\nbar = 2', "unit.toml: foo: unknown key(.|\n)*unit.toml: bar: unknown key"),
        ('title = "x"\ngyro_arw_deg_sqrt_h = -0.1', "gyro_arw_deg_sqrt_h = -0.1 .deg/sqrt.h..: must be greater"),
        ('title = "x"\naccel_white_ug = 1.0\naccel_vrw_ug_sqrt_hz = 1.0', "describe the same noise"),
    ],
)
def test_a_wrong_grade_file_is_refused(text, message, tmp_path):
    if text is not None:
        (tmp_path / "unit.toml").write_text(text, encoding="utf-8")
    (tmp_path / "s.toml").write_text(SCENARIO, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        insenv.load(tmp_path / "s.toml")


LOG = (
    'title = "a rest"\n[imu]\nfile = "rest.csv"\n'
    'time = "t"\ngyro = ["gx", "gy", "gz"]\naccel = ["ax", "ay", "az"]\nkind = "rate"\n'
    'stamp = "interval_end"\ngyro_unit = "rad/s"\naccel_unit = "m/s2"\naxes = "FRD"\n'
)


@pytest.fixture
def rest(tmp_path, monkeypatch):
    """A function that makes a working directory with rest.toml, the log of a unit at rest with these rates."""

    def made(rates, rate):
        table = np.column_stack([np.arange(1, len(rates) + 1) / rate, rates])
        np.savetxt(tmp_path / "rest.csv", table, delimiter=",", header="t,gx,gy,gz,ax,ay,az", comments="", fmt="%.9g")
        (tmp_path / "rest.toml").write_text(LOG, encoding="utf-8")
        monkeypatch.chdir(tmp_path)
        return tmp_path

    return made


def test_the_command(rest):
    folder = rest(unit_rates(np.random.default_rng(2), 2000, rate=50.0), 50.0)
    status, out, _ = call("allan", "rest.toml", "--grade", "unit.toml", "--out", "out")
    assert status == 0 and "only the noise is measured; all else is assumed" in out
    assert {path.name for path in (folder / "out").iterdir()} == {"allan.json", "unit.toml", "allan.png", "allan.svg"}
    found = strict((folder / "out" / "allan.json").read_text("utf-8"))
    assert [axis["name"] for axis in found["axes"]] == list(AXES)
    assert found["axes"][0]["arw_deg_sqrt_h"] == pytest.approx(np.degrees(1e-4) * 60.0, rel=0.1)
    assert found["axes"][3]["vrw_ug_sqrt_hz"] == pytest.approx(1e-3 / 9.80665e-6, rel=0.1)
    low, high = found["axes"][0]["confidence"]["arw_deg_sqrt_h"]
    assert low < np.degrees(1e-4) * 60.0 < high
    assert found["axes"][0]["bias_instability"] is None and found["axes"][0]["unit"] == "deg/h"
    listed = strict(call("list", "grades", "--json")[1])["imu_grades"]
    assert {"name": "unit.toml", "title": "Unit of rest.toml"} in listed
    (folder / "rest.toml").write_text(LOG + 'grade = "unit.toml"\n', encoding="utf-8")
    log = insenv.logs.load("rest.toml")
    assert log.sensors(in_place=True).angle_random_walk == pytest.approx(1e-4, rel=0.1)
    refused(call("allan", "rest.toml", "--grade", "unit.txt"), "unit.txt", "ends in .toml")
    refused(call("allan", "none.toml"), "file not found")
    refused(call("allan", "rest.toml", "--from", "5", "--to", "1"), "ends after it begins")
    refused(call("allan", "ship-swaying"), "a scenario, not a recorded log")


def printed(found):
    console = Console(file=io.StringIO(), width=80)
    for part in tables(found):
        console.print(part)
    return console.file.getvalue()


@pytest.mark.slow
def test_what_is_printed_explains_what_stands_there_and_no_more():
    text = printed(insenv.allan(log_of(unit_rates(np.random.default_rng(1), 6000))))
    assert "not seen: flicker below" in text and "±: half" in text
    assert not any(word in text for word in ("brackets", "lowest", "Gauss-Markov"))
    generator = np.random.default_rng(2)
    rates = unit_rates(generator, 60000, arw=1e-5)
    rates[:, :3] += np.stack([np.cumsum(white(generator, 60000, 3e-5)) / RATE for _ in range(3)], axis=1)
    text = printed(insenv.allan(log_of(rates)))
    assert re.search(r"walk [\d.]+ \[[\d.]+, [\d.]+\] deg/h/sqrt\(h\) +[\d.]+\n", text), text
    assert "walk: a random walk of the bias; in brackets: 95 % bounds" in text and "lowest (deg/h, ug): " in text
    assert "…" not in text and "Gauss-Markov" not in text


def test_scales_name_figures():
    assert {key for kind in SCALES.values() for key, _ in kind.values()} <= set(insenv.sensors.ImuGrade.__dataclass_fields__)


# --- figures that are not measured ---------------------------------------------------------------------


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
    assert re.search(r"^accel, all +not seen: below ", printed(unit), re.MULTILINE)


@pytest.mark.slow
def test_noise_that_vibration_hides_is_not_written_as_measured():
    """The accelerometers get the noise of the assumed class; the gyros, which are not disturbed, theirs."""
    unit = insenv.allan(log_of(vibrating(np.random.default_rng(2))))
    grade, text, shown = unit.grade(), grade_text(unit), printed(unit)
    assert grade.gyro_arw_deg_sqrt_h == pytest.approx(np.degrees(1e-4) * 60.0, rel=0.05)
    assert re.search(r"^gyro_arw_deg_sqrt_h = .*# measured, ", text, re.MULTILINE)
    assert not re.search(r"^accel_.*# measured", text, re.MULTILINE)
    assert "# Not trusted, and so the noise of the accelerometers is assumed too: accel y: the noise terms" in text
    assert grade.parameters()["velocity_random_walk"] == pytest.approx(unit.assumed.parameters()["velocity_random_walk"])
    assert not any(key.startswith("accel") for key in grade.sources)
    rows = {line.split("  ")[0]: line for line in shown.splitlines() if "not trusted" in line}
    assert {"accel y", "accel, all"} <= set(rows) and not {"gyro x", "gyro, all", "accel x"} & set(rows)
    assert "[" not in rows["accel y"] and "±" not in rows["accel y"]
    assert [each["trusted"] for each in unit.as_json()["triads"]] == [True, False]


def test_samples_that_show_no_noise_are_not_written_as_without_noise():
    """A gyro whose noise is below its resolution, or one that is switched off."""
    rates = unit_rates(np.random.default_rng(1), 6000)
    rates[:, :3] = [0.0, 0.0, 1e-4]
    unit = insenv.allan(log_of(rates))
    assert unit.grade().gyro_arw_deg_sqrt_h == unit.assumed.gyro_arw_deg_sqrt_h > 0.0
    assert "# Not trusted, and so the noise of the gyros is assumed too: the samples are constant" in grade_text(unit)
    assert "trusted" not in printed(unit) and "constant" in printed(unit)


@pytest.mark.slow
def test_the_command_says_what_is_not_measured(rest):
    rest(vibrating(np.random.default_rng(2)), RATE)
    out = call("allan", "rest.toml", "--grade", "unit.toml")[1]
    assert "only the noise of the gyros is measured, that of the accelerometers is not trusted; all else is assumed" in out

"""Text logs as people have them: irregular stamps, held fixes, text for missing values, files with other rows, speed and
course, attitude alone; and all faults of a description at once."""

from __future__ import annotations

import numpy as np
import pytest
from text_logs import Folder, N, as_text, gnss_rows, imu_rows, si

from insenv import replay
from insenv.logs.repeats import repeats
from insenv.logs.sampling import sampling

HEADER = "t,gx,gy,gz,ax,ay,az"


# --- faults of keys and of files ---


def test_wrong_keys_do_not_hide_wrong_columns(folder: Folder) -> None:
    folder.change('kind = "rate"', 'kind = "foo"')
    folder.change('gyro = ["gx"', 'gyro = ["gq"')
    folder.change('position_unit = "deg"', 'position_unit = "grad"')
    folder.change('height = "h"', 'height = "hgt"')
    error = folder.error()
    for part in ("imu.kind = 'foo'", "no column 'gq'", "gnss.position_unit = 'grad'", "no column 'hgt'"):
        assert part in error, part


def test_wrong_values_of_different_columns_are_all_named(folder: Folder) -> None:
    folder.line("gnss.csv", 2, "10.5,123,-93,210,0.5,1,1.5")
    folder.line("gnss.csv", 3, "11.5,45,-93,210,-0.5,1,1.5")
    error = folder.error()
    assert "line 2, column 'lat': latitude is 123 deg" in error and "line 3, column 'sn': standard deviation is -0.5 m" in error


def test_an_evaluation_that_ends_before_it_begins(folder: Folder) -> None:
    folder.toml += "\n[evaluation]\nfrom_s = 900\nto_s = 1\n"
    assert "evaluation.to_s = 1 [s]: must be after from_s = 900 s" in folder.error()


# --- irregular sampling ----------------------------------------------------------------------------


def at_times(time: np.ndarray) -> np.ndarray:
    rows = imu_rows(len(time))
    rows[:, 0] = time
    return rows


def test_irregular_steps_are_no_gaps(folder: Folder) -> None:
    """Steps of 4 to 36 ms, as of a phone: every sample covers the time since the one before, and none is invented."""
    time = 10.0 + np.cumsum(np.random.default_rng(2).uniform(0.004, 0.036, N))
    folder.write("imu.csv", as_text(at_times(time), HEADER))
    log = folder.load()
    assert log.gaps.count == 0 and len(log.imu_time) == N
    np.testing.assert_allclose(log.dt[1:], np.diff(time), atol=1e-9)
    np.testing.assert_allclose(log.delta_angle[1:], si(imu_rows())[0][1:] * np.diff(time)[:, None], rtol=1e-6, atol=1e-9)
    assert any("irregular time stamps" in note for note in log.notes)


def test_a_gap_among_irregular_steps_is_bridged(folder: Folder) -> None:
    time = 10.0 + np.cumsum(np.random.default_rng(2).uniform(0.004, 0.036, N))
    time[60:] += 0.4
    folder.write("imu.csv", as_text(at_times(time), HEADER))
    log = folder.load()
    assert log.gaps.count == 1 and log.gaps.samples == pytest.approx(20, abs=8)
    folder.change("[imu]", "[imu]\nmax_gap_s = 0.2")
    assert "no samples between" in folder.error()


def merged(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Increments at rest at 100 Hz, and the same added up over `counts` samples (k,), rows (k, 7) in SI."""
    total = int(counts.sum())
    noise = np.random.default_rng(5).normal(size=(total, 6)) * [1e-5] * 6
    full = np.column_stack([0.01 * np.arange(1, total + 1), noise + [0, 0, 0, 0, 0, -0.0980665]])
    last = np.cumsum(counts)
    sums = np.add.reduceat(full[:, 1:], np.concatenate([[0], last[:-1]]), axis=0)
    return full, np.column_stack([full[last - 1, 0], sums])


@pytest.mark.parametrize(("share", "longest"), [(0.3, 2), (0.8, 4)], ids=["regular", "irregular"])
def test_merged_increments_cover_their_time_and_show_the_rest(folder: Folder, share: float, longest: int) -> None:
    """Nothing is invented beside an increment of two samples, and the first, of unknown length, does not hide the rest."""
    rng = np.random.default_rng(3)
    counts = np.where(rng.random(3000) < share, rng.integers(2, longest + 1, 3000), 1)
    counts[0] = 2
    full, rows = merged(counts)
    folder.write("imu.csv", as_text(rows, HEADER))
    folder.hold_increments("rad")
    log = folder.load()
    assert log.gaps.count == 0 and len(log.imu_time) == len(rows) - 1
    np.testing.assert_allclose(log.dt, 0.01 * counts[1:], atol=1e-9)
    np.testing.assert_allclose(log.delta_velocity.sum(axis=0), full[2:, 4:].sum(axis=0), atol=1e-9)
    until = log.description.initial.static_until_s
    assert until is not None and full[-1, 0] - 3.0 < until <= full[-1, 0]  # whole windows of a hundred samples


def test_lost_increments_are_still_bridged(folder: Folder) -> None:
    full, _ = merged(np.ones(3000, dtype=int))
    keep = np.random.default_rng(3).random(3000) > 0.1
    keep[:2] = keep[-1] = True
    folder.write("imu.csv", as_text(full[keep], HEADER))
    folder.hold_increments("rad")
    log = folder.load()
    assert log.gaps.samples == np.count_nonzero(~keep) and len(log.imu_time) == 3000
    assert log.delta_velocity[:, 2].sum() == pytest.approx(-0.0980665 * 3000, rel=1e-3)


def test_bursts_and_alternating_steps_are_no_gaps() -> None:
    bursts = np.concatenate([k * 0.1 + np.arange(16) * 1e-3 for k in range(50)])
    alternating = np.cumsum(np.tile([0.005, 0.015], 200))
    for time in (bursts, alternating):
        found = sampling(time, None)
        assert found.gap_s is not None and found.missing(time).sum() == 0


def test_a_regular_log_that_loses_samples_stays_regular() -> None:
    draw = np.random.default_rng(5)
    for share in (0.0, 0.02, 0.1):
        kept = np.flatnonzero(draw.random(2000) >= share)
        time = (kept + draw.uniform(-0.1, 0.1, kept.size)) / 100.0
        found = sampling(time, None)
        assert found.gap_s is None and found.missing(time).sum() == kept[-1] - kept[0] + 1 - kept.size


# --- fixes that are held ---------------------------------------------------------------------------


def held_rows(seconds: float = 40.0) -> tuple[np.ndarray, np.ndarray]:
    """Rows at 50 Hz that hold a receiver's values of 1 Hz, and the seconds at which they change; the last 10 s stand still."""
    time = 10.0 + np.arange(1, round(seconds * 50) + 1) / 50
    epoch = np.minimum(np.floor(time + 1e-9), 10.0 + seconds - 10.0)
    return np.column_stack([time, 45 + 1e-5 * epoch, np.full(time.size, -93.0), np.full(time.size, 200.0)]), np.unique(epoch)


def test_a_value_that_is_repeated_at_the_inertial_rate_is_one_fix(folder: Folder) -> None:
    rows, epochs = held_rows()
    imu = imu_rows(len(rows))
    folder.write("imu.csv", as_text(np.column_stack([imu, rows[:, 1:]]), HEADER + ",lat,lon,h"))
    folder.change('file = "gnss.csv"', 'file = "imu.csv"')
    folder.change('position_sigma = ["sn", "se", "sd"]', "position_sigma_m = [1.0, 1.0, 2.0]")
    log = folder.load()
    assert log.gnss is not None and len(log.gnss.time) == len(epochs)
    np.testing.assert_allclose(np.diff(log.gnss.time[1:]), 1.0, atol=0.021)
    assert any("2000 rows repeat 31 fixes, each about 50 times: a fix counts once" in note for note in log.notes)


def test_a_receiver_at_rest_that_states_the_same_place_is_not_repeating() -> None:
    time = np.arange(0.0, 60.0, 1.0)
    place = np.where(time < 30, 0.0, time - 30)[:, None] * [1e-5, 1e-5, 0.0]
    assert repeats(time, place) is None
    assert repeats(time, np.ones((60, 3))) is None  # at rest all the time
    fast = repeats(np.arange(0.0, 10.0, 0.01), np.ones((1000, 3)))  # a receiver of 100 Hz does not state the same for 10 s
    assert fast is not None and fast.rows.tolist() == [0]


def test_the_last_fix_before_an_outage_is_one_fix() -> None:
    """Thirty seconds of the same row: they were thirty fixes, each later and more wrong than the one before."""
    time = np.arange(0.0, 100.0, 0.01)
    epoch = np.floor(time)
    epoch[(time >= 40) & (time < 70)] = 40.0
    found = repeats(time, epoch[:, None] * [1e-5, 2e-5, 0.1])
    assert found is not None
    np.testing.assert_allclose(time[found.rows], np.unique(epoch), atol=1e-9)


# --- missing values --------------------------------------------------------------------------------


def test_text_for_missing_values_can_be_skipped(folder: Folder) -> None:
    lines = as_text(imu_rows()).splitlines()
    words = ["nan,nan,nan", ",,", "NaN,-93,200", "null,null,null", "45,-93,n/a"]
    text = ["t,gx,gy,gz,ax,ay,az,lat,lon,h"]
    text += [line + ("," + ("45,-93,200" if k % 25 == 0 else words[k % len(words)])) for k, line in enumerate(lines)]
    folder.write("imu.csv", "\n".join(text) + "\n")
    folder.change('file = "gnss.csv"', 'file = "imu.csv"\nskip_empty = true')
    folder.change('position_sigma = ["sn", "se", "sd"]', "position_sigma_m = [1.0, 1.0, 2.0]")
    log = folder.load()
    assert log.gnss is not None and len(log.gnss.time) == 4 and len(log.imu_time) == N
    folder.change("skip_empty = true", "skip_empty = false")
    assert "skip_empty = true skips such rows" in folder.error()


# --- files with other rows -------------------------------------------------------------------------


def split_files(folder: Folder, accel_rows: np.ndarray) -> None:
    folder.write("gyro.csv", as_text(imu_rows()[:, :4], "t,gx,gy,gz"))
    folder.write("accel.csv", as_text(accel_rows, "t,ax,ay,az"))
    folder.change('file = "imu.csv"', 'file = ["gyro.csv", "accel.csv"]')


def test_files_with_other_rows_are_joined_by_time(folder: Folder) -> None:
    whole = folder.load()
    split_files(folder, imu_rows()[[*range(0, 40), *range(41, N)]][:, [0, 4, 5, 6]])
    log = folder.load()
    assert len(log.imu_time) == N and log.gaps.samples == 1  # the row that one of them lacks
    np.testing.assert_allclose(np.delete(log.delta_velocity, 40, axis=0), np.delete(whole.delta_velocity, 40, axis=0))
    assert any(f"imu: joined by time: {N - 1} rows have the same time" in note for note in log.notes)


def test_rates_at_other_times_are_interpolated(folder: Folder) -> None:
    """An accelerometer of 200 Hz beside a gyro of 50 Hz; over its gap nothing is interpolated."""
    t = 10.0013 + np.arange(0, 8 * N) / 400
    accel = np.column_stack([t, 0.1 * np.cos(t), 0.2 * np.sin(t), -1.0 + 0.01 * np.cos(2 * t)])
    whole = folder.load()
    split_files(folder, accel)
    log = folder.load()
    same = np.isin(np.round(whole.imu_time, 6), np.round(log.imu_time, 6))
    np.testing.assert_allclose(log.delta_velocity, whole.delta_velocity[same], atol=2e-6)
    assert same.sum() > N - 3 and any("interpolated at the" in note for note in log.notes)
    folder.write("accel.csv", as_text(accel[(t < 10.5) | (t > 10.7)], "t,ax,ay,az"))
    assert folder.load().gaps.samples == pytest.approx(10, abs=1)
    folder.change('kind = "rate"', 'kind = "increment"')
    folder.change('gyro_unit = "deg/s"', 'gyro_unit = "deg"')
    folder.change('accel_unit = "g"', 'accel_unit = "m/s"')
    assert "joined files must have the same clock and the same times" in folder.error()


# --- speed and course ------------------------------------------------------------------------------


def test_speed_and_course(folder: Folder) -> None:
    """Knots and degrees; no course at rest, no course under way; the vertical velocity is unknown."""
    rows = gnss_rows()
    motion = ["10,90", "0.2,", "8,nan"]
    text = [",".join(f"{v:.12g}" for v in row) + f",{m}" for row, m in zip(rows, motion, strict=True)]
    folder.write("gnss.csv", "\n".join(["t,lat,lon,h,sn,se,sd,speed,course", *text]) + "\n")
    folder.change("[gnss]", '[gnss]\nspeed = "speed"\nspeed_unit = "kn"\ncourse = "course"\nspeed_sigma_mps = 0.1')
    gnss = folder.load().gnss
    assert gnss is not None and gnss.velocity_n is not None and gnss.velocity_sigma is not None and len(gnss.time) == 3
    np.testing.assert_allclose(gnss.velocity_n[0], [0.0, 18520 / 3600, 0.0], atol=1e-9)
    np.testing.assert_allclose(gnss.velocity_n[1:], 0.0)
    np.testing.assert_allclose(gnss.velocity_sigma[:, 0], [0.1, np.hypot(0.1, 0.2 * 1852 / 3600), 100.0])
    np.testing.assert_allclose(gnss.velocity_sigma[:, 2], 100.0)
    folder.change("speed_sigma_mps = 0.1", "")
    assert "speed needs either speed_sigma" in folder.error()
    folder.change('course = "course"\n', "")
    assert "speed and course go together" in folder.error()
    folder.change(
        '[gnss]\nspeed = "speed"\nspeed_unit = "kn"', '[gnss]\nspeed = "speed"\ncourse = "course"\nspeed_sigma_mps = 1.0'
    )
    folder.write("gnss.csv", (folder.path / "gnss.csv").read_text().replace("10,90", "-10,90"))
    assert "speed is -10, must be from 0 up" in folder.error()


# --- attitude alone --------------------------------------------------------------------------------


def test_a_reference_of_attitude_alone(folder: Folder) -> None:
    folder.write("ref.csv", as_text(np.array([[10.0, 1, 2, 350], [12.5, 1, 2, 350]]), "t,r,p,y"))
    folder.toml += '[reference]\nfile = "ref.csv"\ntime = "t"\nroll = "r"\npitch = "p"\nheading = "y"\nattitude_unit = "deg"\n'
    log = folder.load()
    assert log.reference is not None and log.reference.latitude is None and log.reference.velocity_n is None
    assert np.degrees(log.reference.heading[0]) == pytest.approx(-10.0)
    assert set(replay(log, "analytic").results[0].errors) == {"roll_deg", "pitch_deg", "heading_deg"}
    folder.change('pitch = "p"\n', "")
    assert "roll, pitch, heading and attitude_unit go together; only roll, heading, attitude_unit given" in folder.error()
    folder.change('roll = "r"\nheading = "y"\nattitude_unit = "deg"\n', "")
    assert "give the columns of position, velocity or attitude" in folder.error()


# --- all faults at once ----------------------------------------------------------------------------


def test_all_faults_of_the_keys_are_listed_at_once(folder: Folder) -> None:
    folder.change('title = "test"', 'title = "test"\nstart_s = 5\nstop_s = 4')
    folder.change('kind = "rate"', 'kind = "increment"')
    folder.change('axes = "FRD"', 'axes = "FRX"')
    folder.change('position_sigma = ["sn", "se", "sd"]', 'velocity = ["a", "b", "c"]')
    folder.toml += '[reference]\nfile = "r.csv"\ntime = "t"\nroll = "r"\n[estimator."loosely-coupled"]\nvrw = 1\narw = 2\n'
    message = folder.error()
    for words in (
        "stop_s = 4 [s]: must be after start_s = 5 s",
        "imu.gyro_unit = 'deg/s': does not go",
        "imu.accel_unit = 'g': does not go",
        "imu.axes = 'FRX'",
        "gnss.position_sigma_m: give either",
        "gnss.velocity_sigma_mps: velocity needs either",
        "roll, pitch, heading and attitude_unit go together",
        "estimator.loosely-coupled.vrw: unknown key",
        "estimator.loosely-coupled.arw: unknown key",
        "r.csv: file not found",
    ):
        assert words in message, words
    assert all(line.startswith(str(folder.path)) for line in message.split("\n")) and len(message.split("\n")) == 13


def test_all_faults_of_the_files_are_listed_at_once(folder: Folder) -> None:
    (folder.path / "gnss.csv").unlink()
    folder.change('"gx", "gy"', '"wx", "wy"')
    folder.toml += '[reference]\nfile = ["a.csv", "b.csv"]\ntime = "t"\nvelocity = ["n", "e", "d"]\n'
    message = folder.error()
    for words in (
        "no column 'wx'",
        "no column 'wy'",
        "gnss.csv: file not found",
        "a.csv: file not found",
        "b.csv: file not found",
    ):
        assert words in message, words

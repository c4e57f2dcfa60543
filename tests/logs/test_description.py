"""The description of a log: wrong keys and values, all of them at once, and spans that do not fit its files."""

import pytest

from insenv.errors import InputError
from insenv.logs import load

SIGMA, TITLE = 'position_sigma = ["sn", "se", "sd"]', 'title = "test"'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kind = "rate"', 'kind = "rates"', "imu.kind = 'rates'"),
        ('kind = "rate"\n', "", "imu.kind is missing"),
        ("[imu]", "[imu]\nrate = 3", "imu.rate: unknown key"),
        ("[imu]", "[imu]\nmax_gap_s = 1e9", "imu.max_gap_s = 1000000000.0 [s]"),
        ('axes = "FRD"', 'axes = "FLD"', "imu.axes = 'FLD': the axes are left-handed"),
        ('axes = "FRD"', 'axes = "XYZ"', "imu.axes = 'XYZ': must be three letters"),
        ('axes = "FRD"', "axes = [[1, 0], [0, 1]]", "a mounting matrix must have three rows of three"),
        ('axes = "FRD"', "axes = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]", "orthonormal"),
        ('["gx", "gy", "gz"]', '["gx", "gy"]', "imu.gyro = ['gx', 'gy']"),
        ('["gx", "gy", "gz"]', '["gx", "gy", -1]', "imu.gyro[2] = -1"),
        (SIGMA, "position_sigma_m = [0, 1, 1]", "gnss.position_sigma_m[0] = 0 [m]"),
        (TITLE, f"{TITLE}\nvehicle_kind = 'shop'", "vehicle_kind = 'shop': unknown; did you mean 'ship'?"),
        (TITLE, "title = test", "not valid TOML"),
        ("[gnss]", '[reference]\nfile = "r.csv"\ntime = "t"\n[gnss]', "give the columns of position, velocity or attitude"),
        ("[gnss]", '[gnss]\nspeed = "speed"\nspeed_sigma_mps = 0.1', "speed and course go together"),
        ("[gnss]", "[evaluation]\nfrom_s = 900\nto_s = 1\n[gnss]", "evaluation.to_s = 1 [s]: must be after from_s = 900 s"),
        ("[gnss]", "[gnss]\ntime_offset_s = 100.0", "do not overlap"),
        ("[imu]", "[imu]\nrate_hz = 100.0", "imu.rate_hz = 100 Hz, but the median step"),
        ("[imu]", '[imu]\ntime_unit = "ms"', "50000 Hz: allowed is up to 10000 Hz"),
        (TITLE, f"{TITLE}\nstart_s = 99.0", "no imu rows from start_s = 99 s"),
        ("[gnss]", "[gnss]\nkeep_where = { h = 7 }", "no row is left by gnss.keep_where"),
        ('position_unit = "deg"', 'position_unit = "rad"', "is position_unit = 'rad' right?"),
    ],
)
def test_wrong_keys_and_values(folder, old, new, said):
    folder.change((old, new))
    folder.error(said)


def test_a_description_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="file not found"):
        load(tmp_path / "none.toml")


def test_all_faults_of_the_keys_are_listed_at_once(folder):
    folder.change(
        (TITLE, f"{TITLE}\nstart_s = 5\nstop_s = 4"), ('kind = "rate"', 'kind = "increment"'), ('axes = "FRD"', 'axes = "FRX"'),
        (SIGMA, 'velocity = ["a", "b", "c"]'),
    )  # fmt: skip
    folder.toml += '[reference]\nfile = "r.csv"\ntime = "t"\nroll = "r"\n[estimator."loosely-coupled"]\nvrw = 1\narw = 2\n'
    message = folder.error(
        "stop_s = 4 [s]: must be after start_s = 5 s", "imu.gyro_unit = 'deg/s': does not go",
        "imu.accel_unit = 'g': does not go", "imu.axes = 'FRX'", "gnss.position_sigma_m: give either",
        "gnss.velocity_sigma_mps: velocity needs either", "roll, pitch, heading and attitude_unit go together",
        "estimator.loosely-coupled.vrw: unknown key", "estimator.loosely-coupled.arw: unknown key", "r.csv: file not found",
    )  # fmt: skip
    assert all(line.startswith(str(folder.path)) for line in message.split("\n")) and len(message.split("\n")) == 13


def test_all_faults_of_the_files_are_listed_at_once_with_those_of_the_keys(folder):
    (folder.path / "gnss.csv").unlink()
    folder.change(('"gx", "gy"', '"wx", "wy"'), ('kind = "rate"', 'kind = "foo"'))
    folder.toml += '[reference]\nfile = ["a.csv", "b.csv"]\ntime = "t"\nvelocity = ["n", "e", "d"]\n'
    files = [f"{name}.csv: file not found" for name in ("gnss", "a", "b")]
    folder.error("no column 'wx'", "no column 'wy'", "imu.kind = 'foo'", *files)

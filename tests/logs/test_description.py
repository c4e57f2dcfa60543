"""Wrong keys and values of the description of a log, and spans that do not fit its files."""

import pytest


@pytest.mark.parametrize(("old", "new", "said"), [
    ('axes = "FRD"', 'axes = "FLD"', "imu.axes = 'FLD': the axes are left-handed"),
    ('axes = "FRD"', "axes = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]", "orthonormal"),
    ('position_sigma = ["sn", "se", "sd"]', "position_sigma_m = [0, 1, 1]", "gnss.position_sigma_m[0] = 0 [m]"),
    ("[gnss]", '[reference]\nfile = "r.csv"\ntime = "t"\n[gnss]', "give the columns of position, velocity or attitude"),
    ("[gnss]", '[gnss]\nspeed = "speed"\nspeed_sigma_mps = 0.1', "speed and course go together"),
    ("[gnss]", "[gnss]\ntime_offset_s = 100.0", "do not overlap"),
    ("[gnss]", "[gnss]\nwander_sigma_m = 5.0", "wander_sigma_m = 5 m north: allowed is up to position_sigma, 0.5 m"),
    ("[imu]", "[imu]\nrate_hz = 100.0", "imu.rate_hz = 100 Hz, but the median step"),
    ("[imu]", '[imu]\ntime_unit = "ms"', "50000 Hz: allowed is up to 10000 Hz"),
    ('position_unit = "deg"', 'position_unit = "rad"', "is position_unit = 'rad' right?"),
])  # fmt: skip
def test_wrong_keys_and_values(folder, old, new, said):
    folder.change((old, new))
    folder.error(said)


def test_all_faults_of_the_files_are_listed_at_once_with_those_of_the_keys(folder):
    (folder.path / "gnss.csv").unlink()
    folder.change(('"gx", "gy"', '"wx", "wy"'), ('kind = "rate"', 'kind = "foo"'))
    folder.toml += '[reference]\nfile = ["a.csv", "b.csv"]\ntime = "t"\nvelocity = ["n", "e", "d"]\n'
    files = [f"{name}.csv: file not found" for name in ("gnss", "a", "b")]
    folder.error("no column 'wx'", "no column 'wy'", "imu.kind = 'foo'", *files)

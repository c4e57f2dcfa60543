"""Arrays of NumPy as the files of a log."""

import numpy as np
from text_logs import imu_rows


def test_a_matrix_an_archive_and_a_structured_array(folder):
    rows, expected = imu_rows(), folder.load()
    np.save(folder.path / "imu.npy", rows.T)  # on its side
    folder.change(
        ('"imu.csv"', '"imu.npy"'), ('"t"', "0"), ('["gx", "gy", "gz"]', "[1, 2, 3]"), ('["ax", "ay", "az"]', "[4, 5, 6]")
    )
    np.testing.assert_allclose(folder.load().delta_velocity, expected.delta_velocity, rtol=1e-8, atol=1e-12)
    at = (rows[:, 0] * 1e9).astype("datetime64[ns]")
    np.savez_compressed(folder.path / "log.npz", at=at, gyro=rows[:, 1:4], accel=rows[:, 4:].T, fixes=np.zeros(3))
    names = [f'["{name}[0]", "{name}[1]", "{name}[2]"]' for name in ("gyro", "accel")]
    folder.change(('"imu.npy"', '"log.npz"'), ("time = 0", 'time = "at"'), ("[1, 2, 3]", names[0]), ("[4, 5, 6]", names[1]))
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, expected.delta_angle, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(log.imu_time, expected.imu_time, rtol=1e-8)
    folder.change(('"accel[2]"', '"fixes"'))
    folder.error("log.npz: column 'fixes' has 3 rows and 'at' has 100: the columns of a section must have the same length")
    folder.change(('"fixes"', '"acc[2]"'))
    folder.error("log.npz: no column 'acc[2]'; did you mean 'accel[2]'?")
    fields = [(name, float) for name in ("t", "gx", "gy", "gz", "ax", "ay", "az")]
    np.save(folder.path / "imu.npy", np.array([tuple(row) for row in rows], dtype=fields))
    folder.toml = type(folder)(folder.path).toml.replace("imu.csv", "imu.npy")
    np.testing.assert_allclose(folder.load().delta_angle, expected.delta_angle, rtol=1e-8, atol=1e-12)


def test_what_is_no_array_of_numbers(folder):
    folder.change(('"imu.csv"', '"imu.npy"'))
    folder.write("imu.npy", b"t,gx\n1,2\n")
    folder.error("imu.npy: not a file of NumPy's save or savez without Python objects")
    np.save(folder.path / "imu.npy", np.array(["a", "b"]))
    folder.error("imu.npy: no vectors or matrices of real numbers")
    rows = imu_rows()
    rows[4, 2] = np.nan
    np.savez(folder.path / "imu.npz", **dict(zip(("t", "gx", "gy", "gz", "ax", "ay", "az"), rows.T, strict=True)))
    folder.change(('"imu.npy"', '"imu.npz"'))
    folder.error("imu.npz: row 5, column 'gy': value is nan, must be a finite number (1 such values in the file); skip_empty")
    folder.change(("[imu]", "[imu]\nskip_empty = true"))
    assert folder.load().gaps.samples == 1

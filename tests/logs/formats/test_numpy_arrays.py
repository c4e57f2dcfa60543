"""Arrays of NumPy as the files of a log."""

import numpy as np
from text_logs import imu_rows


def test_a_matrix_a_structured_array_and_an_archive(folder):
    rows, expected, names = imu_rows(), folder.load(), ("t", "gx", "gy", "gz", "ax", "ay", "az")
    folder.change(('"imu.csv"', '"imu.npy"'))
    np.save(folder.path / "imu.npy", np.array([tuple(row) for row in rows], dtype=[(name, float) for name in names]))
    np.testing.assert_allclose(folder.load().delta_angle, expected.delta_angle, rtol=1e-8, atol=1e-12)
    np.save(folder.path / "imu.npy", rows.T)  # on its side
    folder.change(('"t"', "0"), ('["gx", "gy", "gz"]', "[1, 2, 3]"), ('["ax", "ay", "az"]', "[4, 5, 6]"))
    np.testing.assert_allclose(folder.load().delta_angle, expected.delta_angle, rtol=1e-8, atol=1e-12)
    at = (rows[:, 0] * 1e9).astype("datetime64[ns]")
    rows[4, 2] = np.nan
    np.savez_compressed(folder.path / "log.npz", at=at, w=rows[:, 1:4], f=rows[:, 4:].T, fixes=np.zeros(3))
    columns = [f'["{name}[0]", "{name}[1]", "{name}[2]"]' for name in "wf"]
    folder.change(('"imu.npy"', '"log.npz"'), ("time = 0", 'time = "at"'), ("[1, 2, 3]", columns[0]), ("[4, 5, 6]", columns[1]))
    folder.error("log.npz: row 5, column 'w[1]': value is nan, must be a finite number (1 such values in the file); skip_empty")
    folder.change(("[imu]", "[imu]\nskip_empty = true"))
    np.testing.assert_allclose(folder.load().delta_velocity[5:], expected.delta_velocity[5:], rtol=1e-6, atol=1e-12)
    folder.change(('"f[2]"', '"fixes"'))
    folder.error("log.npz: column 'fixes' has 3 rows and 'at' has 100: the columns of a section must have the same length")
    folder.change(('"fixes"', '"g[2]"'))
    folder.error("log.npz: no column 'g[2]'; did you mean 'w[2]'?")
    folder.write("log.npz", b"t,gx\n1,2\n")
    folder.error("log.npz: not a file of NumPy's save or savez without Python objects")

"""Variables of MATLAB as the files of a log, written by scipy.io."""

import numpy as np
from scipy.io import savemat
from text_logs import imu_rows


def test_vectors_matrices_and_structures_and_what_is_refused(folder):
    rows, expected = imu_rows(), folder.load()
    folder.change(('"imu.csv"', '"log.mat"'), ('["gx", "gy", "gz"]', '["i.w[0]", "i.w[1]", "i.w[2]"]'),
        ('"ax", "ay", "az"', "F"))  # fmt: skip
    folder.change(("F", '"i.f.data[0]", "i.f.data[1]", "i.f.data[2]"'))
    savemat(folder.path / "log.mat", {"t": rows[:, 0], "i": {"w": rows[:, 1:4], "f": {"data": rows[:, 4:].T}}, "note": "a car"})
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, expected.delta_angle, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(log.delta_velocity, expected.delta_velocity, rtol=1e-8, atol=1e-12)
    folder.write("log.mat", b"MATLAB 7.3 MAT-file".ljust(116) + b" " * 8 + b"\x00\x02IM" + bytes(400))
    folder.error("log.mat: a MATLAB file of version 7.3: allowed is one of version 7")
    folder.write("log.mat", b"t,gx\n" * 50)
    folder.error("log.mat: not a MATLAB file, or a damaged one")

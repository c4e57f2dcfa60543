"""Variables of MATLAB as the files of a log, written by scipy.io."""

import numpy as np
import pytest
from scipy.io import savemat
from text_logs import imu_rows


@pytest.mark.parametrize("version", ["4", "5"])
def test_vectors_matrices_and_structures(folder, version):
    rows, expected = imu_rows(), folder.load()
    nested = {"t": rows[:, 0], "imu": {"w": rows[:, 1:4], "f": rows[:, 4:]}, "note": "a car"}
    flat = {"t": rows[:, 0], "w": rows[:, 1:4].T, "f": rows[:, 4:]}
    savemat(folder.path / "log.mat", flat if version == "4" else nested, format=version)
    prefix = "" if version == "4" else "imu."
    names = [f'["{prefix}{name}[0]", "{prefix}{name}[1]", "{prefix}{name}[2]"]' for name in ("w", "f")]
    folder.change(('"imu.csv"', '"log.mat"'), ('["gx", "gy", "gz"]', names[0]), ('["ax", "ay", "az"]', names[1]))
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, expected.delta_angle, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(log.delta_velocity, expected.delta_velocity, rtol=1e-8, atol=1e-12)


def test_other_files_are_refused(folder):
    folder.change(('"imu.csv"', '"log.mat"'))
    folder.write("log.mat", b"MATLAB 7.3 MAT-file".ljust(116) + b" " * 8 + b"\x00\x02IM" + bytes(400))
    folder.error("log.mat: a MATLAB file of version 7.3: allowed is one of version 7")
    folder.write("log.mat", b"t,gx\n" * 50)
    folder.error("log.mat: not a MATLAB file, or a damaged one")

"""Logs of u-blox receivers, written by pyubx2."""

import numpy as np
import pytest
from peers import package

from insenv.base.errors import InputError
from insenv.logs import load

UNIX = 1756402221.0  # 2025-08-28 17:30:21 UTC, GPS time of week 408639 s
FIELDS = {"year": 2025, "month": 8, "day": 28, "hour": 17, "min": 30, "nano": -1000, "fullyResolved": 1}
FIELDS |= {"gnssFixOk": 1, "fixType": 3, "lat": 45.0000123, "lon": -93.5, "height": 200_000, "hAcc": 500, "vAcc": 800}
FIELDS |= {"velN": 1000, "velE": -2000, "velD": 3000, "sAcc": 70}


def message(name, epoch, **fields):
    ubx = package("pyubx2")
    return ubx.UBXMessage("NAV", f"NAV-{name}", ubx.GET, iTOW=408639000 + epoch * 1000, **fields).serialize()


def solution(epoch, **fields):
    return message("PVT", epoch, **{**FIELDS, "second": 21 + epoch, **fields})


def test_the_navigation_solution(folder):
    precise = message("HPPOSLLH", 1, lat=45.0000125, lon=-93.5, height=200_001, hAcc=14.5, vAcc=10.5)
    damaged = bytearray(solution(4))
    damaged[4] ^= 255  # its length covers what follows
    of_fixes = solution(0) + precise + bytes(damaged) + solution(1) + solution(2, fixType=2) + solution(3, fixType=4)
    folder.write("rover.ubx", b"$GNGGA,junk\r\n" + of_fixes)
    of_week = f'[reference]\nfile = "rover.ubx"\ntime = "tow_s"\ntime_offset_s = {9.5 - 408639}\n'
    folder.fixes_in("rover.ubx", 9.5 - UNIX, of_week)
    loaded = folder.load()
    fixes, said = loaded.gnss, " ".join(loaded.notes)
    np.testing.assert_allclose([fixes.time, loaded.reference.time], [np.array([9.5, 10.5, 12.5]) - 1e-6] * 2, atol=5e-7)
    np.testing.assert_allclose(np.degrees(fixes.latitude), [45.0000123, 45.0000125, 45.0000123], rtol=1e-12)
    np.testing.assert_allclose(fixes.height, [200.0, 200.001, 200.0])
    np.testing.assert_allclose(fixes.position_sigma, [[0.5, 0.5, 0.8], [0.0145, 0.0145, 0.0105], [0.5, 0.5, 0.8]])
    np.testing.assert_allclose(np.hstack([fixes.velocity_n, fixes.velocity_sigma]), [[1, -2, 3, 0.07, 0.07, 0.07]] * 3)
    words = ("1 of 4 UBX-NAV-PVT have no", "1 messages with a wrong", "1 fixes contain the receiver's own")
    assert all(each in said for each in words)
    folder.write("rover.ubx", solution(2, fixType=2))
    folder.error("none of its 1 UBX-NAV-PVT has a three-dimensional fix")
    with pytest.raises(
        InputError, match="a file of the format 'ubx', not a description of a log: a section of a description in"
    ):
        load(folder.path / "rover.ubx")
    folder.change(('file = "imu.csv"', 'file = "rover.ubx"'))
    folder.error("has no columns for [imu]: allowed in [gnss], [reference]")

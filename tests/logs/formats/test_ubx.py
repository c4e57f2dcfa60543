"""Logs of u-blox receivers, written by pyubx2."""

import numpy as np
from peers import package

UNIX = 1756402221.0  # 2025-08-28 17:30:21 UTC, GPS time of week 408639 s
WHOLE = {"year": 2025, "month": 8, "day": 28, "hour": 17, "min": 30, "fullyResolved": 1, "gnssFixOk": 1, "fixType": 3}


def message(name, epoch, **fields):
    pyubx2 = package("pyubx2")
    return pyubx2.UBXMessage("NAV", f"NAV-{name}", pyubx2.GET, iTOW=408639000 + epoch * 500, **fields).serialize()


def solution(epoch, **fields):
    place = {"lat": 45.0000123, "lon": -93.0000045, "height": 200_000 + epoch, "hMSL": 230_000, "hAcc": 500, "vAcc": 800}
    motion = {"velN": 1000, "velE": -2000, "velD": 3000, "sAcc": 70}
    nano = -1000 if epoch % 2 == 0 else 499_999_000
    return message("PVT", epoch, **{**WHOLE, **place, **motion, "second": 21 + epoch // 2, "nano": nano, **fields})


def test_the_navigation_solution(folder):
    precise = message("HPPOSLLH", 1, lat=45.0000125, lon=-93.0000045, height=200_001, hAcc=14.5, vAcc=10.5)
    damaged = bytearray(solution(4))
    damaged[20] ^= 255
    damaged[4] ^= 255  # its length covers what follows
    no_fix = solution(5, fixType=2)
    log = b"".join([b"$GNGGA,junk\r\n", solution(0), precise, bytes(damaged), solution(1), no_fix, solution(2, fixType=4)])
    folder.write("rover.ubx", log)
    folder.toml = folder.toml[: folder.toml.index("[gnss]")] + (
        f'[gnss]\nfile = "rover.ubx"\nlever_arm_m = [0, 0, 0]\ntime_offset_s = {10.5 - UNIX}\n'
        f'[reference]\nfile = "rover.ubx"\ntime = "tow_s"\ntime_offset_s = {10.5 - 408639}\n'
    )
    loaded = folder.load()
    fixes = loaded.gnss
    np.testing.assert_allclose(fixes.time, [10.5 - 1e-6, 11 - 1e-6, 11.5 - 1e-6], atol=5e-7)
    np.testing.assert_allclose(loaded.reference.time, fixes.time, atol=1e-6)
    np.testing.assert_allclose(np.degrees(fixes.latitude), [45.0000123, 45.0000125, 45.0000123], rtol=1e-12)
    np.testing.assert_allclose(np.degrees(fixes.longitude), -93.0000045, rtol=1e-12)
    np.testing.assert_allclose(fixes.height, [200.0, 200.001, 200.002])
    np.testing.assert_allclose(fixes.position_sigma, [[0.5, 0.5, 0.8], [0.0145, 0.0145, 0.0105], [0.5, 0.5, 0.8]])
    np.testing.assert_allclose(fixes.velocity_n, [[1, -2, 3]] * 3)
    np.testing.assert_allclose(fixes.velocity_sigma, 0.07)
    for words in ("1 of 4 UBX-NAV-PVT have no", "1 messages with a wrong", "1 fixes contain the receiver's own dead reckoning"):
        assert any(words in note for note in loaded.notes), words
    folder.write("rover.ubx", no_fix)
    folder.error("none of its 1 UBX-NAV-PVT has a three-dimensional fix")


def test_it_holds_no_samples(folder):
    folder.write("rover.ubx", solution(0))
    folder.change(('file = "imu.csv"', 'file = "rover.ubx"'))
    folder.error("has no columns for [imu]: allowed in [gnss], [reference]")

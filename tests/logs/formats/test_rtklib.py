"""Solutions of RTKLIB in its notations of time and place, written as its source prints them."""

import numpy as np
import pymap3d
import pytest

from insenv.logs.formats.rtklib import read_columns
from insenv.logs.gps_time import gps_of_unix, unix_of_gps

UNIX = 1752003240.5  # 2025-07-08 19:34:00.5 UTC
PLACE = np.array([-40.0966268, -105.1474483, 1601.474])  # deg, deg, m
BASE = np.array([-40.1, -105.2, 1500.0])
VELOCITY = np.array([3.0, -4.0, 0.5])  # NED
SIGMAS = np.array([0.02, 0.03, 0.05])
EXTRA = ["1", "12", "0.5", "3.2"]  # Q, ns, age, ratio


def roots(matrix):
    """sd of the axes and the signed roots of the covariances, as RTKLIB writes them."""
    pairs = [matrix[0, 1], matrix[1, 2], matrix[2, 0]]
    return [f"{np.sign(v) * np.sqrt(abs(v)):.12f}" for v in (*np.diag(matrix), *pairs)]


def solution(names, place, C_cn, stamp, clock, base=""):
    """A file: names of the three axes of the position; C_cn from NED to these."""
    turned = C_cn @ np.diag(SIGMAS**2) @ C_cn.T
    a, b, c = names[3:]
    deviations = [a, b, c, a + b, b + c, c + a]
    heading = [*names[:3], "Q", "ns", *(f"sd{each}(m)" for each in deviations), "age(s)", "ratio"]
    heading += [*(f"v{each}(m/s)" for each in names[3:]), *(f"sdv{each}" for each in deviations)]
    row = [stamp, *place, *EXTRA[:2], *roots(turned), *EXTRA[2:], *(f"{v:.9f}" for v in C_cn @ VELOCITY), *roots(4 * turned)]
    return f"% program : RTKLIB\n{base}%  {clock}  {' '.join(heading)}\n{' '.join(row)}\n".encode()


GEODETIC = (["latitude(deg)", "longitude(deg)", "height(m)", "n", "e", "u"], [f"{v:.12f}" for v in PLACE], np.diag([1, 1, -1]))
MINUTES = (["latitude(d'\")", "longitude(d'\")", *GEODETIC[0][2:]], ["-40 05 47.85648 -105 08 50.81388 1601.474"], GEODETIC[2])
C_EN = np.column_stack([pymap3d.enu2uvw(*v, *PLACE[:2]) for v in ((0, 1, 0), (1, 0, 0), (0, 0, -1))])
ECEF = (["x-ecef(m)", "y-ecef(m)", "z-ecef(m)", "x", "y", "z"], [f"{v:.6f}" for v in pymap3d.geodetic2ecef(*PLACE)], C_EN)
OF_BASE = np.column_stack([pymap3d.uvw2enu(*v, *BASE[:2]) for v in C_EN.T])
ENU = (
    ["e-baseline(m)", "n-baseline(m)", "u-baseline(m)", "e", "n", "u"],
    [f"{v:.6f}" for v in pymap3d.geodetic2enu(*PLACE, *BASE)],
    OF_BASE,
)
CALENDAR = "2025/07/08 19:34:18.500"


@pytest.mark.parametrize(
    ("form", "stamp", "clock", "base"),
    [
        (GEODETIC, CALENDAR, "GPST", ""),
        (MINUTES, "2025/07/08 19:34:00.500", "UTC", ""),
        (ECEF, "2374 243258.500", "GPST", ""),
        (ENU, "2025/07/09 04:34:00.500", "JST", "% ref pos   : -40.100000000 -105.200000000  1500.0000\n"),
    ],
)
def test_each_notation_means_the_same(form, stamp, clock, base):
    found = read_columns("x.pos", solution(*form, stamp, clock, base), "gnss")
    columns = {name: column[0] for name, column in found.columns.items()}
    assert columns["unix_s"] == pytest.approx(UNIX, abs=1e-6) and columns["tow_s"] == pytest.approx(243258.5, abs=1e-6)
    assert [columns[name] for name in ("latitude_deg", "longitude_deg")] == pytest.approx(PLACE[:2], abs=1e-10)
    assert columns["height_m"] == pytest.approx(PLACE[2], abs=1e-5)
    for name, expected in (("position_sigma", SIGMAS), ("velocity_sigma", 2 * SIGMAS), ("velocity", VELOCITY)):
        unit = "m" if name == "position_sigma" else "mps"
        assert [columns[f"{name}_{axis}_{unit}"] for axis in ("north", "east", "down")] == pytest.approx(expected, abs=2e-8)
    assert columns["quality"] == 1 and columns["ratio"] == 3.2


def test_a_section_takes_it_and_names_what_is_wrong(folder):
    text = solution(*GEODETIC, CALENDAR, "GPST").decode().splitlines()
    more = [text[2].replace("19:34:18", f"19:34:{second}") for second in (19, 20)]
    folder.write("rover.pos", "\n".join([*text, *more[:1], more[1].replace(" 1 12", " 5 12")]))
    folder.toml = folder.toml[: folder.toml.index("[gnss]")] + (
        f'[gnss]\nfile = "rover.pos"\nlever_arm_m = [0, 0, 0]\ntime_offset_s = {10.5 - UNIX}\n'
        "keep_where = { quality = [1, 2] }\n"
    )
    fixes = folder.load().gnss
    np.testing.assert_allclose(fixes.time, [10.5, 11.5], atol=1e-6)
    np.testing.assert_allclose(fixes.velocity_n, [VELOCITY] * 2)
    folder.line("rover.pos", 4, text[2].replace("19:34:18", "19-34-18"))
    folder.error("rover.pos: line 4: time '2025/07/08 19-34-18.500': allowed is 2025/07/08")
    folder.line("rover.pos", 4, text[2].rpartition(" ")[0])
    folder.error("rover.pos: line 4 has 23 fields, expected 24 by the heading")
    folder.write("rover.pos", "\n".join(text[2:]))
    folder.error("rover.pos: no line '% GPST")


def test_gps_time_is_ahead_by_the_leap_seconds():
    unix = np.array([1483228799.0, 1483228800.0, 362793600.0, 2e9])  # around 2017-01-01, at 1981-07-01
    np.testing.assert_array_equal(gps_of_unix(unix) - unix + 315964800, [17, 18, 1, 18])
    np.testing.assert_array_equal(unix_of_gps(gps_of_unix(unix)), unix)

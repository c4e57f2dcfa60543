"""Solutions of RTKLIB in its notations of time and place, written as its source prints them."""

import numpy as np
import pymap3d
import pytest

from insenv.logs.units import gps_of_unix, unix_of_gps

UNIX = 1752003240.5  # 2025-07-08 19:34:00.5 UTC
PLACE, BASE = np.array([-40.0966268, -105.1474483, 1601.474]), (-40.1, -105.2, 1500.0)  # deg, deg, m
SIGMAS, VELOCITY = np.array([0.02, 0.03, 0.05]), np.array([3.0, -4.0, 0.5])  # NED
NEU, C_EN = np.diag([1, 1, -1]), np.column_stack([pymap3d.enu2uvw(*v, *PLACE[:2]) for v in ((0, 1, 0), (1, 0, 0), (0, 0, -1))])
OFFSET, OF_BASE = pymap3d.geodetic2enu(*PLACE, *BASE), np.column_stack([pymap3d.uvw2enu(*v, *BASE[:2]) for v in C_EN.T])
MINUTES = (-40, 5, 47.85648, -105, 8, 50.81388, 1601.474)


def lines(clock, stamp, second, axes, names, place, C_cn):
    """The heading and three rows; the quality differs between them.  C_cn: from NED to the axes of the columns."""
    (a, b, c), covariance = axes, C_cn @ np.diag(SIGMAS**2) @ C_cn.T
    deviations = np.array([*np.diag(covariance), covariance[0, 1], covariance[1, 2], covariance[2, 0]])
    roots, axes = np.sign(deviations) * np.sqrt(abs(deviations)), (a, b, c, a + b, b + c, c + a)
    sd, sdv = (" ".join(f"{name}{each}(m)" for each in axes) for name in ("sd", "sdv"))
    yield "% ref pos   : -40.100000000 -105.200000000  1500.0000"
    yield f"%  {clock}  {names} Q ns {sd} age(s) ratio v{a}(m/s) v{b}(m/s) v{c}(m/s) {sdv}"
    for row in range(3):
        values = [*place, 1 + row, 12, *roots, 0.5, 3.2, *C_cn @ VELOCITY, *2 * roots]
        yield f"{stamp}{second + row:.3f} {' '.join(f'{v:.12g}' for v in values)}"


@pytest.mark.parametrize("form", [
    ("GPST", "2025/07/08 19:34:", 18.5, "neu", "latitude(deg) longitude(deg) height(m)", PLACE, NEU),
    ("UTC", "2025/07/08 19:34:0", 0.5, "neu", "latitude(d'\") longitude(d'\") height(m)", MINUTES, NEU),
    ("GPST", "2374 ", 243258.5, "xyz", "x-ecef(m) y-ecef(m) z-ecef(m)", pymap3d.geodetic2ecef(*PLACE), C_EN),
    ("JST", "2025/07/09 04:34:0", 0.5, "enu", "e-baseline(m) n-baseline(m) u-baseline(m)", OFFSET, OF_BASE),
])  # fmt: skip
def test_each_notation_means_the_same(folder, form):
    text = list(lines(*form))
    folder.write("rover.pos", "\n".join(text))
    folder.fixes_in("rover.pos", 10.5 - UNIX, "keep_where = { quality = [1, 3] }\n")
    fixes = folder.load().gnss
    np.testing.assert_allclose(fixes.time, [10.5, 12.5], atol=1e-6)
    np.testing.assert_allclose(np.degrees([fixes.latitude, fixes.longitude]).T, [PLACE[:2]] * 2, atol=1e-9)
    np.testing.assert_allclose(fixes.height, PLACE[2], atol=1e-4)
    np.testing.assert_allclose(np.hstack([fixes.position_sigma, fixes.velocity_sigma]), [[*SIGMAS, *2 * SIGMAS]] * 2, atol=1e-7)
    np.testing.assert_allclose(fixes.velocity_n, [VELOCITY] * 2, atol=1e-7)
    folder.line("rover.pos", 4, f"2025-07-08 1 {text[3].split(maxsplit=2)[2]}")
    folder.error("rover.pos: line 4: time '2025-07-08 1': allowed is", ", as in the first row")
    folder.line("rover.pos", 4, text[3].rpartition(" ")[0])
    folder.error("rover.pos: line 4 has 2", " by the header")
    folder.line("rover.pos", 2, "")
    folder.error("rover.pos: no line '% GPST")


@pytest.mark.parametrize("sign", [1, -1])
def test_less_than_a_degree_has_its_sign(folder, sign):
    """In degrees, minutes and seconds the sign stands before a 0."""
    names, place = "latitude(d'\") longitude(d'\") height(m)", (sign * 0.0, 30, 36, sign * 0.0, 6, 18, 100.0)
    folder.write("rover.pos", "\n".join(lines("UTC", "2025/07/08 19:34:0", 0.5, "neu", names, place, NEU)))
    folder.fixes_in("rover.pos", 10.5 - UNIX)
    fixes = folder.load().gnss
    np.testing.assert_allclose(np.degrees([fixes.latitude[0], fixes.longitude[0]]), [sign * 0.51, sign * 0.105], atol=1e-9)


def test_gps_time_is_ahead_by_the_leap_seconds():
    unix = np.array([1483228799.0, 1483228800.0, 362793600.0, 2e9])  # around 2017-01-01, at 1981-07-01
    np.testing.assert_array_equal(gps_of_unix(unix) - unix + 315964800, [17, 18, 1, 18])
    np.testing.assert_array_equal(unix_of_gps(gps_of_unix(unix)), unix)
    leap = np.array([1483228800.0 - 315964800 + 17.5])  # 23:59:60.5, to POSIX the same time as half a second after midnight
    np.testing.assert_array_equal(unix_of_gps(leap), [1483228800.5])

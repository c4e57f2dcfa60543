"""Units of data sheets and logs in SI: every one by what its name says."""

import math
import re

import numpy as np
import pytest
from ambiance import Atmosphere

from insenv.logs.units import ACCEL_UNITS, GYRO_UNITS, TIME_UNITS, standard_height
from insenv.sensors import units
from insenv.sensors.registry import instruments

WORDS = {
    "": 1.0, "rad": 1.0, "deg": math.pi / 180, "arcsec": math.pi / 648000, "urad": 1e-6, "m": 1.0, "km": 1e3, "kn": 1852 / 3600,
    "s": 1.0, "s2": 1.0, "s^2": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "Hz": 1.0, "K": 1.0,
    "g": 9.80665, "mg": 9.80665e-3, "ug": 9.80665e-6, "mGal": 1e-5, "ppm": 1e-6, "%": 0.01,
    "T": 1.0, "uT": 1e-6, "nT": 1e-9, "G": 1e-4, "mG": 1e-7,
}  # fmt: skip


def si(unit):
    """The SI value of a unit: a word, divided by each that follows, or by the root of one."""
    first, *others = re.split(r"/| per ", unit)
    return WORDS[first] / math.prod(math.sqrt(WORDS[o[5:-1]]) if o.startswith("sqrt") else WORDS[o] for o in others)


def test_every_unit_is_what_its_name_says():
    tables = [TIME_UNITS, units.ANGLE_UNITS, units.SPEED_UNITS, *GYRO_UNITS.values(), *ACCEL_UNITS.values()]
    tables += [column.units for each in instruments().values() for column in each.columns]
    assert len(tables) > 10 and {"uT", "mG"} <= {name for table in tables for name in table}
    for name, value in [pair for table in tables for pair in table.items()]:
        assert value == pytest.approx(si(name), rel=1e-14), name
    for name, unit in units.UNITS.items():
        assert unit.convert(2.0) == pytest.approx(2.0 * si(name), rel=1e-14), name
        assert unit.convert.back(unit.convert(3.0)) == pytest.approx(3.0, rel=1e-14), name


def test_temperatures_densities_and_the_height_of_a_pressure():
    heights = np.array([-300.0, 0.0, 1500.0, 10500.0])
    assert standard_height(Atmosphere(heights).pressure) == pytest.approx(heights, abs=0.1)
    assert units.deg_c_to_k(20.0) == pytest.approx(293.15)
    assert units.one_sigma_from_cep(1.1774100225154747) == units.one_sigma_from_r50(0.6744897501960817) == pytest.approx(1.0)
    # a standard deviation of 2e-5 rad/s per sample of 0.005 s: over n samples the angle scatters by 2e-5 * 0.005 * sqrt(n)
    assert units.density_from_sample_std(2e-5, 0.005) * math.sqrt(0.005 * 100) == pytest.approx(2e-5 * 0.005 * 10, rel=1e-14)

"""Units: what they are made of, which become the unit of a row, and which are refused."""

import re

import pytest

from insenv.base.errors import InputError
from insenv.base.units import CONVERTED, check_unit, converted, dimension


@pytest.mark.parametrize(("unit", "made"), [
    ("1", {}),
    ("m/s^2", {"m": 1, "s": -2}),
    ("m/s^1.5", {"m": 1, "s": -1.5}),
    ("m/s^2/sqrt(s)", {"m": 1, "s": -2.5}),
    ("sqrt(m*s)", {"m": 0.5, "s": 0.5}),
    ("(rad/s)/(m/s^2)", {"rad": 1, "s": 1, "m": -1}),
    ("s/s", {}),
    *[(wrong, None) for wrong in ("", "furlong", "SI", "m, m/s", "m/", "/m", "(m", "m)", "sqrt m", "2 m", "^2")],
])  # fmt: skip
def test_what_a_unit_is_made_of(unit, made):
    assert dimension(unit) == made


def test_every_unit_becomes_one_that_is_made_of_si():
    assert all(dimension(each.si) is not None for each in CONVERTED.values())
    assert (
        converted("m/s").convert(3.0) == 3.0
        and converted("").si == "1"
        and converted("km/h").convert(36.0) == pytest.approx(10.0)
    )


@pytest.mark.parametrize(("unit", "row_unit", "message"), [
    ("kmh", "m/s", "the key 'x': unit 'kmh': unknown; did you mean 'km/h'?"),
    ("deg", "m/s", "the key 'x': unit 'deg' (rad) is none of its row 'r' in m/s: allowed is 'm/s', 'km/h', 'kn'"),
    ("m", "1", "unit 'm' (m) is none of its row 'r' in 1: allowed is '', '%', 'ppm'"),
    ("m", "furlong", "unit 'm' (m) is none of its row 'r' in furlong: allowed is 'furlong'"),
])  # fmt: skip
def test_a_unit_that_does_not_fit_its_row_is_refused(unit, row_unit, message):
    with pytest.raises(InputError, match=re.escape(message)):
        check_unit("the key 'x'", unit, "r", row_unit)


@pytest.mark.parametrize(
    ("unit", "row_unit"), [("deg/h/sqrt(h)", "rad/s^1.5"), ("", "1"), ("%", "1"), ("m", "m"), ("deg C", "K")]
)
def test_a_unit_that_fits_is_taken(unit, row_unit):
    check_unit("the key 'x'", unit, "r", row_unit)

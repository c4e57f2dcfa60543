"""The field of the World Magnetic Model and its gradient, against the package itself, beside the poles too."""

import math
from typing import Any

import numpy as np
import pytest
from pygeomag import GeoMag

from insenv.base.errors import InputError
from insenv.geodesy.magnetic import displacement_n, world_magnetic_model


def field_at(lat_deg: float, lon_deg: float, km: float) -> Any:
    found = GeoMag().calculate(lat_deg, (lon_deg + 180.0) % 360.0 - 180.0, km, 2026.0)
    return np.array([found.x, found.y, found.z])  # nT


def test_field_is_that_of_the_model_100_km_away_to_30_nt() -> None:
    lat, lon, h = math.radians(48.0), math.radians(11.0), 500.0
    field, gradient = world_magnetic_model(lat, lon, h, 2026.0)
    np.testing.assert_allclose(field, field_at(48.0, 11.0, 0.5) * 1e-9, rtol=1e-12)
    assert 2e-5 < np.hypot(*field[:2]) < 2.2e-5 and 4.2e-5 < field[2] < 4.6e-5
    for north, east, down in ((1e5, 0, 0), (0, 1e5, 0), (-7e4, 7e4, -2e3)):
        place = lat + north / 6.37e6, lon + east / (6.38e6 * math.cos(lat + north / 6.37e6)), h - down
        near = field + gradient @ displacement_n(*place, lat, lon, h).full().ravel()
        there = field_at(*map(math.degrees, place[:2]), place[2] / 1e3)
        assert np.abs(near * 1e9 - there).max() < 30.0 and np.abs(field * 1e9 - there).max() > 100.0


@pytest.mark.parametrize(("year", "published"), [
    (2010.0, (6649.5, -714.6, 54346.2)), (2015.0, (6636.6, -451.9, 54408.9)), (2020.0, (6570.4, -146.3, 54606.0)),
])  # fmt: skip
def test_each_five_years_have_their_coefficients(year: float, published: tuple[float, ...]) -> None:
    """Test values of the World Magnetic Models, 80 deg north, 0 east, height 0; the next epoch continues them to 100 nT."""
    field = [world_magnetic_model(math.radians(80.0), 0.0, 0.0, at)[0] * 1e9 for at in (year, year + 4.999, year + 5.0)]
    np.testing.assert_allclose(field[0], published, atol=0.06)
    assert np.abs(field[2] - field[1]).max() < 100.0 < np.abs(field[1] - field[0]).max()


def test_a_year_without_coefficients_is_refused() -> None:
    with pytest.raises(InputError, match=r"year = 2009.9: allowed is 2010 to 2030"):
        world_magnetic_model(0.8, 0.2, 0.0, 2009.9)


@pytest.mark.parametrize(("lat", "lon"), [(10.0, 20.0), (-55.0, 179.99), (70.0, -100.0), (89.95, 10.0)])
def test_gradient_agrees_with_differences_of_the_model(lat: float, lon: float) -> None:
    gradient = world_magnetic_model(math.radians(lat), math.radians(lon), 0.0, 2026.0)[1] * 1e12  # nT/km
    step, arc = 0.01, math.radians(0.01) * 6371.0
    east = arc * math.cos(math.radians(lat))
    differences = [
        (field_at(lat + step, lon, 0.0) - field_at(lat - step, lon, 0.0)) / (2 * arc),
        (field_at(lat, lon + step, 0.0) - field_at(lat, lon - step, 0.0)) / (2 * east),
        (field_at(lat, lon, -1.0) - field_at(lat, lon, 1.0)) / 2,
    ]
    np.testing.assert_allclose(gradient.T, differences, rtol=0.02, atol=0.1)

"""Units of data sheets in SI."""

import math

import pytest

from insenv.sensors import units


def test_against_hand_calculation() -> None:
    assert units.deg_h_to_rad_s(1.0) == pytest.approx(4.84813681109536e-6, rel=1e-14)
    assert units.deg_sqrt_h_to_rad_sqrt_s(1.0) == pytest.approx(2.908882086657216e-4, rel=1e-14)
    assert units.deg_h_sqrt_h_to_rad_s_sqrt_s(60.0) == pytest.approx(units.deg_h_to_rad_s(1.0), rel=1e-14)
    assert units.ug_to_m_s2(1e6) == pytest.approx(9.80665, rel=1e-15)
    assert units.m_s_sqrt_h_to_m_s_sqrt_s(60.0) == pytest.approx(1.0, rel=1e-15)
    assert units.deg_h_g_to_rad_s_per_m_s2(9.80665) == pytest.approx(4.84813681109536e-6, rel=1e-14)
    assert units.mgal_to_m_s2(1e5) == 1.0 and units.deg_c_to_k(20.0) == pytest.approx(293.15)
    assert units.rad_s_to_deg_h(units.deg_h_to_rad_s(3.0)) == pytest.approx(3.0)
    assert units.arcsec_to_rad(3600.0) == units.deg_to_rad(1.0)
    assert units.one_sigma_from_cep(1.1774100225154747) == pytest.approx(1.0, rel=1e-15)
    # a standard deviation of 2e-5 rad/s per sample of 0.005 s: over n samples the angle scatters by 2e-5 * 0.005 * sqrt(n)
    assert units.density_from_sample_std(2e-5, 0.005) * math.sqrt(0.005 * 100) == pytest.approx(2e-5 * 0.005 * 10, rel=1e-14)

"""Sensor grades in the units of data sheets, every figure with its source.

A grade is a dataclass of plain numbers; its method `parameters` converts it to parameter rows in SI.  A fixed bias
given as one number applies to all three sensor axes.  A figure that a grade omits is 0: there is no such error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from insenv.sensors import units
from insenv.sensors.imu_tables import HUGE

Numbers = float | tuple[float, float, float]


@dataclass(frozen=True)
class ImuGrade:
    """Grade of an inertial sensor, in the data-sheet units that the field names show; `CONVERSIONS` converts each
    figure.

    ``*_sigma_*`` are standard deviations of quantities drawn at the start, ``*_instability_*`` of the Gauss-Markov
    in-run bias, ``*_flicker_*`` floors of the Allan deviation, ``*_white_*`` of one sample at `white_rate_hz` (an
    alternative to giving white noise as a random walk).  `sources` gives the source of each figure by field name; ""
    stands for all fields that are not named.
    """

    name: str
    title: str
    sources: Mapping[str, str] = field(default_factory=dict)

    gyro_bias_deg_h: Numbers = 0.0
    gyro_bias_sigma_deg_h: float = 0.0
    gyro_arw_deg_sqrt_h: float = 0.0
    gyro_white_deg_h: float = 0.0
    gyro_instability_deg_h: float = 0.0
    gyro_instability_time_s: float = 3600.0
    gyro_rrw_deg_h_sqrt_h: float = 0.0
    gyro_flicker_deg_h: float = 0.0
    gyro_scale_factor_sigma_ppm: float = 0.0
    gyro_misalignment_sigma_urad: float = 0.0
    gyro_g_sensitivity_deg_h_g: float = 0.0
    gyro_temperature_slope_deg_h_k: float = 0.0
    gyro_scale_factor_slope_ppm_k: float = 0.0
    gyro_quantum_arcsec: float = 0.0
    gyro_range_deg_s: float = units.rad_to_deg(HUGE)

    accel_bias_ug: Numbers = 0.0
    accel_bias_sigma_ug: float = 0.0
    accel_vrw_ug_sqrt_hz: float = 0.0
    accel_vrw_m_s_sqrt_h: float = 0.0
    accel_white_ug: float = 0.0
    accel_instability_ug: float = 0.0
    accel_instability_time_s: float = 3600.0
    accel_rrw_ug_sqrt_h: float = 0.0
    accel_flicker_ug: float = 0.0
    accel_scale_factor_sigma_ppm: float = 0.0
    accel_misalignment_sigma_urad: float = 0.0
    accel_temperature_slope_ug_k: float = 0.0
    accel_scale_factor_slope_ppm_k: float = 0.0
    accel_quantum_m_s: float = 0.0
    accel_range_g: float = units.m_s2_to_g(HUGE)

    white_rate_hz: float = 200.0

    def figures(self) -> dict[str, Any]:
        """The given figures, those that differ from the field defaults, by field name."""
        own = (entry for entry in fields(self) if entry.name not in ("name", "title", "sources"))
        return {e.name: getattr(self, e.name) for e in own if getattr(self, e.name) != e.default}

    def source(self, figure: str) -> str:
        """The source of a figure."""
        return self.sources.get(figure, self.sources.get("", ""))

    def parameters(self) -> dict[str, Any]:
        """Values in SI by name of the sensor's parameter row, for `Table.pack`."""
        rows: dict[str, Any] = {}
        for figure, (row, convert) in CONVERSIONS.items():
            value = convert(getattr(self, figure))
            # a row can be given in several ways: those not used are 0
            rows[row] = value if row not in rows or np.any(value) else rows[row]
        for figure, row, convert in (
            ("gyro_white_deg_h", "angle_random_walk", units.deg_h_to_rad_s),
            ("accel_white_ug", "velocity_random_walk", units.ug_to_m_s2),
        ):
            if getattr(self, figure):
                rows[row] = units.density_from_sample_std(convert(getattr(self, figure)), 1.0 / self.white_rate_hz)
        rows["gyro_g_sensitivity"] = rows["gyro_g_sensitivity"] * np.eye(3)
        return rows


def _same(value: Any) -> Any:
    return value


CONVERSIONS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "gyro_bias_deg_h": ("gyro_bias", units.deg_h_to_rad_s),
    "gyro_bias_sigma_deg_h": ("gyro_bias_sigma", units.deg_h_to_rad_s),
    "gyro_arw_deg_sqrt_h": ("angle_random_walk", units.deg_sqrt_h_to_rad_sqrt_s),
    "gyro_instability_deg_h": ("gyro_instability_sigma", units.deg_h_to_rad_s),
    "gyro_instability_time_s": ("gyro_instability_time", _same),
    "gyro_rrw_deg_h_sqrt_h": ("gyro_rate_random_walk", units.deg_h_sqrt_h_to_rad_s_sqrt_s),
    "gyro_flicker_deg_h": ("gyro_flicker", units.deg_h_to_rad_s),
    "gyro_scale_factor_sigma_ppm": ("gyro_scale_factor_sigma", units.ppm_to_one),
    "gyro_misalignment_sigma_urad": ("gyro_misalignment_sigma", units.urad_to_rad),
    "gyro_g_sensitivity_deg_h_g": ("gyro_g_sensitivity", units.deg_h_g_to_rad_s_per_m_s2),
    "gyro_temperature_slope_deg_h_k": ("gyro_temperature_slope", units.deg_h_to_rad_s),
    "gyro_scale_factor_slope_ppm_k": ("gyro_scale_factor_slope", units.ppm_to_one),
    "gyro_quantum_arcsec": ("gyro_quantum", units.arcsec_to_rad),
    "gyro_range_deg_s": ("gyro_range", units.deg_to_rad),
    "accel_bias_ug": ("accel_bias", units.ug_to_m_s2),
    "accel_bias_sigma_ug": ("accel_bias_sigma", units.ug_to_m_s2),
    "accel_vrw_ug_sqrt_hz": ("velocity_random_walk", units.ug_sqrt_hz_to_m_s_sqrt_s),
    "accel_vrw_m_s_sqrt_h": ("velocity_random_walk", units.m_s_sqrt_h_to_m_s_sqrt_s),
    "accel_instability_ug": ("accel_instability_sigma", units.ug_to_m_s2),
    "accel_instability_time_s": ("accel_instability_time", _same),
    "accel_rrw_ug_sqrt_h": ("accel_rate_random_walk", units.ug_sqrt_h_to_m_s2_sqrt_s),
    "accel_flicker_ug": ("accel_flicker", units.ug_to_m_s2),
    "accel_scale_factor_sigma_ppm": ("accel_scale_factor_sigma", units.ppm_to_one),
    "accel_misalignment_sigma_urad": ("accel_misalignment_sigma", units.urad_to_rad),
    "accel_temperature_slope_ug_k": ("accel_temperature_slope", units.ug_to_m_s2),
    "accel_scale_factor_slope_ppm_k": ("accel_scale_factor_slope", units.ppm_to_one),
    "accel_quantum_m_s": ("accel_quantum", _same),
    "accel_range_g": ("accel_range", units.g_to_m_s2),
}
"""Parameter row and conversion to SI of each figure; data-sheet figures are converted here only."""


@dataclass(frozen=True)
class GnssGrade:
    """Grade of a receiver: standard deviations north, east, down of white noise and correlated position error."""

    name: str
    title: str
    source: str
    position_noise_m: tuple[float, float, float]
    velocity_noise_m_s: tuple[float, float, float]
    wander_sigma_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wander_time_s: float = 60.0

    def parameters(self) -> dict[str, Any]:
        """Values in SI by name of the receiver's parameter row, for `Table.pack`."""
        return {
            "gnss_position_noise": np.array(self.position_noise_m),
            "gnss_velocity_noise": np.array(self.velocity_noise_m_s),
            "gnss_wander_sigma": np.array(self.wander_sigma_m),
            "gnss_wander_time": self.wander_time_s,
        }

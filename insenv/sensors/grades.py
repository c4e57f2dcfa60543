"""Sensor grades in the units of data sheets, every figure with its source.

A grade is a dataclass of plain numbers; its method `parameters` converts it to parameter rows in SI.  A fixed bias
given as one number applies to all three sensor axes.  A figure that a grade omits is 0: there is no such error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any

import numpy as np

from insenv.base.toml import Number, PerAxis, key, within
from insenv.core.tables import Row, Table
from insenv.sensors import units
from insenv.sensors.figures import largest
from insenv.sensors.imu_tables import HUGE, IMU_PARAMETERS

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


# The figures of an inertial unit as keys of a file: a section [imu] and a grade file have the same.

WHITE = ("gyro_white_deg_h", "accel_white_ug")
"""Values of white noise that belong to a sample rate."""
WAYS = (("gyro_arw_deg_sqrt_h", "gyro_white_deg_h"), ("accel_vrw_ug_sqrt_hz", "accel_vrw_m_s_sqrt_h", "accel_white_ug"))
"""Values that describe the same noise: at most one of each group may be given."""
_SUFFIXES = {
    "_deg_h_sqrt_h": "deg/h/sqrt(h)", "_deg_sqrt_h": "deg/sqrt(h)", "_deg_h_g": "deg/h/g", "_deg_h_k": "deg/h/K",
    "_m_s_sqrt_h": "m/s/sqrt(h)", "_ug_sqrt_hz": "ug/sqrt(Hz)", "_ug_sqrt_h": "ug/sqrt(h)", "_ug_k": "ug/K", "_ppm_k": "ppm/K",
    "_deg_h": "deg/h", "_deg_s": "deg/s", "_m_s": "m/s", "_ug": "ug", "_ppm": "ppm", "_urad": "urad", "_arcsec": "arcsec",
    "_time_s": "s", "_g": "g",
}  # fmt: skip


def unit_of(figure: str) -> str:
    """The unit in the name of a data-sheet value."""
    return next((unit for suffix, unit in _SUFFIXES.items() if figure.endswith(suffix)), "")


def figure_key(figure: str, otherwise: str) -> tuple[Any, Any]:
    """Type and field of a data-sheet value: None is the grade's; meaning and sign are those of the parameter row."""
    if figure in WHITE:
        what, lower = f"{'Gyro' if figure[0] == 'g' else 'Accelerometer'} white noise, standard deviation of one sample", 0.0
    else:
        row = IMU_PARAMETERS[CONVERSIONS[figure][0]]
        what, lower = row.meaning, row.lower
    most = largest(unit_of(figure))
    limits: dict[str, float] = {"le": most, "ge": -most if lower < 0.0 else 0.0}
    if "_range_" in figure or "_time_" in figure:
        limits = {"le": most, "gt": 0.0}
    meaning = f"{what[0].lower()}{what[1:]}; {otherwise} if absent"
    if figure in ("gyro_bias_deg_h", "accel_bias_ug"):
        return Annotated[PerAxis, within(-most, most)] | None, key(None, meaning, unit_of(figure))
    return Number | None, key(None, meaning, unit_of(figure), **limits)


FIGURES = tuple(f.name for f in fields(ImuGrade) if f.name not in ("name", "title", "sources", "white_rate_hz"))
"""Keys that give an error of the unit, in place of its grade's."""


# Names of at most 16 characters for the elements of parameter rows, and the units in which they are shown.
#
# MAVLink's parameters bear them: the vehicle that sends them and the reader of its logs use the same names.

SHOWN: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "rad": ("deg", units.deg_to_rad),
    "rad/s": ("deg/h", units.deg_h_to_rad_s),
    "m/s^2": ("ug", units.ug_to_m_s2),
    "rad/s^0.5": ("deg/sqrt(h)", units.deg_sqrt_h_to_rad_sqrt_s),
    "m/s^1.5": ("ug/sqrt(Hz)", units.ug_sqrt_hz_to_m_s_sqrt_s),
}
"""Unit shown and its conversion to SI, by SI unit."""

MOST_ELEMENTS = 6
"""Rows with more elements (scripts, waves, matrices) are not parameters."""

LONGEST_NAME = 16
"""Characters of a parameter's name in MAVLink."""

_SHORT = {
    "accel": "ACC", "acceleration": "ACCL", "angle": "ANG", "antenna": "ANT", "bandwidth": "BW", "bias": "BIAS",
    "correlation": "COR", "covariance": "COV", "drop": "DROP", "factor": "F", "frequency": "FRQ", "gnss": "GNSS",
    "gyro": "GYR", "heading": "HDG", "height": "HGT", "imu": "IMU", "innovation": "INN", "instability": "INS",
    "interval": "DT", "latitude": "LAT", "lever": "LEV", "longitude": "LON", "misalignment": "MIS", "mounting": "MNT",
    "noise": "N", "outlier": "OUTL", "position": "POS", "probability": "PROB", "random": "R", "range": "RNG", "rate": "RATE",
    "scale": "SC", "sigma": "SIG", "slope": "SLP", "standing": "STND", "start": "ST", "temperature": "TMP", "time": "T",
    "velocity": "VEL", "walk": "W", "wander": "WAN", "error": "ERR", "limit": "LIM", "arm": "ARM", "b": "", "n": "",
}  # fmt: skip


def elements(prefix: str, table: Table, names: tuple[str, ...]) -> Iterator[tuple[Row, int, str]]:
    """Row, index in the vector of the table and short name of each element of the rows `names` that is a parameter."""
    taken: set[str] = set()
    for row in table:
        if row.name not in names or row.size > MOST_ELEMENTS:
            continue
        first = table.slice(row.name).start
        for element in range(row.size):
            name = parameter_name(prefix, row.name, _suffix(row, element), taken)
            taken.add(name)
            yield row, first + element, name


def _suffix(row: Row, element: int) -> str:
    if row.size == 1:
        return ""
    if row.size == 3:
        return ("NED" if row.frame in ("n", "w") else "XYZ")[element]
    return str(element + 1)


def parameter_name(prefix: str, row: str, suffix: str, taken: Iterable[str]) -> str:
    """A name such as ``E_GYR_BIAS_SIG`` or ``S_GNSS_POS_N_D`` that is not among `taken`, with its words shortened to
    fit.

    prefix: of the group; suffix: of the component.  Raises `ValueError` if there is no free name.
    """
    taken = set(taken)
    words = [_SHORT.get(word, word[:6].upper()) for word in row.split("_")]
    words = [word for word in words if word]
    tail = f"_{suffix}" if suffix else ""
    for length in range(6, 0, -1):
        name = f"{prefix}_{'_'.join(word[:length] for word in words)}{tail}"
        if len(name) <= LONGEST_NAME and name not in taken:
            return name
    for number in range(1, 100):
        name = f"{prefix}_{''.join(words)}"[: LONGEST_NAME - len(tail) - 2] + f"{number:02d}{tail}"
        if name not in taken:
            return name
    raise ValueError(f"no parameter name left for {row!r}")

"""Grades of inertial units in the units of data sheets, every figure with its source.

The method `parameters` of a grade converts it to parameter rows in SI.  A figure that a grade omits means: no such error.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, make_dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Row, Table
from insenv.sensors import units
from insenv.sensors.figures import Figure
from insenv.sensors.imu_tables import ACCEL, GYRO, IMU_PARAMETERS
from insenv.sensors.units import UNITS

Numbers = float | tuple[float, float, float]

LEAST_TIME_S = 10.0
"""Shortest correlation time of scale factors: they are advanced every second."""
DRAWN_FOR = (
    f"{{}} scale factor and misalignment, correlation time of the drawn parts; 0: constant, otherwise from {LEAST_TIME_S:g} s"
)

FIGURES: Mapping[str, Figure] = {
    "gyro_bias_deg_h": Figure("gyro_bias", "deg/h", vector=True),
    "gyro_bias_sigma_deg_h": Figure("gyro_bias_sigma", "deg/h"),
    "gyro_arw_deg_sqrt_h": Figure("angle_random_walk", "deg/sqrt(h)"),
    "gyro_white_deg_h": Figure("angle_random_walk", "deg/h", meaning="Gyro white noise, standard deviation of one sample"),
    "gyro_instability_deg_h": Figure("gyro_instability_sigma", "deg/h"),
    "gyro_instability_time_s": Figure("gyro_instability_time", "s"),
    "gyro_rrw_deg_h_sqrt_h": Figure("gyro_rate_random_walk", "deg/h/sqrt(h)"),
    "gyro_flicker_deg_h": Figure("gyro_flicker", "deg/h"),
    "gyro_scale_factor_sigma_ppm": Figure("gyro_scale_factor_sigma", "ppm"),
    "gyro_scale_factor_time_s": Figure("gyro_scale_factor_time", "s", meaning=DRAWN_FOR.format("Gyro")),
    "gyro_misalignment_sigma_urad": Figure("gyro_misalignment_sigma", "urad"),
    "gyro_g_sensitivity_deg_h_g": Figure("gyro_g_sensitivity", "deg/h/g"),
    "gyro_temperature_slope_deg_h_k": Figure("gyro_temperature_slope", "deg/h/K"),
    "gyro_scale_factor_slope_ppm_k": Figure("gyro_scale_factor_slope", "ppm/K"),
    "gyro_quantum_arcsec": Figure("gyro_quantum", "arcsec"),
    "gyro_range_deg_s": Figure("gyro_range", "deg/s"),
    "accel_bias_ug": Figure("accel_bias", "ug", vector=True),
    "accel_bias_sigma_ug": Figure("accel_bias_sigma", "ug"),
    "accel_vrw_ug_sqrt_hz": Figure("velocity_random_walk", "ug/sqrt(Hz)"),
    "accel_vrw_m_s_sqrt_h": Figure("velocity_random_walk", "m/s/sqrt(h)"),
    "accel_white_ug": Figure(
        "velocity_random_walk", "ug", meaning="Accelerometer white noise, standard deviation of one sample"
    ),
    "accel_instability_ug": Figure("accel_instability_sigma", "ug"),
    "accel_instability_time_s": Figure("accel_instability_time", "s"),
    "accel_rrw_ug_sqrt_h": Figure("accel_rate_random_walk", "ug/sqrt(h)"),
    "accel_flicker_ug": Figure("accel_flicker", "ug"),
    "accel_scale_factor_sigma_ppm": Figure("accel_scale_factor_sigma", "ppm"),
    "accel_scale_factor_time_s": Figure("accel_scale_factor_time", "s", meaning=DRAWN_FOR.format("Accelerometer")),
    "accel_misalignment_sigma_urad": Figure("accel_misalignment_sigma", "urad"),
    "accel_temperature_slope_ug_k": Figure("accel_temperature_slope", "ug/K"),
    "accel_scale_factor_slope_ppm_k": Figure("accel_scale_factor_slope", "ppm/K"),
    "accel_quantum_m_s": Figure("accel_quantum", "m/s"),
    "accel_range_g": Figure("accel_range", "g"),
}
"""The figures of an inertial unit, which are keys of a section [imu] and of a grade file."""


def keys_of(row: str) -> tuple[str, ...]:
    """The figures that state a parameter row, the usual one first."""
    return tuple(name for name, figure in FIGURES.items() if figure.row == row)


WHITE = ("gyro_white_deg_h", "accel_white_ug")
"""Figures of white noise that belong to a sample rate."""
WAYS = (keys_of(GYRO.white), keys_of(ACCEL.white))
"""Figures that describe the same noise: at most one of each group may be given."""


def _omitted(figure: Figure) -> float:
    """Value of a figure that a grade omits: no error, and the start value of a time or a range."""
    row = IMU_PARAMETERS[figure.row]
    return float(UNITS[figure.unit].convert.back(row.start)) if row.lower > 0.0 else 0.0


class _ImuGrade:
    name: str
    title: str
    sources: Mapping[str, str]
    white_rate_hz: float

    def changed(self, **values: Any) -> ImuGrade:
        """The grade with other values of its fields."""
        return cast(ImuGrade, replace(self, **values))  # type: ignore[type-var]

    def figures(self) -> dict[str, Any]:
        """The figures that differ from those of a grade that omits them, by name."""
        values = {each.name: (getattr(self, each.name), each.default) for each in fields(self)[3:]}  # type: ignore[arg-type]
        return {name: value for name, (value, default) in values.items() if value != default}

    def source(self, figure: str) -> str:
        """The source of a figure."""
        return self.sources.get(figure, self.sources.get("", ""))

    def parameters(self) -> dict[str, Any]:
        """Values in SI by name of the sensor's parameter row, for `Table.pack`.

        Raises `InputError` for scale factors that drift faster than they are advanced.
        """
        for name in (f"{triad}_scale_factor_time_s" for triad in ("gyro", "accel")):
            if 0.0 < (time := float(getattr(self, name))) < LEAST_TIME_S:
                raise InputError(
                    f"{name} = {time:g} s: allowed is 0, for scale factors that are constant, or from {LEAST_TIME_S:g} s"
                )
        rows: dict[str, Any] = {}
        for name, figure in FIGURES.items():
            value = figure.to_si(getattr(self, name))
            if name in WHITE:
                value = units.density_from_sample_std(value, 1.0 / self.white_rate_hz)
            if figure.row not in rows or np.any(value):  # a row can be given in several ways: those not used are 0
                rows[figure.row] = value
        rows["gyro_g_sensitivity"] = rows["gyro_g_sensitivity"] * np.eye(3)
        return rows


if TYPE_CHECKING:

    @dataclass(frozen=True, init=False)
    class ImuGrade(_ImuGrade):
        def __init__(
            self, name: str, title: str, sources: Mapping[str, str] = ..., *, white_rate_hz: float = ..., **figures: Numbers
        ) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

else:
    ImuGrade = make_dataclass(
        "ImuGrade",
        [
            ("name", str),
            ("title", str),
            ("sources", Mapping[str, str], field(default_factory=dict)),
            *((name, Numbers, _omitted(figure)) for name, figure in FIGURES.items()),
            ("white_rate_hz", float, 200.0),
        ],
        bases=(_ImuGrade,),
        frozen=True,
        namespace={
            "__module__": __name__,
            "__doc__": """Grade of an inertial sensor: its `FIGURES`, in the data-sheet units that the names show.

            ``*_sigma_*`` are standard deviations of quantities drawn at the start, ``*_instability_*`` of the Gauss-Markov
            in-run bias, ``*_flicker_*`` floors of the Allan deviation, ``*_white_*`` of one sample at `white_rate_hz` (an
            alternative to giving white noise as a random walk).  A bias given as one number applies to all three sensor axes.
            `sources` gives the source of each figure by name; "" stands for all that are not named.
            """,
        },
    )


# Names of at most 16 characters for the elements of parameter rows.
#
# MAVLink's parameters bear them: the vehicle that sends them and the reader of its logs use the same names.

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

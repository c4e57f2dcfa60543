"""Two-antenna heading: the baseline between two GNSS antennas, and its azimuth.

At an epoch, with the attitude C_nb:

    d_n = C_nb (d_b + error) + wander + outlier + noise w
    azimuth = atan2(d_E, d_N)

d_b is the baseline that is told, from the first to the second antenna; its error is constant.  The wander is multipath, a
first-order Gauss-Markov process on each axis; an outlier is a wrong ambiguity, a displacement in a random direction.  The
receiver knows the length of the baseline: a measured one that differs by more than the tolerance is not delivered.  The
standard deviation of the azimuth that it reports is that of noise and wander across the horizontal part of the measured
baseline.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import casadi as ca
import numpy as np

from insenv.attitude import rotate
from insenv.base.errors import InputError
from insenv.base.toml import Vector3, key, within
from insenv.core.elementary import PI, atan2, maximum, minimum
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.sensors.contract import ErrorSource, Sensor, Stated
from insenv.sensors.figures import Figure, FiguresSection, Grade, TimedSection, by_name, figures_section
from insenv.sensors.gnss import direction
from insenv.sensors.imu import normals
from insenv.sensors.imu_tables import HUGE
from insenv.sensors.instruments import HEADING
from insenv.sensors.sampled import LOST, Motion, Sampled, gauss_markov, root_sum

SHORTEST = 1e-3
"""Least horizontal length, m, by which the reported standard deviation divides."""
SMALLEST_SIGMA = 1e-6
"""Smallest standard deviation that the receiver reports, rad."""

PARAMETERS = Table((
    HEADING.told["heading_baseline_b"],
    Row("heading_baseline_error", "Actual minus stated baseline, fixed part", "m", (3,), "b"),
    Row("heading_baseline_error_sigma", "Actual minus stated baseline, 1 sigma of the part drawn at the start", "m", (3,), "b",
        lower=0.0),
    Row("heading_baseline_noise", "White noise of the measured baseline, standard deviation", "m", (3,), "n", lower=0.0),
    Row("heading_wander_sigma", "Correlated error of the measured baseline (Gauss-Markov), standard deviation", "m", (3,), "n",
        lower=0.0),
    Row("heading_wander_time", "Correlated error of the measured baseline (Gauss-Markov), correlation time", "s", start=60.0,
        lower=1e-3, upper=HUGE),
    Row("heading_outlier_probability", "Probability of a wrong ambiguity", lower=0.0, upper=1.0),
    Row("heading_outlier_size", "Length of the displacement by a wrong ambiguity, in a random direction", "m", start=0.19,
        lower=0.0),
    Row("heading_length_tolerance", "Largest difference of the measured from the stated length, 0: no check", "m", lower=0.0),
))  # fmt: skip

STATE = Table((
    Row("heading_baseline_true", "Actual baseline from the first to the second antenna", "m", (3,), "b"),
    Row("heading_wander", "Correlated error at the latest epoch", "m", (3,), "n"),
))  # fmt: skip


def _start(p: Values, r: Any) -> dict[str, Any]:
    n = normals(r)
    error = p.heading_baseline_error + p.heading_baseline_error_sigma * n[0:3]
    return {"heading_baseline_true": p.heading_baseline_b + error, "heading_wander": p.heading_wander_sigma * n[3:6]}


def _measure(p: Values, x: Values, r: Any, motion: Motion) -> dict[str, Any]:
    n = normals(r[0:6])
    wander = gauss_markov(x.heading_wander, p.heading_wander_sigma, p.heading_wander_time, p.heading_interval, n[0:3])
    outlier = (r[6] < p.heading_outlier_probability) * p.heading_outlier_size * direction(r[7], r[8])
    exact = rotate(x.q_nb, x.heading_baseline_true)
    shown = exact + wander + outlier + p.heading_baseline_noise * n[3:6]
    difference = ca.fabs(ca.sqrt(ca.sumsqr(shown)) - ca.sqrt(ca.sumsqr(p.heading_baseline_b)))
    return {
        "heading_azimuth": atan2(shown[1], shown[0]),
        "heading_azimuth_sigma": _azimuth_sigma(p, shown),
        "heading_baseline_n": shown,
        "heading_azimuth_true": atan2(exact[1], exact[0]),
        "heading_wander": wander,
        LOST: (p.heading_length_tolerance > 0.0) * (difference > p.heading_length_tolerance),
    }


def _azimuth_sigma(p: Values, shown: Any) -> Any:
    """Standard deviation of the azimuth (rad) of a measured baseline (3, m, n) that the receiver reports."""
    north, east = shown[0], shown[1]
    level = maximum(north * north + east * east, SHORTEST * SHORTEST)
    variance = p.heading_baseline_noise**2 + p.heading_wander_sigma**2
    across = (east * east * variance[0] + north * north * variance[1]) / (level * level)
    return minimum(maximum(ca.sqrt(across), SMALLEST_SIGMA), PI)


def _told(rows: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "heading_baseline_b": rows["heading_baseline_b"],
        "heading_baseline_sigma": root_sum(rows["heading_baseline_error"], rows["heading_baseline_error_sigma"]),
        "heading_baseline_noise": rows["heading_baseline_noise"],
        "heading_wander_sigma": rows["heading_wander_sigma"],
        "heading_wander_time": rows["heading_wander_time"],
    }


ERRORS = (
    ErrorSource("heading noise", ("heading_baseline_noise",)),
    ErrorSource("heading wander", ("heading_wander_sigma",)),
    ErrorSource("heading baseline", ("heading_baseline_error", "heading_baseline_error_sigma")),
    ErrorSource("heading outliers", ("heading_outlier_probability",)),
)

EQUATIONS = Sampled(
    HEADING,
    parameters=PARAMETERS,
    state=STATE,
    exact=Table((Row("heading_azimuth_true", "True azimuth of the actual baseline at the epoch of the measurement", "rad"),)),
    measure=_measure,
    uniforms=9,
    truth=("heading_baseline_true",),
    told=_told,
    errors=ERRORS,
    stated=Stated(HEADING.new, lambda p, x: {"heading_azimuth_sigma": _azimuth_sigma(p, x.heading_baseline_n)}),
    start=_start,
    start_uniforms=6,
)

FIGURES: dict[str, Figure] = {
    "noise_m": Figure("heading_baseline_noise", "m", vector=True),
    "wander_sigma_m": Figure("heading_wander_sigma", "m", vector=True),
    "wander_time_s": Figure("heading_wander_time", "s"),
    "baseline_error_m": Figure("heading_baseline_error", "m", vector=True),
    "baseline_sigma_m": Figure("heading_baseline_error_sigma", "m", vector=True),
    "outlier_probability": Figure("heading_outlier_probability"),
    "outlier_size_m": Figure("heading_outlier_size", "m"),
    "length_tolerance_m": Figure("heading_length_tolerance", "m"),
}

_F9P = (
    "u-blox ZED-F9P data sheet: heading 0.4 deg at 1 m, so 7 mm across; insenv's choice: half of the variance multipath, 60 s"
)

GRADES = by_name(
    Grade("perfect", "No errors"),
    Grade(
        "rtk",
        "Moving-base real-time kinematic, fixed ambiguities, typical of the u-blox ZED-F9P",
        {
            "": _F9P,
            "baseline_sigma_m": "insenv's choice: the baseline is measured with a ruler, 2 mm",
            "length_tolerance_m": "insenv's choice: 5 cm",
        },
        {
            "noise_m": (0.005, 0.005, 0.01),
            "wander_sigma_m": (0.005, 0.005, 0.01),
            "wander_time_s": 60.0,
            "baseline_sigma_m": 0.002,
            "length_tolerance_m": 0.05,
        },
    ),
)

if TYPE_CHECKING:
    HeadingFigures = FiguresSection
else:
    HeadingFigures = figures_section("HeadingFigures", PARAMETERS, GRADES, FIGURES, "rtk")


class HeadingSection(HeadingFigures, TimedSection):
    """The two-antenna heading."""

    sensor: ClassVar[Sensor] = EQUATIONS.sensor()

    baseline_m: Annotated[Vector3, within(-1e3, 1e3)] = key(
        (1.0, 0.0, 0.0), "from the first to the second antenna: forward, right, down", "m"
    )

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`.  Raises `InputError` for a baseline without length, or wrong times."""
        if not any(self.baseline_m):
            raise InputError("heading.baseline_m = [0, 0, 0] m: allowed is a baseline with a length")
        return {**self.timing(rate_hz), **self.error_rows(), "heading_baseline_b": np.array(self.baseline_m)}

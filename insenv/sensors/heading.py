"""Two-antenna heading: the baseline between two GNSS antennas, and its azimuth.

At an epoch, with the attitude C_nb:

    d_n = C_nb (d_b + error) + wander + outlier + noise w
    azimuth = atan2(d_E, d_N)

d_b is the stated baseline, from the first to the second antenna; its error is constant.  The wander is multipath, a
first-order Gauss-Markov process on each axis; an outlier is a wrong ambiguity, a displacement in a random direction.  The
receiver knows the length of the baseline: a measured one that differs by more than the tolerance is not delivered.  The
standard deviation of the azimuth that it reports is that of noise and wander across the horizontal part of the measured
baseline.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import casadi as ca
from pydantic import AfterValidator

from insenv.base.toml import Vector3, within
from insenv.core.elementary import PI, atan2, maximum, minimum
from insenv.core.model import Values
from insenv.core.tables import Row
from insenv.sensors import units
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.gnss import direction
from insenv.sensors.instrument import Column, Estimated, Instrument, Outlier, Setting, Term, constant, drift, white

SHORTEST = 1e-3
"""Least horizontal length, m, by which the reported standard deviation divides."""
SMALLEST_SIGMA = 1e-6
"""Smallest standard deviation that the receiver reports, rad."""
FLATTEST = 0.3
"""Least horizontal part of the baseline, of its length, with which a filter uses its azimuth: 17 deg from the vertical."""

BASELINE = Row("heading_baseline_b", "From the first to the second antenna", "m", (3,), "b", (1.0, 0.0, 0.0), -1e3, 1e3)
OUTLIER_PROBABILITY = Row("heading_outlier_probability", "Probability of a wrong ambiguity", lower=0.0, upper=1.0)


def _length_squared(p: Values) -> Any:
    return ca.sumsqr(p.heading_baseline_b) + 1e-12


TERMS = (
    white("heading_baseline_noise", "heading noise", "White noise of the measured baseline", "m", (3,), "n", sigma_shape=(3,),
          normals=(3,)),
    constant(
        "heading_baseline_error", "baseline", "heading baseline", "Actual minus stated baseline", "m", (3,), "b",
        value="heading_baseline_offset", stated="heading_baseline_sigma", normals=(0,),
    ),
    drift(
        "heading_wander", "wander", "heading wander", "Slowly changing error of the measured baseline: multipath", "m", (3,),
        "n", sigma_shape=(3,), start_time=60.0, normals=(3, 0),
    ),
    # what an error of the baseline across it does to the azimuth is all of it that a filter can tell
    Term(
        "offset", "heading baseline", "constant", (), "rad",
        states=(Estimated("heading_offset", "azimuth error of the antenna baseline in the body", sigma="heading_baseline_sigma",
                          start_sigma=lambda p: p.heading_baseline_sigma / ca.sqrt(_length_squared(p))),),
    ),
)  # fmt: skip


def _measure(motion: Any, e: Values, p: Values) -> dict[str, Any]:
    baseline = motion.to_navigation(p.heading_baseline_b + e.baseline) + e.wander + e.outlier + e.noise
    return {"heading_azimuth": atan2(baseline[1], baseline[0]) + e.offset, "heading_baseline_n": baseline}


def _exact(motion: Any, e: Values, p: Values) -> dict[str, Any]:
    baseline = motion.to_navigation(p.heading_baseline_b + e.baseline)
    return {"heading_azimuth_true": atan2(baseline[1], baseline[0])}


def _azimuth_sigma(p: Values, rows: Mapping[str, Any]) -> dict[str, Any]:
    """Standard deviation of the azimuth (rad) of a measured baseline that the receiver reports."""
    north, east = rows["heading_baseline_n"][0], rows["heading_baseline_n"][1]
    level = maximum(north * north + east * east, SHORTEST * SHORTEST)
    variance = p.heading_baseline_noise**2 + p.heading_wander_sigma**2
    across = (east * east * variance[0] + north * north * variance[1]) / (level * level)
    return {"heading_azimuth_sigma": minimum(maximum(ca.sqrt(across), SMALLEST_SIGMA), PI)}


def _lost(p: Values, rows: Mapping[str, Any]) -> Any:
    """Whether the measured length differs too much from the stated one."""
    difference = ca.fabs(ca.sqrt(ca.sumsqr(rows["heading_baseline_n"])) - ca.sqrt(ca.sumsqr(p.heading_baseline_b)))
    return (p.heading_length_tolerance > 0.0) * (difference > p.heading_length_tolerance)


def _usable(motion: Any, p: Values) -> Any:
    baseline = motion.to_navigation(p.heading_baseline_b)
    return ca.sumsqr(baseline[:2]) > FLATTEST**2 * _length_squared(p)


def _with_length(value: Any) -> Any:
    if not any(value):
        raise ValueError("[0, 0, 0] m: allowed is a baseline with a length")
    return value


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
    Grade.of(
        "rtk",
        "Moving-base real-time kinematic, fixed ambiguities, typical of the u-blox ZED-F9P",
        _F9P,
        noise_m=(0.005, 0.005, 0.01),
        wander_sigma_m=(0.005, 0.005, 0.01),
        wander_time_s=60.0,
        baseline_sigma_m=(0.002, "insenv's choice: the baseline is measured with a ruler, 2 mm"),
        length_tolerance_m=(0.05, "insenv's choice: 5 cm"),
    ),
)

HEADING = Instrument(
    "heading",
    title="Two-antenna heading",
    called="the two-antenna heading",
    what="azimuth",
    causes="the baseline's direction in the body, its length, and the stated sigma of the azimuth",
    values=(
        Row("heading_azimuth", "Azimuth of the baseline from the first to the second antenna, clockwise from north", "rad",
            lower=-7.0, upper=7.0),
        Row("heading_azimuth_sigma", "Standard deviation of the azimuth that the receiver reports", "rad", start=1.0,
            lower=0.0, upper=1e3),
        Row("heading_baseline_n", "The baseline; zero where only the azimuth is known", "m", (3,), "n", lower=-1e4, upper=1e4),
    ),
    terms=TERMS,
    measure=_measure,
    holds=("heading",),
    parameters=(
        BASELINE,
        OUTLIER_PROBABILITY,
        Row("heading_outlier_size", "Length of the displacement by a wrong ambiguity, in a random direction", "m", start=0.19,
            lower=0.0),
        Row("heading_length_tolerance", "Largest difference of the measured from the stated length, 0: no check", "m",
            lower=0.0),
    ),
    stated=(BASELINE,),
    exact=_exact,
    exact_rows=(Row("heading_azimuth_true", "True azimuth of the actual baseline at the epoch of the measurement", "rad"),),
    totals=(
        (Row("heading_baseline_true", "Actual baseline from the first to the second antenna", "m", (3,), "b"),
         lambda e, p: p.heading_baseline_b + e.baseline),
    ),
    accuracy=_azimuth_sigma,
    lost=_lost,
    outlier=Outlier(
        "outlier", OUTLIER_PROBABILITY.name, 3,
        lambda p, r: (r[0] < p.heading_outlier_probability) * p.heading_outlier_size * direction(r[1], r[2]),
    ),
    aid_row="heading_azimuth",
    limit_row="heading_baseline_n",
    aid_parameters=("heading_baseline_b", "heading_wander_sigma", "heading_wander_time"),
    angle=True,
    sigma="heading_azimuth_sigma",
    least_sigma={"heading_azimuth": 1e-4, "heading_baseline_n": 1e-3},
    lasting=lambda motion, p: (ca.sumsqr(p.heading_wander_sigma[:2]) / 2 / _length_squared(p), p.heading_wander_time),
    usable=_usable,
    columns=(
        Column("azimuth", "heading_azimuth", "azimuth of the baseline, clockwise from north", units.ANGLE_UNITS, "deg",
               angle=True),
        Column("azimuth_sigma", "heading_azimuth_sigma", "standard deviation of the azimuth", units.ANGLE_UNITS,
               unit_key="azimuth_unit", constant="azimuth_sigma_deg"),
        Column("baseline", "heading_baseline_n", "measured baseline north, east, down [m]; absent: the azimuth alone",
               optional=True),
    ),
    settings=(
        Setting("baseline_m", Annotated[Vector3, within(-1e3, 1e3), AfterValidator(_with_length)], (1.0, 0.0, 0.0),
                "from the first to the second antenna: forward, right, down", "m", BASELINE.name, needed=True),
    ),
    figures=FIGURES,
    grades=GRADES,
    grade="rtk",
)  # fmt: skip

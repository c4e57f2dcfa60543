"""A plant whose instruments are worse than their data sheets and fail for a while: real noises, and windows with faults.

The receiver says nothing of it: its fixes report the standard deviations of the data sheet throughout.

    street       the noises of fixes grow, as between houses
    jamming      they grow much more
    drag         positions are drawn away steadily, horizontally, as by a spoofed signal; velocities stay true
    vibration    the white noises of the inertial unit grow
    stuck        one axis of the inertial unit repeats the increment with which the window began
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from insenv import geodesy
from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import maximum, select
from insenv.core.model import Model, Step
from insenv.core.tables import Array, Row, Table
from insenv.envs.checks import check_number, check_type
from insenv.envs.embedded_filter import SCALE, scaled_model
from insenv.envs.filter_score import FilterInside, ScoredStarts
from insenv.envs.starts import uniforms_of
from insenv.scenario import Scenario, plant_of
from insenv.sensors import GNSS

NOISES = ("angle_random_walk", "velocity_random_walk", "gnss_position_noise", "gnss_velocity_noise")
"""Parameters of the plant whose true values differ from the data sheet."""
BIASES = ("gyro_bias_sigma", "accel_bias_sigma")
"""Parameters of the plant whose true values differ from the data sheet from the start on."""
FAULTS = ("street", "jamming", "drag", "vibration", "stuck")
STREET, JAMMING, DRAG, VIBRATION, STUCK = range(5)
PARTS = 3
"""Parts of an episode of equal length, each with at most one window of each kind."""

FAULT_PARAMETERS = Table((
    Row("noise_factor", f"True over stated value of {', '.join(NOISES)}", "1", (4,), start=1.0, lower=0.0, upper=1e4),
    Row("fault_begin", f"Begins of the windows of {', '.join(FAULTS)}, by part", "s", (5, PARTS), lower=0.0, upper=1e9),
    Row("fault_end", "Their ends; a window that ends as it begins is empty", "s", (5, PARTS), lower=0.0, upper=1e9),
    Row("fault_factor", "Factors on the noises in the windows", "1", (5, PARTS), start=1.0, lower=0.0, upper=1e4),
    Row("fault_drag", "Displacement of positions at the end of a drag", "m", (3,), "n", lower=-1e5, upper=1e5),
    Row("fault_axis", "1 for the axis that is stuck: gyros, accelerometers", "1", (6,), lower=0.0, upper=1.0),
))  # fmt: skip
_STATE = Table((
    Row("fault_now", f"1 in the window of {', '.join(FAULTS)}", "1", (5,), lower=0.0, upper=1.0),
    Row("fault_held", "Increments with which the stuck window began", "rad, m/s", (6,), "b"),
))  # fmt: skip

SOONEST_S = 20.0
"""Time before which no window begins, s."""
SHARE = 0.5
"""Probability of each window."""
LENGTH_S = ((5.0, 20.0), (5.0, 15.0), (15.0, 30.0), (5.0, 20.0), (2.0, 8.0))
"""Shortest and longest windows."""
FACTOR = ((3.0, 8.0), (10.0, 30.0), (1.0, 1.0), (5.0, 30.0), (1.0, 1.0))
"""Smallest and largest factors on the noises; uniform in their logarithm."""
DRAG_M = (20.0, 80.0)
"""Smallest and largest displacement at the end of the drag, m, in a random horizontal direction."""


@lru_cache(maxsize=16)
def faulty(plant: Model) -> Model:
    """The plant with `FAULT_PARAMETERS` behind its own; without faults and with factors of 1 the same numbers, to the bit."""
    part = Part(
        parameters=FAULT_PARAMETERS,
        state=_STATE,
        steps={"fault": Step(_fault), "fault_fix": Step(_fix, when="gnss_valid")},
    )
    return merge(
        f"{plant.id}-faulty",
        f"{plant.title}, with faults",
        [as_part(scaled_model(plant, NOISES)), part],
        plant.outputs,
        plant.output,
    )


def _fault(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Find the windows, set the noises of the next sample, and hold the stuck axis."""
    inside = (x.time >= p.fault_begin) * (x.time < p.fault_end)
    now = ca.sum2(inside)
    factor = 1.0 + ca.sum2(inside * (p.fault_factor - 1.0))
    receiver = factor[STREET] * factor[JAMMING]
    measured = ca.vertcat(x.delta_angle, x.delta_velocity)
    held = select(x.fault_now[STUCK] * now[STUCK], x.fault_held, measured)
    given = select(now[STUCK] * p.fault_axis, held, measured)
    return {
        "fault_now": now,
        SCALE: p.noise_factor * ca.vertcat(factor[VIBRATION], factor[VIBRATION], receiver, receiver),
        "fault_held": held,
        "delta_angle": given[:3],
        "delta_velocity": given[3:],
    }


def _fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Displace a fix that is drawn away; let it report what the data sheet says."""
    begin, end = p.fault_begin[DRAG, :], p.fault_end[DRAG, :]
    share = ca.sum2((x.time >= begin) * (x.time < end) * (x.time - begin) / maximum(end - begin, 1e-3))
    place = ("gnss_latitude", "gnss_longitude", "gnss_height")
    moved = geodesy.geodetic_from_ned_offset(p.fault_drag * share, *(getattr(x, name) for name in place))
    assert GNSS.stated is not None
    return {
        **{name: select(share > 0.0, value, getattr(x, name)) for name, value in zip(place, moved, strict=True)},
        **GNSS.stated.rows(p, x),
    }


class FaultyStarts(ScoredStarts):
    """`ScoredStarts` of a faulty plant.

    spread: the true noises and biases are those of the data sheet times factors whose decimal logarithms are uniform between
    -spread and +spread.  faults: whether there are windows.
    """

    def __init__(self, *arguments: Any, estimator: str, spread: float, faults: bool) -> None:
        super().__init__(*arguments, estimator=estimator)
        self.spread, self.faults = spread, faults

    def draw(self, generators: Sequence[np.random.Generator]) -> Array:
        p = super().draw(generators)
        if self._run_seed is not None:  # the instruments of a run are those of the scenario
            return p
        table, windows = self.task.model.parameters, len(FAULTS) * PARTS
        numbers = uniforms_of(generators, 6 + 3 * windows + 3)
        factors = 10.0 ** (self.spread * (2.0 * numbers[:, :6] - 1.0))
        p[:, table.slice("noise_factor")] = factors[:, :4]
        for k, name in enumerate(BIASES):
            p[:, table.slice(name)] *= factors[:, 4 + k, None]
        if not self.faults:
            return p
        when, length, factor = np.moveaxis(numbers[:, 6 : 6 + 3 * windows].reshape(-1, 3, len(FAULTS), PARTS), 1, 0)
        (shortest, longest), (least, most) = (np.array(pairs).T[:, :, None] for pairs in (LENGTH_S, FACTOR))
        part = max(self.duration - SOONEST_S, 0.0) / PARTS
        lengths = np.where(when < SHARE, np.minimum(shortest + (longest - shortest) * length, part), 0.0)
        begin = SOONEST_S + part * np.arange(PARTS) + (when % SHARE) / SHARE * (part - lengths)
        for name, values in (("begin", begin), ("end", begin + lengths), ("factor", least * (most / least) ** factor)):
            p[:, table.slice(f"fault_{name}")] = values.reshape(len(p), windows)
        far, way, axis = numbers[:, 6 + 3 * windows :].T
        distance, angle = DRAG_M[0] + (DRAG_M[1] - DRAG_M[0]) * far, 2.0 * np.pi * way
        p[:, table.slice("fault_drag")] = np.stack([distance * np.cos(angle), distance * np.sin(angle), 0.0 * far], axis=1)
        p[:, table.slice("fault_axis")] = np.eye(6)[(axis * 6).astype(int)]
        return p


@dataclass(kw_only=True, repr=False, eq=False)
class Faulty(FilterInside):
    """The arguments of all environments with a filter inside and instruments that fail."""

    drawn: ClassVar[tuple[str, ...]] = ("spread_decades", "faults")
    samples_per_step: int = 200
    duration_s: float | None = 240.0
    spread_decades: float = 0.5
    faults: bool = True

    def _plant(self, scenario: Scenario) -> Model:
        """Return the plant of a scenario, with faults."""
        check_number("spread_decades", self.spread_decades, 0.0, 2.0)
        check_type("faults", self.faults, bool, "True or False")
        return faulty(plant_of(scenario)[0])

    def _starts(self, scenario: Scenario, *rest: Any) -> FaultyStarts:
        return FaultyStarts(scenario, *rest, estimator=self.estimator, spread=float(self.spread_decades), faults=self.faults)

"""How an episode starts: what is drawn of the scenario, and the parameters that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.core.tables import Table
from insenv.envs.knowledge import TOLD, told_rows
from insenv.envs.limit import limits_of
from insenv.envs.task import Task
from insenv.errors import InputError
from insenv.scenario import Scenario, plant_of
from insenv.scenario.build import check_speed_of_sinusoids
from insenv.scenario.description import MAX_SEED
from insenv.scenario.sensor_notes import sensor_notes
from insenv.sensors import imu_grade
from insenv.sensors.gnss import OUTAGES
from insenv.sensors.imu_tables import IMU_PARAMETERS

Array = NDArray[np.float64]
Range = tuple[float, float]

IMU_RANGE = ("marine", "tactical")


@dataclass(frozen=True)
class Ranges:
    """What differs from episode to episode, besides the seed; None: as the scenario has it.

    imu: a grade of the catalogue, or "random": between the grades `imu_range`, in the logarithm of each figure.
    heading_deg, sea_state: uniform between two numbers; `sea_state` multiplies the amplitudes (and standard deviations) of the
    vehicle's waves, sway, engine and gusts.  initial_error: standard deviations told and drawn of tilt and heading, deg.
    gnss_outages_s: windows without fixes.
    """

    imu: str | None = None
    imu_range: tuple[str, str] = IMU_RANGE
    heading_deg: Range | None = None
    sea_state: Range | None = None
    initial_error: Range | None = None
    gnss_outages_s: tuple[Range, ...] | None = None

    OPTIONS = ("imu", "heading_deg", "sea_state", "initial_error", "gnss_outages_s", "run_seed")

    def __post_init__(self) -> None:
        for grade in (*self.imu_range, *([] if self.imu in (None, "random") else [self.imu])):
            imu_grade(grade)
        for name, least, most in (("heading_deg", -360.0, 360.0), ("sea_state", 0.0, 10.0)):
            _check_range(name, getattr(self, name), least, most)
        if self.initial_error is not None:
            sigmas = np.asarray(self.initial_error, dtype=float)
            if sigmas.shape != (2,) or not np.all((sigmas > 0.0) & (sigmas <= 360.0)):
                raise InputError(
                    f"initial_error = {self.initial_error}: allowed are two numbers above 0 up to 360 deg: tilt, heading"
                )
        for window in self.gnss_outages_s or ():
            if len(window) != 2 or not 0.0 <= window[0] < window[1] < np.inf:
                raise InputError(f"gnss_outages_s has {window}: allowed are pairs of begin and end, 0 <= begin < end, s")
        if len(self.gnss_outages_s or ()) > OUTAGES:
            raise InputError(f"gnss_outages_s has {len(self.gnss_outages_s or ())} windows: allowed are at most {OUTAGES}")

    def overridden(self, options: Mapping[str, Any]) -> Ranges:
        """With the options of a reset in place of the arguments; a number stands for a range of one value."""
        unknown = sorted(set(options) - set(self.OPTIONS))
        if unknown:
            raise InputError(f"options has {', '.join(map(repr, unknown))}: allowed are {', '.join(self.OPTIONS)}")
        given = {name: value for name, value in options.items() if name != "run_seed"}
        for name in ("heading_deg", "sea_state"):
            if name in given and np.ndim(given[name]) == 0:
                given[name] = (given[name], given[name])
        return replace(self, **given)


def _check_range(name: str, value: Any, least: float, most: float) -> None:
    if value is None:
        return
    try:
        pair = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        pair = np.zeros(0)
    if pair.shape != (2,) or not least <= pair[0] <= pair[1] <= most:
        raise InputError(f"{name} = {value!r}: allowed are two rising numbers from {least:g} to {most:g}")


class Starts:
    """Draws the parameters of episodes of a task in a scenario.

    Each episode draws from the generator of its own row and from nothing else, always the same count of numbers.
    constants: parameter rows that all episodes have.  duration: of an episode, s.
    """

    def __init__(self, scenario: Scenario, task: Task, ranges: Ranges, constants: Mapping[str, float], duration: float) -> None:
        self.scenario, self.task, self.ranges, self.duration = scenario, task, ranges, duration
        self._constants = task.model.parameters.pack(constants)
        self._plant = plant_of(scenario)[0]
        self._vehicle = scenario.vehicle.vehicle().parameters
        if ranges.sea_state is not None:
            rows = {name: np.asarray(value) for name, value in plant_of(scenario)[1].items()}
            _scale(rows, self._vehicle, ranges.sea_state[1])
            check_speed_of_sinusoids(rows, 1.0 / scenario.rate_hz)
        if ranges.gnss_outages_s and scenario.gnss is None:
            raise InputError("gnss_outages_s: the scenario has no [gnss]")
        self._base = self._bases(ranges)

    def draw(self, generators: Sequence[np.random.Generator], options: Mapping[str, Any] | None = None) -> Array:
        """Parameters of new episodes, one of each generator, (k, parameters.size); `tell` completes them."""
        ranges, bases = self.ranges, self._base
        if options:
            ranges = self.ranges.overridden(options)
            bases = self._bases(ranges)
        parameters, vectors = self._plant.parameters, np.empty((len(generators), bases[0].size))
        for vector, generator in zip(vectors, generators, strict=True):
            seed, grade, heading, sea = int(generator.integers(0, MAX_SEED)), *generator.uniform(size=3)
            vector[:] = bases[0] if len(bases) == 1 else _between(bases[0], bases[1], grade, parameters)
            vector[parameters.slice("seed")] = seed
            if ranges.heading_deg is not None:
                vector[parameters.slice("start_heading")] = radians(_at(ranges.heading_deg, heading))
            if ranges.sea_state is not None:
                rows = {name: vector[parameters.slice(name)] for name in self._vehicle.names}
                _scale(rows, self._vehicle, _at(ranges.sea_state, sea))
        if options and "run_seed" in options:
            vectors[:, parameters.slice("seed")] = _run_seeds(options["run_seed"], len(vectors))[:, None]
        p = np.tile(self._constants, (len(vectors), 1))
        p[:, : vectors.shape[1]] = vectors  # the plant's rows come first
        return p

    def tell(self, p: Array, x: Array, options: Mapping[str, Any] | None = None) -> Array:
        """p with what is told of start states x (k, state.size), and with the limits."""
        ranges = self.ranges.overridden(options) if options else self.ranges
        model, scenario = self.task.model, self.scenario
        if ranges.initial_error is not None:
            tilt, heading = ranges.initial_error
            told = {"tilt_sigma_deg": tilt, "heading_sigma_deg": heading}
            scenario = scenario.model_copy(update={"knowledge": scenario.knowledge.model_copy(update=told)})
        rows = model.parameters.unpack(p)
        sheets = [self._sheet(rows, i) for i in (range(len(p)) if ranges.imu == "random" else (0,))]
        notes = sheets if len(sheets) == len(p) else sheets * len(p)
        first, last = model.parameters.slice(TOLD.names[0]), model.parameters.slice(TOLD.names[-1])
        p[:, first.start : last.stop] = told_rows(scenario, rows, model.state.unpack(x), notes)
        if "limit" in model.parameters:
            p[:, model.parameters.slice("limit")] = limits_of(self.task, scenario, rows, notes, self.duration)
        return p

    def _sheet(self, rows: Mapping[str, Array], i: int) -> Any:
        plant = {name: rows[name][i] for name in IMU_PARAMETERS.names}
        return sensor_notes(plant, self.scenario.vehicle.in_place)

    def _bases(self, ranges: Ranges) -> tuple[Array, ...]:
        """The plant's parameters, one vector, or two to draw between."""
        grades: tuple[str | None, ...] = ranges.imu_range if ranges.imu == "random" else (ranges.imu,)
        bases = []
        for grade in grades:
            scenario = self.scenario
            if grade is not None:
                scenario = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": grade})})
            model, rows = plant_of(scenario)
            if ranges.gnss_outages_s is not None:
                if scenario.gnss is None:
                    raise InputError("gnss_outages_s: the scenario has no [gnss]")
                windows = np.zeros((2, OUTAGES))
                windows[:, : len(ranges.gnss_outages_s)] = np.array(ranges.gnss_outages_s).reshape(-1, 2).T
                rows = rows | {"gnss_outage_start": windows[0], "gnss_outage_end": windows[1]}
            bases.append(model.parameters.pack(rows))
        return tuple(bases)


def _at(bounds: Range, fraction: float) -> float:
    return bounds[0] + (bounds[1] - bounds[0]) * fraction


def _scale(rows: dict[str, Array], vehicle: Table, factor: float) -> None:
    """Multiply the vehicle's amplitudes and standard deviations, in place where they are views."""
    for name in vehicle.names:
        if name in rows and name.endswith(("_amplitude", "_sigma")):
            rows[name] *= factor


def _between(low: Array, high: Array, fraction: float, parameters: Table) -> Array:
    """Inertial figures between two grades: in the logarithm where both are positive, else linear; the rest is low's."""
    found = low.copy()
    for name in IMU_PARAMETERS.names:
        if name not in parameters:
            continue
        part = parameters.slice(name)
        a, b = low[part], high[part]
        positive = (a > 0.0) & (b > 0.0)
        mixed = a + (b - a) * fraction
        mixed[positive] = a[positive] * (b[positive] / a[positive]) ** fraction
        found[part] = mixed
    return found


def _run_seeds(given: Any, count: int) -> Array:
    seeds = np.asarray(given)
    if seeds.shape not in ((), (count,)) or seeds.dtype.kind not in "iu" or np.any(seeds < 0) or np.any(seeds > MAX_SEED):
        raise InputError(f"options run_seed = {given!r}: allowed is a whole number from 0 to 2^53, or one for each row")
    return np.broadcast_to(seeds + (np.arange(count) if seeds.ndim == 0 else 0), (count,)).astype(float)

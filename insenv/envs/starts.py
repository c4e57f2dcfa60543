"""The start of an episode: random draws, and the model parameters that follow from them and from the start state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from math import pi, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import estimators
from insenv.base.errors import InputError, nearest
from insenv.core.model import Model
from insenv.core.noise import first_uniforms
from insenv.core.tables import Array, Table
from insenv.envs.checks import as_numbers, check_choice, check_number, check_range, check_type, is_number, refused
from insenv.envs.knowledge import KNOWN, KNOWN_FIELDS, fields_known, knowledge_of, known_rows
from insenv.envs.task import Task
from insenv.envs.units import middle_unit, units_between, units_of
from insenv.envs.varied import Varied, variations_of
from insenv.estimators.knowledge import Knowledge
from insenv.evaluation.limits import Limit
from insenv.scenario import Scenario, limit_along, plant_of, prior_of
from insenv.scenario.build import build, check_speed_of_sinusoids
from insenv.scenario.description import MAX_SEED, KnowledgeSection
from insenv.scenario.loop import PREFIX
from insenv.sensors.data_sheet import data_sheets, imu_data_sheet
from insenv.sensors.grade_file import grade_of
from insenv.sensors.imu_tables import IMU_PARAMETERS
from insenv.sensors.sampled import OUTAGES

Range = tuple[float, float]

IMU_RANGE = ("marine", "tactical")
"""Default grades between which a random unit is drawn."""
RANKED = ("angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma")
"""Figures of a data sheet by which one unit is better than another."""


@dataclass(kw_only=True, repr=False, eq=False)
class Variation:
    """What varies between the episodes of every environment, besides the seed; None keeps the scenario's value.

    A random unit is one of those of `insenv.envs.starts`; `imu_sheet` is its data sheet.  `initial_error` is both reported
    and used for the draw.  `vary`: keys of the scenario and the distributions from which each episode draws them
    (`insenv.envs.varied`); `known`: which of them the initial knowledge follows.
    """

    imu: str | None = None
    imu_range: tuple[str, str] | None = None
    imu_sheet: str = "drawn"
    heading_deg: Range | None = None
    sea_state: Range | None = None
    initial_error: Range | None = None
    gnss_outages_s: tuple[Range, ...] | None = None
    vary: Mapping[str, Any] | None = None
    known: bool | Sequence[str] = False


@dataclass(kw_only=True)
class Ranges(Variation):
    """All that can vary between episodes: the arguments of an environment with the options of a reset.

    units: the grades of a random unit if `imu_range` is None.  taken: names of those that an environment takes.  Raises
    `InputError` for a value that is not allowed.
    """

    sway_phases: bool = False
    mounting_deg: float | None = None
    start_speed_mps: Range | None = None
    units: tuple[str, str] = IMU_RANGE
    taken: tuple[str, ...] = ()

    @classmethod
    def of(cls, arguments: Any) -> Ranges:
        """Return the ranges in an environment's arguments; what it does not take keeps its default."""
        names = [field.name for field in fields(cls) if hasattr(arguments, field.name)]
        return cls(taken=tuple(names), **{name: getattr(arguments, name) for name in names})

    def __post_init__(self) -> None:
        check_type("imu", self.imu, (str, type(None)), 'a grade of the catalogue, "random" or None')
        between = self.grades
        if not isinstance(between, (tuple, list)) or len(between) != 2 or not all(isinstance(name, str) for name in between):
            raise refused("imu_range", between, "two grades of the catalogue")
        check_choice("imu_sheet", self.imu_sheet, ("drawn", "middle"))
        for grade in (*between, *([] if self.imu in (None, "random") else [self.imu])):
            grade_of(grade)
        check_range("heading_deg", self.heading_deg, -360.0, 360.0, "deg")
        check_range("sea_state", self.sea_state, 0.0, 10.0)
        if self.initial_error is not None:
            sigmas = as_numbers(self.initial_error)
            if sigmas is None or sigmas.shape != (2,) or not np.all((sigmas > 0.0) & (sigmas <= 360.0)):
                raise refused("initial_error", self.initial_error, "two numbers (tilt, heading) above 0 up to 360 deg")
        check_type("sway_phases", self.sway_phases, bool, "True or False")
        if self.mounting_deg is not None:
            check_number("mounting_deg", self.mounting_deg, 0.0, 80.0, "deg")
        check_range("start_speed_mps", self.start_speed_mps, 0.0, 340.0, "m/s")
        if self.gnss_outages_s is not None:
            pairs = as_numbers(self.gnss_outages_s)
            if pairs is None or (pairs.size and (pairs.ndim != 2 or pairs.shape[1] != 2)) or not _are_intervals(pairs):
                raise refused("gnss_outages_s", self.gnss_outages_s, "a sequence of pairs (begin, end), 0 <= begin < end, s")
            if len(pairs) > OUTAGES:
                raise InputError(f"gnss_outages_s has {len(pairs)} outages: allowed are at most {OUTAGES}")
        self.variations, self.told = variations_of(self.vary, self.known)

    @property
    def grades(self) -> tuple[str, str]:
        """The grades between which a random unit is drawn."""
        return self.units if self.imu_range is None else self.imu_range

    def overridden(self, options: Mapping[str, Any]) -> Ranges:
        """Return the ranges with the options of a reset replaced; a number stands for a range of one value.

        A list is refused where a tuple is a range: with one number per row it would be taken for one.
        The option run_seed asks for a run of the scenario: whatever the other options do not name is not drawn.
        """
        check_type("options", options, Mapping, "a mapping")
        allowed = [name for name in OPTIONS if name in self.taken or name == "run_seed"]
        for name in options:
            if name not in allowed:
                raise InputError(f"options: unknown option {name!r}{nearest(str(name), allowed)}")
        values = {name: value for name, value in options.items() if name != "run_seed"}
        for name in ("heading_deg", "sea_state", "start_speed_mps"):
            if is_number(values.get(name)):
                values[name] = (values[name], values[name])
            elif not isinstance(values.get(name), (tuple, type(None))):
                raise refused(
                    name, values[name], "a number for all episodes of this reset, or a tuple (low, high) to draw from"
                )
        if "run_seed" not in options:
            return replace(self, **values)
        imu = None if self.imu == "random" else self.imu
        kept = ("imu_range", "imu_sheet", "gnss_outages_s", "units", "taken", *(["known"] if "vary" in values else []))
        unchanged = {name: getattr(self, name) for name in kept}
        return Ranges(imu=imu, **{**unchanged, **values})


RANGES = tuple(field.name for field in fields(Ranges) if field.name not in ("units", "taken"))
"""Arguments of environments that say what varies."""
OPTIONS = (*(name for name in RANGES if name not in ("imu_range", "imu_sheet")), "run_seed")
"""Options of a reset."""
TILTS = ("mean_roll", "mean_pitch")
"""Parameters of a vehicle with which its unit is mounted."""
_OF_VARIED = ("variations", "told", "imu", "gnss_outages_s")
"""Ranges on which the plants with varied keys depend."""


def _are_intervals(pairs: Array) -> bool:
    return all(0.0 <= begin < end < np.inf for begin, end in pairs.reshape(-1, 2))


class Starts:
    """Draws the model parameters of the episodes of a task.

    Each episode draws a fixed count of numbers from the generator of its own row only.  constants: parameter rows
    common to all episodes.  duration: of an episode, s.

    limit_s: time from the start whose limit is that of an episode, s; the duration.
    """

    def __init__(self, scenario: Scenario, task: Task, ranges: Ranges, constants: Mapping[str, float], duration: float) -> None:
        self.scenario, self.task, self.ranges, self.duration, self.limit_s = scenario, task, ranges, duration, duration
        self._constants = task.model.parameters.pack(constants)
        self._plant, rows = plant_of(scenario)
        self._vehicle = scenario.vehicle.vehicle().parameters
        places, tilts = np.arange(self._plant.parameters.size), [name for name in TILTS if name in self._vehicle]
        slices = [self._plant.parameters.slice(row.name) for row in self._vehicle if row.name.endswith("_phase")]
        self._phases = np.concatenate([places[:0], *(places[each] for each in slices)])
        self._drawn = [TILTS.index(name) for name in tilts]  # the columns of their numbers
        self._tilts = [places[self._plant.parameters.slice(name)][0] for name in tilts]
        self._tilt_bounds = np.array([[self._vehicle[name].lower, self._vehicle[name].upper] for name in tilts]).T
        if ranges.sea_state is not None:
            rows = {name: np.asarray(value) for name, value in rows.items()}
            _scale(rows, self._vehicle, ranges.sea_state[1])
            check_speed_of_sinusoids(rows, 1.0 / scenario.rate_hz)
        self._run_seed: NDArray[Any] | None = None
        self._varied: Varied | None = None
        self._vary(ranges)
        self._check_units()

    def with_options(self, options: Mapping[str, Any] | None) -> Starts:
        """Return the starts of episodes with the options of a reset.  Raises `InputError` for one that is not allowed."""
        if not options:
            return self
        starts, ranges = copy(self), self.ranges.overridden(options)
        starts._run_seed = np.asarray(options["run_seed"]) if "run_seed" in options else None
        starts._vary(ranges)
        return starts

    def _vary(self, ranges: Ranges) -> None:
        """Take the ranges, and with them the plant's parameters with each unit that can be drawn."""
        before, self.ranges = self.ranges, ranges
        grade = None if ranges.imu == "random" else ranges.imu
        base = self._base(grade)
        if ranges.imu == "random":
            better, worse = ranges.grades
            self._grades = self._base(better), self._base(worse)
            self._pool = units_between(*self._grades, self._plant.parameters)
        else:
            self._pool = base[None]
        if not ranges.variations:
            self._varied = None
        elif self._varied is None or any(getattr(ranges, name) != getattr(before, name) for name in _OF_VARIED):
            self._varied = Varied(self._with_grade(grade), ranges.variations, ranges.told, base, self.duration)
        self._check_apart()
        self._section = self._reported(self.scenario.knowledge)
        self._limits: Array | None = None  # of the units of the pool, NaN where none has been drawn yet
        self._sheets: Mapping[str, Array] | None = None

    def _base(self, grade: str | None) -> Array:
        """Return the plant's parameter vector with a unit of a grade; None: that of the scenario."""
        model, rows = plant_of(self._with_grade(grade))
        return model.parameters.pack(rows)

    def _with_grade(self, grade: str | None) -> Scenario:
        """Return the scenario with the outages of the ranges and a unit of a grade."""
        scenario, outages = self.scenario, self.ranges.gnss_outages_s
        if grade is not None:
            scenario = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": grade})})
        if outages is not None:
            if scenario.gnss is None:
                raise InputError("gnss_outages_s: the scenario has no [gnss]")
            pairs = tuple((float(begin), float(end)) for begin, end in outages)
            scenario = scenario.model_copy(update={"gnss": scenario.gnss.model_copy(update={"outages_s": pairs})})
        return scenario

    def _check_apart(self) -> None:
        """Raise `InputError` for a varied key that another argument draws or replaces too."""
        ranges, slices = self.ranges, self._plant.parameters.slice
        replaced: dict[str, Any] = {
            "imu": np.flatnonzero(self._pool[0] != self._pool[-1]),
            "heading_deg": slices("start_heading") if ranges.heading_deg is not None else [],
            "start_speed_mps": slices("start_speed") if self._draws_speed else [],
            "sway_phases": self._phases if ranges.sway_phases else [],
        }
        for key, changed in () if self._varied is None else self._varied.changed.items():
            others = [name for name, places in replaced.items() if changed[places].any()]
            if key in ("knowledge.tilt_sigma_deg", "knowledge.heading_sigma_deg") and ranges.initial_error is not None:
                others.append("initial_error")
            for name in others:
                neutral, value = type(ranges).__dataclass_fields__[name].default, getattr(ranges, name)
                raise InputError(
                    f"vary {key!r} and {name} = {value!r}: allowed is one of them; {name}={neutral} leaves it to vary"
                )

    @property
    def _draws_speed(self) -> bool:
        speeds = self.ranges.start_speed_mps
        return speeds is not None and "start_speed" in self._vehicle and not self.scenario.vehicle.in_place

    def _check_units(self) -> None:
        """Raise `InputError` for a range that is never drawn from, and for one whose second unit is the better one."""
        ranges = self.ranges
        if ranges.imu != "random":
            for name, neutral in (("imu_range", None), ("imu_sheet", "drawn")):
                if getattr(ranges, name) != neutral:
                    raise InputError(
                        f"{name} = {getattr(ranges, name)!r} with imu = {ranges.imu!r}: a unit is drawn only with "
                        f'imu="random"; allowed is {neutral!r}'
                    )
            return
        in_place = self.scenario.vehicle.in_place
        better, worse = (imu_data_sheet(self._plant.parameters.unpack(grade), in_place) for grade in self._grades)
        if sum(np.log(getattr(worse, name) / getattr(better, name)) for name in RANKED) < 0.0:
            raise refused("imu_range", ranges.grades, "two grades of the catalogue, the better one first")

    def draw(self, generators: Sequence[np.random.Generator]) -> Array:
        """Draw the parameters of one episode per generator, (k, parameters.size); `complete` adds the rest."""
        ranges, pool = self.ranges, self._pool
        parameters, count = self._plant.parameters, len(generators)
        seed, unit, heading, sea = uniforms_of(generators, 4).T
        seeds = seed * MAX_SEED  # whole numbers: a uniform is a multiple of 2^-53
        vectors = pool[(unit * len(pool)).astype(np.intp)]
        run_seeds = seeds if self._run_seed is None else _run_seeds(self._run_seed, count)
        if self._varied is not None:
            units, vectors = vectors, self._varied.parameters_of(run_seeds)
            drawn = np.flatnonzero(pool[0] != pool[-1])  # figures of a random unit
            vectors[:, drawn] = units[:, drawn]
        if ranges.heading_deg is not None:
            if self.scenario.vehicle.lasts_s is not None:
                raise InputError(f"heading_deg = {ranges.heading_deg!r}: the vehicle's track has its own: allowed is None")
            vectors[:, parameters.slice("start_heading").start] = np.radians(_at(ranges.heading_deg, heading))
        if ranges.sea_state is not None:
            rows = {name: vectors[:, parameters.slice(name)] for name in self._vehicle.names}
            _scale(rows, self._vehicle, _at(ranges.sea_state, sea)[:, None])
        self._draw_start(vectors, seeds)
        vectors[:, parameters.slice("seed").start] = run_seeds
        p = np.tile(self._constants, (count, 1))
        p[:, : vectors.shape[1]] = vectors  # the plant's rows come first
        return p

    def _draw_start(self, vectors: Array, seeds: Array) -> None:
        """Draw mounting, start speed and phases into the plant's parameters, from generators of the runs' seeds."""
        parameters, ranges, mounting = self._plant.parameters, self.ranges, self.ranges.mounting_deg
        speed = ranges.start_speed_mps if self._draws_speed else None
        phases = self._phases if ranges.sway_phases else self._phases[:0]
        if mounting is None and speed is None and not len(phases):
            return
        numbers = first_uniforms(seeds.astype(np.uint64).tolist(), 3 + len(phases))
        if mounting is not None and self._tilts:
            now, (lower, upper) = vectors[:, self._tilts], self._tilt_bounds
            room = np.minimum(upper - now, now - lower)
            vectors[:, self._tilts] = now + np.minimum(radians(mounting), room) * (-1.0 + 2.0 * numbers[:, self._drawn])
        if speed is not None:
            vectors[:, parameters.slice("start_speed").start] = _at(speed, numbers[:, 2])
        if len(phases):
            vectors[:, phases] = 2.0 * pi * numbers[:, 3:]

    def complete(self, p: Array, x: Array) -> Array:
        """Write the initial knowledge for start states x (k, state.size), and the limits, into p; return p."""
        model, units = self.task.model, units_of(self._pool, p)
        p[:, _span(model.parameters, KNOWN.names)] = self._known(p, x, units)
        if "limit" in model.parameters:
            place = model.parameters.slice("limit")
            if self._limits is None:
                self._limits = np.full((len(self._pool), place.stop - place.start), np.nan)
            for unit in set(units[np.isnan(self._limits[units, 0])].tolist()):
                self._limits[unit] = self._limit(self._pool[unit])
            p[:, place] = self._limits[units]
        return p

    def _limit(self, unit: Array) -> Array:
        """Return the limits (components,) of an episode with a unit of the pool (parameters.size,)."""
        scenario = self.scenario.model_copy(update={"knowledge": self._section})
        return episode_limit(self.task, self._plant, scenario, unit, self.limit_s)

    def _known(self, p: Array, x: Array, units: NDArray[np.intp]) -> Array:
        """Return the initial knowledge (k, KNOWN.size) of episodes; of varied keys it follows those that are known."""
        model, varied, in_place = self.task.model, self._varied, self.scenario.vehicle.in_place
        parameters = self._plant.parameters
        if self._sheets is None:
            stated = self._pool
            if self.ranges.imu == "random" and self.ranges.imu_sheet == "middle":
                stated = np.tile(middle_unit(*self._grades, parameters), (len(stated), 1))
            self._sheets = data_sheets(parameters.unpack(stated, IMU_PARAMETERS.names), in_place)
        sheets = self._sheets if len(self._pool) == 1 else {name: values[units] for name, values in self._sheets.items()}
        if varied is None:
            return known_rows(self._section, model, p, x, sheets)
        seeds, p = p[:, parameters.slice("seed").start], p.copy()
        stated = varied.parameters_of(seeds, told=True) if varied.hidden else p[:, : parameters.size]
        place = parameters.slice("antenna_lever_arm_b") if "antenna_lever_arm_b" in parameters else slice(0)
        p[:, place] = stated[:, place]
        if varied.tells and self.ranges.imu != "random":
            sheets = data_sheets(parameters.unpack(stated, IMU_PARAMETERS.names), in_place)
        if not varied.reports:
            return known_rows(self._section, model, p, x, sheets)
        rows = []
        for k, values in enumerate(varied.values(seeds)):
            sheet, one = {name: column[k : k + 1] for name, column in sheets.items()}, slice(k, k + 1)
            rows.append(known_rows(self._reported(varied.section(values)), model, p[one], x[one], sheet)[0])
        return np.array(rows)

    def _reported(self, section: KnowledgeSection) -> KnowledgeSection:
        """Return what is reported at the start, with the standard deviations of the ranges."""
        if self.ranges.initial_error is None:
            return section
        tilt, heading = self.ranges.initial_error
        return section.model_copy(update={"tilt_sigma_deg": tilt, "heading_sigma_deg": heading})


class InnerStarts(Starts):
    """`Starts` of a task with a filter inside, whose parameters follow from the initial knowledge.

    arguments: those of `Starts`.  estimator: id of the filter.  mistuning: if not 0, the filter's noises are wrong by
    factors whose decimal logarithms (row ``mistuning`` of the task) are drawn uniformly between -mistuning and +mistuning.
    """

    def __init__(self, *arguments: Any, estimator: str, mistuning: float = 0.0) -> None:
        super().__init__(*arguments)
        self.mistuning, self._estimator = mistuning, estimators.get(estimator)
        self._tunings, self._same = self.scenario.tunings, build(self.scenario, driven=True).knowledge
        table = self._estimator.model.parameters
        self._place = _span(self.task.model.parameters, [PREFIX + name for name in table.names])
        copied = self._estimator.copied(self._tunings)
        self._copied = None if copied is None else {name: field for name, field in copied.items() if field in KNOWN_FIELDS}
        self._uncopied: Array | None = None  # parameters that are the same in all episodes
        self._bounds = [np.repeat([getattr(row, b) for row in table], [row.size for row in table]) for b in ("lower", "upper")]

    def draw(self, generators: Sequence[np.random.Generator]) -> Array:
        p = super().draw(generators)
        if self.mistuning and self._run_seed is None:  # the filter of a run has the data sheet
            place = self.task.model.parameters.slice("mistuning")
            p[:, place] = -self.mistuning + 2.0 * self.mistuning * uniforms_of(generators, place.stop - place.start)
        return p

    def complete(self, p: Array, x: Array) -> Array:
        p = super().complete(p, x)
        rows, table, varied = p[:, self._place], self._estimator.model.parameters, self._varied
        same = [self._same] * len(p)
        if varied is not None and varied.tells:
            seeds = p[:, self._plant.parameters.slice("seed").start]
            same = [varied.knowledge(self._same, values) for values in varied.values(seeds, told=True)]
        if self._copied is None or (varied is not None and varied.tells):
            rows[:] = [self._filter_parameters(*episode) for episode in zip(p, same, strict=True)]
            return p
        if self._uncopied is None:
            self._uncopied = self._filter_parameters(p[0], self._same)
        rows[:] = self._uncopied
        values = fields_known(KNOWN.unpack(p[:, _span(self.task.model.parameters, KNOWN.names)]))
        for name, field in self._copied.items():
            rows[:, table.slice(name)] = values[field].reshape(len(p), -1)
        lower, upper = self._bounds
        if not np.all((rows >= lower) & (rows <= upper)):
            for row in rows:
                table.pack(table.unpack(row))  # raises the error that names the value
        return p

    def _filter_parameters(self, p: Array, same: Knowledge) -> Array:
        """Return the filter's parameters that follow from the initial knowledge in the parameters p of one episode, and from
        what `same` adds to it.
        """
        known = KNOWN.unpack(p[_span(self.task.model.parameters, KNOWN.names)])
        parameters = self._estimator.parameters(knowledge_of(known, same), self._tunings)
        return self._estimator.model.parameters.pack(parameters)


def uniforms_of(generators: Sequence[np.random.Generator], count: int) -> Array:
    """The next `count` uniforms in [0, 1) of each generator, (generators, count)."""
    return np.array([generator.random(count) for generator in generators])


def _at(bounds: Range, fraction: Array) -> Array:
    return bounds[0] + (bounds[1] - bounds[0]) * fraction


def _span(table: Table, names: Sequence[str]) -> slice:
    """Place of rows that follow one another."""
    return slice(table.slice(names[0]).start, table.slice(names[-1]).stop)


def _scale(rows: dict[str, Array], vehicle: Table, factor: Any) -> None:
    """Multiply the vehicle's amplitudes and standard deviations in place."""
    for name in vehicle.names:
        if name in rows and name.endswith(("_amplitude", "_sigma")):
            rows[name] *= factor


def _run_seeds(seeds: NDArray[Any], count: int) -> Array:
    """Return the seeds of `count` episodes: a seed + i for row i, or one for each row."""
    if seeds.shape not in ((), (count,)) or seeds.dtype.kind not in "iu" or np.any(seeds < 0) or np.any(seeds > MAX_SEED):
        raise refused("run_seed", seeds.tolist(), "a whole number from 0 to 2^53, or one for each row")
    return np.broadcast_to(seeds + (np.arange(count) if seeds.ndim == 0 else 0), (count,)).astype(float)


# The limits of an episode: the errors that no method can fall below (`insenv.evaluation.limits`).

MAX_AVERAGED_S = 600.0
"""Longest time over which the limit of a navigation is averaged, s."""
RECORD_INTERVAL = 1.0
"""Time between limits that are averaged, s."""


def episode_limit(task: Task, plant: Model, scenario: Scenario, rows: Array, duration: float) -> Array:
    """Return the 1-sigma limits (components,) of the error of an episode.

    rows: the plant's parameters.  duration: of an episode, s.  Alignment: attitude (rad, rotation about n) at the end.
    Navigation: the root mean square over the episode of attitude (rad), velocity (m/s) and position (m).

    The trajectory, its heading and the mounting are those of the scenario: the limits of an alignment hardly depend on them.
    """
    navigates = task.model.parameters["limit"].size > 3
    samples = round((min(duration, MAX_AVERAGED_S) if navigates else duration) * scenario.rate_hz)
    limits = limit_along(plant, rows, prior_of(scenario.knowledge), samples, scenario.vehicle.in_place)
    return _over_the_episode(limits) if navigates else limits.rotation[-1]


def _over_the_episode(limits: Limit) -> Array:
    """Root mean square (9,) of the limits of attitude, velocity and position."""
    end = float(limits.time[-1])
    times = np.arange(RECORD_INTERVAL, end + 1e-9, RECORD_INTERVAL) if end >= RECORD_INTERVAL else np.array([end])
    rotation = [np.sqrt(np.mean(np.interp(times, limits.time, axis**2))) for axis in limits.rotation.T]
    rms = limits.rms(times)
    return np.array([*rotation, *(rms[name] for name in ("vn_mps", "ve_mps", "vd_mps", "north_m", "east_m", "down_m"))])

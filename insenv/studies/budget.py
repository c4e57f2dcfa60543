"""The error budget: what each source of error contributes to the errors of an estimator.

The runs of every seed are repeated with no source of error, with each source alone, with all sources except one, and with all.
Plant, estimator and statistics are one compiled model, and each of these variants is a row of its batch: sources are switched
off by parameter values.  Random numbers are those of the seed in every variant, and the estimator keeps its tuning.  Errors can
therefore be compared run by run:

    e = m + sum of c_i + x,    c_i = e_i - m

e is the error with all sources, m that with none (of the method itself), e_i that with source i alone, and x what the sources
do together: 0 for a linear estimator.  Gelb 1974, section 7.2, calls the root mean squares of c_i an error budget.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.batch import make_batch
from insenv.core.model import Model, Step, Values
from insenv.core.runner import Progress, check_progress
from insenv.core.tables import Array, Table, Vector
from insenv.estimators import Estimator, get
from insenv.estimators.settings import Settings, setting_rows
from insenv.evaluation.errors import ATTITUDE, statistics_from, wrapped_deg
from insenv.scenario import Plant, ScenarioLike, build, limit_of, load, no_limit, reseeded
from insenv.scenario.build import start_errors
from insenv.scenario.description import KnowledgeSection, Scenario
from insenv.scenario.inputs import recording_interval
from insenv.sensors import IMU, Sensor
from insenv.sensors.contract import ErrorSource
from insenv.studies.budget_result import Budget
from insenv.studies.campaign.block import Begun, in_pieces
from insenv.studies.campaign.model import Measured, measured_model
from insenv.studies.campaign.running import cores

GRAVITY = ErrorSource("gravity disturbance", ("gravity_disturbance_n",))
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Source(ErrorSource):
    """A source of error of a scenario.

    start: keys of [knowledge] with the values that switch off an error of the start; places: its elements of `start_errors`.
    """

    start: Mapping[str, Any] = field(default_factory=dict)
    places: tuple[int, ...] = ()


START = (
    Source("start tilt", (), start={"roll_error_deg": 0.0, "pitch_error_deg": 0.0}, places=(0, 1)),
    Source("start heading", (), start={"heading_error_deg": 0.0}, places=(2,)),
    Source("start position", (), start={"position_error_m": _ZERO}, places=(3, 4, 5)),
    Source("start velocity", (), start={"velocity_error_mps": _ZERO}, places=(6, 7, 8)),
)
"""The initial errors, reported minus true."""


def sensors_of(scenario: Scenario) -> tuple[Sensor, ...]:
    """The sensors of a scenario's plant, the inertial unit first."""
    return (IMU, *(section.sensor for section in scenario.sensors.values()))


def sources_of(plant: Plant, seeds: Sequence[int]) -> tuple[Source, ...]:
    """The sources of error that a plant has in the runs of `seeds`: those whose value is not that without the error."""
    table, vector = plant.model.parameters, plant.model.parameters.pack(plant.parameters)
    named = [source for sensor in sensors_of(plant.scenario) for source in sensor.errors or ()]
    switchable = [Source(source.name, source.rows, source.off) for source in (*named, GRAVITY) if _is_on(source, table, vector)]
    errors = start_errors(plant.scenario.knowledge, np.array(seeds))
    return (*switchable, *(source for source in START if np.any(errors[:, list(source.places)])))


def _is_on(source: ErrorSource, table: Table, vector: Vector) -> bool:
    # a range that is not stated is a conversion of its largest value, which rounds
    rows = [name for name in source.rows if name in table]
    return any(not np.allclose(vector[table.slice(name)], source.off, rtol=1e-6, atol=0.0) for name in rows)


def unknown_errors(scenario: Scenario) -> tuple[str, ...]:
    """Ids of the sensors whose sources of error are not known."""
    return tuple(sensor.id for sensor in sensors_of(scenario) if sensor.errors is None)


def start_without(scenario: Scenario, sources: Iterable[Source]) -> Scenario:
    """The scenario without the initial errors of `sources`; their stated sigmas stay."""
    keys = {key: value for source in sources for key, value in source.start.items()}
    knowledge: KnowledgeSection = scenario.knowledge.model_copy(update=keys)
    changed = scenario.model_copy(update={"knowledge": knowledge})
    changed._name = scenario.name
    return changed


# The sources of error of a scenario: those of its sensors, gravity and the start; and how each is switched off.

# A plant whose sources of error are switched off by parameter values, row by row of a batch.
#
# The estimator must not change with the switch: the standard deviations that a receiver states with its measurements follow
# from the parameters of its noise, and are taken from parameters of their own, ``stated_NAME``, that keep their values.

PREFIX = "stated_"


@lru_cache(maxsize=16)
def switchable(plant: Model, sensors: tuple[Sensor, ...]) -> Model:
    """The plant with the parameters `stated_NAME`; the same object for the same arguments.

    A step after those of the plant writes what each measurement states of its accuracy.  With equal values of NAME and
    `stated_NAME` the numbers are those of the plant, to the bit.
    """
    added, steps = Table(), dict(plant.steps)
    for sensor in sensors:
        if sensor.stated is None:
            continue
        names = tuple(name for source in sensor.errors or () for name in source.rows)
        added += Table(tuple(replace(plant.parameters[name], name=PREFIX + name) for name in names))
        steps[f"{sensor.id}_stated"] = Step(_stating(sensor.stated.rows, names), sensor.stated.when)
    if not added.size:
        return plant
    # the steps come last: the random numbers of a step depend on its place
    return replace(plant, id=f"{plant.id}-switchable", parameters=plant.parameters + added, steps=steps)


def _stating(rows: Callable[[Values, Values], dict[str, Any]], names: tuple[str, ...]) -> Callable[..., dict[str, Any]]:
    def function(p: Values, x: Values, u: Values) -> dict[str, Any]:
        parameters = SimpleNamespace(**{**vars(p), **{name: getattr(p, PREFIX + name) for name in names}})
        return rows(parameters, x)

    return function


def packed(model: Model, rows: Mapping[str, Any]) -> Vector:
    """The parameters of a `switchable` plant with no source switched off, flat, from those of the plant by name."""
    names = (name for name in model.parameters.names if name.startswith(PREFIX))
    stated = {name: rows[name.removeprefix(PREFIX)] for name in names if name.removeprefix(PREFIX) in rows}
    return model.parameters.pack({**rows, **stated})


def switch_off(model: Model, vector: Vector, sources: Iterable[Source]) -> Vector:
    """The parameters `vector` (n,) with the errors of `sources` switched off."""
    switched = vector.copy()
    for source in sources:
        for name in source.rows:
            if name in model.parameters:
                switched[model.parameters.slice(name)] = source.off
    return switched


RECORDS = 240
"""Approximate upper bound of the number of times at which errors are compared."""
ROWS_AT_ONCE = 1024
"""Approximate number of rows of a batch."""
MOST_VALUES = 250_000_000
"""Largest number of values of all errors: 2 GB."""
MAX_RUNS = 100_000
SEEDS_LOOKED_AT = 16
"""Seeds in which an initial error may differ from 0; of one that is drawn, it does in all."""


def budget(
    scenario: ScenarioLike,
    estimator: str | Estimator,
    runs: int = 64,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> Budget:
    """Which source of error dominates: the errors of an estimator with each source alone, and with all sources except one.

    Parameters
    ----------
    scenario: a name that ``insenv list`` shows, the path of a ``.toml`` file, a `Scenario`, or the values of such a file.
    estimator: an id or an `Estimator`.
    runs: number of seeds; run i has the seed `seed` + i (None: the scenario's).
    duration_s: instead of the scenario's, s.
    settings: parameters by estimator id, as of `insenv.run`.
    progress: called with the numbers of inertial samples done and in all; for the limit, once more from the first.

    Raises `InputError` for what is unknown, wrong, or cannot run, and for a scenario without a source of error.
    """
    check_progress(progress)
    case = _case(scenario, estimator, runs, seed, duration_s, settings)
    errors = _errors(case, progress)
    refusal = no_limit(case.plant)
    limit = None if refusal else limit_of(case.plant, progress)
    return _budget(case, errors, {} if limit is None else limit.at(case.times), refusal)


@dataclass(frozen=True)
class _Case:
    """What a budget is of.  plants: one for each seed, with all sources."""

    plant: Plant
    estimator: Estimator
    rows: dict[str, object]
    sources: tuple[Source, ...]
    plants: tuple[Plant, ...]

    @property
    def every(self) -> int:
        return recording_interval(self.plant.samples, RECORDS)

    @property
    def times(self) -> Array:
        """Times at which errors are compared (records,), s."""
        count = self.plant.samples // self.every
        return np.arange(1.0, count + 1.0) * (self.every * self.plant.sample_interval)

    @cached_property
    def measured(self) -> Measured:
        return measured_model(switchable(self.plant.model, sensors_of(self.plant.scenario)), self.estimator)

    @property
    def variants(self) -> list[frozenset[int]]:
        """The sources that are on: all, none, each alone, all but each."""
        every = frozenset(range(len(self.sources)))
        return [every, frozenset(), *(frozenset({k}) for k in sorted(every)), *(every - {k} for k in sorted(every))]


def _case(
    scenario: ScenarioLike,
    estimator: str | Estimator,
    runs: int,
    seed: int | None,
    duration_s: float | None,
    settings: Settings | None,
) -> _Case:
    if isinstance(runs, bool) or not isinstance(runs, (int, np.integer)) or not 2 <= runs <= MAX_RUNS:
        raise InputError(f"runs = {runs!r}: allowed is a whole number from 2 to {MAX_RUNS}, because a budget compares runs")
    loaded = load(scenario)
    plant = build(loaded, seed=seed, duration_s=duration_s)
    chosen = get(estimator)
    rows = setting_rows(settings, [chosen])[chosen.id]
    chosen = plant.adapted(chosen, settings, offline=False)
    plant.parameters_of(chosen, rows, offline=False)  # refuses what cannot run
    seeds = range(plant.seed, plant.seed + int(runs))
    sources = sources_of(plant, seeds[:SEEDS_LOOKED_AT])
    if not sources:
        raise InputError(f"scenario {loaded.name!r} has no source of error: a budget needs one, such as imu.grade")
    case = _Case(plant, chosen, rows, sources, ())
    values = len(seeds) * len(case.variants) * len(case.times) * len(case.measured.channels)
    if values > MOST_VALUES:
        most = int(runs) * MOST_VALUES // values
        raise InputError(f"runs = {runs}: a budget of {len(sources)} sources keeps every error: allowed is up to {most} runs")
    return replace(case, plants=tuple(reseeded(plant, seeds)))


def _errors(case: _Case, progress: Progress | None) -> Array:
    """The errors (seeds, variants, records, channels) of every variant."""
    variants, measured = case.variants, case.measured
    at_once = max(1, ROWS_AT_ONCE // len(variants))
    total = len(case.plants) * len(case.times) * case.every
    errors = []
    try:
        for first in range(0, len(case.plants), at_once):
            part = range(first, min(first + at_once, len(case.plants)))
            unique, places = np.unique(_rows(case, part), axis=0, return_inverse=True)
            batch = make_batch(measured.model, len(unique), unique, threads=cores())

            def look(done: Begun, part: range = part) -> None:
                if progress is not None:
                    progress(part.start * len(case.times) * case.every + done.samples * len(part), total)

            shown = in_pieces(batch, len(case.times), case.every, look)
            error = shown[..., measured.model.outputs.slice("error")]
            errors.append(error[places.ravel()].reshape(len(part), len(variants), *error.shape[1:]))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"interrupted after {sum(map(len, errors))} of {len(case.plants)} seeds; nothing written"
        ) from None
    return np.concatenate(errors)


def _rows(case: _Case, part: range) -> Array:
    """Parameters of the rows of some seeds: all variants of a seed, then those of the next."""
    model, parameters = switchable(case.plant.model, sensors_of(case.plant.scenario)), case.estimator.model.parameters
    tails = {}
    for on in {_start_of(case.sources, variant) for variant in case.variants}:
        off = [source for k, source in enumerate(case.sources) if source.start and k not in on]
        plants = _plants_without(case, part, off)
        tails[on] = [parameters.pack(plant.parameters_of(case.estimator, case.rows, offline=False)) for plant in plants]
    evaluation = np.array([case.every, 1], dtype=np.float64)
    rows = []
    for place, k in enumerate(part):
        whole = packed(model, case.plants[k].parameters)
        for on in case.variants:
            off = [source for j, source in enumerate(case.sources) if j not in on]
            tail = tails[_start_of(case.sources, on)][place]
            rows.append(np.concatenate([switch_off(model, whole, off), tail, evaluation]))
    return np.array(rows)


def _start_of(sources: Sequence[Source], on: frozenset[int]) -> frozenset[int]:
    """Those of a variant's sources that are errors of the start."""
    return frozenset(k for k in on if sources[k].start)


def _plants_without(case: _Case, part: range, off: Sequence[Source]) -> Sequence[Plant]:
    """The plants of some seeds, whose initial knowledge is without the errors `off`."""
    plants = case.plants[part.start : part.stop]
    if not off:
        return plants
    scenario = start_without(case.plant.scenario, off)
    return reseeded(build(scenario, seed=plants[0].seed, duration_s=case.plant.duration_s), [plant.seed for plant in plants])


_UNKNOWN = declared(
    "errors-unknown",
    "the errors of {sensors} are not known to insenv: they are on in all runs, and the table counts them as part of the method",
)
_LOST = declared("budget-diverges", "the estimator diverges in most runs, and the figures are missing: {sources}")


def _budget(case: _Case, errors: Array, limit: dict[str, Array], refusal: tuple[Remark, ...]) -> Budget:
    """The budget from the errors (seeds, variants, records, channels)."""
    channels, count = case.measured.channels, len(case.sources)
    whole, none = errors[:, 0], errors[:, 1]
    angles = [place for place, name in enumerate(channels) if name in ATTITUDE]
    alone = list(_differences(errors, none, count, angles))
    with np.errstate(invalid="ignore"):
        rest = whole - none - sum(alone)
    rest[..., angles] = wrapped_deg(rest[..., angles])
    # views, and one variant at a time below: a copy of all errors takes gigabytes
    series = [whole, none, rest, *alone, *np.moveaxis(errors[:, 2 + count :], 1, 0)]
    finite = np.stack([np.isfinite(one).all(axis=(1, 2)) for one in series], axis=1)
    usable = finite.mean(axis=0) >= 0.5
    usable[2] = usable[:2].all() and usable[3 : 3 + count].all()
    counted = finite[:, usable].all(axis=1) if usable[0] else finite[:, 0]
    if not counted.any():
        raise InputError(
            f"estimator {case.estimator.id!r} diverges in every run of {case.plant.scenario.name!r}: no errors to compare"
        )
    nothing = np.full(whole.shape[1:], np.nan)
    squares = np.stack(
        [np.mean(one[counted] ** 2, axis=0) if good else nothing for one, good in zip(series, usable, strict=True)]
    )
    seeds = np.array([plant.seed for plant in case.plants])
    from_s = statistics_from(case.estimator.navigates, float(case.times[-1]))
    notes = [*case.plant.scenario.notes, *case.plant.notes_of(case.estimator, case.rows)]
    unknown = unknown_errors(case.plant.scenario)
    if unknown:
        notes.append(_UNKNOWN.filled(sensors=", ".join(unknown)))
    lost = [name for name, good in zip(_names(case.sources), usable, strict=True) if not good]
    if lost:
        notes.append(_LOST.filled(sources=", ".join(lost)))
    notes += refusal
    return Budget(
        scenario=case.plant.scenario.name or "scenario",
        estimator=case.estimator.id,
        runs=len(seeds),
        first_seed=case.plant.seed,
        duration_s=case.plant.duration_s,
        from_s=from_s,
        time=case.times,
        channels=channels,
        sources=tuple(source.name for source in case.sources),
        whole=squares[0],
        none=squares[1],
        interaction=squares[2],
        alone=squares[3 : 3 + count],
        without=squares[3 + count :],
        limit=np.stack([limit[name] for name in channels], axis=-1) ** 2 if limit else None,
        diverged=tuple(int(seed) for seed in seeds[~counted]),
        notes=tuple(notes),
    )


def _differences(errors: Array, none: Array, count: int, angles: list[int]) -> Iterator[Array]:
    """The contributions of each source (seeds, records, channels): the error with it alone minus that with none."""
    for k in range(count):
        with np.errstate(invalid="ignore"):
            difference = errors[:, 2 + k] - none
        difference[..., angles] = wrapped_deg(difference[..., angles])
        yield difference


def _names(sources: Sequence[Source]) -> list[str]:
    names = [source.name for source in sources]
    return ["all sources", "no source", "interaction", *(f"{n} alone" for n in names), *(f"all but {n}" for n in names)]

"""The plan of a campaign: everything on which its results depend, and how its runs are partitioned into blocks."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from insenv import estimators
from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.base.shipped import __version__
from insenv.base.toml import validated
from insenv.core.tables import Array
from insenv.estimators import Estimator
from insenv.runs.simulated import members
from insenv.scenario import Plant, Scenario, ScenarioLike, build, load, parse, reseeded
from insenv.scenario.build import seed_and_duration
from insenv.scenario.description import MAX_SEED
from insenv.scenario.inputs import recording_interval
from insenv.scenario.variation import Variation, check_variations, varied
from insenv.studies.campaign.design import check_design, dependent, numbers_of, seed_of, unbalanced, whole_design
from insenv.studies.campaign.model import Measured, measured_model

DIGITS = 9
"""Significant digits of the parameters that a digest compares: fewer than those in which machines may differ."""
RECORDS = 120
"""Approximate upper bound of the number of recorded times."""
BLOCK_SAMPLES = 10_000_000
"""Approximate number of inertial samples in a block: some seconds of one core, so that distributing it costs little."""
LARGEST_BLOCK, LANES = 1024, 8
MAX_RUNS = 10_000_000
COMPARED_RUNS = 8
"""Runs whose parameters the digest contains."""


SAMPLES_HELD = declared(
    "samples-held", "lost inertial samples are replaced by the last one received, not interpolated as in `insenv run`"
)


@dataclass(frozen=True)
class Plan:
    """A campaign: run i is the scenario with seed `seed_of(i)`, by default `first_seed` + i, and with its varied keys.

    scenario: values of the scenario by key, as in a TOML file, less those that follow from its vehicle.
    name: name of the scenario.
    estimator: id of the estimator.
    duration_s: duration of every run.
    design: how the varied keys are spread over the runs (`insenv.studies.campaign.design`).
    block_samples: approximate number of inertial samples in a block.
    """

    scenario: Mapping[str, Any]
    name: str
    estimator: str
    runs: int
    first_seed: int
    duration_s: float
    variations: tuple[Variation, ...] = ()
    block_samples: int = BLOCK_SAMPLES
    design: str = "random"

    def as_json(self) -> dict[str, Any]:
        """Everything on which the results depend, including the version."""
        return {
            "insenv": __version__,
            **asdict(self),
            "variations": [{"key": v.key, **v.distribution.as_json()} for v in self.variations],
            "equations": self.measured.model.fingerprint,
            "parameters": self._parameter_digest,
        }

    @functools.cached_property
    def _parameter_digest(self) -> str:
        """Hash of what the functions of the estimator, the vehicle and the sensors make of the scenario, in the first runs.

        A function that prepares parameters has no text to compare, as a plug-in's source may be anywhere; its results have.
        """
        plants = list(self.plants(range(min(self.runs, COMPARED_RUNS))))
        values = self.parameters_of(plants).ravel()
        return hashlib.sha256(" ".join(f"{value:.{DIGITS}g}" for value in values).encode()).hexdigest()

    @functools.cached_property
    def digest(self) -> str:
        """Hash of `as_json`: campaigns with the same digest give the same results."""
        text = json.dumps(self.as_json(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        """What is sent to a worker: the fields without the plant, which the worker builds."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @functools.cached_property
    def chosen(self) -> Estimator:
        """The estimator.  Raises `InputError` if this process does not know it."""
        try:
            return self.plant.adapted(self.estimator, offline=False)
        except InputError as error:
            raise InputError(
                f"{error}; a worker process knows installed estimators (entry-point group 'insenv.estimators'), but not those "
                "that a script registers: use threads"
            ) from None

    @functools.cached_property
    def _family(self) -> Estimator:
        """The estimator as it was named; `chosen` may be a member of it."""
        return estimators.get(self.estimator)

    @functools.cached_property
    def plant(self) -> Plant:
        """The plant of the first run; model, interval and number of samples are the same for all runs."""
        return self.plant_of(0)

    def seed_of(self, run: int) -> int:
        """The seed of a run."""
        return seed_of(self.design, self.first_seed, run, len(self.variations))

    def numbers(self, runs: Sequence[int]) -> Array:
        """Values of the varied keys (len(runs), variations) in some runs; those of choices are the places of the values."""
        if self.design == "random":
            seeds = [self.seed_of(run) for run in runs]
            uniforms = np.array([v.uniforms(seeds) for v in self.variations]).reshape(len(self.variations), len(seeds)).T
        else:
            uniforms = self._design[list(runs)]
        return numbers_of(self.variations, uniforms)

    @functools.cached_property
    def _design(self) -> Array:
        return whole_design(self.design, self.first_seed, self.runs, len(self.variations))

    def plant_of(self, run: int) -> Plant:
        """The plant of one run."""
        try:
            return build(parse(self.values_of(run), self.name, self.name), self.seed_of(run), self.duration_s)
        except InputError as error:
            if not self.variations:
                raise
            drawn = ", ".join(map(str, self.variations))
            raise InputError(f"vary {drawn}, in the run of seed {self.seed_of(run)}: {error}") from None

    def values_of(self, run: int) -> dict[str, Any]:
        """The values of the scenario of one run."""
        numbers = zip(self.variations, self.numbers([run])[0], strict=True)
        return varied(self.scenario, {v.key: v.distribution.value(number) for v, number in numbers})

    def plants(self, runs: Sequence[int]) -> Iterable[Plant]:
        """The plants of some runs."""
        return map(self.plant_of, runs) if self.variations else reseeded(self.plant, [self.seed_of(run) for run in runs])

    @functools.cached_property
    def measured(self) -> Measured:
        """The model that the runs share."""
        return measured_model(self.plant.model, self.chosen)

    def parameters_of(self, plants: Sequence[Plant]) -> Array:
        """Parameters of `measured` for the plants of some runs, one row per run; without variations only their seeds differ."""
        table, parameters = plants[0].model.parameters, self.chosen.model.parameters
        place, one = table.slice("seed").start, table.pack(plants[0].parameters)
        evaluation = np.array([self.evaluation_samples, self.evaluations], dtype=np.float64)
        rows = []
        for plant in plants:
            if self.variations:
                one = table.pack(plant.parameters)
            one[place] = plant.seed
            rows.append(np.concatenate([one, parameters.pack(plant.parameters_of(self.chosen)), evaluation]))
        return np.array(rows)

    @property
    def too_short(self) -> bool:
        """Whether the runs are too short for the estimator (`Estimator.too_short`)."""
        return bool(self.chosen.too_short(self._parameters, self.duration_s))

    @property
    def _parameters(self) -> dict[str, Any]:
        """Parameters of the estimator in the first run, by row name."""
        table = self.chosen.model.parameters
        return table.unpack(table.pack(self.plant.parameters_of(self.chosen)))

    @property
    def notes(self) -> tuple[Remark, ...]:
        """Notes on the scenario, on the estimator where it is the same in all runs (`Estimator.notes`), and on its tuning."""
        lossy = float(self.plant.parameters.get("imu_drop_probability", 0.0)) > 0.0
        return (
            *self.plant.scenario.notes,
            *members([self._family], [self.chosen]),
            *(() if self.variations else self.chosen.notes(self._parameters, self.duration_s)),
            *self.chosen.without_effect(self.plant.tunings),
            *self._understated,
            *unbalanced(self.design, self.runs),
            *dependent(self.design),
            *([SAMPLES_HELD] if lossy else []),
        )

    @property
    def _understated(self) -> tuple[Remark, ...]:
        """What `Estimator.understated` says of the first run and of the extremes of what is varied, each once."""
        if not self.plant.tunings:
            return ()
        extremes = [build(parse(values, self.name, self.name), self.first_seed, self.duration_s) for *_, values in self.tried]
        said = [self.chosen.understated(plant.knowledge, plant.tunings) for plant in (self.plant, *extremes)]
        return tuple(dict.fromkeys(note for notes in said for note in notes))

    @functools.cached_property
    def tried(self) -> tuple[tuple[Variation, str, dict[str, Any]], ...]:
        """The extremes of what is varied, one at a time: the variation, which extreme, and the values of the scenario."""
        numbers = self.numbers(range(self.runs)) if self.variations else np.zeros((0, 0))
        return tuple(
            (variation, which, varied(self.scenario, {variation.key: value}))
            for place, variation in enumerate(self.variations)
            for value, which in variation.distribution.tried(numbers[:, place])
        )

    @property
    def evaluation_samples(self) -> int:
        """Samples between evaluations of the errors, the same as between records of `insenv.runs.simulated`."""
        return recording_interval(self.plant.samples)

    @property
    def evaluations(self) -> int:
        """Evaluations between records."""
        return recording_interval(self.plant.samples // self.evaluation_samples, RECORDS)

    @property
    def record_samples(self) -> int:
        """Samples between records."""
        return self.evaluation_samples * self.evaluations

    @property
    def samples(self) -> int:
        """Samples of a run up to its last record."""
        return self.plant.samples // self.record_samples * self.record_samples

    @property
    def times(self) -> Array:
        """Recorded times (records,), s."""
        count = self.samples // self.record_samples
        return np.arange(1.0, count + 1.0) * (self.record_samples * self.plant.sample_interval)

    @functools.cached_property
    def blocks(self) -> tuple[range, ...]:
        """The runs of each block.  They depend only on the plan, so that results do not depend on the workers."""
        size = min(max(self.block_samples // self.samples // LANES * LANES, LANES), LARGEST_BLOCK)
        return tuple(range(first, min(first + size, self.runs)) for first in range(0, self.runs, size))


def make_plan(
    scenario: ScenarioLike,
    estimator: str | Estimator,
    runs: int,
    *,
    first_seed: int | None = None,
    duration_s: float | None = None,
    variations: Iterable[Variation] = (),
    design: str = "random",
) -> Plan:
    """The plan of `runs` runs of a scenario with an estimator; `first_seed` and `duration_s` replace the scenario's.

    Raises `InputError` for a combination that cannot be run; both ends of every range, every choice, and the extremes of the
    values that other distributions give are tried.
    """
    scenario, estimator = load(scenario), estimators.get(estimator)
    first = scenario.seed if first_seed is None else first_seed
    if isinstance(runs, bool) or not isinstance(runs, (int, np.integer)) or not 1 <= runs <= MAX_RUNS:
        raise InputError(f"runs = {runs!r}: allowed is a whole number from 1 to {MAX_RUNS}")
    if isinstance(first, int) and 0 <= first <= MAX_SEED < first + runs - 1:
        raise InputError(
            f"first seed = {first} of {runs} runs, whose seeds count up: allowed is a whole number up to {MAX_SEED - runs + 1}"
        )
    plan = Plan(
        scenario=scenario.stated(),
        name=scenario.name or "scenario",
        estimator=estimator.id,
        runs=int(runs),
        first_seed=first,
        duration_s=seed_and_duration(scenario, first_seed, duration_s)[1],
        variations=tuple(sorted(variations, key=lambda v: v.key)),
        design=design,
    )
    check_variations(plan.variations)
    check_design(design, plan.runs, len(plan.variations))
    tried = plan.tried
    if duration_s is None and "duration_s" not in plan.scenario:
        plan = replace(plan, duration_s=_shortest(plan, scenario, [changed for _, _, changed in tried]))
    vars(plan)["_family"] = estimator  # an object that need not be registered
    vars(plan)["chosen"] = estimator = plan.plant.adapted(estimator, offline=False)
    build(scenario, plan.first_seed + plan.runs - 1, plan.duration_s)  # check the last seed too
    plan.plant.parameters_of(estimator, offline=False)
    for variation, which, changed in tried:
        try:
            plant = build(parse(changed, plan.name), plan.first_seed, plan.duration_s)
            plant.parameters_of(estimator, offline=False)
        except InputError as error:
            raise InputError(f"vary {variation}{f', {which}' if which else ''}: {error}") from None
        if plant.model is not plan.plant.model:
            raise InputError(
                f"vary: within the ranges the parts of {scenario.name!r} change (a wave more or less, or more knots of a track "
                "than its model holds: a larger knot_s keeps them fewer)"
            )
    return plan


def _shortest(plan: Plan, scenario: Scenario, tried: Iterable[Mapping[str, Any]]) -> float:
    """The duration (s) of the shortest track of all runs and of the `tried` values."""
    if not any(variation.key.startswith("vehicle.") for variation in plan.variations):
        return plan.duration_s

    def lasts(values: Mapping[str, Any]) -> float:
        try:
            return validated(type(scenario.vehicle), values["vehicle"], plan.name).lasts_s or plan.duration_s
        except InputError:  # which the build of this plant reports
            return plan.duration_s

    durations = {plan.duration_s, *map(lasts, tried)}
    if len(durations) > 1:
        durations |= {lasts(plan.values_of(run)) for run in range(plan.runs)}
    return min(durations)

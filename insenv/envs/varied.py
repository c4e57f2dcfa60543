"""Keys of the scenario that differ from episode to episode: `vary` and `known` of every environment.

The value of a key is a pure function of the seed of the episode's run and of the key, the same as in a campaign
(`insenv.scenario.variation`): whatever else varies, and in whatever row of a batch, it is the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.base.errors import InputError, guess, nearest
from insenv.core.model import Model
from insenv.core.tables import Array
from insenv.envs.checks import check_type, refused
from insenv.estimators.knowledge import Knowledge
from insenv.scenario import Scenario, build, plant_of
from insenv.scenario.build import sensor_rows, stated_errors
from insenv.scenario.description import KnowledgeSection
from insenv.scenario.variation import Variation, check_variations, variation_of, with_values
from insenv.sensors.contract import Place

RARE = 1e-6
"""Share of the draws below the smallest value, and above the largest one, with which a distribution without ends is checked."""
MOVES = ("start", "vehicle")
"""Sections on which the rows of others may depend."""
REPORTED = "knowledge"
"""Section of what is reported at the start: its varied values are always known."""


def variations_of(vary: Any, known: Any) -> tuple[tuple[Variation, ...], frozenset[str]]:
    """Return the variations that `vary` names, and those of its keys that `known` tells.  Raises `InputError`."""
    check_type("vary", vary, (Mapping, type(None)), "a mapping of distributions by key of the scenario, or None")
    keys = dict(vary or {})
    for key in keys:
        check_type("vary, key", key, str, "a key of the scenario, such as 'imu.gyro_bias_deg_h'")
    variations = tuple(variation_of(key, keys[key]) for key in sorted(keys))
    check_variations(variations)
    if isinstance(known, bool):
        return variations, frozenset(keys if known else ())
    if isinstance(known, str) or not isinstance(known, Sequence) or not all(isinstance(key, str) for key in known):
        raise refused("known", known, "True, False or a sequence of the keys of vary")
    for key in known:
        if key not in keys:
            raise InputError(f"known: {key!r} is not a key of vary{nearest(key, keys)}")
    return variations, frozenset(known)


class Varied:
    """The plants of a scenario with varied keys.

    base (parameters.size,): the plant's parameters of the scenario itself.  duration: of an episode, s.
    Raises `InputError` for a key that cannot vary, and for a value at an end of its range that the scenario does not take.
    """

    def __init__(
        self, scenario: Scenario, variations: Sequence[Variation], known: frozenset[str], base: Array, duration: float
    ) -> None:
        self.scenario, self.variations, self._base = scenario, tuple(variations), base
        self._data, self._model = scenario.stated(), plant_of(scenario)[0]
        self._before: dict[str, Mapping[str, Any]] = {}  # rows of sections of the scenario itself
        self.hidden = [v.key for v in variations if v.key not in known and v.key.split(".")[0] != REPORTED]
        self.reports = any(v.key.split(".")[0] == REPORTED for v in variations)
        self.tells = bool(known)
        self._place = Place(*(float(base[self._model.parameters.slice(f"start_{name}").start]) for name in _PLACE))
        allowed = (*MOVES, "imu", "gravity", REPORTED, *scenario.sensors)
        for variation in variations:
            section, dot, _ = variation.key.partition(".")
            if section not in allowed or not dot:
                raise InputError(
                    f"vary {variation.key!r}: allowed in an environment are the keys of {', '.join(allowed)}, such as "
                    f"'imu.gyro_bias_deg_h'{guess(section, allowed)}"
                )
        self.changed = {variation.key: self._tried(variation, duration) for variation in variations}

    def _tried(self, variation: Variation, duration: float) -> Array:
        """Return which parameters (parameters.size,) the ends of a variation change."""
        changed, distribution = np.zeros(len(self._base), dtype=bool), variation.distribution
        for value, _ in distribution.tried(distribution.numbers(np.array([RARE, 1.0 - RARE]))):
            try:
                plant = build(with_values(self.scenario, self._data, {variation.key: value}), None, duration, driven=True)
                self._check(plant.model)
                changed |= self.parameters({variation.key: value}) != self._base
            except InputError as error:
                raise InputError(f"vary {variation}: {str(error).removeprefix(f'vary {variation.key!r}: ')}") from None
        return changed

    def _check(self, model: Model) -> None:
        if model is not self._model:
            raise InputError("the parts of the plant change within the range: allowed is a key that changes numbers alone")

    def values(self, seeds: Array, *, told: bool = False) -> list[dict[str, Any]]:
        """Return the values by key in the episodes of `seeds` (k,); told: only of the keys that are known."""
        variations = [v for v in self.variations if not (told and v.key in self.hidden)]
        whole = [int(seed) for seed in seeds]
        columns = [[v.distribution.value(n) for n in v.distribution.numbers(v.uniforms(whole))] for v in variations]
        return [dict(zip((v.key for v in variations), row, strict=True)) for row in zip(*columns, strict=True)] or [{}] * len(
            whole
        )

    def parameters_of(self, seeds: Array, *, told: bool = False) -> Array:
        """Return the plant's parameters (k, parameters.size) in the episodes of `seeds` (k,), but for the seeds themselves.

        told: with the values of the scenario for keys that are not known.  Raises `InputError` for a draw that the scenario
        does not take.
        """
        vectors = np.empty((len(seeds), len(self._base)))
        for vector, seed, values in zip(vectors, seeds, self.values(seeds, told=told), strict=True):
            try:
                vector[:] = self.parameters(values)
            except InputError as error:
                drawn = ", ".join(map(str, self.variations))
                raise InputError(f"vary {drawn}, in the episode of seed {seed:.0f}: {error}") from None
        return vectors

    def parameters(self, values: Mapping[str, Any]) -> Array:
        """Return the plant's parameters (parameters.size,) with values by key.

        Raises `InputError` for values that the scenario does not take.
        """
        table, sections = self._model.parameters, {key.split(".")[0] for key in values} - {REPORTED}
        if not sections:
            return self._base.copy()
        scenario = self._with(values)
        if sections & set(MOVES):
            model, rows = plant_of(scenario)
            self._check(model)
            return table.pack(rows)
        rows = {}
        for section in sections:
            before = self._before.get(section) or self._before.setdefault(section, self._rows(section, self.scenario))
            for name, value in self._rows(section, scenario).items():  # comparing is faster than packing
                old: Any = before.get(name)
                if not (value == old if isinstance(value, float) else np.array_equal(value, old)):
                    rows[name] = value
        return table.pack(rows, self._base)

    def _rows(self, section: str, scenario: Scenario) -> Mapping[str, Any]:
        """Return the plant's parameter rows that a section sets, of those that have a sensor or gravity."""
        if section == "imu":
            return scenario.imu.rows(scenario.rate_hz)
        if section == "gravity":
            return scenario.gravity.rows(scenario.start)
        return sensor_rows(scenario, section, self._place, self._model.parameters)

    def section(self, values: Mapping[str, Any]) -> KnowledgeSection:
        """Return what is reported at the start, with values by key."""
        return self._with({key: value for key, value in values.items() if key.split(".")[0] == REPORTED}).knowledge

    def knowledge(self, same: Knowledge, values: Mapping[str, Any]) -> Knowledge:
        """Return the knowledge of all episodes with the errors of instruments that follow from values by key."""
        parameters = self._model.parameters.unpack(self.parameters(values))
        return replace(same, instruments=stated_errors(self._with(values), parameters))

    def _with(self, values: Mapping[str, Any]) -> Scenario:
        return with_values(self.scenario, self._data, values)


_PLACE = ("latitude", "longitude", "height")

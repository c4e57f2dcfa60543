"""The common base of the single and the vector interface: named observations, snapshots and pickling."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from insenv.core.tables import Table
from insenv.envs.checks import check_keywords
from insenv.envs.setup import Setup

Array = NDArray[np.float64]
Made = TypeVar("Made", bound="Interface")


@dataclass(frozen=True)
class Snapshot:
    """The complete state of an environment; an environment restored from it continues bit-identically.

    parameters, state, inputs: vectors of the model, (rows, elements) for a vector environment.  over: whether the
    episode has ended, None before the first reset.  generators: states of the random generators.  elapsed: steps made
    in the episode (vector environments).  history: observations and infos of the episode so far, if it is rendered.
    """

    parameters: Array
    state: Array
    inputs: Array
    over: Any
    generators: tuple[Mapping[str, Any], ...]
    elapsed: Any = 0
    history: tuple[tuple[Array, dict[str, Any]], ...] = ()


class Interface:
    """Base of `InertialEnv` and `InertialVectorEnv`; pickled and copied as constructor arguments plus snapshot."""

    setup: Setup
    _made_with: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls: type[Made], *args: Any, **kwargs: Any) -> Made:
        # __init__ runs next and keeps its typed signature; here the message can name the nearest argument
        check_keywords(cls.__name__, cls.__init__, kwargs)
        made = super().__new__(cls)
        made._made_with = (args, kwargs)
        return made

    def __reduce__(self) -> Any:
        return _remade, (type(self), *self._made_with, self.snapshot())

    @property
    def spec(self) -> Any:
        """Gymnasium's specification; `max_episode_steps` is that of the environment's own time."""
        return getattr(self, "_spec", None)

    @spec.setter
    def spec(self, value: Any) -> None:
        self._spec = copy(value)
        if value is not None and value.max_episode_steps is None:
            self._spec.max_episode_steps = self.setup.decisions

    @property
    def layout(self) -> Table:
        """Rows of the observation of one environment, with units, frames and meanings."""
        return self.setup.layout

    def named(self, observation: Array) -> dict[str, Any]:
        """Return an observation by row name (views): ``imu`` (samples, 7), ``time``, ``fix_position`` ...

        A vector environment's rows have the environments along the first axis.
        """
        return self.layout.unpack(observation)

    def snapshot(self) -> Snapshot:
        """Return the complete state."""
        raise NotImplementedError


def _remade(kind: Any, args: tuple[Any, ...], kwargs: dict[str, Any], snapshot: Snapshot) -> Any:
    env = kind(*args, **kwargs)
    env.restore(snapshot)
    return env


def places_of(setup: Setup) -> dict[str, slice]:
    """Return the place of each output of the task behind the watched samples, by row name."""
    outputs, before = setup.task.model.outputs, setup.task.watched.size * setup.samples
    return {name: slice(s.start + before, s.stop + before) for name in outputs.names for s in [outputs.slice(name)]}

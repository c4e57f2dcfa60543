"""Inputs and outputs of an instance, one step at a time, for a master."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.errors import InputError, InsenvError
from insenv.fmu.reading import Array

Place = tuple[NDArray[Any], int]
"""A row (1, elements) of a group of variables, and a place in it."""


class Ports:
    """The connected inputs and all outputs of an instance.

    setters, getters: calls with the rows that they read and fill.  inputs, outputs: `Place` by element name.
    """

    def __init__(
        self,
        name: str,
        setters: list[tuple[Callable[[], int], NDArray[Any]]],
        getters: list[tuple[Callable[[], int], NDArray[Any]]],
        places: tuple[Mapping[str, Place], Mapping[str, Place]],
        do_step: Callable[[float, float], int],
        failure: Callable[[str, int, float, int], InsenvError],
    ) -> None:
        self.name = name
        self._setters, self._getters = setters, getters
        self._inputs, self._outputs = places
        self._do_step, self._failure = do_step, failure
        self._wires: dict[tuple[int, int], tuple[NDArray[Any], NDArray[Any], list[int], list[int]]] = {}
        self._copies: list[tuple[NDArray[Any], NDArray[Any], NDArray[np.intp], NDArray[np.intp]]] = []

    def connect(self, target: str, source: Ports, variable: str) -> None:
        """Take input `target` from the output `variable` of another instance.  Raises `InputError` for an unknown name."""
        if target not in self._inputs:
            raise InputError(f"{self.name}: no input {target!r}")
        if variable not in source._outputs:
            raise InputError(f"{source.name}: no output {variable!r}")
        (to, at), (given, place) = self._inputs[target], source._outputs[variable]
        wire = self._wires.setdefault((id(to), id(given)), (to, given, [], []))
        wire[2].append(at)
        wire[3].append(place)
        self._copies = [(a[0], b[0], np.array(i), np.array(j)) for a, b, i, j in self._wires.values()]

    def step(self, k: int, time: float, step: float) -> None:
        """Step number k: set the inputs, advance, read the outputs."""
        for to, given, at, places in self._copies:
            to[at] = given[places]
        for call, _ in self._setters:
            if (status := call()) > 1:
                raise self._failure("setting the inputs", k, time, status)
        if (status := self._do_step(time, step)) > 1:
            raise self._failure("the step", k, time, status)
        for call, _ in self._getters:
            if (status := call()) > 1:
                raise self._failure("reading the outputs", k, time, status)

    def values(self) -> Array:
        """The outputs, in the order of the variables."""
        return np.array([row[0, place] for row, place in self._outputs.values()], dtype=np.float64)

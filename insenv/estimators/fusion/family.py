"""`fusion`: strapdown navigation with any instruments; a filter composed from error states and aids.

Where nobody names states and aids, `presets` chooses them by the unit, the instruments and the vehicle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.estimators.contract import Choices, Drive, Estimator, Knowledge
from insenv.estimators.fusion.available import AIDS, ALWAYS, STATES, composition
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.contract import Aid, ErrorState
from insenv.estimators.fusion.prepared import prepared
from insenv.estimators.fusion.presets import aids_of, states_of
from insenv.estimators.fusion.smoothing import smoothing_of
from insenv.estimators.parts import applicability, vertical_channel

ID = "fusion"


def fusion(states: Iterable[str | ErrorState], aids: Iterable[str | Aid], id: str = ID, *, smoother: bool = False) -> Estimator:
    """A GNSS/INS-like navigation filter of one's own, as an estimator like any other.

    Parameters
    ----------
    states: beside position, velocity, attitude and the biases of gyros and accelerometers, which every filter has: names that
        ``insenv list states`` shows, or own `ErrorState` objects.
    aids: names that ``insenv list aids`` shows, or own `Aid` objects.
    id: of the estimator.
    smoother: whether to smooth over the whole run; the id of the smoother is ``ID-smoother``.

    Raises `InputError` for an unknown name, a name that is given twice, no aid, or a state that none of the aids shows.
    """
    made = composition(id, states, aids)
    return _smoother(made) if smoother else _estimator(made)


def _estimator(filter: Composition) -> Estimator:
    names = [state.name for state in filter.states]
    sensors = tuple(dict.fromkeys(sensor for aid in filter.aids for sensor in aid.sensors))

    def notes(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
        return (
            *applicability.linear_start(parameters, duration_s),
            *(vertical_channel.notes(parameters, duration_s) if not _holds_height(filter) else ()),
            *_without_sigma(filter, parameters),
        )

    return Estimator(
        filter.model,
        kind="navigation",
        sensors=sensors,
        error=filter.consistency_error,
        prepare=lambda known: prepared(known, filter.parameters, names),
        applicability=notes,
    )


def _holds_height(filter: Composition) -> bool:
    return any(aid.id in ("gnss", "barometer") for aid in filter.aids)


def _without_sigma(filter: Composition, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    idle = [state for state in filter.states if not np.any(np.asarray(parameters[state.sigma]) > 0.0)]
    return tuple(
        f"the state {state.name} has the standard deviation 0 at the start and stays what it is: {state.sigma} sets it"
        for state in idle
    )


def _smoother(filter: Composition) -> Estimator:
    smoothing = smoothing_of(filter, f"{filter.id}-smoother")
    return replace(_estimator(filter), model=smoothing.forward, smooths=filter.id, smoothing=smoothing)


def _composed(known: Knowledge, drive: Drive, choices: Choices) -> Composition:
    """The filter for a drive: the states and aids in `choices`, those of the presets where it has none."""
    aids = choices["aids"] if "aids" in choices else aids_of(drive)
    states = choices["states"] if "states" in choices else states_of(known, drive, aids)
    return composition(ID, states, aids)


def _family(make: Callable[[Composition], Estimator]) -> Estimator:
    """The estimator whose members `make` makes; its own model is that of the smallest."""
    general = make(composition(ID, (), ("gnss", "zero_velocity"), "states and aids chosen by unit, instruments and vehicle"))
    return replace(
        general,
        sensors=(),
        choices={"states": tuple(name for name in STATES if name not in ALWAYS), "aids": tuple(AIDS)},
        settable=composition(ID, STATES, AIDS).parameters,
        adapt=lambda known, drive, choices: make(_composed(known, drive, choices)),
    )


FUSION = _family(_estimator)
SMOOTHER = _family(_smoother)
ESTIMATORS = (FUSION, SMOOTHER)

"""`fusion`: strapdown navigation with any instruments; a filter composed from error states and aids.

Where nobody names states and aids, `presets` chooses them by the unit, the instruments and the vehicle.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from math import cos, radians
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.estimators.contract import TURNTABLE, Choices, Drive, Estimator, Knowledge
from insenv.estimators.fusion import history, unknown_start
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.fusion.available import AIDS, OF_AID, STATES, composition
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.findings import surprising
from insenv.estimators.fusion.gnss import WANDER
from insenv.estimators.fusion.in_place import SHAKEN
from insenv.estimators.fusion.odometer import MOUNTING, NON_HOLONOMIC
from insenv.estimators.fusion.prepared import prepared, untold_mounting
from insenv.estimators.fusion.presets import HOLDING, aids_of, states_of, told_of_unit
from insenv.estimators.fusion.smoothing import smoothing_of
from insenv.estimators.parts import applicability, vertical_channel
from insenv.estimators.velocity_integration.estimator import OLDEST
from insenv.estimators.velocity_integration.wahba import VelocityIntegration
from insenv.geodesy import OMEGA_IE

ID = "fusion"
_SECTIONS = tuple(f"[{sensor}]" for aid in AIDS.values() for sensor in aid.sensors)


def fusion(
    states: Iterable[str | ErrorState] = (),
    aids: Iterable[str | Aid] = ("gnss", "zero_velocity"),
    id: str = ID,
    *,
    smoother: bool = False,
) -> Estimator:
    """A GNSS/INS-like navigation filter of one's own, as an estimator like any other.

    Parameters
    ----------
    states: beside position, velocity, attitude and the biases of gyros and accelerometers, which every filter has: names that
        ``insenv list states`` shows, or own `ErrorState` objects.
    aids: names that ``insenv list aids`` shows, or own `Aid` objects.
    id: of the estimator.
    smoother: whether to smooth over the whole run; the id of the smoother is ``ID-smoother``.

    Raises `InputError` for an unknown name, a name that is given twice, no aid, a state that none of the aids shows, or a
    smoother that is neither True nor False.
    """
    if not isinstance(smoother, bool):
        raise InputError(f"fusion {id!r}: smoother = {smoother!r}: allowed is True or False")
    made, make = composition(id, states, aids), _smoother if smoother else _estimator
    return replace(make(made), adapt=lambda known, drive, choices: _suited(make, made, known, drive))


def _suited(make: Callable[..., Estimator], filter: Composition, known: Knowledge, drive: Drive) -> Estimator:
    """The estimator that `make` makes of a filter for a drive."""
    way = unknown_start.way_of(filter, known, drive)
    made = make(filter, _uncounted(filter, known, drive), way)
    if IN_PLACE in [aid.id for aid in filter.aids] and drive.vehicle != TURNTABLE:
        made = _shaken(made)
    return made if way is None else _seeking(made, filter, way)


def _shaken(estimator: Estimator) -> Estimator:
    """The estimator of a vehicle that stays in place, but not as still as a turntable."""
    assert estimator.prepare is not None
    prepare = estimator.prepare
    return replace(estimator, prepare=lambda known: {**prepare(known), "in_place_sigma": SHAKEN})


def _seeking(estimator: Estimator, filter: Composition, way: VelocityIntegration) -> Estimator:
    """The estimator whose model finds its start attitude first, with what that needs and says."""
    assert estimator.prepare is not None and estimator.applicability is not None and estimator.findings is not None
    prepare, notes, findings = estimator.prepare, estimator.applicability, estimator.findings
    sure = {"tilt_sigma": 0.0, "heading_sigma": 0.0}  # no note says that the start is too uncertain
    return replace(
        estimator,
        prepare=lambda known: {**prepare(known), **unknown_start.prepared(way, known)},
        applicability=lambda parameters, duration_s: (
            *notes({**parameters, **sure}, duration_s),
            *unknown_start.far_place(way, parameters),
        ),
        findings=lambda parameters: (*findings(parameters), *unknown_start.finding(way, parameters)),
        reaches=lambda parameters: unknown_start.reached(way, parameters),
        finds_attitude=True,
        oldest_s=min(estimator.oldest_s, OLDEST),
        settable=filter.parameters,  # not those of the alignment
    )


def _estimator(filter: Composition, uncounted: tuple[str, ...] = (), way: VelocityIntegration | None = None) -> Estimator:
    """The filter; uncounted: sentences about errors that it does not count; way: the alignment that it starts by."""
    names, ids = [state.name for state in filter.states], [aid.id for aid in filter.aids]
    sensors = tuple(dict.fromkeys(sensor for aid in filter.aids for sensor in aid.sensors))

    def notes(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
        return (
            *applicability.linear_start(parameters, duration_s, UNKNOWN_START),
            *(() if _holds(filter, _VERTICAL) else vertical_channel.by_bias(parameters, duration_s)),
            *(() if _holds(filter, _HORIZONTAL) else applicability.free_start(parameters, duration_s)),
            *(() if _holds(filter, _HEADING) or _gyrocompasses(ids, parameters) else (NO_HEADING,)),
            *(applicability.drifting_heading(parameters, duration_s) if IN_PLACE in ids else ()),
            *uncounted,
            *_without_sigma(filter, parameters),
        )

    return Estimator(
        filter.model if way is None else unknown_start.model_of(filter, way),
        kind="navigation",
        sensors=sensors,
        error=filter.consistency_error,
        prepare=lambda known: prepared(known, filter.parameters, names),
        applicability=notes,
        findings=lambda parameters: surprising(filter.states, parameters),
        causes=filter.causes,
        oldest_s=history.OLDEST,
    )


UNKNOWN_START = (
    "fusion first finds an attitude that is unknown by what is told of the start ([knowledge] in a scenario, [initial] in a "
    "log), with velocities of GNSS or of a Doppler log, and without the aids magnetometer and heading"
)
IN_PLACE = "in_place"
_VERTICAL = ("gnss", "barometer", "dvl", "non_holonomic", "in_place")
"""Aids that hold the height or the vertical velocity."""
_HORIZONTAL = (*HOLDING, "zero_velocity", "in_place")
"""Aids that hold the horizontal velocity or position."""
_HEADING = ("gnss", "magnetometer", "heading", "in_place")
"""Aids that show the heading: GNSS by motion, a fixed place by the rotation of the Earth."""
NO_HEADING = (
    "none of the aids shows the heading: a linearised filter takes turns for information on it, and its sigmas of heading and "
    "position come out too small, by a factor of 1.2 to 3 after some minutes of a car's drive, and by more on a turntable"
)


GYROCOMPASS = radians(1.0)
"""rad: heading error by a gyro bias up to which the rotation of the Earth shows the heading to a filter with a Doppler log."""


def _gyrocompasses(ids: Collection[str], parameters: Mapping[str, Any]) -> bool:
    horizontal = OMEGA_IE * cos(parameters["start_latitude"])
    return "dvl" in ids and float(parameters["gyro_bias_sigma"]) < GYROCOMPASS * horizontal


def _holds(filter: Composition, ids: tuple[str, ...]) -> bool:
    return any(aid.id in ids or aid.id not in AIDS for aid in filter.aids)


NO_PLACE = (
    "the vehicle is a turntable, and no aid tells that the unit stays in place while it turns: after a turn the sigmas can "
    "be more than ten times too small; use the aid in_place"
)


NO_MOUNTING = (
    "nothing is told of how the unit is mounted to the wheels, and their constraint takes its axes for theirs: a degree "
    "between them is a degree of heading error; use the state odometer_mounting_error"
)


def _uncounted(filter: Composition, known: Knowledge, drive: Drive) -> tuple[str, ...]:
    """Sentences about what is known to be there and is not in the filter.

    Errors of the instruments in use that are no states; on a turntable also those of the unit, and that it stays in place.
    """
    states = {state.name for state in filter.states}
    left_out = [
        state.name
        for aid in filter.aids
        for state in OF_AID.get(aid.id, ())
        if state.name not in states and state is not WANDER and np.any(np.asarray(known.rows.get(state.sigma, 0.0)) > 0.0)
    ]
    found = []
    if left_out:
        found.append(
            f"errors of the instruments that are known to be there and are neither states nor noise of this filter: "
            f"{', '.join(dict.fromkeys(left_out))}; its sigmas are too small"
        )
    if NON_HOLONOMIC.id in {aid.id for aid in filter.aids} and MOUNTING.name not in states and untold_mounting(known):
        found.append(NO_MOUNTING)
    if drive.vehicle == TURNTABLE:
        of_unit = [name for name in told_of_unit(known) if name not in states]
        if of_unit:
            found.append(
                f"errors of the unit that a turn shows and that are no states of this filter: {', '.join(of_unit)}; after a "
                "turn its sigmas are several times too small"
            )
        if IN_PLACE not in [aid.id for aid in filter.aids]:
            found.append(NO_PLACE)
    return tuple(found)


def _without_sigma(filter: Composition, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    idle = [state for state in filter.states if not np.any(np.asarray(parameters[state.sigma]) > 0.0)]
    return tuple(
        f"the state {state.name} has no effect: its standard deviation at the start is 0. Set {state.sigma}" for state in idle
    )


def _smoother(filter: Composition, uncounted: tuple[str, ...] = (), way: VelocityIntegration | None = None) -> Estimator:
    smoothing = smoothing_of(filter, f"{filter.id}-smoother", way)
    return replace(_estimator(filter, uncounted, way), model=smoothing.forward, smooths=filter.id, smoothing=smoothing)


def _composed(known: Knowledge, drive: Drive, choices: Choices) -> Composition:
    """The filter for a drive: the states and aids in `choices`, those of the presets where it has none."""
    aids = choices["aids"] if "aids" in choices else aids_of(drive)
    if not aids and "aids" not in choices:
        raise InputError(f"estimator {ID!r} needs an instrument: {drive.where} has none of {', '.join(_SECTIONS)}")
    states = choices["states"] if "states" in choices else states_of(known, drive, aids)
    return composition(ID, states, aids)


def _family(make: Callable[..., Estimator]) -> Estimator:
    """The estimator whose members `make` makes; its own model is that of the smallest."""
    general = make(composition(ID, (), ("gnss", "zero_velocity"), "states and aids chosen by unit, instruments and vehicle"))
    settable = composition(ID, STATES, AIDS).parameters

    def adapt(known: Knowledge, drive: Drive, choices: Choices) -> Estimator:
        filter = _composed(known, drive, choices)
        return replace(_suited(make, filter, known, drive), settable=settable)

    return replace(
        general,
        sensors=(),
        choices={"states": tuple(STATES), "aids": tuple(AIDS)},
        settable=settable,
        adapt=adapt,
    )


FUSION = _family(_estimator)
SMOOTHER = _family(_smoother)
ESTIMATORS = (FUSION, SMOOTHER)

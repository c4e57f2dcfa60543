"""`fusion`: strapdown navigation with any instruments; a filter composed from error states and aids.

Where nobody names states and aids, `presets` chooses them by the unit, the instruments and the vehicle.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from math import cos, hypot, radians, sqrt
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Table
from insenv.estimators.contract import Choices, Drive, Estimator
from insenv.estimators.fusion import awaited, azimuth, history, moored, unknown_start
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.fusion.available import OF_UNIT, all_aids, all_states, composition, states_by_aid, suited
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.error_state import DRIFTING, ErrorState
from insenv.estimators.fusion.gnss import WANDER
from insenv.estimators.fusion.in_place import SHAKEN
from insenv.estimators.fusion.non_holonomic import MOUNTING, NON_HOLONOMIC, UNKNOWN_ARM
from insenv.estimators.fusion.restart import restarts
from insenv.estimators.fusion.smoothing import smoothing_of
from insenv.estimators.fusion.surprising import surprising
from insenv.estimators.fusion.ways import Way, lose_heading
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import applicability
from insenv.estimators.parts.error_model import COHERENT_ANGLE, COHERENT_SPEED
from insenv.estimators.velocity_integration.estimator import OLDEST
from insenv.geodesy import OMEGA_IE
from insenv.sensors.data_sheet import MOTION_ERRORS, PROPORTIONAL

# Which states and aids a filter has where nobody says: by the unit, the instruments and the vehicle.
#
# A state is worth its place if what it does exceeds a share of what the unit's white noise does in a minute: a scale factor or
# a misalignment in a manoeuvre (`insenv.estimators.parts.error_model`), an error of an instrument if it is stated at all. On a
# turntable, which turns gravity from axis to axis, every stated error of the unit is worth it.

MOORED = moored.AID.id
WORTH = 0.1
MINUTE = 60.0


def aids_of(drive: Drive) -> tuple[str, ...]:
    """The aids of a drive: those of its instruments, and what the vehicle itself tells.

    Where nothing but rest holds the velocity of a vehicle that is known to stay, rest is not detected: detection asks whether
    the estimate agrees, and one that is 3 standard deviations off takes a parked vehicle for one that accelerates.
    """
    traits = drive.traits
    wheels = traits.wheels and "odometer" in drive.sensors
    parked = bool(drive.in_place and (traits.parks or drive.stands) and not held(drive.sensors))
    stays = traits.turns_in_place or parked
    floating = bool(drive.in_place and traits.floats and not held(drive.sensors))
    without_sensor = {
        "zero_velocity": not stays and not traits.floats,
        "non_holonomic": wheels,
        "in_place": stays,
        MOORED: floating,
    }
    every = all_aids().items()
    return tuple(id for id, aid in every if without_sensor.get(id, bool(aid.sensors)) and set(aid.sensors) <= drive.sensors)


def held(ids: Collection[str]) -> bool:
    """Whether one of the aids is an instrument that holds the horizontal velocity, also of a vehicle that is steered away."""
    return any(id in ids and aid.sensors and "horizontal" in aid.holds for id, aid in all_aids().items())


def states_of(known: Knowledge, drive: Drive, aids: Collection[str]) -> tuple[str, ...]:
    """The states, beside the biases, of a filter with these aids."""
    rows = known.rows
    # sway adds no error of the unit up from turn to turn, as noise would: what it turns it turns back
    in_turns = drive.traits.turns_in_place or MOORED in aids
    names = stated_unit_errors(known) if in_turns else _shown_by_manoeuvres(known, drive)
    for aid in aids:
        names += [state.name for state in states_by_aid().get(aid, ()) if _is_stated(rows, all_states()[state.name].sigma)]
    if NON_HOLONOMIC.id in aids and mounting_unknown(known):
        names.append(MOUNTING.name)
    if MOORED in aids:
        names += [state.name for state in moored.STATES]
        names += [azimuth.STATE.name] if azimuth.ALLOWED.issuperset(aids) else []
    return tuple(dict.fromkeys(names))


def stated_unit_errors(known: Knowledge) -> list[str]:
    """The states of the unit beside its biases whose standard deviation is stated."""
    rows = known.rows
    return [state for state in OF_UNIT if _is_stated(rows, all_states()[state].sigma)]


def _shown_by_manoeuvres(known: Knowledge, drive: Drive) -> list[str]:
    sheet = known.sensors
    if drive.in_place:  # no manoeuvre shows them
        return []
    angle, speed = (max(walk * sqrt(MINUTE), 1e-12) for walk in (sheet.angle_random_walk, sheet.velocity_random_walk))
    effects = {
        **dict.fromkeys(PROPORTIONAL["gyro"], COHERENT_ANGLE / angle),
        **dict.fromkeys(PROPORTIONAL["accel"], COHERENT_SPEED / speed),
        "gyro_g_sensitivity": COHERENT_SPEED / angle,
    }
    return [name for name, effect in effects.items() if getattr(sheet, f"{name}_sigma") * effect > WORTH]


def _is_stated(rows: dict[str, Any], sigma: str) -> bool:
    return bool(np.any(np.asarray(rows.get(sigma, 0.0)) > 0.0))


# Parameters of a composition from what is known of the start and the unit.


def mounting_unknown(known: Knowledge) -> bool:
    """Whether nothing is stated of how the inertial unit is mounted to the wheels."""
    return "odometer_lever_arm_b" not in known.instruments


def prepared(known: Knowledge, table: Table, states: Collection[str]) -> dict[str, Any]:
    """Parameter rows (SI, by name) of a filter that estimates `states`.

    What a state stands for is taken out of what a filter without it counts instead: out of the bias that gravity makes of a
    scale factor, a misalignment or a g-sensitivity, and out of the process noise of manoeuvres
    (`insenv.estimators.parts.error_model`).
    """
    rows, sheet = known.rows_of(table), known.sensors
    for name in known.instruments:  # an error that is not stated, of a requested state, has the size that its row starts with
        if name in rows and not np.any(rows[name]) and table[name].flat_start().any():
            del rows[name]
    if mounting_unknown(known) and "non_holonomic_arm_sigma" in table:
        rows["non_holonomic_arm_sigma"] = UNKNOWN_ARM
    for triad, needed in (("gyro", ("gyro_g_sensitivity",)), ("accel", PROPORTIONAL["accel"])):
        sigma = getattr(sheet, f"bare_{triad}_bias_sigma")
        if sigma > 0 and all(name in states or getattr(sheet, f"{name}_sigma") == 0 for name in needed):
            rows[f"{triad}_bias_sigma"] = sigma
            rows[f"{triad}_correlation_time"] = getattr(sheet, f"bare_{triad}_correlation_time")
    for triad, row in MOTION_ERRORS.items():
        estimated = hypot(*(getattr(sheet, f"{name}_sigma") for name in PROPORTIONAL[triad] if name in states))
        rows[row] = sqrt(max(getattr(known, row) ** 2 - estimated**2, 0.0))
    return rows


ID = "fusion"


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
    _check_mooring(made, smoother)
    return replace(make(made), adapt=lambda known, drive, choices: _suited(make, made, known, drive))


def _check_mooring(filter: Composition, smoother: bool) -> None:
    """Raise `InputError` for a smoother at a mooring, or aids that take the assumed azimuth for the true one."""
    ids = [aid.id for aid in filter.aids]
    lacking = [state.name for state in moored.STATES if state not in filter.states]
    if MOORED in ids and lacking:
        raise InputError(f"fusion {filter.id!r}: the aid {MOORED!r} needs the states {', '.join(lacking)} too")
    if MOORED in ids and smoother:
        raise InputError(f"fusion {filter.id!r}: the smoother does not take the aid {MOORED!r}; use the filter, {ID!r}")
    if azimuth.STATE in filter.states and (MOORED not in ids or not azimuth.ALLOWED.issuperset(ids)):
        allowed = ", ".join(sorted(azimuth.ALLOWED - {MOORED}))
        raise InputError(
            f"fusion {filter.id!r}: the state {azimuth.STATE.name!r} with the aids {', '.join(ids)}: allowed is {MOORED}, "
            f"alone or with {allowed}"
        )


def _suited(make: Callable[..., Estimator], filter: Composition, known: Knowledge, drive: Drive) -> Estimator:
    """The estimator that `make` makes of a filter for a drive, with the correlation times and the gyros of its unit."""
    times = [name for name, state in DRIFTING.items() if _is_stated(known.rows, state.time)]
    filter = suited(filter, times, lose_heading(known))
    way = unknown_start.way_of(filter, known, drive)
    made = make(filter, _uncounted(filter, known, drive), way)
    if IN_PLACE in [aid.id for aid in filter.aids] and not drive.traits.turns_in_place:
        made = _shaken(made)
    return made if way is None else _seeking(made, filter, way)


def _shaken(estimator: Estimator) -> Estimator:
    """The estimator of a vehicle that stays in place, but not as still as a turntable."""
    assert estimator.prepare is not None
    prepare = estimator.prepare
    return replace(estimator, prepare=lambda known: {**prepare(known), "in_place_sigma": SHAKEN})


def _seeking(estimator: Estimator, filter: Composition, way: Way) -> Estimator:
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
        findings=lambda parameters: (*findings(parameters), *unknown_start.findings(way, parameters)),
        finds_attitude=True,
        max_measurement_age_s=min(estimator.max_measurement_age_s, OLDEST),
        settable=filter.parameters,  # not those of the alignment
    )


def _estimator(filter: Composition, uncounted: tuple[str, ...] = (), way: Way | None = None) -> Estimator:
    """The filter; uncounted: sentences about errors that it does not count; way: the alignment that it starts by."""
    names, ids = [state.name for state in filter.states], [aid.id for aid in filter.aids]
    sensors = tuple(dict.fromkeys(sensor for aid in filter.aids for sensor in aid.sensors))

    by_earth_rate = azimuth.STATE in filter.states
    any_heading = {"heading_sigma": 0.0} if by_earth_rate or any(aid.iterated for aid in filter.aids) else {}

    def notes(parameters: Mapping[str, Any], duration_s: float) -> tuple[Remark, ...]:
        return (
            *applicability.linear_start({**parameters, **any_heading}, duration_s, UNKNOWN_START),
            *(
                applicability.notes({**parameters, "latitude": parameters["start_latitude"]}, duration_s)
                if by_earth_rate
                else ()
            ),
            *(() if _holds(filter, "vertical") else applicability.drifting_height(parameters, duration_s)),
            *(() if _holds(filter, "horizontal") else applicability.free_start(parameters, duration_s)),
            *(() if _holds(filter, "heading") or _gyrocompasses(ids, parameters) else (NO_HEADING,)),
            *(applicability.drifting_heading(parameters, duration_s) if IN_PLACE in ids else ()),
            *(applicability.unknown_iron(parameters) if "hard_iron" in names else ()),
            *(() if {IN_PLACE, MOORED} & set(ids) else applicability.unmodelled_motion(parameters, duration_s)),
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
        findings=lambda parameters: (
            *surprising(filter.states, parameters),
            *restarts(filter.aids),
            *(awaited.findings() if filter.awaiting else ()),
            *(azimuth.findings(parameters) if by_earth_rate else ()),
            *(moored.findings(parameters) if MOORED in ids else ()),
        ),
        causes=filter.causes,
        finds_attitude=by_earth_rate,
        max_measurement_age_s=history.OLDEST,
    )


UNKNOWN_START = (
    "fusion first finds an attitude that the stated start ([knowledge] in a scenario, [initial] in a log) leaves unknown, "
    "with velocities of GNSS or of a Doppler log, and without the aids magnetometer and heading"
)
IN_PLACE = "in_place"
NO_HEADING = declared(
    "no-heading-aid",
    "none of the aids shows the heading: a linearised filter treats turns as information about it, and its sigmas of heading "
    "and position are too small, by a factor of 1.2 to 3 after some minutes of a car's drive, and by more on a turntable",
)


GYROCOMPASS = radians(1.0)
"""rad: heading error by a gyro bias up to which the rotation of the Earth shows the heading to a filter with a Doppler log."""


def _gyrocompasses(ids: Collection[str], parameters: Mapping[str, Any]) -> bool:
    horizontal = OMEGA_IE * cos(parameters["start_latitude"])
    return "dvl" in ids and float(parameters["gyro_bias_sigma"]) < GYROCOMPASS * horizontal


def _holds(filter: Composition, what: str) -> bool:
    return any(what in aid.holds for aid in filter.aids)


NO_PLACE = declared(
    "no-place-aid",
    "the vehicle is a turntable, and no aid states that the unit stays in place while it turns: after a turn the sigmas "
    "can be more than ten times too small; use the aid in_place",
)


NO_MOUNTING = declared(
    "mounting-unknown",
    "the mounting of the unit relative to the wheels is not stated, and the wheel constraint assumes aligned axes: one degree "
    "of misalignment is one degree of heading error; use the state odometer_mounting_error",
)
_ERRORS_UNCOUNTED = declared(
    "errors-uncounted",
    "instrument errors that this filter neither estimates nor counts as noise: {states}; its stated sigmas are too small",
)
_UNIT_UNCOUNTED = declared(
    "unit-errors-uncounted",
    "errors of the unit that a turn reveals and that this filter does not estimate: {states}; after a turn its stated sigmas "
    "are several times too small",
)
_IDLE_STATE = declared(
    "state-without-effect", "the state {state} has no effect: its standard deviation at the start is 0. Set {sigma}"
)


def _uncounted(filter: Composition, known: Knowledge, drive: Drive) -> tuple[Remark, ...]:
    """Sentences about what is known to be there and is not in the filter.

    Errors of the instruments in use that are no states; on a turntable also those of the unit, and that it stays in place.
    """
    states = {state.name for state in filter.states}
    left_out = [
        state.name
        for aid in filter.aids
        for state in states_by_aid().get(aid.id, ())
        if state.name not in states and state is not WANDER and np.any(np.asarray(known.rows.get(state.sigma, 0.0)) > 0.0)
    ]
    remarks = []
    if left_out:
        remarks.append(_ERRORS_UNCOUNTED.filled(states=", ".join(dict.fromkeys(left_out))))
    if NON_HOLONOMIC.id in {aid.id for aid in filter.aids} and MOUNTING.name not in states and mounting_unknown(known):
        remarks.append(NO_MOUNTING)
    if drive.traits.turns_in_place:
        of_unit = [name for name in stated_unit_errors(known) if name not in states]
        if of_unit:
            remarks.append(_UNIT_UNCOUNTED.filled(states=", ".join(of_unit)))
        if IN_PLACE not in [aid.id for aid in filter.aids]:
            remarks.append(NO_PLACE)
    return tuple(remarks)


def _without_sigma(filter: Composition, parameters: Mapping[str, Any]) -> tuple[Remark, ...]:
    idle = [state for state in filter.states if not np.any(np.asarray(parameters[state.sigma]) > 0.0)]
    return tuple(_IDLE_STATE.filled(state=state.name, sigma=state.sigma) for state in idle)


def _smoother(filter: Composition, uncounted: tuple[str, ...] = (), way: Way | None = None) -> Estimator:
    smoothing = smoothing_of(filter, f"{filter.id}-smoother", way)
    return replace(_estimator(filter, uncounted, way), model=smoothing.forward, smooths=filter.id, smoothing=smoothing)


def _composed(known: Knowledge, drive: Drive, choices: Choices, smoother: bool) -> Composition:
    """The filter for a drive: the states and aids in `choices`, those of the presets where it has none."""
    aids = choices["aids"] if "aids" in choices else aids_of(drive)
    if smoother and MOORED in aids and len(aids) > 1 and "aids" not in choices:
        aids = tuple(aid for aid in aids if aid != MOORED)
    if not aids and "aids" not in choices:
        sections = ", ".join(f"[{sensor}]" for aid in all_aids().values() for sensor in aid.sensors)
        raise InputError(f"estimator {ID!r} needs an instrument: {drive.where} has none of {sections}")
    states = choices["states"] if "states" in choices else states_of(known, drive, aids)
    made = composition(ID, states, aids)
    _check_mooring(made, smoother)
    return made


def _family(make: Callable[..., Estimator], smoother: bool) -> Estimator:
    """The estimator whose members `make` makes; its own model is that of the smallest."""
    general = make(composition(ID, (), ("gnss", "zero_velocity"), "states and aids chosen by unit, instruments and vehicle"))

    def settable() -> Table:
        return suited(composition(ID, all_states(), all_aids()), DRIFTING).parameters

    def adapt(known: Knowledge, drive: Drive, choices: Choices) -> Estimator:
        filter = _composed(known, drive, choices, smoother)
        return replace(_suited(make, filter, known, drive), settable=settable)

    return replace(
        general,
        sensors=(),
        choices=lambda: {"states": tuple(all_states()), "aids": tuple(all_aids())},
        settable=settable,
        adapt=adapt,
    )


FUSION = _family(_estimator, smoother=False)
SMOOTHER = _family(_smoother, smoother=True)
ESTIMATORS = (FUSION, SMOOTHER)

"""The error states and aids that insenv ships, by name, and a composition from names and own ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

from insenv.base.errors import InputError, nearest
from insenv.estimators.fusion import barometer, dvl, gnss, heading, in_place, inertial, magnetometer, odometer, zero_velocity
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.error_state import ErrorState

ALWAYS = ("gyro_bias", "accel_bias")
"""States that every filter has."""
STATES: Mapping[str, ErrorState] = {
    state.name: state for module in (inertial, gnss, odometer, barometer, magnetometer, dvl, heading) for state in module.STATES
}
AIDS: Mapping[str, Aid] = {
    aid.id: aid
    for aid in (
        gnss.WHITE, odometer.AID, odometer.NON_HOLONOMIC, barometer.AID, magnetometer.AID, dvl.AID, heading.AID,
        zero_velocity.AID, in_place.AID,
    )
}  # fmt: skip
"""In the order in which a filter uses those that measure at the same sample: zero velocity, the surest, last."""
OF_AID = {
    "gnss": gnss.STATES,
    "odometer": odometer.STATES,
    "non_holonomic": (odometer.MOUNTING,),
    "barometer": barometer.STATES,
    "magnetometer": magnetometer.STATES,
    "dvl": dvl.STATES,
    "heading": heading.STATES,
}
"""The states that only the measurements of an aid show, by id of the aid."""


OF_UNIT = tuple(state.name for state in inertial.STATES if state.name not in ALWAYS)
"""The states of the inertial unit beside its biases."""


def composition(id: str, states: Iterable[str | ErrorState], aids: Iterable[str | Aid], title: str = "") -> Composition:
    """A filter with these states, beside the biases, and these aids, in the order of `STATES` and `AIDS`, own ones last.

    The same object for the same parts, so that its model is written out and compiled once.  Raises `InputError` for an
    unknown name, a name that is given twice, no aid, or a state whose aid is missing.
    """
    chosen = _chosen("state", id, states, STATES, ErrorState)
    used = _chosen("aid", id, aids, AIDS, Aid)
    if not used:
        raise InputError(f"fusion {id!r}: aids = []: allowed is at least one of {', '.join(AIDS)}")
    names, ids = {state.name for state in chosen}, {aid.id for aid in used}
    for state in chosen:
        owners = [aid for aid, own in OF_AID.items() if state in own]
        if owners and not ids & set(owners):
            raise InputError(f"fusion {id!r}: nothing shows the state {state.name!r} without the aid {' or '.join(owners)}")
    biases = tuple(STATES[name] for name in ALWAYS if name not in names)
    used = tuple(gnss.WANDER_ESTIMATED if aid is gnss.WHITE and gnss.WANDER.name in names else aid for aid in used)
    every = (*biases, *chosen)
    own = tuple(state for state in every if state not in STATES.values())
    every = (*(state for state in STATES.values() if state in every), *own)
    count = 9 + sum(state.size for state in every)
    named = "".join(f", {state.name}" for state in every if state.name not in ALWAYS)
    made = f"{count} states: navigation, biases{named}; aids: {', '.join(aid.id for aid in used)}"
    return _composed(id, title or made, every, used)


_composed = lru_cache(maxsize=64)(Composition)


def _chosen(kind: str, id: str, given: Iterable[object], known: Mapping[str, object], wanted: type) -> tuple:
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise InputError(f"fusion {id!r}: {kind}s = {given!r}: allowed is a list of names")
    found = []
    for one in given:
        if isinstance(one, str):
            if one not in known:
                raise InputError(f"fusion {id!r}: unknown {kind} {one!r}{nearest(one, tuple(known))}")
            one = known[one]
        if not isinstance(one, wanted):
            raise InputError(f"fusion {id!r}: {kind} {one!r}: allowed is a name or an object of class {wanted.__name__}")
        if one in found:
            raise InputError(f"fusion {id!r}: {kind} {getattr(one, 'id', getattr(one, 'name', one))!r} is given twice")
        found.append(one)
    order: Sequence[object] = list(known.values())
    return tuple(sorted(found, key=lambda each: order.index(each) if each in order else len(order)))

"""The error states and aids of fusion filters by name, those of all registered instruments included; composition by names."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache, lru_cache

from insenv.base.errors import InputError, nearest
from insenv.estimators.fusion import azimuth, error_state, gnss, in_place, moored, non_holonomic, zero_velocity
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.instruments import aid_of, states_of
from insenv.sensors import registry
from insenv.sensors.instrument import Instrument

ALWAYS = ("gyro_bias", "accel_bias")
"""States that every filter has."""
OF_UNIT = tuple(state.name for state in error_state.STATES if state.name not in ALWAYS)
"""The states of the inertial unit beside its biases."""


def _instruments() -> tuple[Instrument, ...]:
    """All instruments in the order of their states and aids: the odometer comes first, before the constraint of its wheels."""
    by_id = registry.instruments()
    return (by_id.pop("odometer"), *by_id.values())


@cache
def _states(instruments: tuple[Instrument, ...]) -> Mapping[str, ErrorState]:
    of_instruments = (state for instrument in instruments for state in states_of(instrument))
    states = (*error_state.STATES, *gnss.STATES, *of_instruments, *moored.STATES, azimuth.STATE)
    return {state.name: state for state in states}


@cache
def _aids(instruments: tuple[Instrument, ...]) -> Mapping[str, Aid]:
    odometer, *others = map(aid_of, instruments)
    every = (gnss.WHITE, odometer, non_holonomic.NON_HOLONOMIC, *others, zero_velocity.AID, in_place.AID, moored.AID)
    return {aid.id: aid for aid in every}


@cache
def own_names() -> Mapping[str, str]:
    """What a filter has without any instrument, by name: its states, its aids, the rows of its model."""
    states = (*error_state.STATES, *gnss.STATES, *moored.STATES, azimuth.STATE)
    aids = (gnss.WHITE, non_holonomic.NON_HOLONOMIC, zero_velocity.AID, in_place.AID, moored.AID)
    filter = Composition("fusion", "", states, (gnss.WHITE,))
    rows = (row.name for table in (filter.parameters, filter.state, filter.inputs, filter.outputs) for row in table)
    return dict.fromkeys(rows, "a filter of fusion") | dict.fromkeys((aid.id for aid in aids), "an aid of fusion")


def all_states() -> Mapping[str, ErrorState]:
    """The states by name, in their order in a filter."""
    return _states(_instruments())


def all_aids() -> Mapping[str, Aid]:
    """The aids by id, in the order in which a filter uses those that measure at the same sample: the surest comes last."""
    return _aids(_instruments())


def states_by_aid() -> Mapping[str, tuple[ErrorState, ...]]:
    """The states that only the measurements of an aid show, by id of the aid."""
    of_instruments = {instrument.id: states_of(instrument) for instrument in _instruments()}
    return {"gnss": gnss.STATES, "non_holonomic": (non_holonomic.MOUNTING,), "moored": moored.STATES, **of_instruments}


def composition(id: str, states: Iterable[str | ErrorState], aids: Iterable[str | Aid], title: str = "") -> Composition:
    """A filter with these states, beside the biases, and these aids, in their order, own ones last.

    The same object for the same parts, so that its model is written out and compiled once.  Raises `InputError` for an
    unknown name, a name that is given twice, no aid, or a state whose aid is missing.
    """
    known, known_aids = all_states(), all_aids()
    chosen = _chosen("state", id, states, known, ErrorState)
    used = _chosen("aid", id, aids, known_aids, Aid)
    if not used:
        raise InputError(f"fusion {id!r}: aids = []: allowed is at least one of {', '.join(known_aids)}")
    names, ids = {state.name for state in chosen}, {aid.id for aid in used}
    for state in chosen:
        owners = [aid for aid, shown in states_by_aid().items() if state in shown]
        if owners and not ids & set(owners):
            raise InputError(f"fusion {id!r}: the state {state.name!r} is not observable without {' or '.join(owners)}")
    biases = tuple(known[name] for name in ALWAYS if name not in names)
    used = tuple(gnss.WANDER_ESTIMATED if aid is gnss.WHITE and gnss.WANDER.name in names else aid for aid in used)
    every = (*biases, *chosen)
    outside = tuple(state for state in every if state not in known.values())
    every = (*(state for state in known.values() if state in every), *outside)
    count = 9 + sum(state.size for state in every)
    named = "".join(f", {state.name}" for state in every if state.name not in ALWAYS)
    made = f"{count} states: navigation, biases{named}; aids: {', '.join(aid.id for aid in used)}"
    return _composed(id, title or made, every, used)


def suited(filter: Composition, names: Collection[str], gyros_lose_heading: bool = False) -> Composition:
    """The same filter with a correlation time of these of its states (`error_state.DRIFTING`), and for such gyros."""
    times = {known: error_state.DRIFTING[known.name] for known in error_state.STATES if known.name in names}
    if not gyros_lose_heading and not times.keys() & set(filter.states):
        return filter
    states = tuple(times.get(state, state) for state in filter.states)
    return _composed(filter.id, filter.title, states, filter.aids, filter.covariance_held, gyros_lose_heading)


_composed = lru_cache(maxsize=64)(Composition)


def _chosen(kind: str, id: str, names: Iterable[object], known: Mapping[str, object], wanted: type) -> tuple:
    if isinstance(names, (str, bytes)) or not isinstance(names, Iterable):
        raise InputError(f"fusion {id!r}: {kind}s = {names!r}: allowed is a list of names")
    chosen: list[object] = []
    for part in names:
        if isinstance(part, str):
            if part not in known:
                raise InputError(f"fusion {id!r}: unknown {kind} {part!r}{nearest(part, tuple(known))}")
            part = known[part]
        if not isinstance(part, wanted):
            raise InputError(f"fusion {id!r}: {kind} {part!r}: allowed is a name or an object of class {wanted.__name__}")
        if part in chosen:
            raise InputError(f"fusion {id!r}: {kind} {getattr(part, 'id', getattr(part, 'name', part))!r} is given twice")
        chosen.append(part)
    order: Sequence[object] = list(known.values())
    return tuple(sorted(chosen, key=lambda each: order.index(each) if each in order else len(order)))

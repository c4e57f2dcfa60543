"""The sections [start] and [vehicle] of a scenario: keys and contract of all vehicles; legs and engines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import radians
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import Field

from insenv.base.errors import InputError, nearest
from insenv.base.keys import keys_of, rows_of, unit_of
from insenv.base.toml import Number, PerAxis, Section, key, validated, within
from insenv.base.units import check_unit, converted
from insenv.core.tables import Row, Table
from insenv.vehicles.truth import Vehicle

# What estimators and interfaces need to know of a kind of vehicle, apart from its equations of motion.


@dataclass(frozen=True)
class StickCommand:
    """How the axes of a joystick set one command of a vehicle.

    command: the command's row without ``command_``, such as ``"yaw_rate"``. name, title: a short name, the same for all
    kinds of vehicle, and what it stands for. axes: the axes that set it, the preferred one first: ``"x"`` pitch (stick
    forward), ``"y"`` roll (stick right), ``"z"`` thrust, ``"r"`` yaw (to the right). full_scale, highest: the command
    at full deflection by default, and the largest full scale allowed, in `unit` ("m/s", "deg" or "deg/s"). sign: -1
    where a positive deflection lowers the command. one_sided: whether a negative deflection commands zero. released:
    the command (SI) when the joystick is lost; None: the one in force stays.
    """

    command: str
    name: str
    title: str
    axes: tuple[str, ...]
    full_scale: float
    highest: float
    unit: str
    sign: float = 1.0
    one_sided: bool = False
    released: float | None = 0.0

    def value(self, deflection: float, full_scale: float) -> float:
        """The command (SI) at a deflection from -1 to 1 for a full scale in `unit`."""
        deflection = self.sign * deflection
        if self.one_sided:
            deflection = max(deflection, 0.0)
        return deflection * (radians(full_scale) if self.unit.startswith("deg") else full_scale)


@dataclass(frozen=True, eq=False)
class Actions:
    """How an agent steers a kind of vehicle (`insenv.envs.ManoeuvreEnv`).

    rows: components of the action, from -1 to 1.  start_speeds: range from which an episode draws the start speed, m/s.
    commands: ``(state, action) -> {command: value}``, in SI: the inputs ``command_NAME`` of the vehicle, or its state rows
        ``commanded_NAME`` where it has no such inputs.
    """

    rows: Table
    commands: Callable[[Any, Any], Mapping[str, Any]]
    start_speeds: tuple[float, float] | None = None


def action(name: str, meaning: str) -> Row:
    """A component of an action."""
    return Row(name, meaning, lower=-1.0, upper=1.0)


@dataclass(frozen=True)
class VehicleTraits:
    """What a kind of vehicle is to estimators, environments and other tools.

    mavlink_type: MAV_TYPE of MAVLink, 0 for a generic vehicle.
    flies: whether wings or rotors carry it, so that it rolls and pitches several times a second.
    airspeed: whether it has a sensor of differential pressure.
    sticks: the commands that a joystick sets, in the order of the vehicle's command rows.
    actions: how an agent steers it; None: no agent does.
    floats: whether it never stands still, so that no estimator looks for rest.
    parks: whether it stands still where it stays in place.
    wheels: whether it rolls without moving sideways.
    turns_in_place: whether it turns the unit about a fixed point, as a turntable does.
    shape: how a page draws it: "car", "ship", "aircraft" or "multirotor"; empty: as a plain body.
    """

    mavlink_type: int = 0
    flies: bool = False
    airspeed: bool = False
    sticks: tuple[StickCommand, ...] = ()
    actions: Actions | None = None
    floats: bool = False
    parks: bool = False
    wheels: bool = False
    turns_in_place: bool = False
    shape: str = ""


MAX_WAVES = 16
MAX_LEGS = 64
MAX_DURATION_S = 86400
"""Longest drive that is simulated."""
FASTEST_MPS = 400.0
"""No vehicle of insenv is faster over the ground."""
MARGIN_MPS = 5.0
"""Of lever arms, sway and overshoot, on average over some minutes."""


class PlaceSection(Section):
    """A place."""

    latitude_deg: Number = key(..., "geodetic latitude", "deg", row="start_latitude", ge=-89.999, le=89.999)
    longitude_deg: Number = key(..., "longitude, east positive", "deg", row="start_longitude", ge=-360, le=360)
    height_m: Number = key(0.0, "height above the WGS-84 ellipsoid", "m", row="start_height", ge=-1e4, le=1e5)


class StartSection(PlaceSection):
    """Position of the inertial unit and attitude of the vehicle at time 0."""

    heading_deg: Number = key(
        0.0, "heading, clockwise from north; the mean for a swaying ship", "deg", row="start_heading", ge=-360, le=360
    )
    roll_deg: Number = key(0.0, "mean roll, right side down positive", "deg", row="mean_roll", ge=-28, le=28)
    pitch_deg: Number = key(0.0, "mean pitch, nose up positive", "deg", row="mean_pitch", ge=-28, le=28)


class VehicleSection(Section):
    """Keys of [vehicle] for one kind of vehicle.

    A subclass declares ``kind: Literal["name"]`` and its other keys, and defines `in_place`, `vehicle` and `rows`; insenv
    needs nothing else to use the kind.  `insenv.register`, or the entry-point group ``insenv.vehicles``, registers it.
    """

    traits: ClassVar[VehicleTraits] = VehicleTraits()
    """What estimators and interfaces need to know of the kind."""

    presets: ClassVar[Mapping[str, Mapping[str, Mapping[str, float]]]] = {}
    """Sets of values that belong together, by name, of a section in this one, by its key: choices of a page."""

    kind: str

    @property
    def in_place(self) -> bool:
        """Whether the vehicle stays in place, within metres."""
        raise NotImplementedError

    @property
    def sticks(self) -> tuple[StickCommand, ...]:
        """The commands that a joystick sets: those of the kind, for a vehicle that takes them."""
        return self.traits.sticks

    def steerable(self) -> VehicleSection:
        """The same vehicle, to the bit where nothing is commanded, with every command that it can take; for pages."""
        return self

    @property
    def lasts_s(self) -> float | None:
        """Duration of the motion, s; None: without an end."""
        return None

    @property
    def fastest_mps(self) -> float:
        """A speed over the ground, or at least towards the poles, that it does not exceed, unless it is steered."""
        return FASTEST_MPS

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what the keys leave open, for a reader of the results."""
        return ()

    def check_interval(self, sample_interval: float) -> None:
        """Raise `InputError` where the motion needs more samples; sample_interval: s."""

    def start_values(self) -> dict[str, float] | None:
        """The keys of [start] of a kind whose motion has a place of its own; None: the scenario states them."""
        return None

    def vehicle(self) -> Vehicle:
        """Equations of motion.  Sections with equal equations return the same object, to share one compiled model."""
        raise NotImplementedError

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI) of the equations of motion: all whose start value is 0, except those of [start].

        Raises `InputError` for values that conflict.
        """
        raise NotImplementedError


def check_section(section: VehicleSection, vehicle: Vehicle) -> None:
    """Raise `InputError` for a key whose unit is none of its row, and for a stick of a command that the vehicle lacks.

    A conversion that a key states itself is not checked.
    """
    rows = {row.name: row for row in vehicle.parameters}
    for name, sets in keys_of(type(section)).items():
        unit = unit_of(type(section).model_fields[name])
        if sets.row in rows and sets.convert == converted(unit).convert:
            check_unit(f"key {name!r}", unit, sets.row, rows[sets.row].unit)
    inputs = (name for name in vehicle.inputs.names if name.startswith("command_") and name != "command_valid")
    commands = [name.removeprefix("command_") for name in inputs]
    for stick in section.sticks if commands else ():
        if stick.command not in commands:
            raise InputError(f"stick {stick.name!r}: command {stick.command!r}: unknown{nearest(stick.command, commands)}")


class LegSection(Section):
    """One leg of a script: exactly one of the keys `kinds`, and further ones."""

    kinds: ClassVar[tuple[str, ...]]


def lasting(meaning: str, default: Any = None) -> Any:
    """A key of a leg: a time, at most that of the longest drive."""
    return key(default, meaning, "s", gt=0, le=MAX_DURATION_S)


def turning(meaning: str, fastest_deg: float | None = None) -> Any:
    """A key of a leg: an angle, right positive; fastest_deg: the largest rate of the turn, deg/s, if it has one of its own."""
    limit = "" if fastest_deg is None else f"; up to {fastest_deg:g} deg/s"
    return key(None, meaning + limit, "deg", ge=-3600, le=3600)


AnyLeg = TypeVar("AnyLeg", bound=LegSection)
Legs = Sequence[Mapping[str, float] | LegSection]
"""Legs of a script, or their values by key."""
Made = TypeVar("Made")


def legs_of(section: type[AnyLeg], legs: Legs) -> Iterator[tuple[str, AnyLeg, str, float]]:
    """Of each leg its place for messages ("legs[0]"), the leg, the one key of its kind and the value.

    Raises `InputError` for a key or value that is not allowed, and for a leg without a kind or with several.
    """
    return of_kinds(placed(section, legs))


def placed(section: type[AnyLeg], legs: Legs) -> Iterator[tuple[str, AnyLeg]]:
    """Of each leg its place for messages, and the leg.  Raises `InputError` for a key or value that is not allowed."""
    for number, stated in enumerate(legs):
        where = f"legs[{number}]"
        yield where, stated if isinstance(stated, section) else validated(section, stated, where)


def of_kinds(legs: Iterable[tuple[str, AnyLeg]]) -> Iterator[tuple[str, AnyLeg, str, float]]:
    """The same, with the one key of each leg's kind and its value.  Raises `InputError` for no kind, and for several."""
    for where, leg in legs:
        kinds = [name for name in leg.kinds if getattr(leg, name) is not None]
        if len(kinds) != 1:
            allowed = ", ".join(leg.kinds)
            raise InputError(f"{where} has {' and '.join(kinds) or 'none'}: allowed is exactly one of {allowed}")
        yield where, leg, kinds[0], getattr(leg, kinds[0])


def fastest(start_mps: float, legs: tuple[Section, ...], *keys: str) -> float:
    """The largest of a start speed and of the speeds that the legs name by `keys`, m/s; of several keys, their sum in a leg."""
    speeds = (sum(abs(getattr(leg, name) or 0.0) for name in keys) for leg in legs)
    return max(start_mps, *speeds, 0.0)


def in_legs(make: Callable[[], Made]) -> Made:
    """The result of `make`; the message of an `InputError` begins with the key, ``vehicle.legs`` or that of a leg."""
    try:
        return make()
    except InputError as error:
        begin = "vehicle." if str(error).startswith("legs[") else "vehicle.legs: "
        raise InputError(f"{begin}{error}") from None


class EngineWave(Section):
    """One frequency of an engine's vibration."""

    frequency_hz: Number = key(..., "frequency, below half the sample rate", "Hz", row="engine_angular_frequency", gt=0, le=5e3)
    roll_deg: Number = key(0.0, "amplitude of roll", "deg", row="engine_roll_amplitude", ge=0, le=5)
    pitch_deg: Number = key(0.0, "amplitude of pitch", "deg", row="engine_pitch_amplitude", ge=0, le=5)
    down_m: Number = key(0.0, "amplitude of the displacement down", "m", row="engine_down_amplitude", ge=0, le=0.1)
    roll_phase_deg: Number = key(0.0, "phase of roll at time 0", "deg", row="engine_roll_phase", ge=-360, le=360)
    pitch_phase_deg: Number = key(0.0, "phase of pitch at time 0", "deg", row="engine_pitch_phase", ge=-360, le=360)
    down_phase_deg: Number = key(0.0, "phase of the displacement at time 0", "deg", row="engine_down_phase", ge=-360, le=360)


Engine = Annotated[tuple[EngineWave, ...], Field(max_length=MAX_WAVES)]


def engine_rows(engine: tuple[EngineWave, ...]) -> dict[str, Any]:
    """Parameter rows (SI) of the vibration; without an engine, one frequency of amplitude 0."""
    waves = [rows_of(wave) for wave in engine or (EngineWave(frequency_hz=1.0),)]
    return {row: [wave[row] for wave in waves] for row in waves[0]}


class GustsSection(VehicleSection):
    """The keys of a vehicle in the air: its engine, gusts."""

    engine: Engine = key((), "the engine's vibration")
    gust_roll_sigma_deg: Number = key(0.0, "roll due to gusts, standard deviation", "deg", row="gust_roll_sigma", ge=0, le=10)
    gust_pitch_sigma_deg: Number = key(
        0.0, "pitch due to gusts, standard deviation", "deg", row="gust_pitch_sigma", ge=0, le=10
    )
    gust_yaw_sigma_deg: Number = key(0.0, "yaw due to gusts, standard deviation", "deg", row="gust_yaw_sigma", ge=0, le=10)
    gust_velocity_sigma_mps: Annotated[PerAxis, within(0.0, 10.0)] = key(
        (0.0, 0.0, 0.0), "velocity due to gusts, north, east, down, standard deviations", "m/s"
    )
    gust_correlation_s: Number = key(3.0, "correlation time of the gusts", "s", row="gust_time_constant", ge=0.01, le=1e6)

    @property
    def gusting_mps(self) -> float:
        """A speed over the ground that gusts do not exceed."""
        return MARGIN_MPS + 10.0 * sum(self.gust_velocity_sigma_mps)

    def air_rows(self) -> dict[str, Any]:
        """Parameter rows (SI) of the engine, the gusts and all keys that set one."""
        velocities = zip(("north", "east", "down"), self.gust_velocity_sigma_mps, strict=True)
        return {**engine_rows(self.engine), **{f"gust_{name}_sigma": value for name, value in velocities}, **rows_of(self)}

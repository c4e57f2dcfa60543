"""The simulated vehicle: the messages of each sample, and its control.  It is independent of links and wall clock."""

from __future__ import annotations

import json
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.core.model import Model
from insenv.core.tables import Row
from insenv.estimators import Estimator
from insenv.mavlink.messages import MESSAGES, STREAMED, Message, Schedule, View
from insenv.mavlink.messages.status import error_messages
from insenv.mavlink.messages.view import MANUAL, MILLI_G, MM_S2
from insenv.mavlink.score import Score
from insenv.mavlink.simulation import Simulation
from insenv.mavlink.surroundings import Surroundings, interference
from insenv.scenario import Scenario
from insenv.sensors.gnss import GNSS_PARAMETERS
from insenv.sensors.grades import elements
from insenv.sensors.imu_tables import IMU_PARAMETERS
from insenv.sensors.units import SHOWN
from insenv.vehicles import StickCommand

# Parameters of the stream, of the scenario's sensors and of the estimator.
#
# All are REAL32, because clients disagree on how PARAM_VALUE encodes integers.  Units are degrees, deg/h, deg/sqrt(h), ug
# and ug/sqrt(Hz) where the tables have SI units (docs/mavlink.md).
#
# The equations determine when a new value takes effect.  A parameter on which a step of the model depends acts from
# the next sample on.  One on which only the start depends acts at the next alignment if it is the estimator's, and cannot
# be set if it is the plant's, whose run has begun.

REAL32 = 9
"""MAV_PARAM_TYPE_REAL32."""
LARGEST = 1e6
"""Largest magnitude that can be set, in the unit shown, where the row itself allows more."""

NOW, NEXT_ALIGNMENT, NEVER = "now", "next alignment", "never"
_TIMING = ("gnss_interval", "gnss_latency", "gnss_epoch_offset", "drift_interval")
"""Rows that must remain whole numbers of samples: they cannot be set."""


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    acts: when a new value takes effect (`NOW`, `NEXT_ALIGNMENT`, or `NEVER`: it cannot be set).  lower, upper: bounds
    in `unit`.
    """

    name: str
    meaning: str
    unit: str
    acts: str
    lower: float
    upper: float
    read: Callable[[], float]
    write: Callable[[float], None] | None = None

    def value(self) -> float:
        """The value as it is sent: the nearest float32."""
        return float(np.float32(min(max(self.read(), -3e38), 3e38)))

    def set(self, value: float) -> None:
        """Set the value.  Raises `InputError` if it is out of range or cannot be set."""
        if self.write is None:
            raise InputError(f"{self.name} cannot be set during a run")
        if not isfinite(value) or not self.lower <= value <= self.upper:
            raise InputError(f"{self.name} = {value:g}: allowed is {self.lower:g} to {self.upper:g} {self.unit}".rstrip())
        self.write(value)


class Parameters:
    """The parameters of a vehicle, in order and by name."""

    def __init__(self, own: list[Parameter], simulation: Simulation) -> None:
        self.all = list(own)
        self.all += self._of_plant(simulation)
        self.all += self._of_estimator(simulation)
        self._place = {parameter.name: place for place, parameter in enumerate(self.all)}

    def __len__(self) -> int:
        return len(self.all)

    def find(self, name: str) -> int:
        """The index of a parameter.  Raises `InputError` for an unknown name."""
        if name not in self._place:
            raise InputError(f"no parameter {name!r}{nearest(name, self._place)[:60]}")
        return self._place[name]

    def _of_plant(self, simulation: Simulation) -> Iterator[Parameter]:
        model = simulation.plant.model
        sensors = IMU_PARAMETERS.names + GNSS_PARAMETERS.names
        live = used_by_steps(model)
        for row, place, name in elements("S", model.parameters, sensors):
            settable = live[place] and row.name not in _TIMING
            yield _made(
                row, name, NOW if settable else NEVER, place, simulation.plant_parameter, simulation.set_plant_parameter
            )

    def _of_estimator(self, simulation: Simulation) -> Iterator[Parameter]:
        model = simulation.estimator.model
        live = used_by_steps(model)
        for row, place, name in elements("E", model.parameters, model.parameters.names):
            acts = NOW if live[place] else NEXT_ALIGNMENT
            if row.name == "sample_interval" or row.name.startswith("start_"):  # known anew at each alignment
                acts = NEVER
            yield _made(row, name, acts, place, simulation.estimator_parameter, simulation.set_estimator_parameter)


def _made(
    row: Row, name: str, acts: str, place: int, read: Callable[[int], float], write: Callable[[int, float], None]
) -> Parameter:
    unit, to_si = SHOWN.get(row.unit, (row.unit, float))
    scale = float(to_si(1.0))

    def get() -> float:
        return read(place) / scale

    def put(value: float) -> None:
        number = float(to_si(value))
        write(place, min(max(number, row.lower), row.upper))

    bounds = max(row.lower / scale, -LARGEST), min(row.upper / scale, LARGEST)
    return Parameter(name, row.meaning, "" if unit == "1" else unit, acts, *bounds, get, None if acts == NEVER else put)


def used_by_steps(model: Model) -> list[bool]:
    """Whether a step or the output depends on each element of the model's parameters."""
    used = np.zeros(model.parameters.size, dtype=bool)
    for name, kernel in model.kernels.items():
        if name != "start":
            used[sorted(set(kernel.function.jac_sparsity(0, 0).get_triplet()[1]))] = True
    return used.tolist()


# Component metadata: names, units and ranges of the parameters, as files that ground stations read by FTP.
#
# https://mavlink.io/en/services/component_information.html

GENERAL, PARAMETERS = "/general.json", "/parameter.json"
_TYPE_PARAMETER = 1
_LIMIT = 1e30
_CHECKSUM_ALL = 0xFFFFFFFF


def metadata(parameters: Iterable[Parameter]) -> dict[str, bytes]:
    """The files by name: the general one, which lists the others, and that of the parameters."""
    listed = _document({"version": 1, "parameters": [_described(parameter) for parameter in parameters]})
    entry = {"type": _TYPE_PARAMETER, "uri": f"mftp://{PARAMETERS}", "fileCrc": checksum(listed)}
    return {GENERAL: _document({"version": 1, "metadataTypes": [entry]}), PARAMETERS: listed}


def checksum(data: bytes) -> int:
    """The 32-bit checksum of MAVLink FTP: that of zip without its inversions of the start and the end."""
    return zlib.crc32(data, _CHECKSUM_ALL) ^ _CHECKSUM_ALL


def _described(parameter: Parameter) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": parameter.name,
        "type": "Float",
        "shortDesc": parameter.meaning,
        "longDesc": f"{parameter.meaning}. Takes effect: {parameter.acts}.",
        "group": parameter.name.partition("_")[0],
        "decimalPlaces": 7,
        "readOnly": parameter.acts == NEVER,
    }
    if parameter.unit:
        found["units"] = parameter.unit
    if parameter.acts != NEVER:
        found |= {key: value for key, value in (("min", parameter.lower), ("max", parameter.upper)) if abs(value) < _LIMIT}
    return found


def _document(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode("ascii")


# MANUAL_CONTROL: from the axes of a joystick to a vehicle's commands.

AXIS_UNUSED = 32767
"""The value of an axis that the joystick does not have."""
FULL = 1000.0
LOST_AFTER_S = 1.0
"""Simulated time without MANUAL_CONTROL after which it counts as lost."""


class Sticks:
    """A joystick that sets the commands of a vehicle.

    commands: the vehicle's stick commands.  full_scale: what full deflection commands, by `StickCommand.name` and in
    its unit; may be changed at any time.
    """

    def __init__(self, commands: Iterable[StickCommand]) -> None:
        self.commands = tuple(commands)
        self.full_scale = {stick.name: stick.full_scale for stick in self.commands}

    def commanded(self, x: int, y: int, z: int, r: int) -> dict[str, float]:
        """Commands (SI) at these axes, -1000 to 1000 each; `AXIS_UNUSED` commands nothing.

        Of several axes that set one command the first that is deflected counts.
        """
        values: dict[str, float] = {}
        axes = {"x": x, "y": y, "z": z, "r": r}
        for stick in self.commands:
            present = [axes[axis] for axis in stick.axes if axes[axis] != AXIS_UNUSED]
            if present:
                axis = next((value for value in present if value), 0)
                deflection = max(-1.0, min(1.0, axis / FULL))
                values[stick.command] = stick.value(deflection, self.full_scale[stick.name])
        return values

    def released(self) -> dict[str, float]:
        """Commands (SI) when the joystick is lost."""
        return {stick.command: stick.released for stick in self.commands if stick.released is not None}

    def parameters(self) -> Iterator[Parameter]:
        """The full scales as parameters."""
        scale = self.full_scale
        for stick in self.commands:

            def read(name: str = stick.name) -> float:
                return scale[name]

            def write(value: float, name: str = stick.name) -> None:
                scale[name] = value

            meaning = f"{stick.title} at full deflection of MANUAL_CONTROL"
            yield Parameter(f"MAN_{stick.name}", meaning, stick.unit, NOW, 0.0, stick.highest, read, write)


MIN_SPEED, MAX_SPEED = 0.01, 100.0
"""Range of the speed of the simulation, in simulated seconds per second; 0 is as fast as possible."""
HIL_ACCELERATIONS = {"mG": MILLI_G, "mm/s^2": MM_S2}
SEVERITY = {"error": 3, "warning": 4, "notice": 5, "info": 6}
UNDULATION = 120.0
"""Largest height of the geoid above or below the ellipsoid, m."""
_TEXT, _LONGEST_TEXT = 50, 250
_TEXTS_WAITING = 20
_SECONDS_A_YEAR = 365.25 * 86400.0


class Vehicle:
    """A scenario's vehicle with its estimator, observed and steered through MAVLink.

    scenario, estimator, seed: see `Simulation`.  rates: Hz by message, instead of the default.  speed: simulated
    seconds per second; 0: as fast as possible.  start_unix: Unix time (s) at the start of the run; None: that of the
    wall clock.  system, component: the sender that its messages state, 1 to 255; those of the link must be the same.
    hil_acceleration: unit of the accelerations in HIL_STATE_QUATERNION, ``"mG"`` (MAVLink) or ``"mm/s^2"`` (PX4).
    show_errors: send the errors of the estimate with each HEARTBEAT (NAMED_VALUE_FLOAT).  undulation: height of the geoid above
    the ellipsoid (m), the same everywhere.
    Raises `InputError` for an estimator, rate, speed, sender, unit or undulation that is not allowed.

    score: judges the estimates that clients send, or None: they are ignored.
    files: what clients can read by FTP, by name: names, units and ranges of the parameters.
    """

    def __init__(
        self,
        scenario: Scenario,
        estimator: str | Estimator | None = None,
        *,
        seed: int | None = None,
        rates: Mapping[str, float] | None = None,
        speed: float = 1.0,
        start_unix: float | None = None,
        system: int = 1,
        component: int = 1,
        hil_acceleration: str = "mG",
        show_errors: bool = False,
        undulation: float = 0.0,
    ) -> None:
        start_unix = time.time() if start_unix is None else start_unix
        self.simulation = Simulation(scenario, estimator, seed, 1970.0 + start_unix / _SECONDS_A_YEAR)
        surroundings = Surroundings(self.simulation.plant.seed)
        self.view = View(self.simulation, surroundings, start_unix)
        for name, value in (("system", system), ("component", component)):
            if not 1 <= value <= 255:
                raise InputError(f"{name} {value}: allowed is 1 to 255")
        if hil_acceleration not in HIL_ACCELERATIONS:
            raise InputError(f"hil_acceleration {hil_acceleration!r}: allowed is {' or '.join(HIL_ACCELERATIONS)}")
        if not -UNDULATION <= undulation <= UNDULATION:
            raise InputError(f"undulation = {undulation:g} m: allowed is {-UNDULATION:g} to {UNDULATION:g} m")
        self.view.undulation = undulation
        self.view.system, self.view.component = system, component
        self.view.hil_acceleration = HIL_ACCELERATIONS[hil_acceleration]
        self.schedule = Schedule(scenario.rate_hz, rates)
        self.speed = checked_speed(speed)
        self.paused, self.show_errors = False, show_errors
        self.score: Score | None = None
        commands = self.simulation.commands
        self.sticks = Sticks(stick for stick in self.view.traits.sticks if stick.command in commands)
        self.parameters = Parameters(list(self._own_parameters()), self.simulation)
        self.files = metadata(self.parameters.all)
        self.view.metadata_crc = checksum(self.files[GENERAL])
        _ = self.view.air, self.view.values  # computed now, so that the first sample is not late
        self._texts: deque[Message] = deque(maxlen=_TEXTS_WAITING)
        self._long_texts = 0
        self._steered_at: float | None = None
        self._refused_steering = False
        self._announced = "aligning"
        self._noted = ""

    # --- messages -----------------------------------------------------------------------------------

    def step(self) -> list[Message]:
        """Advance by one inertial sample, and return the messages that are due."""
        self._release_lost_control()
        self.simulation.advance()
        if self.score is not None:
            self.score.follow()
        sample = self.simulation.samples
        messages = []
        for name in self.schedule.due(sample):
            message = STREAMED[name](self.view)
            if message is not None:
                messages.append(message)
            if name == "HEARTBEAT":
                self._announce_alignment()
                messages += error_messages(self.view) if self.show_errors else []
        if self._texts:
            messages += self.texts()
        return messages

    def make(self, name: str) -> Message | None:
        """A message of the present sample by name; None if it is unknown or has no content yet."""
        return MESSAGES[name](self.view) if name in MESSAGES else None

    def announce(self, text: str, severity: str = "info") -> None:
        """Queue a text, as one STATUSTEXT or as several, the chunks of a longer one.  severity: a key of `SEVERITY`.

        Chunks have a number of their text in common and are counted; the last one is shorter than the field.
        """
        text, number = text[:_LONGEST_TEXT], 0
        if len(text) > _TEXT:
            number = self._long_texts = self._long_texts % 0xFFFF + 1
        for place in range(0, len(text) + (1 if number else 0), _TEXT):
            chunk = text[place : place + _TEXT]
            self._texts.append(self.view.fields.message("STATUSTEXT", SEVERITY[severity], chunk, number, place // _TEXT))

    def texts(self) -> list[Message]:
        """Remove and return the queued STATUSTEXTs."""
        waiting = list(self._texts)
        self._texts.clear()
        return waiting

    def _announce_alignment(self) -> None:
        """Announce a change between aligning, aligned and diverged."""
        state = "diverged" if self.simulation.diverged else "aligned" if self.view.aligned else "aligning"
        if state != self._announced:
            self._announced = state
            diverged = state == "diverged"
            self.announce("estimate diverged: start a new alignment" if diverged else state, "error" if diverged else "notice")
        doubt = self.view.doubt if state == "aligning" else ""
        if doubt and doubt.partition(":")[0] != self._noted:
            self._noted = doubt.partition(":")[0]
            self.announce(self._noted, "warning")

    # --- control ------------------------------------------------------------------------------------

    def realign(self) -> None:
        """Start a new alignment."""
        self.simulation.realign()
        self.view.forget()
        self.announce("new alignment started", "notice")

    def set_gnss(self, on: bool) -> None:
        """Switch the GNSS receiver on or off.  Raises `InputError` if there is none."""
        if not self.simulation.has_gnss:
            raise InputError("this scenario has no GNSS receiver")
        if on != self.simulation.gnss_on:
            self.simulation.gnss_on = on
            self.announce("GNSS on" if on else "GNSS off", "warning")

    def disturb_gnss(self, kind: float, values: Sequence[float]) -> None:
        """Disturb the receiver from now on.  kind, values: see `insenv.mavlink.surroundings`.  Raises `InputError`."""
        if not self.simulation.has_gnss:
            raise InputError("this scenario has no GNSS receiver")
        self.simulation.interference = interference(kind, values, self.simulation.time)
        found = self.simulation.interference
        self.announce("GNSS: " + ("undisturbed" if found is None else found.name), "warning")

    def set_paused(self, paused: bool) -> None:
        """Pause or resume the simulation."""
        if paused != self.paused:
            self.paused = paused
            self.announce("paused" if paused else "resumed", "notice")

    def set_speed(self, speed: float) -> None:
        """Set the simulated seconds per second; 0: as fast as possible.  Raises `InputError`."""
        self.speed = checked_speed(speed)

    def steer(self, x: int, y: int, z: int, r: int) -> None:
        """Steer by a joystick's axes, -1000 to 1000 each.  A vehicle that cannot be steered announces it once."""
        if not self.simulation.commands or not self.view.armed:
            if not self._refused_steering:
                self._refused_steering = True
                self.announce("no manual control: " + self._why_not(), "warning")
            return
        self._refused_steering = False
        if self._steered_at is None:
            self.announce("manual control: the script has ended", "notice")
        self.view.mode = MANUAL
        self._steered_at = self.simulation.time
        self.simulation.command(self.sticks.commanded(x, y, z, r))

    def _why_not(self) -> str:
        if not self.view.armed:
            return "disarmed"
        if not self.simulation.estimator.navigates:
            return "aligning in place"
        return "motion is prescribed"

    def _release_lost_control(self) -> None:
        if self._steered_at is not None and self.simulation.time - self._steered_at > LOST_AFTER_S:
            self._steered_at = None
            self.simulation.command(self.sticks.released())
            self.announce("manual control lost", "warning")

    # --- parameters ---------------------------------------------------------------------------------

    def _own_parameters(self) -> Iterator[Parameter]:
        view, simulation = self.view, self.simulation

        def pause(value: float) -> None:
            self.set_paused(value != 0.0)

        def gnss(value: float) -> None:
            self.set_gnss(value != 0.0)

        yield Parameter(
            "SIM_SPEED", "Simulated seconds per second; 0: as fast as possible", "", NOW, 0.0, MAX_SPEED,
            lambda: self.speed, self.set_speed,
        )  # fmt: skip
        yield Parameter("SIM_PAUSE", "1: the simulation is paused", "", NOW, 0.0, 1.0, lambda: float(self.paused), pause)
        if simulation.has_gnss:
            yield Parameter(
                "SIM_GNSS", "0: the GNSS receiver is off", "", NOW, 0.0, 1.0, lambda: float(simulation.gnss_on), gnss
            )
        yield Parameter(
            "SIM_UNDULATION", "Height of the geoid above the ellipsoid", "m", NEVER, -UNDULATION, UNDULATION,
            lambda: view.undulation,
        )  # fmt: skip
        yield Parameter("SIM_RATE", "Inertial sample rate", "Hz", NEVER, 1.0, 1e4, lambda: 1.0 / simulation.interval)
        yield Parameter("SIM_SEED", "Seed of the run", "", NEVER, 0.0, 2.0**53, lambda: float(simulation.plant.seed))
        yield from self.sticks.parameters()


def checked_speed(speed: float) -> float:
    """Check a speed of the simulation.  Raises `InputError`."""
    if speed != 0.0 and not MIN_SPEED <= speed <= MAX_SPEED:
        raise InputError(
            f"speed = {speed:g}: allowed is {MIN_SPEED:g} to {MAX_SPEED:g} simulated seconds per second,"
            " or 0 (as fast as possible)"
        )
    return float(speed)

"""The simulated vehicle: the messages of each sample, and its control.  It is independent of links and wall clock."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence

from insenv.base.errors import InputError
from insenv.estimators import Estimator
from insenv.mavlink.messages import Message, Schedule, View, make
from insenv.mavlink.messages.state import error_messages
from insenv.mavlink.messages.view import MANUAL, MILLI_G, MM_S2
from insenv.mavlink.parameters import NEVER, NOW, Parameter, Parameters, of_mapping
from insenv.mavlink.score import Score
from insenv.mavlink.simulation import Simulation
from insenv.mavlink.surroundings import interference
from insenv.mavlink.wire.link import check_sender
from insenv.scenario import Scenario
from insenv.vehicles import StickCommand

AXIS_UNUSED = 32767
"""The value of an axis of MANUAL_CONTROL that the joystick does not have."""
FULL = 1000.0
"""Full deflection of an axis."""
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
        for stick in self.commands:
            meaning = f"{stick.title} at full deflection of MANUAL_CONTROL"
            yield of_mapping(self.full_scale, stick.name, f"MAN_{stick.name}", meaning, stick.unit, stick.highest)


MIN_SPEED, MAX_SPEED = 0.01, 100.0
"""Range of the speed of the simulation, in simulated seconds per second; 0 is as fast as possible."""
HIL_ACCELERATIONS = {"mG": MILLI_G, "mm/s^2": MM_S2}
SEVERITY = {"error": 3, "warning": 4, "notice": 5, "info": 6}
TRIADS = ("gyros", "accelerometers")
FAILURE_OK, FAILURE_STUCK = 0, 2
"""Of MAVLink's FAILURE_TYPE."""
MAX_UNDULATION = 120.0
"""Largest height of the geoid above or below the ellipsoid, m."""
_TEXT_FIELD, _MAX_TEXT = 50, 250
_MAX_TEXTS = 20
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
        check_sender(system, component)
        if hil_acceleration not in HIL_ACCELERATIONS:
            raise InputError(f"hil_acceleration {hil_acceleration!r}: allowed is {' or '.join(HIL_ACCELERATIONS)}")
        if not -MAX_UNDULATION <= undulation <= MAX_UNDULATION:
            raise InputError(f"undulation = {undulation:g} m: allowed is {-MAX_UNDULATION:g} to {MAX_UNDULATION:g} m")
        self.simulation = Simulation(scenario, estimator, seed, 1970.0 + start_unix / _SECONDS_A_YEAR)
        self.view = View(
            self.simulation, start_unix, undulation=undulation, system=system, component=component,
            hil_acceleration=HIL_ACCELERATIONS[hil_acceleration],
        )  # fmt: skip
        self.schedule = Schedule(scenario.rate_hz, rates)
        self.speed = checked_speed(speed)
        self.paused, self.show_errors = False, show_errors
        self.score: Score | None = None
        commands = self.simulation.commands
        self.sticks = Sticks(stick for stick in self.view.traits.sticks if stick.command in commands)
        self.parameters = Parameters(self._control_parameters(), self.simulation)
        _ = self.view.air, self.view.values  # computed now, so that the first sample is not late
        self._texts: deque[Message] = deque(maxlen=_MAX_TEXTS)
        self._long_texts = 0
        self._steered_at: float | None = None
        self._refused_steering = False
        self._announced_state, self._announced_doubt = "aligning", ""

    # --- messages -----------------------------------------------------------------------------------

    def step(self) -> list[Message]:
        """Advance by one inertial sample, and return the messages that are due."""
        self._release_lost_control()
        self.simulation.advance()
        if self.score is not None:
            self.score.follow()
        messages = []
        for name in self.schedule.due(self.simulation.samples):
            if (message := self.make(name)) is not None:
                messages.append(message)
            if name == "HEARTBEAT":
                self._announce_alignment()
                messages += error_messages(self.view) if self.show_errors else []
        return messages + self.texts() if self._texts else messages

    def make(self, name: str) -> Message | None:
        """A message of the present sample by name; None if it is unknown or has no content yet."""
        return make(self.view, name)

    def announce(self, text: str, severity: str = "info") -> None:
        """Queue a text, as one STATUSTEXT or as several, the chunks of a longer one.  severity: a key of `SEVERITY`.

        Chunks have a number of their text in common and are counted; the last one is shorter than the field.
        """
        text, number = text[:_MAX_TEXT], 0
        if len(text) > _TEXT_FIELD:
            number = self._long_texts = self._long_texts % 0xFFFF + 1
        for place in range(0, len(text) + (1 if number else 0), _TEXT_FIELD):
            chunk = text[place : place + _TEXT_FIELD]
            self._texts.append(self.view.fields.message("STATUSTEXT", SEVERITY[severity], chunk, number, place // _TEXT_FIELD))

    def texts(self) -> list[Message]:
        """Remove and return the queued STATUSTEXTs."""
        waiting = list(self._texts)
        self._texts.clear()
        return waiting

    def _announce_alignment(self) -> None:
        """Announce a change between aligning, aligned and diverged."""
        state = "diverged" if self.simulation.diverged else "aligned" if self.view.aligned else "aligning"
        if state != self._announced_state:
            self._announced_state = state
            if state == "diverged":
                self.announce("estimate diverged: start a new alignment", "error")
            else:
                self.announce(state, "notice")
        doubt = self.view.doubt.partition(":")[0] if state == "aligning" else ""
        if doubt and doubt != self._announced_doubt:
            self._announced_doubt = doubt
            self.announce(doubt, "warning")

    # --- control ------------------------------------------------------------------------------------

    def realign(self) -> None:
        """Start a new alignment."""
        self.simulation.realign()
        self.view.forget()
        self.announce("new alignment started", "notice")

    def set_gnss(self, on: bool) -> None:
        """Switch the GNSS receiver on or off.  Raises `InputError` if there is none."""
        self._check_receiver()
        if on != self.simulation.gnss_on:
            self.simulation.gnss_on = on
            self.announce("GNSS on" if on else "GNSS off", "warning")

    def disturb_gnss(self, kind: float, values: Sequence[float]) -> None:
        """Disturb the receiver from now on.  kind, values: see `insenv.mavlink.surroundings`.  Raises `InputError`."""
        self._check_receiver()
        disturbed = self.simulation.interference = interference(kind, values, self.simulation.time)
        self.announce(f"GNSS: {disturbed.name if disturbed else 'undisturbed'}", "warning")

    def fail_imu(self, triad: float, failure: float, axis: float) -> None:
        """Freeze an axis of the inertial unit at its latest value, or free it.  Raises `InputError`.

        triad: 0 gyros, 1 accelerometers.  failure: `FAILURE_OK` or `FAILURE_STUCK`.  axis: 1 to 3, or 0 for all.
        """
        allowed = {"param1": (triad, (0, 1)), "param2": (failure, (FAILURE_OK, FAILURE_STUCK)), "param3": (axis, (0, 1, 2, 3))}
        for name, (value, values) in allowed.items():
            if value not in values:
                raise InputError(f"{name} = {value:g}: allowed is {', '.join(map(str, values))}")
        first = 3 * int(triad)
        self.simulation.stuck[first + int(axis) - 1 if axis else slice(first, first + 3)] = failure == FAILURE_STUCK
        self.simulation.changed = True
        which = f"axis {axis:g} of the {TRIADS[int(triad)]}" if axis else TRIADS[int(triad)]
        self.announce(f"{which}: {'stuck' if failure else 'as before'}", "warning")

    def _check_receiver(self) -> None:
        if not self.simulation.has_gnss:
            raise InputError("this scenario has no GNSS receiver")

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

    def _control_parameters(self) -> Iterator[Parameter]:
        view, simulation = self.view, self.simulation
        yield Parameter(
            "SIM_SPEED", "Simulated seconds per second; 0: as fast as possible", "", NOW, 0.0, MAX_SPEED,
            lambda: self.speed, self.set_speed,
        )  # fmt: skip
        yield Parameter(
            "SIM_PAUSE", "1: the simulation is paused", "", NOW, 0.0, 1.0,
            lambda: float(self.paused), lambda value: self.set_paused(value != 0.0),
        )  # fmt: skip
        if simulation.has_gnss:
            yield Parameter(
                "SIM_GNSS", "0: the GNSS receiver is off", "", NOW, 0.0, 1.0,
                lambda: float(simulation.gnss_on), lambda value: self.set_gnss(value != 0.0),
            )  # fmt: skip
        yield Parameter(
            "SIM_UNDULATION", "Height of the geoid above the ellipsoid", "m", NEVER, -MAX_UNDULATION, MAX_UNDULATION,
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

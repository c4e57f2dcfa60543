"""The simulated vehicle: what it sends at each sample, and what can be done to it.  It knows no sockets and no wall clock."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping

from insenv.errors import InputError
from insenv.mavlink.manual import LOST_AFTER_S, Sticks
from insenv.mavlink.messages import MESSAGES, STREAMED, Message, Schedule, View
from insenv.mavlink.parameters import NEVER, NOW, Parameter, Parameters
from insenv.mavlink.simulation import Simulation
from insenv.mavlink.surroundings import Surroundings
from insenv.scenario import Scenario

MAX_SPEED = 100.0
"""Largest speed of the simulation, in simulated seconds a second; 0 is as fast as possible."""
SEVERITY = {"error": 3, "warning": 4, "notice": 5, "info": 6}
_TEXT = 50
_TEXTS_WAITING = 20
_SECONDS_A_YEAR = 365.25 * 86400.0


class Vehicle:
    """A scenario's vehicle with its estimator, seen and steered through MAVLink.

    scenario, estimator, seed: see `Simulation`.  rates: Hz by message instead of the default.  speed: simulated seconds a
    second, 0 as fast as possible.  start_unix: Unix time (s) at the start of the run; the wall clock's if None.
    Raises `InputError`.
    """

    def __init__(
        self,
        scenario: Scenario,
        estimator: str | None = None,
        *,
        seed: int | None = None,
        rates: Mapping[str, float] | None = None,
        speed: float = 1.0,
        start_unix: float | None = None,
    ) -> None:
        start_unix = time.time() if start_unix is None else start_unix
        self.simulation = Simulation(scenario, estimator, seed)
        surroundings = Surroundings(self.simulation.plant.seed, 1970.0 + start_unix / _SECONDS_A_YEAR)
        self.view = View(self.simulation, surroundings, start_unix)
        self.schedule = Schedule(scenario.rate_hz, rates)
        self.speed = checked_speed(speed)
        self.paused = False
        taken = self.simulation.commands
        self.sticks = Sticks(stick for stick in self.view.traits.sticks if stick.command in taken)
        self.parameters = Parameters(list(self._own_parameters()), self.simulation)
        _ = self.view.air, self.view.values  # what is made once is made now, not at the first sample
        self._texts: deque[Message] = deque(maxlen=_TEXTS_WAITING)
        self._steered_at: float | None = None
        self._refused_steering = False
        self._was_aligned = False

    # --- what it sends ------------------------------------------------------------------------------

    def step(self) -> list[Message]:
        """One inertial sample; the messages that are due after it."""
        self._let_go()
        self.simulation.advance()
        sample = self.simulation.samples
        messages = []
        for name in self.schedule.due(sample):
            message = STREAMED[name](self.view)
            if message is not None:
                messages.append(message)
            if name == "HEARTBEAT":
                self._watch()
        if self._texts:
            messages += self.texts()
        return messages

    def make(self, name: str) -> Message | None:
        """A message of the present sample by name, or None: there is no such message, or it has nothing to say yet."""
        return MESSAGES[name](self.view) if name in MESSAGES else None

    def tell(self, text: str, severity: str = "info") -> None:
        """Have a STATUSTEXT sent, cut to 50 characters."""
        self._texts.append(self.view.fields.message("STATUSTEXT", SEVERITY[severity], text[:_TEXT], 0, 0))

    def texts(self) -> list[Message]:
        """The STATUSTEXTs that wait to be sent, which then wait no more."""
        waiting = list(self._texts)
        self._texts.clear()
        return waiting

    def _watch(self) -> None:
        """Say when the alignment has become good, or the estimate bad."""
        aligned = self.view.aligned
        if aligned != self._was_aligned:
            self._was_aligned = aligned
            if self.simulation.diverged:
                self.tell("estimate diverged: begin a new alignment", "error")
            else:
                self.tell("aligned" if aligned else "aligning", "notice")

    # --- what can be done to it ---------------------------------------------------------------------

    def realign(self) -> None:
        """Begin a new alignment."""
        self.simulation.realign()
        self.view.forget()
        self.tell("new alignment begun", "notice")

    def set_gnss(self, on: bool) -> None:
        """Cut the receiver off, or restore it.  Raises `InputError` if there is none."""
        if not self.simulation.has_gnss:
            raise InputError("this scenario has no GNSS receiver")
        if on != self.simulation.gnss_on:
            self.simulation.gnss_on = on
            self.tell("GNSS restored" if on else "GNSS cut off", "warning")

    def set_paused(self, paused: bool) -> None:
        """Stop the simulation's clock, or let it go on."""
        if paused != self.paused:
            self.paused = paused
            self.tell("paused" if paused else "going on", "notice")

    def set_speed(self, speed: float) -> None:
        """Simulated seconds a second from now on; 0: as fast as possible.  Raises `InputError`."""
        self.speed = checked_speed(speed)

    def steer(self, x: int, y: int, z: int, r: int) -> None:
        """Take a joystick's axes, -1000 to 1000.  A vehicle that cannot be steered says so, once."""
        if not self.simulation.commands or not self.view.armed:
            if not self._refused_steering:
                self._refused_steering = True
                self.tell("no manual control: " + self._why_not(), "warning")
            return
        self._refused_steering = False
        if self._steered_at is None:
            self.tell("manual control: the script has ended", "notice")
        self._steered_at = self.simulation.time
        self.simulation.command(self.sticks.commanded(x, y, z, r))

    def _why_not(self) -> str:
        if not self.view.armed:
            return "disarmed"
        if self.simulation.estimator.kind == "alignment":
            return "aligning in place"
        return "motion is prescribed"

    def _let_go(self) -> None:
        if self._steered_at is not None and self.simulation.time - self._steered_at > LOST_AFTER_S:
            self._steered_at = None
            self.simulation.command(self.sticks.released())
            self.tell("manual control lost", "warning")

    # --- its own parameters -------------------------------------------------------------------------

    def _own_parameters(self) -> Iterator[Parameter]:
        view, simulation = self.view, self.simulation

        def pause(value: float) -> None:
            self.set_paused(value != 0.0)

        def gnss(value: float) -> None:
            self.set_gnss(value != 0.0)

        def undulation(value: float) -> None:
            view.undulation = value

        yield Parameter(
            "SIM_SPEED", "Simulated seconds a second; 0: as fast as possible", "", NOW, 0.0, MAX_SPEED,
            lambda: self.speed, self.set_speed,
        )  # fmt: skip
        yield Parameter("SIM_PAUSE", "1: the simulation stands still", "", NOW, 0.0, 1.0, lambda: float(self.paused), pause)
        if simulation.has_gnss:
            yield Parameter(
                "SIM_GNSS", "0: the receiver is cut off", "", NOW, 0.0, 1.0, lambda: float(simulation.gnss_on), gnss
            )
        yield Parameter(
            "SIM_UNDULATION", "Height of the geoid over the ellipsoid", "m", NOW, -120.0, 120.0,
            lambda: view.undulation, undulation,
        )  # fmt: skip
        yield Parameter("SIM_RATE", "Inertial samples a second", "Hz", NEVER, 1.0, 1e4, lambda: 1.0 / simulation.interval)
        yield Parameter("SIM_SEED", "Seed", "", NEVER, 0.0, 2.0**53, lambda: float(simulation.plant.seed))
        yield from self.sticks.parameters()


def checked_speed(speed: float) -> float:
    """A speed of the simulation.  Raises `InputError`."""
    if not 0.0 <= speed <= MAX_SPEED:
        raise InputError(
            f"speed = {speed:g}: allowed is from 0 (as fast as possible) to {MAX_SPEED:g} simulated seconds a second"
        )
    return float(speed)

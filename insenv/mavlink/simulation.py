"""A scenario run live: its plant and one estimator, advanced together one inertial sample at a time.

The results are bit-identical to those of `insenv.runs.simulated`, except that a lost inertial sample is replaced by the
previous one, since the next one is not available yet.  While it runs, the receiver can be switched off, the alignment
restarted and the vehicle steered.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.runner import make_runner
from insenv.core.tables import Table, Vector
from insenv.estimators import Estimator, Knowledge
from insenv.evaluation.live_health import LiveHealth
from insenv.mavlink.surroundings import Interference, defaults
from insenv.scenario import Scenario, build, poles
from insenv.scenario.build import model_of
from insenv.scenario.files import named_estimators
from insenv.sensors import IMU

_INCREMENTS = ("delta_angle", "delta_velocity")
PLACE = ("latitude", "longitude", "height")
POSE = ("q_nb", "velocity_n", *PLACE)


@dataclass(frozen=True)
class Fix:
    """A GNSS fix as delivered by the receiver.

    time: of validity (s).  Position (rad, m) and velocity (m/s, n) are the antenna's, with 1-sigma accuracies (3, m;
    m/s, n).
    """

    time: float
    latitude: float
    longitude: float
    height: float
    position_sigma: Vector
    velocity_valid: bool
    velocity_n: Vector
    velocity_sigma: Vector


_TOO_EARLY = declared("too-early", "{id} needs {needed:.3g} s of data")


class Simulation:
    """A scenario's plant and one estimator of its measurements.

    estimator: registered id; None: the first that the scenario names.  seed: instead of the scenario's.
    year: decimal year at the start, for the magnetic field of a scenario without a magnetometer.  Raises `InputError` for an
    estimator that cannot run live on this scenario.

    truth, estimate: outputs of the plant and of the estimator after the latest sample, by row name (views, overwritten
    by the next `advance`).  samples: number simulated.  alignments: number started.  fix: the latest fix received;
    fixes: their number.  readings: number of measurements of magnetometer and barometer, by id.  gnss_on: whether the
    receiver is on.  interference: what disturbs it, or None.  increments (6): sums of the delta angles (rad) and delta
    velocities (m/s) that the estimator received; last_increment (6): the latest of them.  stuck (6): whether an element of them
    repeats its latest value, as of an axis that is frozen.  bridged: number of lost samples;
    lost_in_a_row: consecutive ones up to the latest.  health: of the estimator since the alignment began, or None if it does
    not report it.  reported_heading_sigma: standard deviation (rad) of the heading from which the alignment began, 0 if the
    estimator takes none.  plant_parameters, estimator_parameters: the values in force, in the order of the models' tables;
    set them by `set_plant_parameter` and `set_estimator_parameter`.  changed: whether commands or parameters have made the
    drive another one than the scenario's.
    """

    def __init__(
        self, scenario: Scenario, estimator: str | Estimator | None = None, seed: int | None = None, year: float = 2026.0
    ) -> None:
        plant = build(scenario, seed=seed)
        added = defaults(scenario, year)
        with_added = build(scenario.model_copy(update=added), seed=seed) if added else plant
        # the estimator knows the scenario alone: its run is that of `insenv run`
        # and what is added stands last, since a sensor's random streams follow its place among the sensors
        sections = with_added.scenario.sensors
        ordered = sorted(sections, key=lambda id: id in added)
        model = model_of(scenario.vehicle.vehicle(), (IMU, *(sections[id].sensor for id in ordered)))
        self.plant = replace(plant, model=model, parameters=with_added.parameters)
        self.estimator = self.plant.adapted(estimator or named_estimators(scenario)[0], offline=False)
        self.interval = self.plant.sample_interval
        self._plant = make_runner(self.plant.model, self.plant.parameters)
        self._settings: dict[int, float] = {}
        self._filter = make_runner(self.estimator.model, self.plant.parameters_of(self.estimator, offline=False))
        self.plant_parameters, self.estimator_parameters = self._plant.p, self._filter.p
        self._y = self._plant.output()
        self._z = self._filter.output()
        self.truth = self.plant.model.outputs.unpack(self._y)
        self.estimate = self.estimator.model.outputs.unpack(self._z)
        self._start = {name: np.array(self.truth[name]) for name in POSE}
        self.samples = self.bridged = self.lost_in_a_row = self.fixes = 0
        self.fix: Fix | None = None
        self.readings = {"magnetometer": 0, "barometer": 0}
        self.gnss_on = True
        self.interference: Interference | None = None
        self._delivered = 0
        self.alignments = 1
        self._aligning_since = 0
        self.increments, self.last_increment = np.zeros(6), np.zeros(6)
        self.stuck = np.zeros(6, dtype=bool)
        self.health = self._new_health()

        inputs, outputs, known = self.estimator.model.inputs, self.plant.model.outputs, plant.model.outputs
        self._u = inputs.start_vector()
        self._u[inputs.slice("dt")] = self.interval
        self._increment_to = _places(inputs, _INCREMENTS)
        copied = [name for name in inputs.names if name in known and name not in (*_INCREMENTS, "dt")]
        self._to, self._from = _places(inputs, copied), _places(outputs, copied)
        self._valid = inputs.slice("gnss_valid") if "gnss_valid" in inputs else None
        self._commands = self.plant.model.inputs.start_vector() if self.plant.model.inputs.rows else None
        self._commanded = self.changed = False

    @property
    def time(self) -> float:
        """The simulation clock: seconds from the start of the run to the end of the latest sample."""
        return self.samples * self.interval

    @property
    def has_gnss(self) -> bool:
        """Whether the scenario has a receiver."""
        return "gnss" in self.plant.sensors

    @property
    def diverged(self) -> bool:
        """Whether the estimate is not finite."""
        return not bool(np.isfinite(self._z).all())

    def advance(self) -> None:
        """Advance by one inertial sample: the plant, then the estimator with the measurements.

        Raises `InputError` near a pole.
        """
        self._plant.advance(self._commands if self._commanded else None)
        if self._commanded and self._commands is not None:  # the command is valid for one sample
            valid = self.plant.model.inputs.slice("command_valid")
            self._commanded = bool(self._commands[valid])
            self._commands[valid] = 0.0
        self.samples += 1
        self._y[:] = self._plant.output()
        truth, u = self.truth, self._u
        if poles.too_near(latitude := float(truth["latitude"])):
            raise poles.refusal(self.plant.scenario, latitude, self.time)
        for id in self.readings:
            self.readings[id] += int(truth[f"{id}_new"] != 0.0)
        self.lost_in_a_row += 1
        if truth["imu_valid"]:
            self.lost_in_a_row = 0
            measured = np.concatenate([truth[name] for name in _INCREMENTS])
            self.last_increment[:] = np.where(self.stuck, self.last_increment, measured)
        else:
            self.bridged += 1
        self.increments += self.last_increment
        u[self._increment_to] = self.last_increment
        if self.has_gnss and truth["gnss_valid"]:
            self._delivered += 1
            if self.interference is not None:
                self.interference.apply(truth, self.time, self.plant.seed, self._delivered)
        u[self._to] = self._y[self._from]
        if not self.gnss_on and self._valid is not None:
            u[self._valid] = 0.0
        fix = self._new_fix() if self.has_gnss and truth["gnss_valid"] and self.gnss_on else None
        try:
            self._filter.advance(u)
        except InputError:  # sensor parameters have been set to values that make the measurements infinite
            self.bridged += 1
            u[:] = np.where(np.isfinite(u), u, 0.0)
            self._filter.advance(u)
        self._z[:] = self._filter.output()
        if fix is not None:
            self.fix, self.fixes = fix, self.fixes + 1
            if self.health is not None:
                self.health.take(self.time, self.estimate, fix.velocity_sigma if fix.velocity_valid else None)

    def _new_health(self) -> LiveHealth | None:
        self.reported_heading_sigma = self.estimator_row("heading_sigma") or 0.0
        return LiveHealth(self.estimator.health_rows) if self.estimator.reports_health else None

    def _new_fix(self) -> Fix:
        now = self.truth
        return Fix(
            time=self.time - float(now["gnss_age"]),
            latitude=float(now["gnss_latitude"]),
            longitude=float(now["gnss_longitude"]),
            height=float(now["gnss_height"]),
            position_sigma=np.array(now["gnss_position_sigma"]),
            velocity_valid=bool(now["gnss_velocity_valid"]),
            velocity_n=np.array(now["gnss_velocity_n"]),
            velocity_sigma=np.array(now["gnss_velocity_sigma"]),
        )

    # --- control ------------------------------------------------------------------------------------

    def realign(self) -> None:
        """Restart the estimator with `known_now`; parameters that have been set stay in force."""
        known = self.known_now()
        self._filter.p[:] = self.estimator.model.parameters.pack(self.estimator.parameters(known, self.plant.tunings))
        for place, value in self._settings.items():
            self._filter.p[place] = value
        self._filter.start()
        self._z[:] = self._filter.output()
        self.alignments += 1
        self._aligning_since = self.samples
        self.health = self._new_health()

    def notes(self) -> tuple[Remark, ...]:
        """The estimator's objections to its estimate, with its parameters and the data since the alignment began.

        The last one is that these data are fewer than it needs.
        """
        rows = self.estimator.model.parameters.unpack(self._filter.p)
        duration = max(self.samples - self._aligning_since, 1) * self.interval
        needed = self.estimator.needed_s(rows)
        short = (_TOO_EARLY.filled(id=self.estimator.id, needed=needed),) if duration < needed * (1 - 1e-9) else ()
        return (*self.estimator.objections(rows, duration), *short)

    def known_now(self) -> Knowledge:
        """Knowledge of the present state: the truth, with the errors of the knowledge at the start."""
        known, start, now = self.plant.knowledge, self._start, self.truth
        reported = (known.latitude, known.longitude, known.height)
        error_m = geodesy.numeric.ned_offset(*reported, *(start[name] for name in PLACE))
        place = geodesy.numeric.geodetic_from_ned_offset(error_m, *(now[name] for name in PLACE))
        latitude, longitude, height = map(float, place)
        error = np.array([known.roll, known.pitch, known.heading]) - np.array(attitude.numeric.to_euler(start["q_nb"]))
        roll, pitch, heading = np.array(attitude.numeric.to_euler(now["q_nb"])) + error
        return replace(
            known,
            latitude=latitude,
            longitude=longitude,
            height=height,
            velocity_n=np.array(now["velocity_n"]) + known.velocity_n - start["velocity_n"],
            roll=float(roll),
            pitch=float(pitch),
            heading=float(heading),
        )

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the vehicle's commands (``"speed"``, ``"bank"``).

        There are none if its motion is prescribed, or if the estimator is an alignment, which needs a vehicle in place.
        """
        if not self.estimator.navigates:
            return ()
        names = self.plant.model.inputs.names
        return tuple(name.removeprefix("command_") for name in names if name != "command_valid")

    def command(self, values: Mapping[str, float]) -> None:
        """Set commands (SI) that the vehicle follows from the next sample on, instead of its script.

        Commands not named keep their values.  Values are limited to the bounds of their rows.  Raises `InputError` for
        a command that the vehicle does not have.
        """
        if self._commands is None or not self.commands:
            raise InputError(f"the motion of {self.plant.scenario.name!r} is prescribed: it takes no commands")
        unknown = set(values) - set(self.commands)
        if unknown:
            raise InputError(f"no command {sorted(unknown)[0]!r} (allowed: {', '.join(self.commands)})")
        inputs, state = self.plant.model.inputs, self.plant.model.state
        for name in self.commands:
            row = inputs[f"command_{name}"]
            value = values.get(name, float(self._plant.x[state.slice(f"commanded_{name}")][0]))
            self._commands[inputs.slice(row.name)] = min(max(value, row.lower), row.upper)
        self._commands[inputs.slice("command_valid")] = 1.0
        self._commanded = self.changed = True

    def state(self, name: str) -> float | None:
        """A scalar of the plant's state by row name; None if the plant has no such row."""
        table = self.plant.model.state
        return float(self._plant.x[table.slice(name)][0]) if name in table else None

    def estimator_row(self, name: str) -> float | None:
        """A scalar parameter of the estimator by row name; None if it has no such row."""
        table = self.estimator.model.parameters
        return float(self._filter.p[table.slice(name)][0]) if name in table else None

    def set_plant_parameter(self, place: int, value: float) -> None:
        """Set element `place` of the plant's parameters, from the next sample on."""
        self._plant.p[place] = value
        self.changed = True

    def set_estimator_parameter(self, place: int, value: float) -> None:
        """Set element `place` of the estimator's parameters, from the next sample on and in later alignments."""
        self._filter.p[place] = value
        self._settings[place] = value


def _places(table: Table, names: Iterable[str]) -> NDArray[np.int64]:
    """The indices of rows in the vector of a table."""
    return np.concatenate([np.zeros(0, np.int64), *(np.r_[table.slice(name)] for name in names)])

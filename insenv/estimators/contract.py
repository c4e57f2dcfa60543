"""The contract of an estimator: what it needs, how it starts, where it may be trusted.

Whatever runs an estimator (run, replay, campaign, environment, FMU, MAVLink) asks the `Estimator` and holds no copy of the
answers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, get_args

from insenv.base.errors import InputError, naming
from insenv.base.plugins import check_id
from insenv.base.remarks import Caveat, Remark, coded, remark
from insenv.core.model import Model, Values
from insenv.core.tables import Array, Table, check_rows
from insenv.estimators.knowledge import VALUES, Knowledge
from insenv.estimators.parts.adjoint import Smoothing
from insenv.estimators.parts.error_model import understated as motion_errors_understated
from insenv.estimators.parts.fed import misfed
from insenv.estimators.parts.finding import Finding, Reached
from insenv.estimators.parts.rows import AIDED_OUTPUTS, FIX_HEALTH, aid_health, reported_aids
from insenv.sensors.gnss import ARM, GNSS_STATED
from insenv.vehicles import VehicleTraits
from insenv.vehicles.registry import traits_of


@dataclass(frozen=True)
class Drive:
    """What an estimator is to run on.

    where: in messages (``"scenario 'ship-swaying'"``).  sensors: ids of those beside the inertial unit.  in_place: whether
    the vehicle stays where it is; None: unknown.  offline: whether the run can be gone through again from its end.
    vehicle: its kind ("car", "ship", ...); empty: unknown.
    motion: where it does not stay, what shows that, for messages.  stands: whether all of it is known to be a rest.
    fix_velocity: whether the fixes of its GNSS, if it has one, have a velocity.
    ages: largest age (s) of the measurements of sensors when they arrive, by id, where it is not 0.
    """

    where: str
    sensors: frozenset[str]
    in_place: bool | None = None
    offline: bool = True
    vehicle: str = ""
    motion: str = ""
    stands: bool = False
    fix_velocity: bool = True
    ages: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def traits(self) -> VehicleTraits:
        """The traits of its kind of vehicle; of an unknown one, those of a generic vehicle."""
        return traits_of(self.vehicle)


_ROUNDED = 1e-6
"""s: by which a stated age may be rounded."""
Choices = Mapping[str, tuple[str, ...]]
"""Names by key, such as the states and the aids of a fusion filter."""
Notes = Callable[[Mapping[str, Any], float], tuple[str, ...]]
"""Of parameters by row name and a duration (s): sentences about where an estimate may not be trusted "
"(`insenv.base.remarks`)."""
Kind = Literal["alignment", "navigation"]
Motion = Literal["in place", "moving", "any"]


@dataclass(frozen=True, repr=False)
class Estimator:
    """An estimator: its equations, and all that is needed to run it.

    Parameters
    ----------
    model: its equations.  Inputs are fed by name: ``delta_angle``, ``delta_velocity``, ``dt``, and the output rows of sensors.
        The output ``q_nb`` is the attitude; ``attitude_sigma`` (3, rad about n) states its standard deviation.  A navigation
        has the outputs ``velocity_n``, ``latitude``, ``longitude`` and ``height`` too.
    kind: "alignment" (attitude alone) or "navigation".
    sensors: ids of the sensors that it cannot do without, beside the inertial unit (``("gnss",)``).
    motion: of the vehicle: "in place" (None and an alignment), "moving" or "any" (None and a navigation).
    moving_row: parameter row that, set to 1, lets an alignment in place work on a moving vehicle with GNSS, or empty.
    fix_velocity: whether, on a vehicle that moves, it needs fixes of GNSS with a velocity.
    prepare: its parameters by row name from what is known.  None: every parameter row that is named like a field of
        `Knowledge` or `ImuDataSheet`, or ``start_`` and such a name, has its value.
    needs: ``(parameters by row name) -> s`` of data before which its errors have not settled and are not compared with a
        limit.  None: 0.
    applicability: ``(parameters by row name, duration in s) -> sentences`` about where its estimate may not be trusted.
        While there is one that is not a `Caveat`, the estimate does not count as aligned.
    on_turntable: a sentence of `applicability` where a turntable turns the unit, or empty.
    error: ``(state, outputs, truth) -> (error, covariance)``, symbols: what its consistency (NEES) is measured on.  None:
        the attitude, if there is an output ``attitude_covariance`` (3 x 3, rad^2 about n).
    without: ``(state, error) -> state rows``, symbols, of a navigation from which an error was taken out: estimate minus truth
        in n, rotation vector (rad), velocity (m/s) and position (m), (9,).  None: nothing is taken out from outside.
    smooths: id of the filter over whose whole run this one goes back, or empty.  It starts and is tuned as that filter is,
        with its own tuning on top.
    smoothing: the two passes of such an estimator.
    read_file: parameter rows from the file that its tuning key `file` names.  None: it takes no file.
    choices: gives the keys of its section that take lists of names, and the names that are allowed.  None: there are none.
    settable: the parameter rows that its section may set, or what gives them.  None: those of the model.
    adapt: ``(known, drive, names by those keys) -> Estimator`` of the same id: the one that runs there (`adapted`).  None: it
        is the same everywhere.
    findings: ``(parameters by row name) -> Finding or Reached, ...``: what the outputs at the end of a run may show, and when
        standard deviations became small; of those about one row, the first that holds counts.
    max_measurement_age_s: the largest age (s) of measurements with which its estimate and its standard deviations are right.
    missing_sensors: of one that `adapt` gave, what it needs of the drive and does not find there, for the refusal; or empty.
    finds_attitude: of a navigation, whether its start attitude may be unknown: it finds level and heading.
    causes: by id of an aid, what to look at where its measurements do not fit (``{"odometer": "its scale factor"}``).
    """

    model: Model
    kind: Kind
    sensors: tuple[str, ...] = ()
    motion: Motion | None = None
    moving_row: str = ""
    fix_velocity: bool = False
    prepare: Callable[[Knowledge], Mapping[str, Any]] | None = None
    needs: Callable[[Mapping[str, Any]], float] | None = None
    applicability: Notes | None = None
    on_turntable: str = ""
    error: Callable[[Values, Values, Values], tuple[Any, Any]] | None = None
    without: Callable[[Values, Any], Mapping[str, Any]] | None = None
    smooths: str = ""
    smoothing: Smoothing | None = None
    read_file: Callable[[str], Mapping[str, Any]] | None = None
    choices: Callable[[], Choices] | None = None
    settable: Table | Callable[[], Table] | None = None
    adapt: Callable[[Knowledge, Drive, Choices], Estimator] | None = None
    causes: Mapping[str, str] = field(default_factory=dict, hash=False)
    findings: Callable[[Mapping[str, Any]], tuple[Finding | Reached, ...]] | None = None
    finds_attitude: bool = False
    max_measurement_age_s: float = math.inf
    missing_sensors: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.model, Model):
            raise InputError(f"Estimator: model = {self.model!r}: allowed is an insenv.Model")
        check_id("estimator", self.id)
        if self.kind not in ("alignment", "navigation"):
            raise InputError(f"estimator {self.id!r}: kind = {self.kind!r}: allowed is 'alignment' or 'navigation'")
        if self.motion not in (None, *get_args(Motion)):
            raise InputError(f"estimator {self.id!r}: motion = {self.motion!r}: allowed is 'in place', 'moving' or 'any'")
        if not isinstance(self.sensors, tuple) or not all(isinstance(sensor, str) for sensor in self.sensors):
            raise InputError(
                f"estimator {self.id!r}: sensors = {self.sensors!r}: allowed is a tuple of sensor ids, such as ('gnss',)"
            )
        lacking = [name for name in _OUTPUTS[self.kind] if name not in self.model.outputs]
        if lacking:
            raise InputError(
                f"estimator {self.id!r}: an estimator of kind {self.kind!r} has the output {lacking[0]!r} "
                f"(given: {', '.join(self.model.outputs.names) or 'none'})"
            )
        for where, rows in (("AIDED_OUTPUTS", _READ), ("FIX_HEALTH", FIX_HEALTH if self.reports_fixes else ())):
            for row in rows:
                shape = self.model.outputs[row.name].shape if row.name in self.model.outputs else row.shape
                if shape != row.shape:
                    raise InputError(
                        f"estimator {self.id!r}: output {row.name!r} has the shape {shape}: allowed is {row.shape}, as in "
                        f"insenv.estimators.parts.rows.{where}"
                    )
        if self.motion is None:
            object.__setattr__(self, "motion", "in place" if self.kind == "alignment" else "any")

    def __repr__(self) -> str:
        return f"Estimator({self.id!r}, kind={self.kind!r})"

    @property
    def id(self) -> str:
        """The name it is asked for by."""
        return self.model.id

    @property
    def title(self) -> str:
        """One line for listings."""
        return self.model.title

    @property
    def settable_rows(self) -> Table:
        """The parameter rows that its section may set."""
        rows = self.model.parameters if self.settable is None else self.settable
        return rows if isinstance(rows, Table) else rows()

    @property
    def lists_of_names(self) -> Choices:
        """The keys of its section that take lists of names, and the names that are allowed."""
        return {} if self.choices is None else self.choices()

    @property
    def navigates(self) -> bool:
        """Whether it gives velocity and position too."""
        return self.kind == "navigation"

    @property
    def aided(self) -> bool:
        """Whether it takes more than the inertial unit."""
        return bool(self.sensors)

    @property
    def reports_health(self) -> bool:
        """Whether its outputs tell how well it fits its measurements: `health_rows`."""
        return bool(self.health_rows.rows)

    @property
    def reports_fixes(self) -> bool:
        """Whether they tell that of GNSS: all rows of `insenv.estimators.parts.rows.FIX_HEALTH`."""
        return all(name in self.model.outputs for name in FIX_HEALTH.names)

    @cached_property
    def health_rows(self) -> Table:
        """The outputs that tell how well it fits its fixes and its other aids (`insenv.evaluation.health`)."""
        outputs = self.model.outputs
        names = [*(FIX_HEALTH.names if self.reports_fixes else ())]
        names += [name for id in reported_aids(outputs.names) for name in aid_health(id)]
        return Table(tuple(outputs[name] for name in names))

    def adapted(self, known: Knowledge, drive: Drive, choices: Choices | None = None) -> Estimator:
        """The estimator that runs on `drive`: itself, or, of a family, the member with the names in `choices`.

        Raises `InputError` if there is none.
        """
        member = self if self.adapt is None else self.adapt(known, drive, choices or {})
        if not member.on_turntable or not drive.traits.turns_in_place:
            return member
        notes = member.applicability or (lambda rows, duration_s: ())
        return replace(member, applicability=lambda rows, duration_s: (*notes(rows, duration_s), member.on_turntable))

    def refusal(self, drive: Drive, rows: Mapping[str, Any] | None = None) -> str:
        """The one sentence why it cannot run on `drive` with the parameters `rows`; empty if it can."""
        this = f"estimator {self.id!r}"
        if self.missing_sensors:
            return f"{this} needs {self.missing_sensors}"
        follows = bool(self.moving_row) and float((rows or {}).get(self.moving_row, 0.0)) != 0.0
        for sensor in (*self.sensors, *(("gnss",) if follows else ())):
            if sensor not in drive.sensors:
                return f"{this} needs {shown_name(sensor)}: {drive.where} has no [{sensor}]"
        for sensor in self.sensors:
            if (age := drive.ages.get(sensor, 0.0)) > self.max_measurement_age_s + _ROUNDED:
                return (
                    f"{this} uses measurements that are up to {self.max_measurement_age_s:g} s old when they arrive, because "
                    "it does not know the motion before that well enough: "
                    f"those of {shown_name(sensor)} of {drive.where} are up to {age:.3g} s old"
                )
        if self.fix_velocity and (follows or self.motion != "in place") and not drive.fix_velocity:
            return f"{this} needs the velocity of GNSS: the fixes of {drive.where} have none"
        if self.motion == "in place" and drive.in_place is False and not follows:
            motion = f" ({drive.motion})" if drive.motion else ""
            return f"{this} is for a vehicle that stays in place, and the vehicle of {drive.where} moves{motion}"
        if self.motion == "moving" and drive.in_place:
            return f"{this} needs a vehicle that moves: that of {drive.where} stays in place"
        if self.smooths and not drive.offline:
            return (
                f"{this} smooths a whole run from its end: allowed in `insenv run` without --live, one seed at a time; here "
                f"use {self.smooths!r}"
            )
        return ""

    def check(self, drive: Drive, rows: Mapping[str, Any] | None = None) -> None:
        """Raise `InputError` if it cannot run on `drive` with the parameters `rows`, or for a sentence of `misfed`."""
        refusal = self.refusal(drive, rows) or misfed(self.model)
        if refusal:
            raise InputError(refusal)

    def parameters(
        self, known: Knowledge, tunings: Mapping[str, Mapping[str, Any]] | None = None, rows: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """Its parameters by row name, SI: from what is known, from `tunings` (rows by estimator id), and `rows` on top."""
        return {**self._from(known), **self._set_rows(tunings, rows)}

    def understated(
        self, known: Knowledge, tunings: Mapping[str, Mapping[str, Any]] | None = None, rows: Mapping[str, Any] | None = None
    ) -> tuple[Remark, ...]:
        """What must be said of parameters that are set smaller than the unit's data sheet; arguments as for `parameters`."""
        return motion_errors_understated(self._from(known), self._set_rows(tunings, rows))

    @remark("set-without-effect", "{rows}: set without effect, because this filter does not have the state or aid")
    def without_effect(self, tunings: Mapping[str, Mapping[str, Any]]) -> dict[str, Any] | None:
        """Parameters in `tunings` (rows by estimator id) of states and aids that were not chosen."""
        idle = [name for name in self._of_drive(tunings) if self._unchosen(name)]
        return {"rows": ", ".join(idle)} if idle else None

    def tuned(self, tunings: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        """Its rows in `tunings` (by estimator id), without those of states and aids that were not chosen."""
        return {name: value for name, value in self._of_drive(tunings).items() if not self._unchosen(name)}

    def _of_drive(self, tunings: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        return {**tunings.get(self.smooths, {}), **tunings.get(self.id, {})}

    def _unchosen(self, name: str) -> bool:
        return self.settable is not None and name in self.settable_rows and name not in self.model.parameters

    def _set_rows(self, tunings: Mapping[str, Mapping[str, Any]] | None, rows: Mapping[str, Any] | None) -> dict[str, Any]:
        """The parameter rows that are set, by name."""
        set_rows = {**self.tuned(tunings or {}), **(rows or {})}
        for name in set_rows:
            if name not in self.model.parameters:
                raise InputError(f"estimator {self.id!r}: {name} is set, and it has no such parameter ({self.title})")
        return set_rows

    def copied(self, tunings: Mapping[str, Mapping[str, Any]]) -> dict[str, str] | None:
        """The names (`Knowledge.field_of`) of what `parameters` copies, by row name; None if `prepare` computes.

        Many starts can then be had by copying columns.
        """
        if self.prepare is not None:
            return None
        tuned = self._of_drive(tunings)
        names = {name: Knowledge.field_of(name) for name in self.model.parameters.names if name not in tuned}
        return {name: field for name, field in names.items() if field}

    def _from(self, known: Knowledge) -> Mapping[str, Any]:
        if self.prepare is not None:
            with naming(f"estimator {self.id!r}, prepare"):
                return check_rows(self.prepare(known), self.model.parameters)
        return known.rows_of(self.model.parameters)

    @cached_property
    def tunable(self) -> tuple[str, ...]:
        """Parameter rows that may be changed during a run, from one sample to the next: noises, gates and the lever arm.

        Not among them: what is known of the start, and rows that the equations of the start use.
        """
        import casadi as ca

        table, known = self.model.parameters, {*VALUES, *GNSS_STATED.names} - {ARM.name}
        p = ca.SX.sym("p", table.size)
        start = self.model.kernels["start"].function(p, ca.SX.sym("r", self.model.start_uniforms))
        used = set(ca.jacobian_sparsity(start, p).get_triplet()[1])
        return tuple(
            row.name
            for row in table
            if row.name.endswith(_TUNABLE)
            and not row.name.startswith("start_")
            and row.name not in known
            and not used.intersection(range(table.slice(row.name).start, table.slice(row.name).stop))
        )

    def needed_s(self, parameters: Mapping[str, Any]) -> float:
        """The time (s) of data that it needs with these parameters (by row name): see `needs`."""
        if self.needs is None:
            return 0.0
        with naming(f"estimator {self.id!r}, needs"):
            needed = float(self.needs(parameters))
        if not 0 <= needed < math.inf:
            raise InputError(f"estimator {self.id!r}, needs: {needed!r} s: allowed is a finite number of seconds, not negative")
        return needed

    @remark(
        "too-short",
        "too short: {duration:g} s of data, {id} needs {needed:.3g} s to converge; its errors before that time do not show its "
        "accuracy",
    )
    def too_short(self, parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
        """`duration_s` of data are too few with these parameters (by row name)."""
        needed = self.needed_s(parameters)
        if self.needs is None or duration_s > needed * (1 - 1e-9):
            return None
        return {"duration": duration_s, "id": self.id, "needed": needed}

    def notes(self, parameters: Mapping[str, Any], duration_s: float) -> tuple[Remark, ...]:
        """What must be said of its estimate, with these parameters (by row name), after `duration_s` of data."""
        said = self._applicability(parameters, duration_s)
        return (*self.too_short(parameters, duration_s), *sorted(said, key=lambda each: isinstance(each, Caveat)))

    def objections(self, parameters: Mapping[str, Any], duration_s: float) -> tuple[Remark, ...]:
        """Those of `notes` with which its estimate does not count as aligned."""
        return tuple(each for each in self._applicability(parameters, duration_s) if not isinstance(each, Caveat))

    def _applicability(self, parameters: Mapping[str, Any], duration_s: float) -> tuple[Remark, ...]:
        if self.applicability is None:
            return ()
        with naming(f"estimator {self.id!r}, applicability"):
            return coded(self.applicability(parameters, duration_s), "applicability")

    def shown(self, parameters: Mapping[str, Any], time: Array, outputs: Mapping[str, Array]) -> tuple[Remark, ...]:
        """What must be said of a run with these parameters and outputs (by row name): see `findings`.

        time (k,): of its records since its start, s.
        """
        held = self.held(parameters, outputs)
        with naming(f"estimator {self.id!r}, findings"):
            reaches = [each for each in self.to_find(parameters) if isinstance(each, Reached) and each.row not in held]
            when = [said for each in reaches for said in each.said(time, outputs)]
        return (*(sentence.filled(ratio=f"{ratio:.3g}") for sentence, ratio in held.values()), *when)

    def held(self, parameters: Mapping[str, Any], outputs: Mapping[str, Array]) -> dict[str, tuple[Remark, float]]:
        """The findings that hold at the end of such a run, with their ratios (`Finding`): the first of each row, by row."""
        held: dict[str, tuple[Remark, float]] = {}
        with naming(f"estimator {self.id!r}, findings"):
            for finding in self.to_find(parameters):
                if isinstance(finding, Finding) and (numbers := finding.numbers(outputs))["said"]:
                    held.setdefault(finding.row, (finding.remark, numbers["ratio"]))
        return held

    def to_find(self, parameters: Mapping[str, Any]) -> tuple[Finding | Reached, ...]:
        """Its findings with these parameters (by row name)."""
        if self.findings is None:
            return ()
        with naming(f"estimator {self.id!r}, findings"):
            return self.findings(parameters)


_OUTPUTS = {"alignment": ("q_nb",), "navigation": ("q_nb", "velocity_n", "latitude", "longitude", "height")}
_READ = tuple(AIDED_OUTPUTS[name] for name in (*_OUTPUTS["navigation"], "attitude_sigma", "velocity_sigma", "position_sigma"))
"""Outputs that insenv reads, of the estimators that have them."""
_TUNABLE = ("_random_walk", "_sigma", "_gate", "_error", "_correlation_time", "antenna_lever_arm")
"""Ends of the names of noises, gates and the lever arm."""


def shown_name(sensor: str) -> str:
    """A sensor's id as messages show it."""
    return "GNSS" if sensor == "gnss" else sensor

"""Errors of estimates against the truth (or a reference), and their statistics.

`CHANNELS` are the names of the errors.  Angles are in degrees, wrapped to -180 to 180; positions in metres north,
east and down of the truth; velocities in m/s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import degrees, hypot, pi
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError, nearest
from insenv.base.remarks import Doubt, Remark, declared, filled, remark
from insenv.core.elementary import select, sin_cos, wrap_angle
from insenv.core.model import Values
from insenv.core.tables import Array, Table
from insenv.estimators import Estimator
from insenv.evaluation.health import Health
from insenv.evaluation.outages import BEYOND, Outages
from insenv.evaluation.specific_force import SpecificForce
from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles.registry import traits_of

# The result of a calibration: the errors of the inertial unit that a filter estimates, beside the true ones.

DEG_H = degrees(1.0) * 3600.0
UNITS = {
    "gyro_bias": ("deg/h", DEG_H),
    "accel_bias": ("ug", 1e6 / STANDARD_GRAVITY),
    "gyro_g_sensitivity": ("deg/h/g", DEG_H * STANDARD_GRAVITY),
    "gyro_scale": ("ppm", 1e6),
    "accel_scale": ("ppm", 1e6),
    "gyro_misalignment": ("urad", 1e6),
    "accel_misalignment": ("urad", 1e6),
}
"""Unit in which an error state is shown, and the factor from SI."""
_COMPONENTS = {3: ("x", "y", "z"), 6: ("xy", "xz", "yx", "yz", "zx", "zy")}


@dataclass(frozen=True)
class UnitError:
    """One component of an error of the unit at the end of a run: estimate, standard deviation and truth, in `unit`.

    name: that of the error state.  component: the body axis ("x" forward, "y" right, "z" down), or which axis couples into
    which.  true: None where it is not known.
    """

    name: str
    component: str
    unit: str
    estimate: float
    sigma: float
    true: float | None = None

    @property
    def error(self) -> float | None:
        """Estimate minus truth."""
        return None if self.true is None else self.estimate - self.true

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {**vars(self), "error": self.error}


def unit_errors(vehicle: str, outputs: Mapping[str, Array], true: Mapping[str, Array] | None = None) -> tuple[UnitError, ...]:
    """The errors of the unit in an estimator's outputs (n, k) by row name, at the last record; none off a turntable.

    vehicle: its kind.  true: `insenv.sensors.imu.true_unit_errors` (k,) by the same names, or None.
    """
    estimated = [name for name in UNITS if traits_of(vehicle).turns_in_place and f"{name}_estimate_sigma" in outputs]
    unit: list[UnitError] = []
    for name in estimated:
        unit_name, factor = UNITS[name]
        estimates, sigmas = (factor * outputs[row][-1] for row in (name, f"{name}_estimate_sigma"))
        actual = [None] * len(estimates) if true is None else [float(factor * value) for value in true[name]]
        columns = zip(_COMPONENTS[len(estimates)], estimates, sigmas, actual, strict=True)
        unit += [UnitError(name, axis, unit_name, float(e), float(sigma), known) for axis, e, sigma, known in columns]
    return tuple(unit)


ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")
POSITION = ("north_m", "east_m", "down_m")
VELOCITY = ("vn_mps", "ve_mps", "vd_mps")
CHANNELS = ATTITUDE + POSITION + VELOCITY
STEEP = 80.0
"""Pitch (deg) from which roll and heading do not show an error of the attitude."""
TOO_SURE = 3.0
"""Ratio of an rms error to its stated standard deviation beyond which a run says so."""
BEYOND_SHARE = 0.05
"""A reference contradicts an estimate if an error is beyond `BEYOND` stated standard deviations for more than this share of the
time: of true ones it is for 0.27 %, and an error that changes slowly may be for some per cent of one run."""
STEEP_LIMIT = declared(
    "steep-no-limit",
    "no limit for roll and heading: the pitch comes near 90 deg, where their errors are large even if the attitude is right",
)


def statistics_from(navigates: bool, end_s: float) -> float:
    """Start of the statistics of a run that ends at `end_s`, s: of a navigation 0, of an alignment its last quarter."""
    return 0.0 if navigates else 0.75 * end_s


@dataclass(frozen=True)
class Track:
    """A motion at sampled times.

    time (n,) s; q_nb (n, 4); velocity_n (n, 3) m/s; latitude, longitude (n,) rad, height (n,) m: None where not known.
    """

    time: Array
    q_nb: Array | None = None
    velocity_n: Array | None = None
    latitude: Array | None = None
    longitude: Array | None = None
    height: Array | None = None

    def since(self, first: int) -> Track:
        """The track from row `first` on."""
        series = {each.name: getattr(self, each.name) for each in fields(self)}
        return replace(self, **{name: values[first:] for name, values in series.items() if values is not None})

    def at(self, times: Array) -> dict[str, Array]:
        """The rows that are known at times (m,) s of the track, by name."""
        rows = np.searchsorted(self.time, times - 1e-9).clip(0, max(len(self.time) - 1, 0))
        series = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "time"}
        return {name: values[rows] for name, values in series.items() if values is not None}

    def euler_deg(self) -> Array:
        """Roll, pitch, heading (n, 3), degrees."""
        if self.q_nb is None:
            raise ValueError("this track has no attitude")
        return np.degrees(np.stack(attitude.numeric.to_euler(self.q_nb), axis=-1))


@dataclass(frozen=True, repr=False)
class Result:
    """The result of one estimator in one run.

    time (n,) s: of the records.  outputs: the estimator's outputs at these times, by row name.
    errors: (n,) by channel.  sigma: standard deviations that the estimator states, likewise; empty if it states none.
    limit: by channel, the smallest standard deviation that any method can have (`insenv.evaluation.limits`), as root mean
        square over the records from `from_s` on; empty if there is none.
    from_s: start of the statistics.  us_per_sample: processor time of the estimator per inertial sample, microseconds.
    settled: False for a run shorter than the estimator needs: its errors are then not compared with a limit.
    health: how well a filter fits its fixes; None if it does not report it, or if no fix came.
    limit_sigma: the limit at the recorded times, (n,) by channel; empty if there is none.
    unit: on a turntable, the errors of the inertial unit that the estimator found.
    outages: errors where fixes were withheld; None if none were.  reference_sigma: stated of the reference, by channel.
    specific_force: how the attitude, and that of the reference, fit the velocities of the receiver; None without these.
    """

    estimator: str
    time: Array
    outputs: dict[str, Array]
    errors: dict[str, Array]
    sigma: dict[str, Array]
    limit: dict[str, float]
    from_s: float
    us_per_sample: float
    notes: tuple[Remark, ...] = ()
    health: Health | None = None
    settled: bool = True
    limit_sigma: dict[str, Array] = field(default_factory=dict)
    unit: tuple[UnitError, ...] = ()
    outages: Outages | None = None
    specific_force: SpecificForce | None = None
    reference_sigma: dict[str, float] = field(default_factory=dict)

    def statistics(self) -> dict[str, dict[str, float]]:
        """Final error, rms and max (largest magnitude) by channel; rms and max over the times from `from_s` on."""
        late = self._late
        return {
            "final": {name: float(e[-1]) for name, e in self.errors.items()},
            "rms": rms(self.errors, late),
            "max": {name: float(np.max(np.abs(e[late]))) for name, e in self.errors.items()},
        }

    def stated(self) -> dict[str, float]:
        """Root mean square of the standard deviations that the estimator states, by channel, over the same times as `rms`."""
        return rms({name: self.sigma[name] for name in self.errors if name in self.sigma}, self._late)

    def judged(self) -> Result:
        """The result with the notes that follow from its errors, and without a limit of `unjudged` ones."""
        limit = {name: value for name, value in self.limit.items() if name not in self.unjudged}
        return replace(self, limit=limit, notes=(*self.notes, *self.steep(), *self.too_sure()))

    @property
    def doubts(self) -> tuple[str, ...]:
        """The codes of the notes that contradict the estimate."""
        return tuple(dict.fromkeys(note.code for note in self.notes if isinstance(note, Doubt)))

    @property
    def unjudged(self) -> tuple[str, ...]:
        """Errors that are none of the attitude: roll and heading, where the pitch comes near 90 deg."""
        return ("roll_deg", "heading_deg") if self.steep() else ()

    @remark(
        "steep-pitch",
        "the pitch comes to {pitch:.3g} deg: errors of roll and heading are differences of Euler angles, which near "
        "90 deg are large even if the attitude is right, and are not judged here",
    )
    def steep(self) -> dict[str, Any] | None:
        """The pitch comes near 90 deg, where a small turn changes roll and heading by any angle."""
        if "pitch_deg" not in self.errors or "q_nb" not in self.outputs:
            return None
        true_deg = np.degrees(attitude.numeric.to_euler(self.outputs["q_nb"])[1]) - self.errors["pitch_deg"]
        pitch = np.abs(true_deg[self._late])
        numbers = steep_pitch(np.max(pitch, initial=0.0))
        return numbers if numbers["said"] else None

    def too_sure(self) -> tuple[Remark, ...]:
        """An rms error is more than `TOO_SURE` times its stated sigma; not said of a run that is too short."""
        stated = {k: hypot(s, self.reference_sigma.get(k, 0.0)) for k, s in self.stated().items() if k not in self.unjudged}
        return too_sure(self.statistics()["rms"], stated) if self.settled else ()

    def against_reference(self) -> Result:
        """The result with what the reference of its log contradicts, unless the log contradicts that; the verdict says it."""
        if self.specific_force is not None and self.specific_force.contradicted:
            return self
        notes = (*self.notes, *self.reference_contradicts())
        return replace(self, notes=notes, health=None if self.health is None else self.health.doubted(notes))

    @remark(
        "reference-contradicts",
        "the reference contradicts the estimate: {what} differs by more than 3 stated sigmas for {share} % of the time; the "
        "stated sigmas are too small, unless the reference errs by as much",
        Doubt,
    )
    def reference_contradicts(self) -> dict[str, Any] | None:
        """An error is beyond `BEYOND` stated sigmas for more than `BEYOND_SHARE` of the time; not said of a run too short."""
        shares = {name: self.beyond(name) for name in self.errors if name in self.sigma and name not in self.unjudged}
        worst = max(shares, key=lambda name: shares[name], default="")
        if not self.settled or not worst or shares[worst] <= BEYOND_SHARE:
            return None
        return {"what": worst.rpartition("_")[0], "share": f"{100 * shares[worst]:.0f}"}

    def beyond(self, name: str) -> float:
        """Share of the time from `from_s` on with an error beyond `BEYOND` sigmas of estimate and reference together."""
        sigma = np.hypot(self.sigma[name], self.reference_sigma.get(name, 0.0))
        return float(np.mean((np.abs(self.errors[name]) > BEYOND * sigma)[self._late]))

    @property
    def _late(self) -> Any:
        return self.time >= self.from_s - 1e-9

    def __repr__(self) -> str:
        final = []
        if "heading_deg" in self.errors:
            final.append(f"heading {self.errors['heading_deg'][-1]:.3g} deg")
        if position := [self.errors[name][-1] for name in POSITION if name in self.errors]:
            final.append(f"position {np.linalg.norm(position):.3g} m")
        return f"{self.estimator}: final error {', '.join(final)}" if final else f"{self.estimator}: no reference"


# Rules of numbers or symbols: Python evaluates them after a run, a live page runs them compiled (`insenv.web.judging`).


def steep_pitch(pitch: Any) -> dict[str, Any]:
    """Whether the largest pitch of a run, deg, is near 90 deg."""
    return {"said": pitch > STEEP, "pitch": pitch}


def larger_error(rms: Any, stated: Any) -> dict[str, Any]:
    """Whether an rms error is more than `TOO_SURE` times its stated sigma, unless that is 0, and the ratio of the two."""
    return {"said": (stated > 0.0) * (stated * TOO_SURE < rms), "ratio": rms / select(stated > 0.0, stated, 1.0)}


RATIO = "{what} {ratio:.3g}"
"""One of the `ratios` of "too-sure"; what: its channel without the unit."""


@remark("too-sure", "the errors are larger than this estimator states, rms over stated sigma: {ratios}")
def too_sure(rms: Mapping[str, float], stated: Mapping[str, float]) -> dict[str, str] | None:
    """Rms errors that are more than `TOO_SURE` times the stated sigma, by channel."""
    numbers = {name: larger_error(rms[name], sigma) for name, sigma in stated.items()}
    worst = [filled(RATIO, {"what": name.rpartition("_")[0], **each}) for name, each in numbers.items() if each["said"]]
    return {"ratios": ", ".join(worst)} if worst else None


def rms(channels: Mapping[str, Array], where: Any = ...) -> dict[str, float]:
    """Root mean square of each channel over the times `where` (an index)."""
    return {name: float(np.sqrt(np.mean(values[where] ** 2))) for name, values in channels.items()}


def track_of(times: Array, rows: dict[str, Array]) -> Track:
    """The track of outputs by row name; rows that are missing are None."""
    return Track(times, **{name: rows.get(name) for name in ("q_nb", "velocity_n", "latitude", "longitude", "height")})


def errors(estimate: Track, truth: Track) -> dict[str, Array]:
    """Errors (estimate minus truth) by channel, for the quantities of both tracks, which have the same times."""
    by_channel: dict[str, Array] = {}
    if estimate.q_nb is not None and truth.q_nb is not None:
        by_channel.update(zip(ATTITUDE, wrapped_deg(estimate.euler_deg() - truth.euler_deg()).T, strict=True))
    if estimate.latitude is not None and truth.latitude is not None:
        places = [(t.latitude, t.longitude, t.height) for t in (estimate, truth)]
        by_channel.update(zip(POSITION, geodesy.numeric.position_error(*places[0], *places[1]).T, strict=True))
    if estimate.velocity_n is not None and truth.velocity_n is not None:
        by_channel.update(zip(VELOCITY, (estimate.velocity_n - truth.velocity_n).T, strict=True))
    return by_channel


def stated_sigma(outputs: dict[str, Array]) -> dict[str, Array]:
    """Standard deviations by channel, from an estimator's outputs `attitude_sigma` (rad about n), `position_sigma` and
    `velocity_sigma`.

    The heading converts misalignments about north and east to roll and pitch; this does not hold near 90 deg of
    pitch.
    """
    sigma: dict[str, Array] = {}
    if "attitude_sigma" in outputs:
        heading = attitude.numeric.to_euler(outputs["q_nb"])[2]
        north, east, down = np.degrees(outputs["attitude_sigma"]).T
        c, s = np.cos(heading) ** 2, np.sin(heading) ** 2
        sigma.update(
            zip(ATTITUDE, (np.sqrt(north**2 * c + east**2 * s), np.sqrt(north**2 * s + east**2 * c), down), strict=True)
        )
    for names, row in ((POSITION, "position_sigma"), (VELOCITY, "velocity_sigma")):
        if row in outputs:
            sigma.update(zip(names, outputs[row].T, strict=True))
    return sigma


def wrapped_deg(angle_deg: Array) -> Array:
    """Angles in degrees wrapped to -180 (included) to 180."""
    return (angle_deg + 180.0) % 360.0 - 180.0


# Errors and stated standard deviations by channel as symbols, for models that evaluate them at run time.
#
# The formulas are those of `insenv.evaluation.errors`, which evaluates them in NumPy after a run.

DEGREES = 180.0 / pi
_GROUPS = (
    (ATTITUDE, "q_nb", "attitude_sigma"),
    (POSITION, "latitude", "position_sigma"),
    (VELOCITY, "velocity_n", "velocity_sigma"),
)


def channels_of(outputs: Table) -> tuple[str, ...]:
    """The channels of an estimator with these outputs."""
    return tuple(name for names, row, _ in _GROUPS if row in outputs for name in names)


def stated_of(outputs: Table) -> tuple[str, ...]:
    """Those of `channels_of` whose standard deviation the estimator states."""
    return tuple(name for names, row, sigma in _GROUPS if row in outputs and sigma in outputs for name in names)


def error_of(channels: Sequence[str], estimate: Values, truth: Values) -> Any:
    """Estimate minus truth by channel (deg, m, m/s); estimate, truth: outputs by row name."""
    parts = []
    if "roll_deg" in channels:
        angles = zip(attitude.to_euler(estimate.q_nb), attitude.to_euler(truth.q_nb), strict=True)
        parts += [DEGREES * wrap_angle(angle - true) for angle, true in angles]
    if "north_m" in channels:
        places = [(v.latitude, v.longitude, v.height) for v in (estimate, truth)]
        parts.append(geodesy.position_error(*places[0], *places[1]))
    if "vn_mps" in channels:
        parts.append(estimate.velocity_n - truth.velocity_n)
    return ca.vertcat(*parts)


def sigma_of(stated: Sequence[str], estimate: Values) -> Any:
    """The standard deviation that an estimator states, by channel (deg, m, m/s); estimate: its outputs by row name."""
    parts = []
    for names, _, row in _GROUPS:
        if names[0] not in stated:
            continue
        sigma = getattr(estimate, row)
        if names is ATTITUDE:
            s, c = sin_cos(attitude.to_euler(estimate.q_nb)[2])
            north, east = sigma[0] * sigma[0], sigma[1] * sigma[1]
            level = (north * c * c + east * s * s, north * s * s + east * c * c)
            sigma = DEGREES * ca.vertcat(*(ca.sqrt(square) for square in level), sigma[2])
        parts.append(sigma)
    return ca.vertcat(*parts)


# Normalised estimation error squared (NEES), e^T P^-1 e, of estimators with a covariance, as a symbolic expression.
#
# The NEES of a consistent filter has a mean equal to the number of states compared.


def normalised(error: Any, P: Any) -> Any:
    """e^T P^-1 e of a column (k,) and a symmetric positive definite matrix (k, k), by elimination (P = L D L^T)."""
    total = error[0] * error[0] / P[0, 0]
    while error.shape[0] > 1:
        column = P[1:, 0] / P[0, 0]
        error, P = error[1:] - column * error[0], P[1:, 1:] - P[0, 0] * (column @ column.T)
        total = total + error[0] * error[0] / P[0, 0]
    return total


def nees(estimator: Estimator, x: Values, outputs: Values, truth: Values) -> tuple[Any, int]:
    """NEES of an estimator and its degrees of freedom; (None, 0) if it has no covariance.

    x, outputs: the estimator's state and outputs by row name.  truth: the plant's rows.  The error is
    `Estimator.error`, or, for an estimator without it, that of the attitude.
    """
    if estimator.error is not None:
        error, P = estimator.error(x, outputs, truth)
    elif hasattr(outputs, "attitude_covariance"):
        error, P = attitude.error_rotation_vector(outputs.q_nb, truth.q_nb), outputs.attitude_covariance
    else:
        return None, 0
    return normalised(error, ca.densify(P)), error.shape[0]


# An estimate that comes from outside insenv: what may be in it, and its checks.
#
# A wrong one is refused in one sentence, so that no error is computed from it.

SHAPES: Mapping[str, tuple[int, ...]] = {
    "q_nb": (4,),
    "velocity_n": (3,),
    "latitude": (),
    "longitude": (),
    "height": (),
    "attitude_sigma": (3,),
    "velocity_sigma": (3,),
    "position_sigma": (3,),
}
"""Rows of an estimate and their shapes, as estimators have them as outputs: rad, m/s, m; sigma of the attitude about n."""
_LIMITS = {"latitude": np.pi / 2, "longitude": 2 * np.pi, "height": 1e7, "velocity_n": 1e5}
_POSITION = ("latitude", "longitude", "height")
NORM = 0.01
"""Largest difference of the norm of a quaternion from 1: beyond it something else was sent."""
ROUNDING = 1e-12
"""A norm that differs from 1 by less is left as it is: so are the bits of a quaternion that was normalised."""
ORTHONORMAL = 1e-3
"""Largest element of C^T C - I of a matrix."""


def checked_estimate(returned: Any) -> dict[str, Array]:
    """An estimate by row name.  Raises `InputError` that names the row, its value and what is allowed.

    returned: q_nb (4, scalar first), C_nb (3, 3), a ``scipy.spatial.transform.Rotation`` from b to n, or a dict of `SHAPES` in
    which ``C_nb`` may stand for ``q_nb``.
    """
    values = dict(returned) if isinstance(returned, Mapping) else {"q_nb": returned}
    if "C_nb" in values:
        values["q_nb"] = values.pop("C_nb")
    for name in values:
        if name not in SHAPES:
            raise InputError(f"{name!r}: unknown row of an estimate{nearest(str(name), SHAPES)}")
    some = [name for name in _POSITION if name in values]
    if some and len(some) < len(_POSITION):
        raise InputError(
            f"{', '.join(some)} without {', '.join(n for n in _POSITION if n not in some)}: a position has all three"
        )
    estimate = {name: _quaternion(value) if name == "q_nb" else _row(name, value) for name, value in values.items()}
    if not estimate:
        raise InputError("the estimate is empty: allowed is an attitude, or a dict with it")
    return estimate


def _row(name: str, value: Any) -> Array:
    row = _numbers(name, value, SHAPES[name])
    if name in _LIMITS and np.any(np.abs(row) > _LIMITS[name]):
        raise InputError(f"{name} = {row.tolist()}: allowed is up to {_LIMITS[name]:.6g} in size (rad, m, m/s)")
    if name.endswith("_sigma") and np.any(row < 0.0):
        raise InputError(f"{name} = {row.tolist()}: a standard deviation is not negative")
    return row


def _numbers(name: str, value: Any, *shapes: tuple[int, ...]) -> Array:
    """An array of one of the shapes, finite."""
    try:
        row = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        row = None
    if row is None or row.shape not in shapes:
        what = f"shape {row.shape}" if row is not None else f"type {type(value).__name__}"
        raise InputError(f"{name} has {what}: allowed is {' or '.join(str(shape) for shape in shapes)}")
    if not np.isfinite(row).all():
        raise InputError(f"{name} = {row.tolist()}: allowed are finite numbers")
    return row


def _quaternion(value: Any) -> Array:
    """Unit quaternion q_nb (4,)."""
    if hasattr(value, "as_matrix"):  # scipy's Rotation, whose quaternions are scalar last
        value = value.as_matrix()
    row = _numbers("q_nb", value, (4,), (3, 3))
    if row.shape == (3, 3):
        if np.max(np.abs(row.T @ row - np.eye(3))) > ORTHONORMAL or np.linalg.det(row) < 0.0:
            raise InputError(f"C_nb = {row.round(6).tolist()}: allowed is a rotation matrix, right-handed and orthonormal")
        return np.asarray(attitude.numeric.from_dcm(row))
    norm = float(np.linalg.norm(row))
    if abs(norm - 1.0) > NORM:
        raise InputError(f"q_nb = {row.tolist()} has the norm {norm:.6g}: allowed is 1 within {NORM:g}")
    return row if abs(norm - 1.0) < ROUNDING else row / norm

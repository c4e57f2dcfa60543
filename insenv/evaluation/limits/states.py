"""The error sources of a plant as states of the optimal filter: variances, drives, and how they enter the navigation errors;
and its aiding instruments as measurements of these states.

A source without variance has no state.  A fixed error (a bias that the data sheet of a scenario gives as a number) counts as
one standard deviation of the ensemble of units, as a drawn one does.  Not counted, because they can only add to the error:
quantization, the range of the sensors, lost samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core.model import Values
from insenv.core.numeric import vectorized
from insenv.core.tables import Array
from insenv.evaluation.limits.steps import DR, DV, NAVIGATION, PSI, REST_MPS, Steps, outages_of
from insenv.sensors import registry
from insenv.sensors.gnss import DELAY, LEVER_ARM, WANDER
from insenv.sensors.imu_tables import COUPLINGS, FLICKER_PARTS, FLICKER_SIGMA, FLICKER_TIMES
from insenv.sensors.instrument import Instrument, Term, errors_of

LEAST_ANGLE_NOISE, LEAST_VELOCITY_NOISE = 1e-9, 1e-7
"""White noise of a unit without any, rad/s^0.5 and m/s^1.5, which keeps the recursion regular."""


@dataclass(frozen=True)
class Source:
    """k states of one kind.

    name: of the kind.  triad: 0 gyros, 1 accelerometers, 2 both, None neither.  place (k,): which of the kind's components
    the states are.  variance (k,): at time 0.  walk (k,): variance per second of a random walk.  time (k,): correlation time
    of a stationary Gauss-Markov process, s; infinite: none.
    """

    name: str
    triad: int | None
    place: NDArray[np.int64]
    variance: Array
    walk: Array
    time: Array


@dataclass(frozen=True)
class Unit:
    """The inertial unit, with the gravity that it measures: its sources, its white noise and its temperature.

    noise (2, 3): white noise of gyros (rad/s^0.5) and accelerometers (m/s^1.5), s.  C_bs (3, 3): from sensor to body axes.
    temperatures: initial, final and reference temperature (K), time constant (s) and ramp (K/s).
    """

    sources: tuple[Source, ...]
    noise: Array
    C_bs: Array
    temperatures: tuple[float, ...]


def unit_of(rows: Mapping[str, Any]) -> Unit:
    """The inertial unit of a plant's parameters by row name (SI)."""

    def row(name: str, size: int) -> Array:
        return np.broadcast_to(np.asarray(rows.get(name, 0.0), dtype=float).ravel(), size)

    sources: list[Source | None] = []
    shortest = 0.5 * float(rows.get("drift_interval", 1.0))  # the plant interpolates between values this far apart, twice
    for triad, name in enumerate(("gyro", "accel")):
        turn_on = row(f"{name}_bias", 3) ** 2 + row(f"{name}_bias_sigma", 3) ** 2
        sources.append(source("bias", triad, turn_on, walk=row(f"{name}_rate_random_walk", 3) ** 2))
        times = np.maximum(row(f"{name}_instability_time", 3), shortest)
        sources.append(source("in-run bias", triad, row(f"{name}_instability_sigma", 3) ** 2, time=times))
        floor = FLICKER_SIGMA * row(f"{name}_flicker", 3)
        sources += [
            source(f"flicker {part}", triad, floor**2, time=np.full(3, FLICKER_TIMES[part])) for part in range(FLICKER_PARTS)
        ]
        sources.append(source("thermal bias", triad, row(f"{name}_temperature_slope", 3) ** 2))
        sources.append(source("thermal scale factor", triad, row(f"{name}_scale_factor_slope", 3) ** 2))
        fixed, drawn = (
            _matrix(row(f"{name}_scale_factor{part}", 3) ** 2, row(f"{name}_misalignment{part}", 6) ** 2)
            for part in ("", "_sigma")
        )
        time = float(rows.get(f"{name}_scale_factor_time", 0.0))
        sources.append(source("matrix", triad, fixed if time > 0.0 else fixed + drawn))
        if time > 0.0:
            sources.append(source("drifting matrix", triad, drawn, time=np.full(9, max(time, shortest))))
    sources.append(source("g-sensitivity", 0, row("gyro_g_sensitivity", 9) ** 2))
    sources.append(source("gravity", None, row("gravity_disturbance_n", 3) ** 2))
    sources.append(source("mounting", 2, row("mounting_error", 3) ** 2 + row("mounting_error_sigma", 3) ** 2))
    q_bs = np.asarray(rows.get("q_bs", (1.0, 0.0, 0.0, 0.0)), dtype=float)
    white = [
        np.maximum(np.abs(row("angle_random_walk", 3)), LEAST_ANGLE_NOISE),
        np.maximum(np.abs(row("velocity_random_walk", 3)), LEAST_VELOCITY_NOISE),
    ]
    usual = {"initial": 293.15, "final": 293.15, "reference": 293.15, "time": 600.0, "ramp": 0.0}
    return Unit(
        sources=tuple(source for source in sources if source is not None),
        noise=np.array(white),
        C_bs=attitude.numeric.to_dcm(q_bs / np.linalg.norm(q_bs)),
        temperatures=tuple(float(rows.get(f"imu_temperature_{name}", value)) for name, value in usual.items()),
    )


def _matrix(diagonal: Array, coupling: Array) -> Array:
    """A 3x3 matrix by rows (9,) with this diagonal (3,) and these `COUPLINGS` (6,)."""
    matrix = np.diag(diagonal)
    matrix[tuple(zip(*COUPLINGS, strict=True))] = coupling
    return matrix.ravel()


def receiver_of(rows: Mapping[str, Any]) -> tuple[Source, ...]:
    """The slowly varying error of the fixes (n, m), that of the lever arm (b, m) and of the delay (s) of a plant's receiver."""
    return _sources({term.name.replace("_", " "): term for term in (WANDER, LEVER_ARM, DELAY)}, rows)


def _sources(terms: Mapping[str, Term], rows: Mapping[str, Any]) -> tuple[Source, ...]:
    """The states of errors by name with these parameters, those that vary."""
    sources = []
    for name, term in terms.items():
        time = None if term.time is None else np.broadcast_to(np.asarray(rows[term.time.name], dtype=float), term.size)
        sources.append(source(name, None, term.variance(rows), time=time))
    return tuple(each for each in sources if each is not None)


def constants(name: str, variance: Array) -> Source:
    """States that do not change, such as the place of a mooring; `variance` (k,) > 0."""
    made = source(name, None, variance)
    assert made is not None
    return made


def source(
    name: str, triad: int | None, variance: Array, walk: Array | None = None, time: Array | None = None
) -> Source | None:
    """The states of one kind, those of its components (k,) that vary; None if none does."""
    walk = np.zeros_like(variance) if walk is None else walk
    time = np.full_like(variance, np.inf) if time is None else time
    (place,) = np.nonzero((variance > 0.0) | (walk > 0.0))
    return Source(name, triad, place, variance[place], walk[place], time[place]) if place.size else None


def entering(source: Source, unit: Unit, steps: Steps, force: Array) -> Array:
    """How the states enter over each step (m, 6, k): integrals of the gyros' error (rad) and of that of the accelerometers
    (m/s) in n, by state.

    force (m, 3, 3, 3): as `Steps.force`; at rest that of gravity alone.
    """
    columns = np.zeros((len(steps.time), 6, source.place.size))
    if source.name == "gravity":  # the estimate lacks it
        columns[:, 3:] = -np.eye(3)[:, source.place] * steps.length[:, None, None]
    if source.triad is None:
        return columns
    for triad in (0, 1) if source.triad == 2 else (source.triad,):
        increments = steps.angle if triad == 0 else force
        columns[:, 3 * triad : 3 * triad + 3] = _columns(source, unit, steps, increments, force)
    return columns


def _columns(source: Source, unit: Unit, steps: Steps, increments: Array, force: Array) -> Array:
    if source.name in ("bias", "in-run bias") or source.name.startswith("flicker"):
        columns = steps.C_ns
    elif source.name == "thermal bias":
        columns = steps.C_ns * _warmth(unit, steps)
    elif source.name == "thermal scale factor":
        columns = increments.reshape(-1, 3, 9)[:, :, [0, 4, 8]] * _warmth(unit, steps)
    elif source.name in ("matrix", "drifting matrix"):
        columns = increments.reshape(-1, 3, 9)
    elif source.name == "g-sensitivity":
        columns = force.reshape(-1, 3, 9)
    else:  # mounting: the increments d are sensed as d + d x e
        columns = np.einsum("mnkj,kjl->mnl", increments, _CROSS)
    return np.asarray(columns[:, :, source.place])


def _warmth(unit: Unit, steps: Steps) -> Array:
    """Temperature of the unit in the middle of each step above that of reference, K (m, 1, 1)."""
    initial, final, reference, constant, ramp = unit.temperatures
    middle = steps.time - steps.length / 2
    warmth = final + ramp * middle + (initial - final) * np.exp(-middle / constant) - reference
    return np.asarray(warmth)[:, None, None]


_CROSS = np.zeros((3, 3, 3))
"""(d x e)_k = sum over j and l of _CROSS[k, j, l] d_j e_l."""
for _k, _j, _l in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_k, _j, _l], _CROSS[_k, _l, _j] = 1.0, -1.0


# What is known of a vehicle that stays in place: it rests, or it sways about a place.
#
# At rest the velocity is measured as 0.  A moored ship cannot be said to stand still: its heave moves it by metres.  What is
# known is that its displacement from an unknown place is a sum of oscillations, of which the frequencies are known, and
# neither amplitude nor phase on any axis.  On the known axes alone the sway would be a compass.

REST_SIGMA = 1e-5
"""Standard deviation of the velocity of a vehicle at rest, m/s, in each step."""
SWAY_SIGMA = 1e-4
"""Standard deviation of the displacement of a moored vehicle from its place and sway, m, in each step."""
PLACE_SIGMA = 100.0
"""Standard deviation of the place of a mooring, m: nothing is known of it but the initial position."""
_ANGLES, _DISPLACEMENTS = ("roll", "pitch", "yaw"), ("north", "east", "down")
_LEAST_LENGTH, _LEAST_ANGLE = 1e-4, 1e-4
"""Smallest amplitudes, m and rad, of a frequency that counts as sway."""


@dataclass(frozen=True)
class Mooring:
    """A sway: angular frequencies (k,), rad/s, and the standard deviation of each sinusoid's coefficients, m."""

    frequencies: Array
    sigma: float

    def sources(self) -> tuple[Source, Source]:
        """The place (3), and the coefficients of cosine and sine by frequency and axis n (k x 2 x 3)."""
        count = 6 * len(self.frequencies)
        return constants("place", np.full(3, PLACE_SIGMA**2)), constants("sway", np.full(count, self.sigma**2))

    def rows(self, time: Array) -> Array:
        """The displacement by the states of `sources`, (m, 3, 3 + 6 k), at times (m,)."""
        angle = time[:, None] * self.frequencies
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(len(time), 1, -1, 1)
        axes = np.eye(3)
        sway = (waves * axes[:, None]).reshape(len(time), 3, -1)
        return np.concatenate([np.broadcast_to(axes, (len(time), 3, 3)), sway], axis=2)


def mooring_of(rows: Mapping[str, Any]) -> Mooring | None:
    """The sway of a vehicle that stays in place, from a plant's parameters by row name (SI); None if it rests.

    Frequencies are those of all its sinusoids (rows ``*_angular_frequency`` and ``*_amplitude``), of rotations too: a ship
    that rolls at a frequency moves at it.  Without that frequency the limit would distinguish accelerometer biases, which turn
    with the ship, from tilts, which do not.
    """
    arm = float(np.linalg.norm(rows.get("imu_lever_arm_b", 0.0)))
    moved: dict[float, float] = {}  # sum of the amplitudes, m, by angular frequency
    turned: dict[float, float] = {}  # the same, rad
    for name, value in rows.items():
        bank = name.removesuffix("_angular_frequency")
        if bank == name:
            continue
        frequencies = np.atleast_1d(np.asarray(value, dtype=float))
        for motion in (*_ANGLES, *_DISPLACEMENTS):
            amplitude = rows.get(f"{motion}_amplitude" if bank == motion else f"{bank}_{motion}_amplitude", 0.0)
            sizes = np.abs(np.broadcast_to(amplitude, frequencies.shape)).tolist()
            for frequency, size in zip(frequencies.tolist(), sizes, strict=True):
                turns = motion in _ANGLES
                turned[frequency] = turned.get(frequency, 0.0) + (size if turns else 0.0)
                moved[frequency] = moved.get(frequency, 0.0) + (arm * size if turns else size)
    if np.sqrt(sum((w * length) ** 2 for w, length in moved.items()) / 2.0) < REST_MPS / 2:
        return None
    swaying = [w for w, length in moved.items() if length > _LEAST_LENGTH or turned[w] > _LEAST_ANGLE]
    return Mooring(np.array(sorted(swaying)), float(np.linalg.norm(list(moved.values()))))


# The aiding instruments as measurements of the error states: their measurement equations, differentiated along the truth.
#
# Errors of navigation are those of `insenv.evaluation.limits.steps`, estimate minus truth.  Of the epochs within a step, the
# white noises are averaged and the measurement is applied at the end of the step, at most 0.1 s later.  The latency, which only
# delays what is known, is not counted, nor is rounding beyond its variance.

NOISE_FLOOR = 0.01
"""Smallest standard deviation of a measurement here, as a share of that which a filter takes of a perfect instrument."""


class DisturbedMotion:
    """The true motion with a small error (9: psi, dv, dr in e), as instruments see it (`insenv.sensors.instrument.Motion`).

    What it does to the climb and to the displacement from the start is left out.  C_en, C_nb (3 x 3); velocity_n, rate_b,
    force_b, displacement_n (3); height, climbed.
    """

    def __init__(self, error: Any, C_en: Any, C_nb: Any, velocity_n: Any, rate_b: Any, **motion: Any) -> None:
        self._C_en, self._rate_b = C_en, rate_b
        self._C_eb = (ca.SX.eye(3) + skew(error[PSI])) @ C_en @ C_nb
        self._velocity_e = C_en @ velocity_n + error[DV]
        self.specific_force_b = motion["force_b"]
        self.height = motion["height"] - ca.dot(C_en[:, 2], error[DR])
        self.climbed = motion["climbed"]
        self.displacement_n = motion["displacement_n"]

    @property
    def speed_squared(self) -> Any:
        return ca.sumsqr(self._velocity_e)

    def to_body(self, vector_n: Any) -> Any:
        return self._C_eb.T @ (self._C_en @ vector_n)

    def to_navigation(self, vector_b: Any) -> Any:
        return self._C_en.T @ (self._C_eb @ vector_b)

    def body_velocity(self, arm_b: Any, flow_n: Any = None) -> Any:
        velocity_e = self._velocity_e if flow_n is None else self._velocity_e - self._C_en @ flow_n
        return self._C_eb.T @ velocity_e + ca.cross(self._rate_b, arm_b)


@dataclass(frozen=True)
class Aid:
    """An instrument along a trajectory: its sources, its white noise (r,), when it measures, and its sensitivity.

    sensitivity: from arrays of the true motion at m instants to the derivatives (m, r, 9 + elements of all sources).
    interval: inertial samples.  outages (k, 2): begin and end, s.  sample_interval: s.  place: of the start (rad, m).
    """

    id: str
    sources: tuple[Source, ...]
    columns: Mapping[str, slice]
    noise: Array
    sensitivity: Callable[..., Array]
    interval: int
    outages: Array
    sample_interval: float
    place: tuple[float, float, float]

    def epochs(self, begin: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number of its epochs after sample `begin` up to sample `end`, for each of m steps."""
        count = end // self.interval - begin // self.interval
        for first, last in self.outages:
            if last > first:  # epochs k with first <= k interval < last
                low, high = (int(np.ceil(t / (self.interval * self.sample_interval) - 1e-6)) for t in (first, last))
                lost = np.minimum(end // self.interval, high - 1) - np.maximum(begin // self.interval, low - 1)
                count = count - np.maximum(lost, 0)
        return np.asarray(np.maximum(count, 0))

    def linear(self, steps: Steps, C_en: Array) -> tuple[Array, dict[str, Array]]:
        """How the measurement at the end of each of m steps follows the errors of navigation (m, r, 9), and by name of a source
        its elements (m, r, all elements)."""
        C_nb = attitude.numeric.to_dcm(steps.q_nb)
        rate_b, force_b = (
            (C_nb.swapaxes(1, 2) @ each[..., None])[..., 0] for each in (steps.rate_n, steps.thrust / steps.length[:, None])
        )
        latitude, longitude, height = self.place
        R_M, R_N = geodesy.numeric.radii(np.sin(steps.latitude))
        east = np.angle(np.exp(1j * (steps.longitude - longitude))) * (R_N + steps.height) * np.cos(steps.latitude)
        displacement = np.stack([(steps.latitude - latitude) * (R_M + steps.height), east, height - steps.height], axis=1)
        sensitivity = self.sensitivity(C_en, C_nb, steps.velocity_n, rate_b, force_b, steps.height, displacement)
        H = sensitivity.reshape(len(steps.time), -1, sensitivity.shape[-1])
        return H[..., :NAVIGATION], {name: H[..., columns] for name, columns in self.columns.items()}


def aids_of(rows: Mapping[str, Any], sample_interval: float) -> tuple[Aid, ...]:
    """The instruments of a plant's parameters by row name (SI)."""
    ids = [id for id in registry.names() if f"{id}_interval" in rows]
    instruments = [instrument for id in ids if (instrument := registry.instrument(id)) is not None]
    return tuple(aid_of(instrument, rows, sample_interval) for instrument in instruments)


def aid_of(instrument: Instrument, rows: Mapping[str, Any], sample_interval: float) -> Aid:
    """An instrument with these parameters."""
    id, row = instrument.id, instrument.limiting
    terms = {f"{id} {term.name.replace('_', ' ')}": term for term in instrument.terms if term.kind != "white"}
    columns, begin = {}, NAVIGATION
    for name, term in terms.items():
        columns[name] = slice(begin, begin + term.size)
        begin += term.size
    noise = instrument.noise.variance(rows)
    if instrument.quantum is not None:
        noise = noise + float(rows[instrument.quantum.name]) ** 2 / 12.0
    if instrument.outlier is not None:  # a detected outlier is a measurement that is missing
        noise = noise / max(1.0 - float(rows[instrument.outlier.probability]), 1e-12)
    latitude, longitude, height = (float(np.ravel(rows[f"start_{name}"])[0]) for name in ("latitude", "longitude", "height"))
    return Aid(
        id=id,
        sources=_sources(terms, rows),
        columns=columns,
        noise=np.maximum(np.sqrt(np.broadcast_to(noise, row.size)), NOISE_FLOOR * instrument.least_sigma.get(row.name, 0.0)),
        sensitivity=_sensitivity(instrument, list(terms.values()), rows, height),
        interval=round(float(rows[f"{id}_interval"]) / sample_interval),
        outages=outages_of(id, rows),
        sample_interval=sample_interval,
        place=(latitude, longitude, height),
    )


def _sensitivity(
    instrument: Instrument, terms: list[Term], rows: Mapping[str, Any], start_height: float
) -> Callable[..., Array]:
    """Derivatives of what the instrument shows with these parameters by the errors of navigation, then by those of `terms`."""
    p = Values(**{row.name: ca.DM(np.asarray(rows[row.name], dtype=float)) for row in instrument.all_parameters})

    def derivatives(C_en: Any, C_nb: Any, velocity_n: Any, rate_b: Any, force_b: Any, height: Any, displacement_n: Any) -> Any:
        error = ca.SX.sym("error", NAVIGATION + sum(term.size for term in terms))
        motion = DisturbedMotion(
            error, C_en, C_nb, velocity_n, rate_b, force_b=force_b, height=height, climbed=height - start_height,
            displacement_n=displacement_n,
        )  # fmt: skip
        values, begin = {}, NAVIGATION
        for term in terms:
            part = error[begin : begin + term.size]
            values[term.name] = ca.reshape(part, *term.shape[::-1]).T if len(term.shape) == 2 else part
            begin += term.size
        shown = instrument.measure(motion, errors_of(instrument, values), p)[instrument.limiting.name]
        return ca.substitute(ca.jacobian(shown, error), error, ca.SX.zeros(error.numel()))

    return vectorized(derivatives, (3, 3), (3, 3), 3, 3, 3, (), 3)

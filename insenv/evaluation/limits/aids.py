"""The aiding instruments as measurements of the error states: their measurement equations, differentiated along the truth.

Errors of navigation are those of `insenv.evaluation.limits.steps`, estimate minus truth.  Of the epochs within a step, the
white noises are averaged and the measurement is applied at the end of the step, at most 0.1 s later.  The latency, which only
delays what is known, is not counted, nor is rounding beyond its variance.
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
from insenv.evaluation.limits.states import Source, source
from insenv.evaluation.limits.steps import DR, DV, NAVIGATION, PSI, Steps
from insenv.sensors import registry
from insenv.sensors.instrument import Instrument, Term, errors_of

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
    terms = [term for term in instrument.terms if term.kind != "white"]
    columns, begin = {}, NAVIGATION
    for term in terms:
        columns[_name(instrument, term)] = slice(begin, begin + term.size)
        begin += term.size
    sources = [source(_name(instrument, term), None, term.variance(rows), time=_times(term, rows)) for term in terms]
    noise = instrument.noise.variance(rows)
    if instrument.quantum is not None:
        noise = noise + float(rows[instrument.quantum.name]) ** 2 / 12.0
    if instrument.outlier is not None:  # a detected outlier is a measurement that is missing
        noise = noise / max(1.0 - float(rows[instrument.outlier.probability]), 1e-12)
    windows = np.stack([np.ravel(rows[f"{id}_outage_{end}"]) for end in ("start", "end")], axis=1).astype(float)
    latitude, longitude, height = (float(np.ravel(rows[f"start_{name}"])[0]) for name in ("latitude", "longitude", "height"))
    return Aid(
        id=id,
        sources=tuple(each for each in sources if each is not None),
        columns=columns,
        noise=np.maximum(np.sqrt(np.broadcast_to(noise, row.size)), NOISE_FLOOR * instrument.least_sigma.get(row.name, 0.0)),
        sensitivity=_sensitivity(instrument, terms, rows, height),
        interval=round(float(rows[f"{id}_interval"]) / sample_interval),
        outages=windows,
        sample_interval=sample_interval,
        place=(latitude, longitude, height),
    )


def _name(instrument: Instrument, term: Term) -> str:
    return f"{instrument.id} {term.name.replace('_', ' ')}"


def _times(term: Term, rows: Mapping[str, Any]) -> Array | None:
    return None if term.time is None else np.broadcast_to(np.asarray(rows[term.time.name], dtype=float), term.size)


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

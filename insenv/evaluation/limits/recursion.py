"""The Riccati recursion: the covariance of the optimal filter, linearised on the truth, from step to step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.core.tables import Array
from insenv.evaluation.limits.states import REST_SIGMA, SWAY_SIGMA, Aid, Mooring, Source, Unit, entering
from insenv.evaluation.limits.steps import (
    DR,
    DV,
    NAVIGATION,
    PSI,
    Fixes,
    Steps,
    earth_axes,
    euler_jacobian,
    integrals,
    local,
)

UNIFORM = np.pi / np.sqrt(3.0)
"""Standard deviation of an angle of which nothing is known, rad."""


@dataclass(frozen=True)
class Prior:
    """The initial uncertainty: standard deviations of roll, pitch and heading (3, rad), velocity (3, m/s) and position
    (3, m), in n."""

    attitude: Array
    velocity: Array
    position: Array


@dataclass(frozen=True)
class Layout:
    """The states after the navigation errors: those of the unit, of the receiver, of the other instruments, and the mooring."""

    unit: Unit
    receiver: tuple[Source, ...]
    fixes: Fixes | None
    mooring: Mooring | None
    aids: tuple[Aid, ...] = ()

    @property
    def sources(self) -> tuple[Source, ...]:
        """All sources, in the order of their states."""
        of_aids = (source for aid in self.aids for source in aid.sources)
        moored = () if self.mooring is None else self.mooring.sources()
        return (*self.unit.sources, *self.receiver, *of_aids, *moored)

    def matrix(self, sources: Iterable[Source], navigation: Array, by_source: Mapping[str, Array]) -> Array:
        """A measurement matrix (m, r, states).

        navigation (m, r, 9): by the errors of navigation.  by_source (m, r, components): by those of `sources`, by name.
        """
        H = np.zeros((*navigation.shape[:2], NAVIGATION + sum(source.place.size for source in self.sources)))
        H[:, :, :NAVIGATION] = navigation
        for source in sources:
            H[:, :, self.place(source)] = by_source[source.name][:, :, source.place]
        return H

    def place(self, source: Source) -> slice:
        """The states of a source."""
        begin = NAVIGATION
        for other in self.sources:
            if other is source:
                return slice(begin, begin + other.place.size)
            begin += other.place.size
        raise ValueError(f"no source {source.name!r}")


def recursion(blocks: Iterable[Steps], layout: Layout, prior: Prior) -> Iterable[tuple[Array, Array]]:
    """Times (m,) and standard deviations (m, 12) of roll, pitch, heading (rad), velocity (m/s), position (m), and of the
    attitude as a rotation (rad) about the axes n, block by block; the first time is 0.

    The covariance at a time is that after everything delivered by then.  A fix is applied at its epoch; up to its delivery
    the recorded covariance is a copy without it.
    """
    filter_ = None
    for steps in blocks:
        if filter_ is None:
            filter_ = CovarianceFilter(layout, prior, steps)
            yield np.zeros(1), filter_.start
        yield steps.time, filter_.block(steps)


@dataclass(frozen=True)
class Moves:
    """What m steps do to the s states, navigation errors first, without measurements.

    both (m, 9, s): transition of the navigation errors.  drive (m, 9, 9): covariance that white noise adds to them.
    decay, grown (m, decaying states): of Gauss-Markov processes, factor and added variance.  walked (m, walking states):
    added variance of random walks.
    """

    both: Array
    drive: Array
    decay: Array
    grown: Array
    walked: Array


class CovarianceFilter:
    """The covariance, and the part of it that does not change from block to block."""

    def __init__(self, layout: Layout, prior: Prior, first: Steps) -> None:
        self.layout = layout
        sources = layout.sources
        variance, walk, time = (
            np.concatenate([np.zeros(0), *(getattr(s, name) for s in sources)]) for name in ("variance", "walk", "time")
        )
        self.variance, self.walk, self.time = variance, walk, time
        (self.decaying,) = np.nonzero(np.isfinite(time))
        (self.walking,) = np.nonzero(walk > 0.0)
        W = local(first, earth_axes(first.latitude, first.longitude))[:1]
        J = euler_jacobian(first.q_nb[:1])
        tilts = np.linalg.inv(J[0])
        initial = np.zeros((9, 9))
        initial[PSI, PSI] = tilts @ np.diag(np.minimum(prior.attitude, UNIFORM) ** 2) @ tilts.T
        initial[DV, DV], initial[DR, DR] = np.diag(prior.velocity**2), np.diag(prior.position**2)
        back = np.linalg.inv(W[0])
        self.P = np.zeros((NAVIGATION + len(variance),) * 2)
        self.P[:NAVIGATION, :NAVIGATION] = back @ initial @ back.T
        self.P[NAVIGATION:, NAVIGATION:] = np.diag(variance)
        self.without: Array | None = None  # the covariance without the fix that is not yet delivered
        self.due = 0  # sample of its delivery
        self.last = 0  # sample that ended the block before
        rotation = np.sqrt(np.diag(initial[PSI, PSI]))
        self.start = np.concatenate([np.minimum(prior.attitude, UNIFORM), prior.velocity, prior.position, rotation])[None]

    def block(self, steps: Steps) -> Array:
        """The standard deviations (m, 12) after each step."""
        covariances = np.empty((len(steps.time), NAVIGATION, NAVIGATION))
        for k in self.each(steps):
            covariances[k] = (self.P if self.without is None else self.without)[:NAVIGATION, :NAVIGATION]
        return _channels(covariances, steps, earth_axes(steps.latitude, steps.longitude))

    def each(self, steps: Steps) -> Iterator[int]:
        """Go through the steps of a block; the number of each, after its measurements."""
        layout, count = self.layout, len(steps.time)
        C_en = earth_axes(steps.latitude, steps.longitude)
        rest = steps.rest if layout.mooring is None else np.zeros(count, dtype=bool)
        moves = self._moves(steps, C_en, rest)
        still = np.eye(len(self.P))[DV]
        fixes, fix = layout.fixes, None if layout.fixes is None else fix_of(layout, layout.fixes, steps, C_en)
        moored = None if layout.mooring is None else layout.mooring.rows(steps.time)
        begins = np.concatenate([[self.last], steps.end[:-1]])
        self.last = int(steps.end[-1])
        aided = [(aid.epochs(begins, steps.end), *aid_of(layout, aid, steps, C_en)) for aid in layout.aids]
        for k in range(count):
            self.move(moves, k)
            if moored is not None:
                self._moored(moored[k], C_en[k])
            elif rest[k]:
                self.measure(still, np.full(3, REST_SIGMA**2))
            for number, H, variance in aided:
                if number[k]:
                    self.measure(H[k], variance / number[k])
            if fixes is not None and fix is not None:
                sample = int(steps.end[k])
                if fixes.measured(sample):
                    before = self.P.copy() if fixes.latency else None
                    self.without = None
                    if fix[1].size:
                        self.measure(fix[0][k], fix[1])
                    self.without, self.due = before, sample + fixes.latency
                if self.without is not None and sample >= self.due:
                    self.without = None
            yield k

    def move(self, moves: Moves, k: int) -> None:
        """The step k of a block, without measurements."""
        decaying, walking = self.decaying + NAVIGATION, self.walking + NAVIGATION
        for P in self._all():
            _propagate(P, moves.both[k], moves.drive[k])
            if decaying.size:
                P[decaying] *= moves.decay[k][:, None]
                P[:, decaying] *= moves.decay[k]
                P[decaying, decaying] += moves.grown[k]
            P[walking, walking] += moves.walked[k]

    def measure(self, H: Array, variance: Array) -> None:
        """Measure H x with white noise of variances (r,)."""
        for P in self._all():
            crossed = P @ H.T
            _measure(P, crossed, H @ crossed, variance)

    def _all(self) -> tuple[Array, ...]:
        return (self.P,) if self.without is None else (self.P, self.without)

    def _moves(self, steps: Steps, C_en: Array, rest: NDArray[np.bool_]) -> Moves:
        thrust, force = _as_known(steps, rest)
        A = integrals(steps, C_en, thrust)
        transition = np.eye(NAVIGATION) + A + A @ A / 2
        decay = np.exp(-steps.length[:, None] / self.time[self.decaying])
        return Moves(
            both=np.concatenate([transition, self._coupling(steps, C_en, A, force)], axis=2),
            drive=self._drive(steps, C_en, A),
            decay=decay,
            grown=self.variance[self.decaying] * (1 - decay**2),
            walked=self.walk[self.walking] * steps.length[:, None],
        )

    def _drive(self, steps: Steps, C_en: Array, A: Array) -> Array:
        """Covariance (m, 9, 9) that the white noise of the unit adds in each step."""
        C_es = C_en @ (steps.C_ns / steps.length[:, None, None])
        white = np.zeros_like(A)
        for block, noise in ((PSI, self.layout.unit.noise[0]), (DV, self.layout.unit.noise[1])):
            white[:, block, block] = (C_es * noise**2) @ C_es.swapaxes(1, 2) * steps.length[:, None, None]
        middle = np.eye(NAVIGATION) + A / 2
        return np.asarray(middle @ white @ middle.swapaxes(1, 2))

    def _coupling(self, steps: Steps, C_en: Array, A: Array, force: Array) -> Array:
        """Effect (m, 9, states) of the error sources on the navigation errors over each step."""
        coupling = np.zeros((len(steps.time), NAVIGATION, len(self.variance)))
        begin = 0
        for source in self.layout.sources:
            entry = entering(source, self.layout.unit, steps, force)
            span = slice(begin, begin + source.place.size)
            coupling[:, PSI, span], coupling[:, DV, span] = C_en @ entry[:, :3], C_en @ entry[:, 3:]
            begin = span.stop
        return np.asarray(coupling + A @ coupling / 2)

    def _moored(self, rows: Array, C_en: Array) -> None:
        """Measure: the displacement is that of the place and the sway, `rows` of `Mooring.rows`."""
        for P in self._all():
            begin = len(P) - rows.shape[1]
            crossed = P[:, DR] @ C_en - P[:, begin:] @ rows.T
            inside = C_en.T @ crossed[DR] - rows @ crossed[begin:]
            _measure(P, crossed, inside, np.full(3, SWAY_SIGMA**2))


def aid_of(layout: Layout, aid: Aid, steps: Steps, C_en: Array) -> tuple[Array, Array]:
    """The measurement matrix (m, r, states) of an instrument at the end of each step, and its white variance (r,)."""
    return layout.matrix(aid.sources, *aid.linear(steps, C_en)), aid.noise**2


def fix_of(layout: Layout, fixes: Fixes, steps: Steps, C_en: Array) -> tuple[Array, Array]:
    """The same of position and velocity of the antenna in n; the small acceleration by its rotation is left out."""
    C_nb, C_ne = attitude.numeric.to_dcm(steps.q_nb), C_en.swapaxes(1, 2)
    arm = (C_nb @ fixes.lever_arm[:, None])[..., 0]
    turning = np.cross(steps.rate_n, arm)
    acceleration = steps.thrust / steps.length[:, None]
    acceleration[:, 2] += geodesy.numeric.normal_gravity(np.sin(steps.latitude), steps.height)
    by_source = {
        "lever arm": np.concatenate([C_nb, attitude.numeric.skew(steps.rate_n) @ C_nb], axis=1),
        "delay": np.concatenate([steps.velocity_n + turning, acceleration], axis=1)[..., None],
        "wander": np.broadcast_to(np.eye(6, 3), (len(arm), 6, 3)),
    }
    nav = np.zeros((len(arm), 6, NAVIGATION))
    # psi x a = -[a x] psi
    nav[:, :3, PSI], nav[:, 3:, PSI] = (-attitude.numeric.skew(each) @ C_ne for each in (arm, turning))
    nav[:, :3, DR], nav[:, :3, DV], nav[:, 3:, DV] = C_ne, -fixes.offset * C_ne, C_ne
    measured = np.isfinite(fixes.sigma)
    return layout.matrix(layout.receiver, nav, by_source)[:, measured], fixes.sigma[measured] ** 2


def _propagate(P: Array, both: Array, drive: Array) -> None:
    """One step, in place.  both (9, n): the transition of the navigation errors."""
    moved = both @ P
    inner = moved @ both.T + drive
    P[:NAVIGATION, :NAVIGATION] = (inner + inner.T) / 2
    P[:NAVIGATION, NAVIGATION:] = moved[:, NAVIGATION:]
    P[NAVIGATION:, :NAVIGATION] = moved[:, NAVIGATION:].T


def _measure(P: Array, crossed: Array, inside: Array, variance: Array) -> None:
    """Measure with white noise, in place.  crossed (n, k): P H^T.  inside (k, k): H P H^T.  variance (k,)."""
    inside = (inside + inside.T) / 2
    inside.flat[:: len(variance) + 1] += variance
    P -= crossed @ np.linalg.solve(inside, crossed.T)
    P += P.T
    P *= 0.5


def _as_known(steps: Steps, rest: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Integral of the specific force (m, 3) and `Steps.force`, at rest those of gravity alone.

    With the true force, a measured velocity of 0 would tell the small motion of a vehicle at rest.
    """
    if not rest.any():
        return steps.thrust, steps.force
    gravity = np.asarray(geodesy.numeric.normal_gravity(np.sin(steps.latitude), steps.height))
    up = np.stack([0 * gravity, 0 * gravity, -gravity], axis=1)
    C_ns = steps.C_ns / steps.length[:, None, None]
    up_s = (C_ns.swapaxes(1, 2) @ up[..., None])[..., 0]
    force = steps.C_ns[..., None] * up_s[:, None, None, :]
    return np.where(rest[:, None], up * steps.length[:, None], steps.thrust), np.where(
        rest[:, None, None, None], force, steps.force
    )


def _channels(P: Array, steps: Steps, C_en: Array) -> Array:
    """Standard deviations (m, 12), as `recursion` gives them, from covariances in e."""
    W = local(steps, C_en)
    W = np.concatenate([euler_jacobian(steps.q_nb) @ W[:, PSI], W[:, DV], W[:, DR], W[:, PSI]], axis=1)
    sigma = np.sqrt(np.maximum(np.sum((W @ P) * W, axis=2), 0.0))
    sigma[:, :3], sigma[:, 9:] = np.minimum(sigma[:, :3], UNIFORM), np.minimum(sigma[:, 9:], UNIFORM)
    return np.asarray(sigma)

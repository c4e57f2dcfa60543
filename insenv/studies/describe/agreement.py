"""How well gyros, accelerometers and fixes agree, without a word on attitude or mounting.

The log is cut into windows.  In each the gyros alone turn the specific force f into the axes that the sensor had at the
window's begin, C(t) f(t), and its integral u between two fixes is compared with the change y of their velocity less that by
gravity: y = C_0 u, with the one unknown attitude C_0 of the window, from Wahba's problem (Markley 1988).  What remains is small
only if the gyros' unit, order and signs fit those of the accelerometers, both fit the unit of the fixes and the time of both is
one: a wrong sign, a transposed pair of axes, degrees for radians and a delay leave more.  A common rotation of both triads
leaves nothing, and so the mounting follows from the C_0 that are found.

Two assumptions about one log are compared by the sum of squares that each leaves: n / 2 log(S_2 / S_1) is the logarithm of
their likelihood ratio, n the number of independent components.  Constant errors of gyros and accelerometers are linear in u and
estimated where one assumption is refined.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from insenv import attitude, geodesy
from insenv.core.tables import Array
from insenv.geodesy import OMEGA_IE

STEP_S = 0.04
"""Shortest step (s) in which the samples are turned; faster ones are added up."""
LAG_S = 1.0
"""Time (s) over which changes of velocity are compared."""
MAX_WINDOWS = 24
"""Windows that are used: those in which the most happens."""
MAX_HOLE_S = 0.5
"""Longest hole (s) in the samples of a window."""
MIN_PAIRS = 6
"""Changes of velocity that a window needs."""
LARGEST = 5.0
"""Residuals, in medians of their sizes, from which one is an outlier: it counts no more."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples: time (n,) s of their ends, rate (n, 3) rad/s and force (n, 3) m/s^2, in the order of their columns."""

    time: Array
    rate: Array
    force: Array


@dataclass(frozen=True, eq=False)
class Track:
    """Fixes: time (m,) s; latitude, longitude (m,) rad; height (m,) m; velocity (m, 3) m/s, NED, None: from positions."""

    time: Array
    latitude: Array
    longitude: Array
    height: Array
    velocity: Array | None = None
    spacing: float = LAG_S
    """Time (s) over which velocities are made of positions, where the fixes have none."""
    velocity_lag: float = 0.0
    """Time (s) by which the velocities show an earlier motion than the positions of the same stamps."""

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the track and half of its length, s."""
        return 0.5 * float(self.time[0] + self.time[-1]), max(0.5 * float(self.time[-1] - self.time[0]), 1e-3)

    def part(self, time: Array) -> Array:
        """Times (s) as parts of the track, -1 to 1."""
        middle, half = self.middle
        return (time - middle) / half

    @cached_property
    def gravity(self) -> float:
        """Gravity at the middle of the track, m/s^2."""
        middle = len(self.time) // 2
        return float(geodesy.numeric.normal_gravity(np.sin(self.latitude[middle]), self.height[middle]))

    @cached_property
    def interval(self) -> float:
        """Median time (s) between two fixes."""
        return float(np.median(np.diff(self.time)))

    @property
    def averaged(self) -> int:
        """Number of fixes whose mean is taken where velocities are made of positions: their noise is less than that of one."""
        return max(round(LAG_S / self.interval), 1) if self.velocity is None else 1

    @cached_property
    def _means(self) -> tuple[Array, Array, Array, Array]:
        """Time, latitude, longitude and height of means of `averaged` fixes, without those over a gap."""
        each = self.averaged
        count = len(self.time) // each
        parts = [
            column[: count * each].reshape(count, each) for column in (self.time, self.latitude, self.longitude, self.height)
        ]
        whole = np.ptp(parts[0], axis=1) < 1.5 * each * self.interval
        time, latitude, longitude, height = (part.mean(axis=1)[whole] for part in parts)
        return time, latitude, longitude, height

    @cached_property
    def speeds(self) -> tuple[Array, Array]:
        """Times (k,) s and velocities (k, 3) m/s, NED: of the fixes, or between those that are `LAG_S` or more apart."""
        if self.velocity is not None:
            return self.time - self.velocity_lag, self.velocity
        time, *places = self._means
        interval = self.interval * self.averaged
        lag = max(round(self.spacing / interval), 1)
        took = time[lag:] - time[:-lag]
        fine = took < 1.5 * lag * interval
        middle = 0.5 * (time[lag:] + time[:-lag])
        way = geodesy.numeric.ned_offset(*(each[lag:] for each in places), *(each[:-lag] for each in places))
        return middle[fine], (np.asarray(way) / took[:, None])[fine]


@dataclass(frozen=True, eq=False)
class Windows:
    """The windows of a log.

    begin (w,) s; step s; turned (w, k, 3) rad and pushed (w, k, 3) m/s: increments of the samples in each step.
    """

    begin: Array
    step: float
    turned: Array
    pushed: Array

    @property
    def length(self) -> float:
        """Length (s) of a window."""
        return self.step * self.turned.shape[1]


def windows_of(motion: Motion, track: Track, length: float) -> Windows:
    """The windows of `length` (s) in which the most happens; none if the samples and the fixes do not overlap."""
    step = max(STEP_S, float(np.median(np.diff(motion.time))))
    begin, end = max(motion.time[0], track.time[0] - length), min(motion.time[-1], track.time[-1] + length)
    per = max(round(length / step), 2)
    count = max(int((end - begin) / (per * step)), 0)
    edges = begin + step * np.arange(count * per + 1)
    dt = np.diff(motion.time, prepend=2 * motion.time[0] - motion.time[1])
    # over a hole the last sample before it would count alone
    sums = [
        np.vstack([np.zeros(3), np.cumsum(each * np.minimum(dt, 5 * np.median(dt))[:, None], axis=0)])
        for each in (motion.rate, motion.force)
    ]
    knots = np.append(motion.time[0] - dt[0], motion.time)
    turned, pushed = (
        np.diff(np.column_stack([np.interp(edges, knots, column) for column in each.T]), axis=0).reshape(count, per, 3)
        for each in sums
    )
    starts = edges[:-1:per][:count]
    holes = motion.time[1:][np.diff(motion.time) > max(MAX_HOLE_S, 3 * step)]
    whole = np.array([not np.any((holes > at) & (holes < at + length + MAX_HOLE_S)) for at in starts], dtype=bool)
    time, velocity = track.speeds
    inside = [(time >= at) & (time < at + length) for at in starts]
    activity = np.array([
        0.0 if np.count_nonzero(rows) < MIN_PAIRS else float(np.sqrt(velocity[rows].var(axis=0).sum())) for rows in inside
    ])  # fmt: skip
    activity = np.where(whole, activity, 0.0)
    chosen = np.sort(np.argsort(-activity)[:MAX_WINDOWS])
    chosen = chosen[activity[chosen] > 0]
    return Windows(starts[chosen], step, turned[chosen], pushed[chosen])


@dataclass(frozen=True, eq=False)
class Turned:
    """Windows whose samples are turned: attitude (..., w, k + 1, 3, 3) at each edge and integral (..., w, k + 1, 3) m/s of the
    turned force up to it; by_gyro, by_accel, by_lever (w, k + 1, 3, 3): derivatives of the velocity of the antenna by constant
    errors of both, and by its lever arm, if asked for."""

    windows: Windows
    attitude: Array
    integral: Array
    by_gyro: Array | None = None
    by_accel: Array | None = None
    by_lever: Array | None = None


def turned(windows: Windows, gyro: Array, errors: bool = False) -> Turned:
    """The windows with their samples turned by gyros that are multiplied by `gyro` (..., 3, 3); errors: derivatives too."""
    w, k = windows.turned.shape[:2]
    angle = np.einsum("...ij,wkj->...wki", gyro, windows.turned)
    push = (windows.pushed + 0.5 * np.cross(angle, windows.pushed))[..., None]
    rotation = attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(angle))
    C = np.empty((*gyro.shape[:-2], w, k + 1, 3, 3))
    C[..., 0, :, :] = np.eye(3)
    for i in range(k):
        np.matmul(C[..., i, :, :], rotation[..., i, :, :], out=C[..., i + 1, :, :])
    before = C[..., :-1, :, :]
    moved = (before @ push)[..., 0]
    integral = _summed(moved, -2)
    if not errors:
        return Turned(windows, C, integral)
    # a constant error of the accelerometers adds up as C does; one of the gyros turns C(t), by what it has added up to
    added = _summed(before * windows.step, -3)
    by_gyro = _summed(-attitude.numeric.skew(moved) @ added[..., :-1, :, :], -3)
    of_rate = before @ attitude.numeric.skew(angle / windows.step)
    # of the rate in each step: at the edges the mean of two
    by_lever = np.concatenate([of_rate, of_rate[..., -1:, :, :]], axis=-3)
    by_lever[..., 1:-1, :, :] = 0.5 * (of_rate[..., 1:, :, :] + of_rate[..., :-1, :, :])
    return Turned(windows, C, integral, by_gyro, added, by_lever)


def _summed(steps: Array, axis: int) -> Array:
    """The sum of the steps up to each edge, beginning with 0."""
    sums = np.cumsum(steps, axis=axis)
    return np.concatenate([np.zeros_like(np.take(sums, [0], axis=axis)), sums], axis=axis)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Changes of velocity in windows: rows (w, p) of begin and end as places on the grid of a window, valid (w, p), and y
    (w, p, 3) m/s, the change less that by gravity; speed (w, p, 3) m/s in the middle; part (w,): place of the window in the
    log, -1 to 1; width: half of the time over which a velocity is the mean, and blur: time over which the positions at its ends
    are means, in steps; 0: a point."""

    first: Array
    last: Array
    valid: np.ndarray
    y: Array
    speed: Array
    part: Array
    width: float = 0.0
    blur: float = 0.0


def pairs_of(windows: Windows, track: Track, delay: float = 0.0, drift: float = 0.0) -> Pairs:
    """The changes of velocity in each window, if the fixes show the velocity of `delay` (s) before their stamps, which grows
    by `drift` (s) from the middle of the log to its end."""
    time, velocity = track.speeds
    time = time - delay - drift * track.part(time)
    interval = float(np.median(np.diff(time)))
    lag = max(round(LAG_S / interval), 1) if track.velocity is not None else max(round(track.spacing / interval), 1)
    first, last = np.arange(len(time) - lag), np.arange(lag, len(time))
    close = time[last] - time[first] < 2.5 * max(lag * interval, LAG_S)
    first, last = first[close], last[close]
    took = (time[last] - time[first])[:, None]
    middle = 0.5 * (velocity[last] + velocity[first])
    sin, cos = np.sin(track.latitude.mean()), np.cos(track.latitude.mean())
    earth = OMEGA_IE * np.array([cos, 0.0, -sin])
    y = velocity[last] - velocity[first] - took * (np.array([0.0, 0.0, track.gravity]) - 2.0 * np.cross(earth, middle))
    half = 0.0 if track.velocity is not None else 0.5 * lag * interval
    # the mean of n fixes has the variance in time of a mean over this
    blur = np.sqrt(track.averaged**2 - 1.0) * track.interval
    reach = half + 0.5 * blur
    rows = [np.flatnonzero((time[first] - reach >= at) & (time[last] + reach <= at + windows.length)) for at in windows.begin]
    most = max([len(each) for each in rows] or [0])
    index, valid = np.zeros((len(rows), most), int), np.zeros((len(rows), most), bool)
    for place, each in enumerate(rows):
        index[place, : len(each)], valid[place, : len(each)] = each, True
    grid = [(time[ends[index]] - windows.begin[:, None]) / windows.step for ends in (first, last)]
    grid = [np.where(valid, each, 0.0) for each in grid]
    return Pairs(
        grid[0],
        grid[1],
        valid,
        np.where(valid[..., None], y[index], 0.0),
        middle[index],
        track.part(windows.begin + 0.5 * windows.length),
        half / windows.step,
        blur / windows.step,
    )


def changes(series: Array, pairs: Pairs) -> Array:
    """The change of a series (..., w, k + 1, c) over each pair, (..., w, p, c)."""
    if pairs.width:
        sums = _integral(series)
        ends = _integral(sums) if pairs.blur else sums
        half = 0.5 * pairs.blur

        def mean(place: Array) -> Array:
            if not half:
                return _at(ends, place)
            return (_at(ends, place + half) - _at(ends, place - half)) / pairs.blur

        means = [
            (mean(place + pairs.width) - mean(place - pairs.width)) / (2 * pairs.width) for place in (pairs.first, pairs.last)
        ]
        return np.asarray(np.where(pairs.valid[..., None], means[1] - means[0], 0.0))
    return np.asarray(np.where(pairs.valid[..., None], _at(series, pairs.last) - _at(series, pairs.first), 0.0))


def _integral(series: Array) -> Array:
    """The integral of (..., k + 1, c) over its steps, from 0."""
    return _summed(0.5 * (series[..., 1:, :] + series[..., :-1, :]), -2)


def _at(series: Array, place: Array) -> Array:
    """Linear interpolation of (..., w, k + 1, c) at places (w, p)."""
    place = np.clip(place, 0.0, series.shape[-2] - 1.000001)
    low = place.astype(int)
    part = (place - low)[..., None]
    rows = np.arange(place.shape[0])[:, None]
    return np.asarray(series[..., rows, low, :] * (1 - part) + series[..., rows, low + 1, :] * part)


PRIOR = np.array([0.05] * 3 + [0.3] * 3 + [4.0] * 3 + [1.0, 0.3])
"""Standard deviations of the errors of gyros (rad/s) and accelerometers (m/s^2), of the lever arm (m), of the delay (s) and
of its change from the middle of the log to its end: what the motion does not show stays small."""
GYRO, ACCEL, ARM, DELAY, DRIFT = slice(0, 3), slice(3, 6), slice(6, 9), 9, 10
"""Their places."""
ERRORS = len(PRIOR)
SLOPE_S = 0.1
"""Time (s) to both sides over which the slope of the velocity is taken, for the delay."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What an assumption leaves: start (..., w, 3, 3), from the sensor's axes at the begin of each window to NED; residual
    (..., w, p, 3) m/s; squares (...): the sum of their squares, outliers cut; count: of independent components; errors
    (11,): as of `PRIOR`, in the sensor's axes, with their covariance.  mean: square of a component."""

    start: Array
    residual: Array
    squares: Array
    count: float
    errors: Array = field(default_factory=lambda: np.zeros(ERRORS))
    covariance: Array = field(default_factory=lambda: np.diag(PRIOR**2))
    mean: Array = field(default_factory=lambda: np.zeros(()))


def fitted(u: Array, pairs: Pairs, windows: Windows) -> Fit:
    """Wahba's problem in each window."""
    y = pairs.y
    start = _wahba(u, y)
    residual = y - np.einsum("...wij,...wpj->...wpi", start, u)
    size = np.linalg.norm(residual, axis=-1)
    limit = LARGEST * np.array(np.median(size[..., pairs.valid], axis=-1))[..., None, None]
    weight = np.where(size > limit, np.sqrt(limit / np.maximum(size, 1e-12)), 1.0)[..., None]
    start = _wahba(u * weight, y * weight)
    residual = y - np.einsum("...wij,...wpj->...wpi", start, u)
    squares = np.minimum(np.sum(residual**2, axis=-1), limit**2) * pairs.valid
    # overlapping pairs hold no more than those that stand one after the other, and an attitude of each window is free
    span = float(np.median((pairs.last - pairs.first)[pairs.valid])) * windows.step if pairs.valid.any() else 1.0
    count = max(len(windows.begin) * (3 * min(windows.length / span, pairs.valid.sum() / max(len(windows.begin), 1)) - 3), 1.0)
    total = squares.sum(axis=(-1, -2))
    return Fit(start, residual, total, count, mean=total / max(3 * pairs.valid.sum(), 1))


def _wahba(u: Array, y: Array) -> Array:
    B = np.einsum("...wpi,...wpj->...wij", np.broadcast_to(y, u.shape), u)
    U, _, Vt = np.linalg.svd(B)
    flip = np.ones((*B.shape[:-2], 3))
    flip[..., 2] = np.linalg.det(U) * np.linalg.det(Vt)
    return np.asarray((U * flip[..., None, :]) @ Vt)


def refined(done: Turned, pairs: Pairs, rounds: int = 3) -> Fit:
    """The fit of one assumption with constant errors of gyros and accelerometers, a lever arm and a further delay of the
    fixes, for `done` of `turned` with `errors`."""
    assert done.by_gyro is not None and done.by_accel is not None and done.by_lever is not None
    u = changes(done.integral, pairs)
    w, k = done.by_gyro.shape[:2]
    parts = (done.by_gyro, done.by_accel, done.by_lever)
    columns = [changes(each.reshape(w, k, 9), pairs).reshape(*u.shape, 3) for each in parts]
    reach = max(round(SLOPE_S / done.windows.step), 1)
    ahead, behind = (np.clip(np.arange(k) + each, 0, k - 1) for each in (reach, -reach))
    slope = (done.integral[:, ahead] - done.integral[:, behind]) / ((ahead - behind) * done.windows.step)[:, None]
    late = -changes(slope, pairs)[..., None]
    design = np.concatenate([*columns, late, late * pairs.part[:, None, None, None]], axis=-1)
    errors, covariance = np.zeros(ERRORS), np.diag(PRIOR**2)
    fit = fitted(u, pairs, done.windows)
    repeats = max(3 * pairs.valid.sum() / (fit.count + 3 * w), 1.0)
    for _ in range(rounds):
        variance = float(fit.squares / max(3 * pairs.valid.sum(), 1)) + 1e-6
        # the attitude of each window absorbs what is a rotation of u: it is projected out
        A = np.einsum("wij,wpjk->wpik", fit.start, design)
        K = -attitude.numeric.skew(np.einsum("wij,wpj->wpi", fit.start, u + design @ errors)).reshape(w, -1, 3)
        r = (fit.residual + A @ errors).reshape(w, -1)
        A = A.reshape(w, -1, ERRORS)
        size = np.linalg.norm(fit.residual, axis=-1)
        keep = np.repeat(pairs.valid & (size <= LARGEST * np.median(size[pairs.valid])), 3, axis=1)
        A, K, r = A * keep[..., None], K * keep[..., None], r * keep
        onto = np.linalg.pinv(np.swapaxes(K, 1, 2) @ K) @ np.swapaxes(K, 1, 2)
        A, r = A - K @ (onto @ A), r - (K @ (onto @ r[..., None]))[..., 0]
        normal = np.einsum("wni,wnj->ij", A, A) / (variance * repeats)
        covariance = np.linalg.inv(normal + np.diag(PRIOR**-2.0))
        errors = covariance @ np.einsum("wni,wn->i", A, r) / (variance * repeats)
        fit = fitted(u + design @ errors, pairs, done.windows)
    return replace(fit, errors=errors, covariance=covariance)


def independent(residual: Array, pairs: Pairs) -> float:
    """Number of independent components of residuals (w, p, 3): their number by their correlation along a window.

    N / (1 + 2 sum rho_k), the sum up to the first rho_k that is not positive (Geyer 1992); each window's attitude takes three.
    """
    size = np.linalg.norm(residual, axis=-1)
    limit = LARGEST * np.median(size[pairs.valid])
    cut = np.where((pairs.valid & (size <= limit))[..., None], residual, 0.0)
    squares, correlated = float(np.sum(cut**2)), 1.0
    for k in range(1, residual.shape[1]):
        rho = float(np.sum(cut[:, k:] * cut[:, :-k])) / max(squares, 1e-30)
        if rho <= 0.0:
            break
        correlated += 2.0 * rho
    return max((3.0 * pairs.valid.sum() - 3.0 * len(residual)) / correlated, 1.0)


def log_ratio(worse: float, better: float, count: float) -> float:
    """Logarithm of the likelihood ratio of two fits by their mean squares."""
    return float(0.5 * count * np.log(max(worse, 1e-30) / max(better, 1e-30)))

"""A mooring: the vehicle floats, sways, and stays where it is; the sway is part of the state.

Alignments in place filter the sway or average over it.  Both have a band, and below it they take a slow surge for tilt.  Here
the displacement d from the place at the start is modelled, per axis, as a sum of damped oscillators j that white noise drives,
about a centre c that walks slowly, and of what keeps step with the attitude, A(C) l with six constant arms l:

    d = c + A(C) l + sum of a_j,   a_j' = -2 z w_j a_j - w_j b_j + noise,   b_j' = w_j a_j,   c', l' = noise, 0

with standard deviations s_j of a_j and of b_j, whatever the sea.  The spectrum of a_j falls to zero at low frequencies, as that
of a moored vehicle beside its walk does.  A sum of the b_j would have white noise there, which hides the slow growth of the
displacement by which a wrong heading shows: the heading after 300 s then is known to 3.5 times the limit, not 1.5 times.

The same waves roll, pitch and lift a vehicle, so a part of its sway keeps step with its attitude, even where the unit is at
the centre of the rotation: the arms are the ratios of that part to the angles.  A bias of an accelerometer, turned by the
roll, looks like such a heave.  The oscillators forget their phase; without the arms a heave that never does counts as a
measurement of the bias: with biases of 16 mg, and a roll of 10 deg and a heave of 1 m of one period, the roll is 2.7 times as
wrong as stated.  There is an arm for each angle that turns a bias into an axis: heave by roll is no lever arm that surges by
yaw too.

The measurement is that the navigated displacement is d.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude
from insenv.base.remarks import Doubt, declared
from insenv.core.elementary import exp, maximum, minimum, select, sin_cos
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, waited
from insenv.estimators.fusion.error_state import ErrorState, Process, constant, sigma_row
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.finding import Finding
from insenv.sensors.imu_tables import COUPLINGS

PERIODS = (100.0, 45.0, 22.0, 11.0, 6.0)
SIGMAS = (0.09, 0.3, 0.3, 0.3, 0.3)
"""s: of the oscillators of an axis; with `DAMPING` the spectra overlap, so that a line between two is covered."""
COUNT = len(PERIODS)
DAMPING = 0.12
SHORTEST = 5.0
"""s: of a period; `kalman.elementary` needs less than a quarter of it between propagations, of which 1 s is the longest."""

PROCESS_ROWS = Table((
    Row("sway_period", "Periods of the oscillators that stand for the sway along an axis", "s", (COUNT,), start=PERIODS,
        lower=SHORTEST, upper=1e4),
    Row("sway_damping", "Their damping", "1", start=DAMPING, lower=1e-3, upper=0.7),
))  # fmt: skip


def oscillation(p: Any, duration: Any) -> Any:
    """Transition (k x k) of the oscillators: north, east, down, of each axis the pairs a, b in the order of the periods."""
    blocks = []
    for j in range(COUNT):
        w = 2 * ca.pi / p.sway_period[j]
        across = ca.sqrt(1 - p.sway_damping**2)
        sine, cosine = sin_cos(w * across * duration)
        fades, sine = exp(-p.sway_damping * w * duration), sine / across
        damped = p.sway_damping * sine
        blocks.append(fades * ca.blockcat([[cosine - damped, -sine], [sine, cosine + damped]]))
    return ca.diagcat(*blocks * 3)


def _driven(p: Any, duration: Any) -> Any:
    """Variances that keep the stationary ones."""
    Phi = oscillation(p, duration)
    sigma = pairs(p)
    return sigma**2 * ca.vertcat(*[1 - ca.sumsqr(Phi[i, :]) for i in range(Phi.shape[0])])


def pairs(p: Any) -> Any:
    """Standard deviations of the numbers of `SWAY`."""
    of_axis = [p.sway_sigma[j] for j in range(COUNT) for _ in "ab"]
    return ca.vertcat(*of_axis * 3)


_SIGMA = sigma_row("sway_sigma", "Standard deviation of the displacement by each oscillator", "m", COUNT, start=SIGMAS)
SWAY = ErrorState(
    Row("sway", "Estimated oscillators of the sway along north, east, down: displacement and a quarter of a period later", "m",
        (6 * COUNT,)),
    sigma=_SIGMA.name,
    rows=PROCESS_ROWS + Table((_SIGMA,)),
    process=Process("damped oscillators", oscillation, _driven),
    started_sigma=pairs,
)  # fmt: skip
_CENTRE_SIGMA = sigma_row("mooring_centre_sigma", "Standard deviation of the centre of the sway about the place at the start",
    "m", start=3.0)  # fmt: skip
CENTRE = ErrorState(
    Row("mooring_centre", "Estimated centre of the sway relative to the place at the start", "m", (3,), "n"),
    sigma=_CENTRE_SIGMA.name,
    rows=Table((
        _CENTRE_SIGMA,
        Row("mooring_walk", "Random walk of the centre", "m/s^0.5", start=1e-3, lower=0.0, upper=1e3),
    )),
    process=Process(
        "random walk", lambda p, duration: ca.SX.eye(3), lambda p, duration: ca.repmat(p.mooring_walk**2 * duration, 3, 1)
    ),
    less_position=True,
)  # fmt: skip
ARM = constant(
    "sway_arm", "arms of the sway that keeps step with the attitude, displacement over angle: xy, xz, yx, yz, zx, zy", "m", 6,
    sigma_row("sway_arm_sigma", "Standard deviation of an arm of the sway that keeps step with the attitude", "m", start=10.0),
)  # fmt: skip
STATES = (SWAY, CENTRE, ARM)


# How much it sways, as the filter estimates it: a sea that is larger than `sway_sigma` where the oscillators are slow makes the
# errors larger by as much.

LEAST_SWAY = 1e-9
"""m: of which a larger sway is a multiple, if none is assumed."""
LARGE = 1.3
"""Root mean square of an oscillator over its standard deviation from which a note says so."""
SLOW = 15.0
"""s: of periods above which that matters."""
AXES = Table((
    Row("mooring_axes", "Cosine and sine of the azimuth of the vehicle when the mooring was used first, from w", "1", (2,)),
))  # fmt: skip
POWER = Table((
    Row("sway_rms", "Root mean square of each oscillator, over about one period: north, east, down", "m", (3 * COUNT,)),
))  # fmt: skip


def _remembered(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The root mean squares after one more interval between measurements."""
    mean = []
    for k in range(3 * COUNT):
        now = ca.sumsqr(x.sway[2 * k : 2 * k + 2]) / 2
        share = minimum(p.moored_interval / p.sway_period[k % COUNT], 1.0)
        mean.append(ca.sqrt(x.sway_rms[k] ** 2 + share * (now - x.sway_rms[k] ** 2)))
    ahead = attitude.to_dcm(x.q_wb)[:2, 0]
    axes = select(x.moored_count > 0, x.mooring_axes, ahead / maximum(ca.norm_2(ahead), 1e-9))
    return {"sway_rms": ca.vertcat(*mean), "mooring_axes": axes}


def _widened(p: Any, x: Any) -> Any:
    """By how much a slow horizontal sway is larger than assumed, 1 at least.

    The filter is linear: of errors that the sway drives, the standard deviation grows with it.
    """
    factor: Any = 1.0
    for axis in range(2):
        for k in range(COUNT):
            ratio = select(p.sway_period[k] > SLOW, x.sway_rms[COUNT * axis + k] / maximum(p.sway_sigma[k], LEAST_SWAY), 0.0)
            factor = maximum(factor, ratio)
    return factor


_LARGE_SWAY = declared(
    "sway-large",
    "the vehicle sways slowly with {ratio} times the amplitude that the filter assumes: its sigmas are widened by that, but "
    "too small before it has seen some periods; set sway_sigma_m (for the oscillators of {periods} s)",
    Doubt,
)


def findings(parameters: Mapping[str, Any]) -> tuple[Finding, ...]:
    """A slow horizontal sway that is larger than what is assumed of it."""
    periods, sigma = (np.broadcast_to(np.ravel(parameters[name]), COUNT) for name in ("sway_period", "sway_sigma"))
    of_axis = np.where(periods > SLOW, np.maximum(sigma, LEAST_SWAY), np.inf)
    shown = ", ".join(f"{period:g}" for period in periods)
    sentence = _LARGE_SWAY.filled(periods=shown)
    return (Finding("sway_rms", sentence, np.concatenate([of_axis, of_axis, np.full(COUNT, np.inf)]), limit=LARGE),)


def _in_step(arm: Any, C_wb: Any, axes: Any) -> Any:
    """Displacement (3, m, w) that keeps step with the attitude C_wb; axes: cosine and sine of the azimuth that is none."""
    level = ca.blockcat([[axes[0], -axes[1], 0], [axes[1], axes[0], 0], [0, 0, 1]])
    turned = level.T @ C_wb
    sums = [ca.SX(0)] * 3
    for value, (row, column) in zip(ca.vertsplit(arm), COUPLINGS, strict=True):
        sums[row] = sums[row] + value * turned[row, column]
    return level @ ca.vertcat(*sums)


def _displacement(sway: Any, centre: Any, arm_n: Any) -> Any:
    of_axis = [ca.sum1(sway[2 * COUNT * axis : 2 * COUNT * (axis + 1) : 2]) for axis in range(3)]
    return centre + arm_n + ca.vertcat(*of_axis)


def displacement(x: Any) -> Any:
    """Displacement (3, m) from the place at the start by the estimated sway, centre and arms."""
    arm_n = strapdown.C_nw(x.q_ew) @ _in_step(getattr(x, ARM.name), attitude.to_dcm(x.q_wb), x.mooring_axes)
    return _displacement(getattr(x, SWAY.name), getattr(x, CENTRE.name), arm_n)


def _residual(p: Any, seen: Navigation, u: Any) -> Any:
    """Displacement (3, m, n) by the navigation less that by sway, centre and arms."""
    displaced = seen.C_nw @ seen.offset_w - seen.offset_n(p.start_latitude, p.start_longitude, p.start_height)
    arm_n = seen.C_nw @ _in_step(seen.value(ARM.name), seen.C_wb, seen.row("mooring_axes"))
    return displaced - _displacement(seen.value(SWAY.name), seen.value(CENTRE.name), arm_n)


AID = Aid(
    id="moored",
    title="a mooring",
    size=3,
    what="displacement other than that of sway and centre",
    causes="whether the vehicle stays at its mooring, and whether it sways more than sway_sigma",
    unit="m",
    frame="n",
    residual=_residual,
    variance=lambda p, x, u, spread: ca.repmat(p.moored_sigma**2, 3, 1),
    due=lambda p, x, u: select(waited(x.moored_since, u, p.moored_interval), 1.0, 0.0),
    state=AXES + POWER,
    outputs=tuple(POWER.names),
    steps={"sway": Step(_remembered, when="moored_due")},
    widened=_widened,
    parameters=Table((
        sigma_row("moored_sigma", "What sway and centre leave of the displacement", "m", start=0.003),
        Row("moored_interval", "Time between uses of it", "s", start=0.5, lower=0.0, upper=3600.0),
    )),
)  # fmt: skip

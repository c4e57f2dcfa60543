"""What the fixes say of a barometer: that the air moves about it.

The wind, and the air of rotors, changes the pressure at a port by metres for seconds, which is neither the noise of a data
sheet nor a bias.  A receiver's vertical velocity, integrated, has the changes of the height without them.  What differs within
`SLOW_S` and is neither the stated noise nor the walk of an integrated velocity with white noise is the air's, and counts as
noise.  What differs more slowly may as well be the receiver's, and belongs to bias and drift.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np

from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.disturbance import DISTURBED, interval_of, is_stuck, lasting_of, turned_by, white_noise
from insenv.logs.noise import spread_of
from insenv.logs.recorded import NO_INFORMATION, GnssFixes, Readings, RecordedLog
from insenv.sensors.barometer import BAROMETER

_DISTURBED = declared(
    "barometer-disturbed",
    "{name}: the height varies by {spread:.2g} m beside the way of the fixes, for {time:.2g} s each time: its white noise is "
    "taken as {noise:.2g} m instead of {stated:.2g} m",
)
_STUCK = declared(
    "barometer-stuck",
    "{name}: all heights are the same, and the gyros turn by {turned:.0f} deg: the barometer is left out",
)
SLOW_S = 10.0
"""Time over which the mean difference is taken off."""
GAP_S = 1.5
"""Longest time between fixes over which their velocity is integrated."""
LEAST_S = 30.0
"""Time that shows anything."""
ORDER = 3
"""Of the differences of velocities that show their noise."""
_NOISE, _LAG = "barometer_noise", "barometer_lag"


def with_barometer_judged(log: RecordedLog) -> RecordedLog:
    """The log without a barometer that is stuck, or with the white noise that it has in the air, if that is larger."""
    instruments, stated, notes = [], dict(log.stated_errors), list(log.notes)
    for each in log.instruments:
        if each.id == BAROMETER.id and is_stuck(each, turned := turned_by(log)):
            notes.append(_STUCK.filled(name=each.name, turned=np.degrees(turned)))
            continue
        if each.id == BAROMETER.id and log.gnss is not None:
            found = disturbed(each, log.gnss, float(stated[_NOISE]), float(stated[_LAG]))
            if found is not None:
                stated[_NOISE], said = found
                notes.append(said)
        instruments.append(each)
    return replace(log, instruments=tuple(instruments), stated_errors=stated, notes=tuple(notes))


def disturbed(readings: Readings, gnss: GnssFixes, stated: float, lag: float) -> tuple[float, Remark] | None:
    """The white noise (m) of a barometer, and what is said of it; None where it is about the `stated` one (m), or unknown.

    lag: s, by which the readings follow the height.
    """
    fixes = _vertical(gnss)
    if fixes is None or len(readings.time) < 2:
        return None
    time, down = fixes
    left, interval = _left(readings, time, down, lag), interval_of(readings)
    if len(left) * interval < LEAST_S:
        return None
    walk = float(np.median(np.diff(time))) * _noise_of(down, gnss) ** 2 * SLOW_S / 12.0
    air = float(spread_of(left)) ** 2 - walk - stated**2
    if air <= max(walk, (DISTURBED * stated) ** 2):
        return None
    lasting = lasting_of(left, interval)
    noise = white_noise(float(np.sqrt(air)), lasting, interval)
    return noise, _DISTURBED.filled(name=readings.name, spread=np.sqrt(air), time=lasting, noise=noise, stated=stated)


def _vertical(gnss: GnssFixes) -> tuple[Array, Array] | None:
    """Times (m,) s and downward velocities (m,) m/s of the fixes that have one; None for fewer than four."""
    if gnss.velocity_n is None:
        return None
    known = np.isfinite(gnss.velocity_n[:, 2])
    if gnss.velocity_sigma is not None:
        known &= gnss.velocity_sigma[:, 2] < NO_INFORMATION
    return (gnss.time[known], gnss.velocity_n[known, 2]) if np.count_nonzero(known) > ORDER else None


def _noise_of(down: Array, gnss: GnssFixes) -> float:
    """White noise of the velocities (m/s): what their differences show, which contain motion too, or the stated one."""
    shown = float(spread_of(np.diff(down, ORDER)) / np.sqrt(comb(2 * ORDER, ORDER)))
    return shown if gnss.velocity_sigma is None else min(shown, float(np.median(gnss.velocity_sigma[:, 2])))


def _left(readings: Readings, time: Array, down: Array, lag: float) -> Array:
    """Heights (n,) less the way of the fixes, and less the mean of that over `SLOW_S`; none where fixes are missing."""
    way = -np.append(0.0, np.cumsum(0.5 * (down[1:] + down[:-1]) * np.diff(time)))
    at = readings.time - lag
    use = (at > time[0]) & (at < time[-1])
    use[use] = np.diff(time)[np.searchsorted(time, at[use]) - 1] < GAP_S
    at = at[use]
    differs = readings.columns()[BAROMETER.compared.name][use].ravel() - np.interp(at, time, way)
    begin, end = (np.searchsorted(at, at + side * SLOW_S / 2) for side in (-1.0, 1.0))
    total = np.append(0.0, np.cumsum(differs))
    return np.asarray(differs - (total[end] - total[begin]) / np.maximum(end - begin, 1))

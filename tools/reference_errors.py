"""Heading errors of estimates and of a log's reference, minute by minute, as the velocities of the receiver show them; and
velocities of both while the vehicle stands.

    python tools/reference_errors.py [LOG ...] [--data FOLDER]

LOG: names of `insenv prove`; without one, those developed on that have a reference attitude and fixes with velocities, and the
n380 drives.

Over two seconds the specific force that an attitude turns into n differs from the receiver's change of velocity by the bias of
the accelerometers, the delay of the velocities, and the errors of the attitude: a heading error turns the horizontal
acceleration, a tilt is nearly constant.  Least squares over the whole log find bias and delay, and of each minute the heading
error and two tilts.  The estimates have used the same velocities, so theirs may be flattered; the reference has used them too.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from insenv import attitude, replay
from insenv.core.tables import Array
from insenv.evaluation.outages import attitude_between
from insenv.logs import RecordedLog
from insenv.logs.rest import rest_rows
from insenv.studies.proof import public_logs

SPAN = 2
"""Fixes, s apart, between which velocities are compared."""
MINUTE = 60.0


def heading_errors(log: RecordedLog, time: Array, q_nb: Array, from_s: float) -> tuple[Array, Array]:
    """Heading errors of an attitude (n, 4) at times (n,) s by minute from `from_s` on, and their standard errors, deg."""
    ends, dt = log.imu_time, log.dt[:, None]
    middles = ends - log.dt / 2
    later = np.clip(np.searchsorted(time, middles), 1, len(time) - 1)
    share = ((middles - time[later - 1]) / (time[later] - time[later - 1]))[:, None]
    C_nb = attitude.numeric.to_dcm(attitude_between(q_nb[later - 1], q_nb[later], share))
    force_n = np.einsum("nij,nj->ni", C_nb, log.delta_velocity)
    sums = np.cumsum(np.hstack([force_n, C_nb.reshape(-1, 9) * dt, np.zeros_like(dt)]), axis=0)
    assert log.gnss is not None and log.gnss.velocity_n is not None
    fixes, measured = log.gnss.time, log.gnss.velocity_n
    counts = (fixes > max(from_s, time[0])) & (fixes < min(time[-1], ends[-1]) - 1.0)
    fixes, measured = fixes[counts], measured[counts]
    at_fixes = np.column_stack([np.interp(fixes, ends, column) for column in sums.T])
    acceleration = np.column_stack([np.interp(fixes, ends, column) for column in (force_n / dt).T])
    length = (fixes[SPAN:] - fixes[:-SPAN])[:, None]
    mean, change = ((each[SPAN:] - each[:-SPAN]) / length for each in (at_fixes, acceleration))
    left = (measured[SPAN:] - measured[:-SPAN]) / length - mean[:, :3]
    minute = ((fixes[SPAN:] - from_s) // MINUTE).astype(int)
    rows = np.arange(len(minute))
    count = int(minute.max()) + 1
    columns = np.zeros((2, len(minute), 4 + 3 * count))
    for axis, (other, sign) in enumerate(((1, 1.0), (0, -1.0))):
        columns[axis, :, :3] = -mean[:, 3 + 3 * axis : 6 + 3 * axis]
        columns[axis, :, 3] = -change[:, axis]
        columns[axis, rows, 4 + minute] = sign * mean[:, other]
        columns[axis, rows, 4 + (1 + axis) * count + minute] = 1.0
    A, y = columns.reshape(-1, columns.shape[-1]), left[:, :2].T.reshape(-1)
    found = np.linalg.lstsq(A, y, rcond=1e-9)[0]
    variance = np.var(y - A @ found) * np.diag(np.linalg.pinv(A.T @ A))
    part = slice(4, 4 + count)
    return np.degrees(found[part]), np.degrees(np.sqrt(variance[part]))


def velocity_at_rest(log: RecordedLog, time: Array, velocity_n: Array, from_s: float) -> Array:
    """Rms (3,) m/s of velocities (n, 3) at times (n,) s where the inertial samples show a rest, which makes them errors."""
    rest = log.imu_time[rest_rows(log)]
    rest = rest[(rest > max(from_s, time[0])) & (rest < time[-1])]
    return (
        np.sqrt([np.mean(np.interp(rest, time, column) ** 2) for column in velocity_n.T]) if len(rest) else np.full(3, np.nan)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("logs", nargs="*")
    parser.add_argument("--data", type=Path, default=Path())
    options = parser.parse_args()
    known = public_logs()
    developed_on = [name for name in known if known[name].used == "developed on" and name.startswith("umn")]
    for name in options.logs or [*developed_on, *(name for name in known if name.startswith("n380"))]:
        log = known[name].load(options.data)
        reference = log.reference
        assert reference is not None
        q_nb = attitude.numeric.from_euler(reference.roll, reference.pitch, reference.heading)
        tracks = {"reference": (reference.time, q_nb, reference.velocity_n)}
        for estimator in ("fusion", "fusion-smoother"):
            result = replay(log, estimator).results[0]
            tracks[estimator] = (result.time, result.outputs["q_nb"], result.outputs["velocity_n"])
        for track, (time, q_nb, velocity_n) in tracks.items():
            errors, sigmas = heading_errors(log, time, q_nb, result.from_s)
            weights = 1.0 / sigmas**2
            rms, sigma = (np.sqrt((each**2 * weights).sum() / weights.sum()) for each in (errors, sigmas))
            by_minute = " ".join(f"{each:.1f}" for each in errors)
            print(f"{name:15} {track:15} rms {rms:.2f} +- {sigma:.2f} deg, by minute: {by_minute}", flush=True)
            if velocity_n is not None:
                north, east, down = velocity_at_rest(log, time, velocity_n, result.from_s)
                print(f"{'':31} at rest: north {north:.3f}, east {east:.3f}, down {down:.3f} m/s", flush=True)


if __name__ == "__main__":
    main()

"""Roll and pitch of quadrotors: `fusion` at every grade that they may carry, beside filters of the library `ahrs`.

    pip install ahrs; git clone https://github.com/erlerobot/logs
    python tools/quadrotors.py [FLIGHT ...] [--data logs] [--short]

Two judges, over the same samples for all, those in the air in which `fusion` states its level: the autopilot's attitude, which
is a filter on the same sensors and good to one or two degrees; and the changes of the receiver's velocity over 1 s, which need
no reference (`insenv.evaluation.specific_force`; the horizontal parts).  What an attitude leaves of those contains the bias of
the accelerometers too, which `fusion` estimates and the others take for a tilt: `less bias` is without the one constant bias
that suits each way best.

The filters of `ahrs` take gyros, less their mean at rest, and accelerometers, and begin with the level at rest.  They run at
their default gains and at the best of four, which each judge chooses afterwards, on the flight itself.  They find no heading:
for the second judge all ways, the autopilot's too, have that of `fusion`, where it states 10 deg or less.

The clocks are aligned first: the autopilot's attitude by the rates of the gyros, the fixes by the autopilot's attitude.
"""

from __future__ import annotations

import argparse
import contextlib
import io
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pymavlink.DFReader import DFReader_binary

from insenv import attitude, replay
from insenv.base.errors import InsenvError
from insenv.core.tables import Array
from insenv.evaluation.errors import Result
from insenv.evaluation.outages import attitude_between
from insenv.evaluation.specific_force import FEWEST, SETTLED, VelocityChanges
from insenv.logs import RecordedLog, load
from insenv.logs.rest import rest_of, rest_rows
from insenv.runs.velocity_changes import velocity_changes

try:
    from ahrs.filters import Complementary, Madgwick, Mahony
except ModuleNotFoundError:
    raise SystemExit("tools/quadrotors.py compares with the library ahrs, which is not installed: pip install ahrs") from None

FLIGHTS: dict[str, tuple[str, tuple[float, float] | None]] = {
    "10-11-2014/103": ("developed on", None),
    "14-11-2014/118": ("developed on", None),
    "15-12-2014/16": ("developed on", None),
    "5-12-2014/218": ("developed on", None),
    "10-11-2014/104": ("developed on", None),
    "10-11-2014/105": ("developed on", None),
    "09-10-2014/25": ("reported on", None),
    "11-2-2015/112": ("reported on", None),
    "31-3-2015/83": ("reported on", None),
    "14-11-2014/118 at 447": ("reported on", (446.0, 500.0)),
    "14-11-2014/118 at 548": ("reported on", (547.0, 634.0)),
    "09-10-2014/31": ("reported on", None),
    "09-10-2014/31 at 462": ("reported on", (461.0, 581.0)),
    "6-11-2014/GPS_issues1": ("reported on", None),
    "6-11-2014/GPS_issues3": ("reported on", None),
    "6-11-2014/GPS_issues3 at 182": ("reported on", (181.0, 235.0)),
    "6-11-2014/Loiter_RTL": ("reported on", None),
    "8-10-2014/10": ("reported on", None),
    "8-10-2014/11": ("reported on", None),
}
"""By name: how insenv used the flight, and the part of the log, s, where it is not the longest without a gap."""
GRADES = ("no grade", "consumer", "autopilot", "industrial", "tactical")
"""None, and those of MEMS units."""
GAINS: dict[str, tuple[tuple[float, ...], ...]] = {
    "complementary": ((0.9,), (0.98,), (0.995,), (0.999,)),
    "Mahony": ((1.0, 0.3), (0.3, 0.03), (0.1, 0.003), (0.03, 0.0003)),
    "Madgwick": ((0.033,), (0.1,), (0.01,), (0.003,)),
}
"""Of each filter, its default first."""
FLYING, TIPPED = 200.0, np.radians(45.0)
"""The autopilot's throttle from which motors carry, of 1000, and the tilt beyond which the quadrotor lies on the ground."""
BEGIN_S = 2.0
"""Time whose mean force is the level at the start of a log without a rest."""
WRONG = np.radians(2.0)
"""Level (rad) that a filter may be off at the end of a rest: more shows wrong axes or signs."""


def started(log: RecordedLog) -> tuple[int, Array, Array]:
    """Sample from which the filters run, level there (roll, pitch, rad), and rate of the gyros at rest."""
    rows = rest_rows(log)
    if len(rows):
        rest = rest_of(log, rows, int(rows[-1]))
        return int(rows[0]), np.array(rest.level), rest.rate
    x, y, z = log.delta_velocity[log.imu_time < log.imu_time[0] + BEGIN_S].sum(axis=0)
    return 0, np.array([np.arctan2(-y, -z), np.arctan2(x, np.hypot(y, z))]), np.zeros(3)


def filtered(log: RecordedLog, name: str, gain: tuple[float, ...]) -> tuple[Array, Array]:
    """Times (n,) s and attitude (n, 4) of a filter of `ahrs`.

    Its axes are those of insenv: forward, right, down, and an attitude that turns b into n.  But its accelerometers show +g on
    the axis that points down: minus the specific force.
    """
    first, (roll, pitch), rest_rate = started(log)
    part = slice(first, None)
    dt = log.dt[part, None]
    gyro, accel = log.delta_angle[part] / dt - rest_rate, -log.delta_velocity[part] / dt
    if name == "complementary":
        begin = np.array([roll, pitch, 0.0])
        angles = Complementary(gyro, accel, Dt=float(np.median(dt)), gain=gain[0], w0=begin).W
        track = np.asarray(attitude.numeric.from_euler(*angles.T))
    else:
        one = Mahony(k_P=gain[0], k_I=gain[1]) if name == "Mahony" else Madgwick(gain=gain[0])
        q = np.asarray(attitude.numeric.from_euler(roll, pitch, 0.0))
        track = np.empty((len(dt), 4))
        for i, (rate, force, length) in enumerate(zip(gyro, accel, dt[:, 0], strict=True)):
            track[i] = q = one.updateIMU(q, rate, force, dt=float(length))
    if len(rows := rest_rows(log)):
        off = np.array(attitude.numeric.to_euler(track[len(rows) - 1])[:2]) - [roll, pitch]
        assert np.abs(off).max() < WRONG, f"{name} is {np.degrees(off)} deg off at the end of the rest"
    return log.imu_time[part], track


def at(times: Array, time: Array, q_nb: Array) -> Array:
    """An attitude (n, 4) known at `time` (n,) at others; NaN outside."""
    later = np.clip(np.searchsorted(time, times), 1, len(time) - 1)
    share = ((times - time[later - 1]) / (time[later] - time[later - 1]))[:, None]
    within = (times >= time[0]) & (times <= time[-1])
    return np.where(within[:, None], attitude_between(q_nb[later - 1], q_nb[later], share.clip(0.0, 1.0)), np.nan)


def best(values: Array, cost: Callable[[float], float]) -> float:
    """The value of least cost."""
    return min(map(float, values), key=cost)


def reference_of(log: RecordedLog) -> tuple[Array, Array]:
    """Times (m,) s and attitude (m, 4) of the autopilot, on the clock of the gyros."""
    reference = log.reference
    assert reference is not None
    q = np.asarray(attitude.numeric.from_euler(reference.roll, reference.pitch, reference.heading))
    time, angle = reference.time, np.cumsum(log.delta_angle, axis=0)
    turn = attitude.numeric.to_rotation_vector(attitude.numeric.multiply(attitude.numeric.conjugate(q[:-1]), q[1:]))
    near = np.linalg.norm(turn, axis=1) < 0.5

    def differs(late: float) -> float:
        moved = np.stack([np.diff(np.interp(time - late, log.imu_time, column)) for column in angle.T], axis=1)
        return float(np.mean((moved - turn)[near, :2] ** 2))

    return time - best(np.arange(-0.3, 0.31, 0.01), differs), q


def throttle_of(path: Path) -> tuple[Array, Array]:
    """Times (n,) s and throttle (n,) of the autopilot."""
    rows = []
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        reader = DFReader_binary(str(path))
        while (message := reader.recv_match(type=["CTUN"])) is not None:
            rows.append((message.TimeMS * 1e-3, message.ThrOut))
    time, throttle = np.array(rows).T
    return time, throttle


@dataclass(frozen=True)
class Judges:
    """The samples over which all ways are judged.

    time (m,) s, level (m, 2) rad: of the autopilot.  changes: of the receiver's velocity.  heading: times (n,) s and heading
    (n,) rad that all ways have for the second judge.
    """

    time: Array
    level: Array
    changes: VelocityChanges
    heading: tuple[Array, Array]

    def level_error(self, time: Array, q_nb: Array) -> Array:
        """Rms of roll and of pitch (2,), deg."""
        angles = np.stack(attitude.numeric.to_euler(at(self.time, time, q_nb))[:2], axis=1)
        wrapped = (angles - self.level + np.pi) % (2.0 * np.pi) - np.pi
        return np.asarray(np.degrees(np.sqrt(np.mean(wrapped**2, axis=0))))

    def force(self, time: Array, q_nb: Array) -> Array:
        """Rms of what the attitude leaves of the receiver's horizontal changes, and that less a constant bias, (2,), m/s^2."""
        if len(self.changes.time) < FEWEST:
            return np.full(2, np.nan)
        roll, pitch, _ = attitude.numeric.to_euler(at(self.changes.time, time, q_nb))
        q = np.asarray(attitude.numeric.from_euler(roll, pitch, np.interp(self.changes.time, *self.heading)))
        left, C_nb = self.changes.left(q)[:, :2].ravel(), attitude.numeric.to_dcm(q)[:, :2].reshape(-1, 3)
        unbiased = left - C_nb @ np.linalg.lstsq(C_nb, left, rcond=None)[0]
        return np.array([np.sqrt(2.0 * np.mean(each**2)) for each in (left, unbiased)])


def judges(path: Path, log: RecordedLog, result: Result) -> Judges:
    """What is in the air, from the start of the statistics on, where `fusion` states its level, and for forces its heading."""
    time, q_reference = reference_of(log)
    throttle, gnss = throttle_of(path), log.gnss
    assert gnss is not None
    level_sigma = np.hypot(result.sigma["roll_deg"], result.sigma["pitch_deg"])
    begin = max(result.from_s, result.time[0], log.imu_time[0] + BEGIN_S, time[0])
    end = min(result.time[-1], time[-1])

    def counts(times: Array, *sigmas: Array) -> NDArray[np.bool_]:
        inside = (times >= begin) & (times <= end)
        upright = attitude.numeric.to_dcm(at(times.clip(time[0], time[-1]), time, q_reference))[:, 2, 2] > np.cos(TIPPED)
        settled = [np.interp(times, result.time, each) < np.degrees(SETTLED) for each in sigmas]
        return np.asarray(inside & upright & (np.interp(times, *throttle) > FLYING) & np.all(settled, axis=0))

    use = counts(time, level_sigma)
    times, level = time[use], np.stack(attitude.numeric.to_euler(q_reference[use])[:2], axis=1)
    heading = np.unwrap(np.asarray(attitude.numeric.to_euler(result.outputs["q_nb"])[2]))

    def moved(offset: float) -> Judges:
        changes = velocity_changes(replace(log, gnss=replace(gnss, time=gnss.time + offset)))
        assert changes is not None
        use = counts(changes.time, level_sigma, result.sigma["heading_deg"])
        part = VelocityChanges(**{name: values[use] for name, values in vars(changes).items()})
        return Judges(times, level, part, (result.time, heading))

    return moved(best(np.arange(-0.6, 0.21, 0.05), lambda offset: float(moved(offset).force(time, q_reference)[0])))


@dataclass(frozen=True)
class Line:
    """What the judges say of a way: its name, rms of roll and pitch (2,), deg; forces (2,), m/s^2; what it states, deg."""

    way: str
    level: Array
    force: Array
    stated: Array | None = None
    verdict: str = ""

    @property
    def tilt(self) -> float:
        """Rms of both angles, deg."""
        return float(np.sqrt(np.mean(self.level**2)))

    def __str__(self) -> str:
        stated = "" if self.stated is None else f" ({self.stated[0]:.1f} {self.stated[1]:.1f})"
        level = "" if np.isnan(self.level).any() else f"{self.level[0]:.1f} {self.level[1]:.1f}{stated}"
        forces = ["" if np.isnan(each) else f"{each:.2f}" for each in self.force]
        return f"{self.way} | {level} | {forces[0]} | {forces[1]} | {self.verdict} |"


def lines(name: str, folder: Path) -> Iterator[Line]:
    """The lines of a flight, first the autopilot's, whose verdict is the time that is judged; none if `fusion` never starts."""
    _, part = FLIGHTS[name]
    path = next(folder.rglob(f"{name.split(' at ')[0]}.[Bb][Ii][Nn]"))
    span = {} if part is None else {"start_s": part[0], "stop_s": part[1]}
    unknown, refused, judge = np.full(2, np.nan), [], None
    for grade in GRADES:
        way = f"fusion, {grade}"
        try:
            log = load(path, changes={**span, **({} if grade == GRADES[0] else {"grade": grade})})
            result = replay(log, "fusion").results[0]
        except InsenvError as error:
            line = Line(way, unknown, unknown, verdict="diverged" if "diverged" in str(error) else "no start")
            if judge is None:
                refused.append(line)
            else:
                yield line
            continue
        if judge is None:
            judge = judges(path, log, result)
            seconds = len(judge.time) * float(np.median(np.diff(judge.time)))
            yield Line("autopilot", unknown, judge.force(*reference_of(log)), verdict=f"{seconds:.0f} s")
            yield from refused
        sigmas = [np.interp(judge.time, result.time, result.sigma[channel]) for channel in ("roll_deg", "pitch_deg")]
        track = result.time, result.outputs["q_nb"]
        verdict = "" if result.health is None else result.health.verdict
        stated = np.sqrt(np.mean(np.square(sigmas), axis=1))
        yield Line(way, judge.level_error(*track), judge.force(*track), stated, verdict)
    if judge is None:
        return
    for filter_, gains in GAINS.items():
        tracks = [filtered(log, filter_, gain) for gain in gains]
        errors, forces = (np.array([each(*track) for track in tracks]) for each in (judge.level_error, judge.force))
        nearest = int(np.argmin(np.linalg.norm(errors, axis=1)))
        yield Line(f"{filter_}, default", errors[0], forces[0])
        yield Line(f"{filter_}, best: {gains[nearest][0]:g}", errors[nearest], forces.min(axis=0))


def short(name: str, of_flight: Iterable[Line]) -> str:
    """A flight in one line."""
    by_way = {line.way.split(":")[0]: line for line in of_flight}

    def fusion(grade: str) -> str:
        line = by_way[f"fusion, {grade}"]
        return line.verdict if line.stated is None else f"{line.tilt:.1f} ({np.sqrt(np.mean(line.stated**2)):.1f})"

    rated = [by_way[f"fusion, {grade}"].tilt for grade in GRADES[1:]]
    rated = [tilt for tilt in rated if np.isfinite(tilt)]
    others = [f"{by_way[f'{each}, default'].tilt:.1f}, {by_way[f'{each}, best'].tilt:.1f}" for each in GAINS]
    least = min(by_way[f"{each}, best"].force[1] for each in GAINS)
    forces = [by_way["fusion, no grade"].force[1], by_way["autopilot"].force[1], least]
    cells = [
        f"{name}, {by_way['autopilot'].verdict}",
        fusion(GRADES[0]),
        f"{min(rated):.1f} to {max(rated):.1f}",
        *others,
        ", ".join("-" if np.isnan(each) else f"{each:.2f}" for each in forces),
    ]
    return f"| {' | '.join(cells)} |"


HEADER = "| flight | way | roll, pitch, rms (stated) [deg] | force [m/s2] | less bias | verdict |"
SHORT = "| flight, time | `fusion` (stated) | with a grade | complementary | Mahony | Madgwick | force less bias |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flights", nargs="*", metavar="FLIGHT")
    parser.add_argument("--data", type=Path, default=Path("."))
    parser.add_argument("--short", action="store_true", help="one line for each flight, of both angles together")
    chosen = parser.parse_args()
    header = SHORT if chosen.short else HEADER
    print(f"{header}\n{'|---' * header.count(' | ')}|---|")
    for name in chosen.flights or FLIGHTS:
        of_flight = list(lines(name, chosen.data))
        if not of_flight:
            print(f"{name}: fusion finds no start", flush=True)
        elif chosen.short:
            print(short(name, of_flight), flush=True)
        else:
            titles = [name, FLIGHTS[name][0], *[""] * len(of_flight)]
            print("\n".join(f"| {title} | {line}" for title, line in zip(titles, of_flight, strict=False)), flush=True)


if __name__ == "__main__":
    main()

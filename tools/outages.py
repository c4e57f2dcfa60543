"""Largest errors in the outages of a drive, by filter, beside the limit: the table on the page of `fusion`.

    python tools/outages.py                      prints it, half an hour
    python tools/outages.py --write              and into docs/estimators/fusion.md
    python tools/outages.py car-odometer -n 4    fewer runs

By filter: the root mean square, over runs and outages, of the largest horizontal error of an outage, the same of the optimal
filter or smoother, and the root mean square heading error from 300 s on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from yardsticks import error_paths

import insenv
from insenv.core.model import Values
from insenv.estimators import get_all
from insenv.estimators.contract import Estimator
from insenv.evaluation.limits.bound import blocks_of, layout_of
from insenv.evaluation.limits.states import Aid, aid_of
from insenv.scenario import build, load
from insenv.scenario.limits import TRAJECTORY_SEED, prior_of
from insenv.sensors.odometer import ODOMETER, axis

Array = NDArray[np.float64]

FIRST_SEED, RUNS = 30000, 32
"""No filter was tuned on these seeds."""
DRAWS = 1000
"""Paths of the optimal filter and smoother: their statistic is known to 1 %."""
SETTLED = 300.0
"""s, from which the heading counts."""
SIDEWAYS = 0.005
"""m/s, at each epoch of the odometer: wheels that do not slip, as in the simulation.  A fifth or four times as much changes
the limit by 1 % at most."""
PAGE = Path(__file__).parents[1] / "docs" / "estimators" / "fusion.md"
BEGIN, END = "<!-- begin outages -->\n", "<!-- end outages -->"


@dataclass(frozen=True)
class Case:
    """A filter on a scenario with outages.

    what: how the table names it.  settings: its keys.  odometer, wheels: what the optimal filter has beside GNSS and rest: the
    speed, and that wheels do not slip.
    """

    scenario: str
    what: str
    estimator: str | Estimator
    odometer: bool = False
    wheels: bool = False
    settings: dict[str, Any] = field(default_factory=dict)


def cases() -> tuple[Case, ...]:
    """The rows of the table."""
    unit = ("gyro_scale", "gyro_misalignment", "accel_scale", "accel_misalignment", "gnss_wander")
    still = insenv.fusion(("gyro_scale", "accel_scale"), id="still", smoother=True)
    held = insenv.fusion(unit, ["gnss", "zero_velocity", "non_holonomic"], id="wheels")
    gripping = insenv.fusion(unit, ["gnss", "zero_velocity", "non_holonomic"], id="gripping")
    free = insenv.fusion(unit, ["gnss", "zero_velocity"], id="no-wheels")
    both = ("fusion", "fusion-smoother")
    return (
        *(Case("car-survey", f"`{id}`", id) for id in ("loosely-coupled", *both)),
        Case("car-survey", "`fusion-smoother`, `standing_sigma_mps = 0.002`", still, settings={"standing_sigma_mps": 0.002}),
        *(Case("car-odometer", f"`{id}`, odometer and wheels", id, odometer=True, wheels=True) for id in both),
        Case("car-odometer", "aids gnss, zero_velocity, non_holonomic", held, wheels=True),
        Case(
            "car-odometer",
            "the same, `non_holonomic_sigma_mps = 0.005`, `non_holonomic_slip = 0`",
            gripping,
            wheels=True,
            settings={"non_holonomic_sigma_mps": 0.005, "non_holonomic_slip": 0.0},
        ),
        Case("car-odometer", "aids gnss, zero_velocity", free),
    )


def wheels_of(rows: dict[str, Any], interval: float, speed: bool) -> Aid:
    """Wheels that move neither sideways nor off the road, and the odometer with its speed or without.

    rows: the plant's parameters; interval: of its samples, s.
    """
    (row,) = ODOMETER.values

    def measure(motion: Any, e: Values, p: Values) -> dict[str, Any]:
        velocity_b = motion.body_velocity(p.odometer_lever_arm_b)
        aside = (ca.dot(axis(number, p, e.mounting), velocity_b) for number in (1, 2))
        forward = (ODOMETER.measure(motion, e, p)[row.name],) if speed else ()
        return {row.name: ca.vertcat(*forward, *aside)}

    wheels = replace(ODOMETER, values=(replace(row, shape=(2 + speed,)),), measure=measure)
    made = aid_of(wheels, rows, interval)
    return replace(made, noise=np.array([*(made.noise[:1] if speed else ()), SIDEWAYS, SIDEWAYS]))


def largest(time: Array, error: Array, outages: Array) -> Array:
    """Largest error (outages, ...) of the errors (instants, ...) in each outage (k, 2)."""
    return np.array([error[(time >= begin) & (time <= end)].max(axis=0) for begin, end in outages])


def least(case: Case, outages: Array, recorded: Array) -> tuple[float, float]:
    """The statistic of the optimal filter and of the optimal smoother, at the recorded instants (n,) s."""
    plant = build(load(case.scenario), seed=TRAJECTORY_SEED)
    rows, interval = plant.model.parameters.unpack(plant.model.parameters.pack(plant.parameters)), plant.sample_interval
    layout = layout_of(rows, interval, in_place=False)
    aids = {aid.id: aid for aid in layout.aids}
    odometer = aids.pop("odometer", None)
    if odometer is not None and (case.odometer or case.wheels):
        aids["odometer"] = wheels_of(rows, interval, case.odometer) if case.wheels else odometer
    layout = replace(layout, aids=tuple(aids.values()))
    blocks = blocks_of(plant.model, rows, interval, plant.samples, layout)
    paths = error_paths(blocks, layout, prior_of(plant.scenario.knowledge), outages, DRAWS, seed=1)
    shown = np.unique(np.abs(recorded[:, None] - paths.time).argmin(axis=1))
    filtered, smoothed = (
        float(np.sqrt(np.mean(largest(paths.time[shown], np.hypot(errors[shown, 0], errors[shown, 1]), outages) ** 2)))
        for errors in (paths.filtered, paths.smoothed)
    )
    return filtered, smoothed


def rows(scenario: str, runs: int) -> Iterator[str]:
    """Lines of the table in Markdown."""
    chosen = [case for case in cases() if case.scenario == scenario]
    estimators = get_all([case.estimator for case in chosen])
    settings = {e.id: case.settings for e, case in zip(estimators, chosen, strict=True)}
    gnss = load(scenario).gnss
    assert gnss is not None
    outages = np.array(gnss.outages_s)
    worst: list[list[Array]] = [[] for _ in chosen]
    heading: list[list[float]] = [[] for _ in chosen]
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        results = insenv.run(scenario, estimators, seed=seed, settings=settings).results
        for k, found in enumerate(results):
            error = np.hypot(found.errors["north_m"], found.errors["east_m"])
            worst[k].append(largest(found.time, error, outages))
            heading[k].append(float(np.mean(found.errors["heading_deg"][found.time >= SETTLED] ** 2)))
    kept: dict[tuple[bool, bool], tuple[float, float]] = {}
    for k, case in enumerate(chosen):
        key = (case.odometer, case.wheels)
        kept[key] = kept.get(key) or least(case, outages, results[k].time)
        rms, limit = np.sqrt(np.mean(np.square(worst[k]))), kept[key][bool(estimators[k].smooths)]
        yield f"| {scenario} | {case.what} | {rms:.3g} | {limit:.3g} | {rms / limit:.2f} | {np.sqrt(np.mean(heading[k])):.2g} |"


HEADER = (
    f"| scenario | filter | outages, m | limit, m | rms/limit | heading from {SETTLED:g} s, deg |\n|---|---|---|---|---|---|"
)


def main(arguments: list[str] | None = None) -> None:
    """Measure the cases of these scenarios and print their rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scenarios", nargs="*", help="all, if none is named")
    parser.add_argument("-n", "--runs", type=int, default=RUNS)
    parser.add_argument("--write", action="store_true", help="write the table into docs/estimators/fusion.md")
    given = parser.parse_args(arguments)
    if given.write and (given.runs != RUNS or given.scenarios):
        parser.error(f"--write: the table has all scenarios and {RUNS} seeds")
    print(HEADER)
    lines = []
    for scenario in given.scenarios or dict.fromkeys(case.scenario for case in cases()):
        for line in rows(scenario, given.runs):
            print(line, flush=True)
            lines.append(line)
    if given.write:
        before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        said = f"{RUNS} runs, seeds {FIRST_SEED} to {FIRST_SEED + RUNS - 1} (`python tools/outages.py --write`):"
        after = END + rest.split(END)[1]
        PAGE.write_text("\n".join([before + BEGIN.rstrip(), "", said, "", HEADER, *lines, "", after]), encoding="utf-8")


if __name__ == "__main__":
    main()

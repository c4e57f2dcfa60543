"""What a self-calibration reaches: errors of each error state of `fusion` at the end of a plan, over seeds, beside the bound.

    python tools/calibration.py                          turntable-calibration, 64 seeds from 7000
    python tools/calibration.py SCENARIO [RUNS [STATE]]  STATE: axis by axis

By state: the root mean square over runs and axes of the error before (what the data sheet states) and after, of the stated
standard deviation after, and the theoretical lower bound.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray
from yardsticks import bound_of_unit

from insenv.core.runner import make_runner
from insenv.evaluation.errors import UNITS
from insenv.runs.ensemble import ensemble
from insenv.scenario import build, load
from insenv.scenario.limits import TRAJECTORY_SEED, prior_of
from insenv.sensors.imu import true_unit_errors

Array = NDArray[np.float64]

FIRST_SEED, RUNS = 7000, 64


def table(
    name: str = "turntable-calibration", runs: int = RUNS, first_seed: int = FIRST_SEED, apart: str = ""
) -> list[dict[str, float | str]]:
    """One row per error state, in the units of `UNITS`; one per axis of the state `apart`, if it is given."""
    scenario = load(name)
    done = ensemble(scenario, ["fusion"], range(first_seed, first_seed + runs), records=2)
    outputs = done.outputs["fusion"]
    plant = build(scenario, seed=TRAJECTORY_SEED)
    least = bound_of_unit(
        plant.model, plant.parameters, prior_of(scenario.knowledge), plant.samples, in_place=bool(plant.in_place)
    )
    true = [
        true_unit_errors(
            make_runner(each.model, each.parameters).state
            | {row: done.truth[row][k, -1] for row in ("gyro_bias_true", "accel_bias_true", "imu_temperature")},
            each.model.parameters.unpack(each.model.parameters.pack(each.parameters)),
        )
        for k, each in enumerate(done.plants)
    ]
    rows: list[dict[str, float | str]] = []
    for state in [apart] if apart else [state for state in UNITS if state in outputs and state in least]:
        unit, scale = UNITS[state]
        actual = np.array([each[state] for each in true])
        error = outputs[state][:, -1] - actual
        sigma = outputs[f"{state}_estimate_sigma"][:, -1]
        parts = {f"{state}[{k}]": [k] for k in range(actual.shape[1])} if apart else {state: slice(None)}
        for label, part in parts.items():
            rows.append({
                "state": label,
                "unit": unit,
                "before": scale * _rms(actual[:, part]),
                "after": scale * _rms(error[:, part]),
                "stated": scale * _rms(sigma[:, part]),
                "bound": scale * _rms(least[state][part]),
                "beyond": float(np.mean(np.abs(error[:, part]) > 3 * sigma[:, part])),
            })  # fmt: skip
    return rows


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main(arguments: list[str]) -> None:
    """Print the table."""
    name = arguments[0] if arguments else "turntable-calibration"
    runs = arguments[1] if len(arguments) > 1 else str(RUNS)
    rows = table(name, int(runs), apart=arguments[2] if len(arguments) > 2 else "")
    print("| state | unit | before | after: rms | stated | bound | rms/bound | beyond 3 sigma |\n|---" + "|---" * 7 + "|")
    for row in rows:
        numbers = " | ".join(f"{row[key]:.3g}" for key in ("before", "after", "stated", "bound"))
        ratio = float(row["after"]) / float(row["bound"])
        print(f"| `{row['state']}` | {row['unit']} | {numbers} | {ratio:.2f} | {100 * float(row['beyond']):.1f} % |")


if __name__ == "__main__":
    main(sys.argv[1:])

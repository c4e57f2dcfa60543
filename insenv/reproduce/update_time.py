"""Time of one filter update: the steps that run on a fix, without inertial samples, in the native loop."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.scenario import build, load
from insenv.scenario.chunks import input_rows

REPETITIONS = 5
UPDATES = 50_000
SCENARIO, WARM_UP_S = "large-misalignment", 60.0
SUKF = ("predict", "gnss")
LSSVM = ("fix", "infer")
INFER = ("infer",)


def microseconds(id: str, steps: tuple[str, ...]) -> float:
    """Median time (us) of the named steps over repetitions, with the state and fix at the end of a warm-up run."""
    estimator, plant = get(id), build(load(SCENARIO), duration_s=WARM_UP_S)
    columns = dict(plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples)))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    rows = input_rows(estimator.model, columns, plant.samples)
    warm = make_runner(estimator.model, estimator.parameters(plant.knowledge))
    warm.run(plant.samples, rows, 0)
    fix = rows[columns["gnss_valid"] != 0][-1]

    runner = make_runner(_alone(estimator.model, {step: Step(estimator.model.steps[step].function) for step in steps}), warm.p)
    taken = []
    for _ in range(REPETITIONS):
        runner.x[:] = warm.x
        begin = time.process_time()
        runner.run(UPDATES, fix, 0)
        taken.append(time.process_time() - begin)
    return statistics.median(taken) / UPDATES * 1e6


def _alone(model: Model, steps: Mapping[str, Step]) -> Model:
    """The model with only these steps, which run on every advance."""
    return replace(model, id=f"{model.id}-{'-'.join(steps)}", steps=steps)

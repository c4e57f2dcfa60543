"""A vehicle alone as a model: its state is its output."""

import functools

import numpy as np

from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.vehicles import aircraft, car, multirotor, ship, truth_part

DEG = np.pi / 180
VEHICLES = {
    "ship": ship(), "two sines": ship({"roll": 2, "down": 1}), "sea": ship(0, 16), "seeded": ship({"pitch": 1}, seeded=True),
    "under way": ship(1, 3, under_way=True), "car": car(), "shaken car": car(2), "aircraft": aircraft(),
    "multirotor": multirotor(),
}  # fmt: skip


@functools.cache
def plant(name: str) -> Model:
    """The vehicle of `VEHICLES` alone; the outputs are the whole state."""
    base = Part(
        parameters=Table((SEED, Row("sample_interval", "Sample interval", "s", start=0.005, lower=1e-4, upper=1.0))),
        state=Table((STEP,)),
        steps={"sample": Step(lambda p, x, u: {"step": x.step + 1.0})},
    )
    part = truth_part(VEHICLES[name])
    state = part.state + base.state
    return merge("plant", "Vehicle", [part, base], state, lambda p, x: {name: getattr(x, name) for name in state.names})


def history(name: str, parameters: dict, n: int, every: int = 1) -> dict:
    """Rows of the state by name, before the first sample and after each `every` samples."""
    runner = make_runner(plant(name), parameters)
    first = runner.output()
    return runner.model.outputs.unpack(np.vstack([first, runner.run(n, every=every)]))

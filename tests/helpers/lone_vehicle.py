"""A vehicle alone as a model: its state is its output."""

from __future__ import annotations

import numpy as np

from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.vehicles import Vehicle, truth_part

DEG = np.pi / 180


def plant(vehicle: Vehicle) -> Model:
    """The vehicle alone; the outputs are the whole state."""
    base = Part(
        parameters=Table((SEED, Row("sample_interval", "Sample interval", "s", start=0.005, lower=1e-4, upper=1.0))),
        state=Table((STEP,)),
        steps={"sample": Step(lambda p, x, u: {"step": x.step + 1.0})},
    )
    part = truth_part(vehicle)
    state = part.state + base.state
    return merge("plant", "Vehicle", [part, base], state, lambda p, x: {name: getattr(x, name) for name in state.names})


def history(vehicle: Vehicle, parameters: dict, n: int, every: int = 1, backend: str | None = None) -> dict:
    """Rows of the state by name, before the first sample and after each `every` samples."""
    runner = make_runner(plant(vehicle), parameters, backend)
    first = runner.output()
    return runner.model.outputs.unpack(np.vstack([first, runner.run(n, every=every)]))

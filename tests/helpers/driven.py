"""The columns of a simulated drive, and models that are fed with such columns."""

import numpy as np

from insenv.core.runner import make_runner
from insenv.scenario.inputs import input_rows


def columns_of(plant, **rows):
    """Outputs of a plant and dt by name, (samples, ...); rows: parameters in place of its own."""
    shown = make_runner(plant.model, {**plant.parameters, **rows}).run(plant.samples)
    return {**plant.model.outputs.unpack(shown), "dt": np.full(plant.samples, plant.sample_interval)}


def of_model(model, values):
    """Those of the values that the model has as parameters."""
    return {name: value for name, value in values.items() if name in model.parameters}


def fed(model, columns, parameters=None, backend=None, **state):
    """The runner of a model after all samples of some columns; state: rows other than those that it starts with."""
    runner, count = make_runner(model, parameters, backend), len(columns["dt"])
    runner.x[:] = model.state.pack(state, base=runner.x)
    runner.run(count, input_rows(model, columns, count), 0)
    return runner


def fed_outputs(model, columns, parameters, every=1):
    """Outputs by name after each `every` of the samples."""
    count = len(columns["dt"])
    return model.outputs.unpack(make_runner(model, parameters).run(count, input_rows(model, columns, count), every))


def outputs_of(model, state, parameters=None):
    """Outputs by name of a state (vector)."""
    p = model.parameters.pack(parameters or {})
    return model.outputs.unpack(np.array(model.kernels["output"].function(p, state)).ravel())

"""The FMU of the peer: an estimator of insenv as a PythonFMU slave that calls its native runner from Python.

insenv does not import this module: `insenv.bench.fmu` passes the file to the builder of PythonFMU, and the FMU runs it.  The
environment variable INSENV_SLAVE names the estimator as JSON: {"id": ..., "parameters": flat vector}.
"""

import json
import os

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

from insenv import estimators
from insenv.core.runner import make_runner


class Estimator(Fmi2Slave):
    """Inputs and outputs of the tables, one variable per element."""

    author = "insenv"
    description = "An estimator of insenv, run in Python"

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        chosen = json.loads(os.environ["INSENV_SLAVE"])
        model = estimators.get(chosen["id"]).model
        self.runner = make_runner(model, np.array(chosen["parameters"]))
        self.u = model.inputs.start_vector().tolist()
        self.y = self.runner.output().tolist()
        continuous = Fmi2Variability.continuous
        for table, values, causality in (
            (model.inputs, self.u, Fmi2Causality.input),
            (model.outputs, self.y, Fmi2Causality.output),
        ):
            place = 0
            for row in table:
                for k in range(row.size):
                    name = f"{row.name}[{k + 1}]" if row.shape else row.name
                    get, put = _access(values, place)
                    self.register_variable(Real(name, causality=causality, variability=continuous, getter=get, setter=put))
                    place += 1

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by one sample."""
        self.runner._u[:] = self.u
        self.runner._advance()
        self.runner._output()
        self.y[:] = self.runner._y.tolist()
        return True


def _access(values: list[float], place: int):  # type: ignore[no-untyped-def]
    return (lambda: values[place]), (lambda value: values.__setitem__(place, value))

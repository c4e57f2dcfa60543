"""What feeds the inputs of estimators, and what is wrong with an input that does not fit it.

Inputs are bound by name: one whose name is misspelt would keep its start value, and one in another unit or frame would be taken
as it comes, both without an error.  `Estimator.check` asks here before a run, and so does the conformance suite.
"""

from __future__ import annotations

from insenv.base.errors import nearest
from insenv.core.model import Model
from insenv.core.tables import Table
from insenv.estimators.parts.rows import SAMPLE_INPUTS, SMOOTHED_INPUT, STANDING_INPUT
from insenv.sensors import IMU
from insenv.sensors import registry as sensor_registry


def feeds() -> dict[str, Table]:
    """By what feeds them, all rows that an estimator may take as inputs: a column has unit, frame and shape of its row.

    They are the sample interval, what the inertial unit and each registered sensor measure, the rest that a log or a stream
    states, and what the backward pass of a smoother is asked for.
    """
    sensors = (IMU, *(section.sensor for section in sensor_registry.registered().values()))
    return {
        "the clock": Table((SAMPLE_INPUTS["dt"],)),
        **{f"sensor {sensor.id!r}": sensor.measured for sensor in sensors},
        "a log or a stream": STANDING_INPUT,
        "the backward pass": SMOOTHED_INPUT,
    }


def misfed(model: Model) -> str:
    """The sentence about an input of an estimator's model that nothing feeds, or whose unit, frame or shape differs from those
    of the row that feeds it; empty if there is none.
    """
    fed = {row.name: (source, row) for source, table in feeds().items() for row in table}
    for row in model.inputs:
        where = f"estimator {model.id!r}, input {row.name!r}"
        if row.name not in fed:
            return f"{where}: nothing feeds it{nearest(row.name, fed, '`insenv.estimators.parts.fed.feeds()`')}"
        source, feeding = fed[row.name]
        for what in ("unit", "frame", "shape"):
            declared, allowed = getattr(row, what), getattr(feeding, what)
            if declared != allowed:
                return f"{where}: {what} = {declared!r}: allowed is {allowed!r}, as {source} gives it"
    return ""

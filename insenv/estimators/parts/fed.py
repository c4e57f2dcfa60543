"""What feeds the inputs and the parameters of estimators, and what is wrong with one that does not fit it.

They are bound by name: an input whose name is misspelt would keep its start value, and what is in another unit or frame would
be taken as it comes, both without an error.  `Estimator.check` asks here before a run, and so does the conformance suite.
"""

from __future__ import annotations

from insenv.base.errors import nearest
from insenv.core.model import Model
from insenv.core.tables import Table
from insenv.estimators.parts.rows import (
    PLACE,
    SAMPLE_INPUTS,
    SENSORS,
    SMOOTHED_INPUT,
    STANDING_INPUT,
    START,
    START_BIASES,
    START_SIGMAS,
)
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


def known() -> dict[str, Table]:
    """By what gives them, rows of parameters that have the value of their name in `Knowledge`, if nobody sets them."""
    return {
        "the start": PLACE + START + START_SIGMAS + START_BIASES,
        "the data sheet of the unit": SENSORS,
        "the receiver or the data sheet of an instrument": sensor_registry.stated_rows(),
    }


def misfed(model: Model) -> str:
    """The sentence about an input of an estimator's model that nothing feeds, or whose unit, frame or shape differs from those
    of the row that feeds it, or about a parameter in another unit than what is known; empty if there is none.
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
    for source, table in known().items():
        for row in table:
            if row.name in model.parameters and (declared := model.parameters[row.name].unit) != row.unit:
                return (
                    f"estimator {model.id!r}, parameter {row.name!r}: unit = {declared!r}: allowed is {row.unit!r}, "
                    f"as {source} gives it"
                )
    return ""

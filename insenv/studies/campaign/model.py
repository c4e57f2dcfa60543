"""The model of a campaign: plant, sensors, estimator and error statistics in one model, of which only summaries are
read.

Errors and stated variances are evaluated every `evaluation_samples` samples, as often as `insenv.runs.simulated` records
them, and the squares are summed; the outputs are read after every `evaluations` evaluations.  The statistics are part of the
model's arithmetic, and therefore bit-identical on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv.core.elementary import select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators import Estimator
from insenv.evaluation.errors import channels_of, error_of, nees, sigma_of, stated_of
from insenv.scenario.loop import loop_model, unprefixed


@dataclass(frozen=True, eq=False)
class Measured:
    """The model of a campaign and the meaning of its outputs.

    channels: names of the errors, of `insenv.evaluation.errors.CHANNELS`.
    stated: channels whose standard deviation the estimator states.
    degrees: degrees of freedom of the NEES; 0: there is none.
    """

    model: Model
    channels: tuple[str, ...]
    stated: tuple[str, ...]
    degrees: int


@lru_cache(maxsize=16)
def measured_model(plant: Model, estimator: Estimator) -> Measured:
    """The campaign's model for a plant and an estimator; the same object for the same pair.

    Outputs: `error` (channels) and `sigma` (stated channels), current; the means of their squares since the previous record,
    `mean_square` and `mean_variance`; `nees`; the rows with which the estimator tells its health.  Added parameters:
    `evaluation_samples`, `evaluations`.
    """
    loop = loop_model(plant, estimator.model)
    statistics = _Statistics(loop, estimator)
    added = Table((Row("evaluation_samples", "Samples between evaluations", start=1.0, lower=1.0),
                   Row("evaluations", "Evaluations between records", start=1.0, lower=1.0)))  # fmt: skip
    model = Model(
        id=f"campaign-{loop.id}",
        title=f"{loop.title}; statistics",
        parameters=loop.parameters + added,
        state=loop.state + statistics.state,
        inputs=loop.inputs,
        outputs=statistics.outputs,
        steps={
            **loop.steps,
            "statistics_sample": Step(statistics.sample),
            "statistics_evaluate": Step(statistics.evaluate, when="evaluation_due"),
        },
        output=statistics.output,
        start=loop.start,
        start_uniforms=loop.start_uniforms,
    )
    return Measured(model, statistics.channels, statistics.stated, statistics.degrees)


class _Statistics:
    """Rows and functions of the statistics appended to a loop."""

    def __init__(self, loop: Model, estimator: Estimator) -> None:
        self.loop, self.estimator = loop, estimator
        outputs = estimator.model.outputs
        self.channels, self.stated = channels_of(outputs), stated_of(outputs)
        self.degrees = self._degrees()
        count = len(self.channels)
        rows = [
            Row("evaluation_count", "Samples since the last evaluation"),
            Row("evaluation_due", "1 on a sample after which errors are evaluated"),
            Row("evaluated", "Evaluations since the last record"),
            Row("squared_error", "Sum of the squared errors of these evaluations", "deg^2, m^2, m^2/s^2", (count,)),
        ]
        if self.stated:
            rows.append(Row("squared_sigma", "Sum of the stated variances", "deg^2, m^2, m^2/s^2", (len(self.stated),)))
        shown = [
            Row("error", "Estimate minus truth", "deg, m, m/s", (count,)),
            Row("mean_square", "Mean squared error since the last record", "deg^2, m^2, m^2/s^2", (count,)),
        ]
        if self.stated:
            size = (len(self.stated),)
            shown.append(Row("sigma", "Standard deviation that the estimator states", "deg, m, m/s", size))
            shown.append(Row("mean_variance", "Mean of its square since the last record", "deg^2, m^2, m^2/s^2", size))
        if self.degrees:
            shown.append(Row("nees", "Normalised estimation error squared"))
        shown.extend(estimator.health_rows)
        self.state, self.outputs = Table(tuple(rows)), Table(tuple(shown))

    def sample(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        """On every sample: count it."""
        count = x.evaluation_count + 1
        due = count >= p.evaluation_samples
        return {"evaluation_count": count - due * count, "evaluation_due": due}

    def evaluate(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        """Add the squared errors and the stated variances; the first evaluation after a record restarts the sums."""
        _, outputs = self._estimated(p, x)
        added = {"squared_error": error_of(self.channels, outputs, x)}
        if self.stated:
            added["squared_sigma"] = sigma_of(self.stated, outputs)
        continues = x.evaluated < p.evaluations
        # selected rather than multiplied by 0: a NaN must not survive the restart
        sums = {name: select(continues, getattr(x, name), 0.0) + value * value for name, value in added.items()}
        return {"evaluated": continues * x.evaluated + 1, **sums}

    def output(self, p: Values, x: Values) -> dict[str, Any]:
        """The outputs at a record."""
        state, outputs = self._estimated(p, x)
        count = x.evaluated + (x.evaluated == 0)
        rows: dict[str, Any] = {"error": error_of(self.channels, outputs, x), "mean_square": x.squared_error / count}
        if self.stated:
            rows |= {"sigma": sigma_of(self.stated, outputs), "mean_variance": x.squared_sigma / count}
        if self.degrees:
            rows["nees"] = nees(self.estimator, state, outputs, x)[0]
        rows.update({name: getattr(outputs, name) for name in self.estimator.health_rows.names})
        return rows

    def _degrees(self) -> int:
        """Degrees of freedom of the NEES, found by asking for it once."""
        model = self.estimator.model
        p, x = (table.symbols(ca.SX.sym(n, table.size)) for n, table in (("p", model.parameters), ("x", model.state)))
        truth = self.loop.state.symbols(ca.SX.sym("t", self.loop.state.size))
        return nees(self.estimator, x, SimpleNamespace(**model.output(p, x)), truth)[1]

    def _estimated(self, p: Values, x: Values) -> tuple[Values, Values]:
        """State and outputs of the estimator, under its own names."""
        model = self.estimator.model
        state = unprefixed(x, model.state)
        return state, SimpleNamespace(**model.output(unprefixed(p, model.parameters), state))

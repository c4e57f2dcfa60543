"""`Tuning`: what tuning found, to be printed, drawn and saved as the section of a TOML file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from insenv.base.remarks import Remark, as_json
from insenv.core.tables import Array
from insenv.report.document import Block, Document, Line, Page, Sentences, Table, page_of
from insenv.report.notebook import Shown
from insenv.report.panels import TRUTH_GROUP, Curve, IntervalsPanel, Picture, Section, TimePanel
from insenv.report.tables import label, number
from insenv.studies.campaign.statistics import Estimate
from insenv.studies.tune_search import Parameter

NAME = "tuning"
PARAMETER_COLUMNS = ("parameter", "before", "after", "factor")
CHANNEL_COLUMNS = ("rms", "before", "after", "ratio", "from", "to", "limit")


@dataclass(frozen=True)
class Channel:
    """The rms of one channel on the data for judging: before, after, their ratio with a 95 % interval, the limit or None."""

    name: str
    before: float
    after: float
    ratio: Estimate
    limit: float | None

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {"before": self.before, "after": self.after, "ratio": self.ratio.as_json(), "limit": self.limit}


@dataclass(frozen=True, repr=False)
class Tuning(Shown):
    """The result of tuning.

    trained_on, judged_on: which data.  parameters, factors: what was tuned, and by how much.  history (generations, 2): best
    and median objective of each population; start: the objective before, on the same data.  before, after: objective on the
    data for judging; change: after minus before, with a 95 % interval.  channels: errors there.  consistency: there, 1 for a
    consistent filter: mean NEES over its degrees of freedom, or on a log the mean squared innovation over its variance; None
    without.
    """

    source: str
    estimator: str
    trained_on: str
    judged_on: str
    duration_s: float
    parameters: tuple[Parameter, ...]
    factors: Array
    history: Array
    start: float
    before: float
    after: float
    change: Estimate
    channels: tuple[Channel, ...]
    consistency: dict[str, float] | None
    notes: tuple[Remark, ...] = ()

    @property
    def is_better(self) -> bool:
        """Whether the objective on the data for judging has fallen, by more than chance."""
        return self.change.high < 0.0

    def settings(self) -> dict[str, Any]:
        """The tuned parameters by their keys in [estimator.ID]."""
        return {p.key: p.setting(float(f)) for p, f in zip(self.parameters, self.factors, strict=True)}

    def toml(self) -> str:
        """The section of a scenario or of the description of a log."""
        head = [f"# insenv tune {self.source} -e {self.estimator}: tuned on {self.trained_on}, evaluated on {self.judged_on}"]
        head += [] if self.is_better else ["# not significantly better on held-out data"]
        lines = [f"{key} = {value}" for key, value in self.settings().items()]
        return "\n".join([*head, f'[estimator."{self.estimator}"]', *lines]) + "\n"

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "source": self.source,
            "estimator": self.estimator,
            "trained_on": self.trained_on,
            "judged_on": self.judged_on,
            "duration_s": self.duration_s,
            "parameters": [
                {"key": p.key, "before": p.setting(1.0), "after": p.setting(float(f)), "factor": float(f)}
                for p, f in zip(self.parameters, self.factors, strict=True)
            ],
            "objective": {"before": self.before, "after": self.after, "change": self.change.as_json()},
            "better": self.is_better,
            "errors": {channel.name: channel.as_json() for channel in self.channels},
            "consistency": self.consistency,
            **as_json(self.notes),
        }

    def document(self) -> Document:
        """What is printed and kept of it."""
        texts, page, figure = {f"{NAME}.toml": self.toml()}, partial(tuning_page, self), partial(tuning_picture, self)
        return Document(NAME, self.as_json(), partial(tuning_blocks, self), texts, page=page, figure=figure)

    def __repr__(self) -> str:
        if not self.is_better:
            return f"Tuning of {self.estimator} on {self.source}: no better on {self.judged_on}; keep the present tuning"
        return f"Tuning of {self.estimator} on {self.source}: better on {self.judged_on}\n{self.toml()}"


def tuning_blocks(tuning: Tuning) -> Iterator[Block]:
    """The printed lines and tables, top to bottom."""
    yield Line(f"{tuning.source}: {tuning.estimator}", "bold")
    yield Line(f"tuned on {tuning.trained_on}, evaluated on {tuning.judged_on}")
    yield Line()
    parameters = [
        (one.key, _shown(one.setting(1.0)), _shown(one.setting(float(factor))), number(float(factor)))
        for one, factor in zip(tuning.parameters, tuning.factors, strict=True)
    ]
    yield Table(PARAMETER_COLUMNS, parameters, caption="Parameters")
    yield Line()
    if tuning.channels:
        yield Table(CHANNEL_COLUMNS, list(map(_channel_row, tuning.channels)), caption=f"Errors on {tuning.judged_on}")
    yield Sentences("explained", sentences(tuning))
    if not tuning.is_better:
        yield Line("not significantly better on held-out data: keep the present tuning", "yellow")
    yield Sentences("notes", tuning.notes, head="note: ")


def _channel_row(channel: Channel) -> tuple[str | Line, ...]:
    """The cells of `CHANNEL_COLUMNS`."""
    before, after, ratio, *others = map(
        number, (channel.before, channel.after, channel.ratio.value, channel.ratio.low, channel.ratio.high, channel.limit)
    )
    real = channel.ratio.low > 1.0 or channel.ratio.high < 1.0
    return label(channel.name), before, after, Line(ratio, "bold" if real else ""), *others


def sentences(tuning: Tuning) -> tuple[str, ...]:
    """The consistency and the objective on the data for judging."""
    consistent, change = tuning.consistency, tuning.change
    texts = []
    if consistent is not None:
        before, after = (number(consistent[name]) for name in ("before", "after"))
        texts.append(f"consistency, 1 if the stated sigmas are right: {before} before, {after} after")
    ends = f", 95 %: {change.low:+.3f} to {change.high:+.3f}" if np.isfinite([change.low, change.high]).all() else ""
    return (*texts, f"objective on {tuning.judged_on}: {tuning.before:.3f}, changed by {change.value:+.3f}{ends}")


def _shown(value: float | list[float]) -> str:
    return ", ".join(map(number, value)) if isinstance(value, list) else number(value)


# The page and the figure of a tuning: what was changed, the errors before and after, and the search.

LEGEND = ("best of a population", "median of a population")


def tuning_page(tuning: Tuning) -> Page:
    """The page of a tuning."""
    changes = change_panels(tuning)
    return page_of(
        tuning_blocks(tuning),
        tab=f"{tuning.source}: tuning of {tuning.estimator}",
        title="Tuning" if tuning.is_better else "Tuning: no significant improvement, keep the present parameters",
        facts=[f"tuned on {tuning.trained_on}", f"evaluated on {tuning.judged_on}", f"{number(tuning.duration_s)} s"],
        legend=[{"name": name} for name in LEGEND],
        sections=[
            Section("Before and after", changes, columns=2),
            Section("The search", [history_panel(tuning)], columns=1),
        ],
        truth="before",
        more={"axis": {"name": "Generation", "unit": "", "whole": True}},
    )


def tuning_picture(tuning: Tuning) -> Picture:
    """The objective over the generations, the factors, and the ratio of the errors after to those before."""
    title = f"{tuning.source}: tuning of {tuning.estimator}"
    return Picture(title, [[history_panel(tuning), *change_panels(tuning)]], LEGEND, (10.5, 4.2), truth="before", columns=3)


def change_panels(tuning: Tuning) -> list[IntervalsPanel]:
    """The factors, and the ratio of the errors after to those before."""
    factors = [(one.key, float(factor), None, None) for one, factor in zip(tuning.parameters, tuning.factors, strict=True)]
    ratios = [(label(one.name), one.ratio.value, one.ratio.low, one.ratio.high) for one in tuning.channels]
    panels = [IntervalsPanel("Factors on the parameters", factors)]
    heading = "rms after / before, 95 %"
    rms = IntervalsPanel(f"{heading}, on {tuning.judged_on}", ratios, heading, tuning.judged_on)
    return panels + ([rms] if ratios else [])


def history_panel(tuning: Tuning) -> TimePanel:
    """The objective over the generations."""
    generations = np.arange(1.0, len(tuning.history) + 1)
    panel = TimePanel(f"Objective on {tuning.trained_on}", "1", generations, x_name="generation")
    panel.marks = [Curve(TRUTH_GROUP, np.full(len(generations), tuning.start))]
    panel.marks += [Curve(group, tuning.history[:, group]) for group in (1, 0)]
    return panel

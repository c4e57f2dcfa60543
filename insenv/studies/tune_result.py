"""`Tuning`: what tuning found, to be printed, drawn and saved as the section of a TOML file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.style import COLOURS, LIMIT, legend, page, title
from insenv.base.version import __version__
from insenv.report.document import Block, Document, Grid, Line
from insenv.report.files import FilesWritten, OutputFolder, write_document
from insenv.report.notebook import require_matplotlib
from insenv.report.page import assembled
from insenv.report.page.panels import TRUTH_GROUP, Pool, TimePanel, intervals_panel, section, table
from insenv.report.tables import label, number
from insenv.studies.campaign.statistics import Estimate
from insenv.studies.tune_search import Parameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
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
class Tuning:
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
    notes: tuple[str, ...] = ()

    @property
    def is_better(self) -> bool:
        """Whether the objective on the data for judging has fallen, by more than chance."""
        return self.change.high < 0.0

    def settings(self) -> dict[str, Any]:
        """The tuned parameters by their keys in [estimator.ID]."""
        return {p.key: p.setting(float(f)) for p, f in zip(self.parameters, self.factors, strict=True)}

    def toml(self) -> str:
        """The section of a scenario or of the description of a log."""
        head = [f"# insenv tune {self.source} -e {self.estimator}: sought on {self.trained_on}, judged on {self.judged_on}"]
        head += [] if self.is_better else ["# no better than by chance on data that the search has not seen"]
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
            "notes": list(self.notes),
        }

    def plot(self) -> Figure:
        """The figure of the search and of the errors.  Raises `InsenvError` if matplotlib is missing."""
        require_matplotlib()
        return draw_tuning(self)

    def save(self, folder: str | Path, figure: bool = True) -> FilesWritten:
        """Write tuning.toml, tuning.json and, if `figure` and matplotlib is installed, the figure.

        Raises `InputError` if the folder cannot be written to, `InsenvError` if writing fails.
        """
        return write_document(self.document(), OutputFolder(folder), figure)

    def document(self) -> Document:
        """What is printed and kept of it."""
        texts, page = {f"{NAME}.toml": self.toml()}, partial(tuning_page, self)
        return Document(NAME, self.as_json(), partial(tuning_blocks, self), texts, page=page, figure=self.plot)

    def __repr__(self) -> str:
        if not self.is_better:
            return f"Tuning of {self.estimator} on {self.source}: no better on {self.judged_on}; keep the present tuning"
        return f"Tuning of {self.estimator} on {self.source}: better on {self.judged_on}\n{self.toml()}"


def tuning_blocks(found: Tuning) -> Iterator[Block]:
    """The printed lines and tables, top to bottom."""
    yield Line(f"{found.source}: {found.estimator}", "bold")
    yield Line(f"sought on {found.trained_on}, judged on {found.judged_on}")
    yield Line()
    yield Grid(PARAMETER_COLUMNS, parameter_rows(found))
    yield Line()
    if found.channels:
        rows: list[Sequence[str | Line]] = []
        for channel, (name, before, after, ratio, *others) in zip(found.channels, channel_rows(found), strict=True):
            real = channel.ratio.low > 1.0 or channel.ratio.high < 1.0
            rows.append((name, before, after, Line(ratio, "bold" if real else ""), *others))
        yield Grid(CHANNEL_COLUMNS, rows)
    for sentence in sentences(found):
        yield Line(sentence)
    if not found.is_better:
        yield Line("no better than by chance on data not seen before: keep the present tuning", "yellow")
    for note in found.notes:
        yield Line(f"note: {note}")


def parameter_rows(found: Tuning) -> list[tuple[str, ...]]:
    """By parameter: key, value before and after, factor."""
    return [
        (one.key, _shown(one.setting(1.0)), _shown(one.setting(float(factor))), number(float(factor)))
        for one, factor in zip(found.parameters, found.factors, strict=True)
    ]


def channel_rows(found: Tuning) -> list[tuple[str, ...]]:
    """By channel: label, rms before and after, their ratio with its interval, limit."""
    return [
        (label(one.name), *map(number, (one.before, one.after, one.ratio.value, one.ratio.low, one.ratio.high, one.limit)))
        for one in found.channels
    ]


def sentences(found: Tuning) -> tuple[str, ...]:
    """The consistency and the objective on the data for judging."""
    consistent, change = found.consistency, found.change
    told = []
    if consistent is not None:
        before, after = (number(consistent[name]) for name in ("before", "after"))
        told.append(f"consistency, 1 if the stated sigmas are right: {before} before, {after} after")
    ends = f", 95 %: {change.low:+.3f} to {change.high:+.3f}" if np.isfinite([change.low, change.high]).all() else ""
    return (*told, f"objective on {found.judged_on}: {found.before:.3f}, changed by {change.value:+.3f}{ends}")


def _shown(value: float | list[float]) -> str:
    return ", ".join(map(number, value)) if isinstance(value, list) else number(value)


def draw_tuning(found: Tuning) -> Figure:
    """The objective over the generations, the factors, and the ratio of the errors after to those before."""
    from matplotlib.ticker import MaxNLocator

    with page(10.5, 4.2) as figure:
        panels = figure.subplots(1, 3 if found.channels else 2)
        axes = panels[0]
        generations = np.arange(1, len(found.history) + 1)
        axes.axhline(found.start, color=LIMIT, linestyle=":", label="before")
        for column, text, colour in ((1, "median of a population", COLOURS[5]), (0, "best of a population", COLOURS[0])):
            axes.plot(generations, found.history[:, column], color=colour, label=text)
        axes.set_title(f"Objective on {found.trained_on}")
        axes.set_xlabel("generation")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        axes = panels[1]
        places = np.arange(len(found.parameters))[::-1]
        axes.barh(places, np.log10(found.factors), color=COLOURS[1], height=0.6)
        axes.set_yticks(places, [parameter.key for parameter in found.parameters])
        axes.axvline(0.0, color=LIMIT, linewidth=0.8)
        axes.set_title("Factors, decimal logarithm")
        if found.channels:
            axes = panels[2]
            places = np.arange(len(found.channels))[::-1]
            ratios = np.array([[c.ratio.value, c.ratio.low, c.ratio.high] for c in found.channels])
            spread = np.abs(np.nan_to_num(ratios[:, 1:] - ratios[:, :1])).T
            axes.errorbar(ratios[:, 0], places, xerr=spread, fmt="o", color=COLOURS[2], capsize=3, markersize=4)
            axes.set_yticks(places, [label(channel.name) for channel in found.channels])
            axes.axvline(1.0, color=LIMIT, linewidth=0.8)
            axes.set_title("rms after / before, 95 %")
            axes.set_xlabel(found.judged_on)
        title(figure, f"{found.source}: tuning of {found.estimator}")
        legend(figure, handles, columns=3)
        return figure


# The page of a tuning: what was changed, the errors before and after, and the search, as one document for the front end.


def tuning_page(found: Tuning) -> str:
    """The HTML of a tuning."""
    return assembled(f"{found.source}: tuning of {found.estimator}", {"report": tuning_page_document(found)})


def tuning_page_document(found: Tuning) -> dict[str, Any]:
    """The document of the page of a tuning (web/README.md)."""
    pool = Pool()
    factors = [
        (parameter.key, float(factor), None, None) for parameter, factor in zip(found.parameters, found.factors, strict=True)
    ]
    ratios = [(label(one.name), one.ratio.value, one.ratio.low, one.ratio.high) for one in found.channels]
    changes = [intervals_panel("Factors on the parameters", factors)]
    changes += [intervals_panel(f"rms after / before, 95 %, on {found.judged_on}", ratios)] if ratios else []
    tables = [table("Parameters", PARAMETER_COLUMNS, parameter_rows(found))]
    tables += [table(f"Errors on {found.judged_on}", CHANNEL_COLUMNS, channel_rows(found))] if ratios else []
    return {
        "kind": "report",
        "version": __version__,
        "name": f"{found.source}: {found.estimator}",
        "title": "Tuning" if found.is_better else "Tuning: no better than by chance, keep the present one",
        "facts": [f"sought on {found.trained_on}", f"judged on {found.judged_on}", f"{number(found.duration_s)} s"],
        "truth": "before",
        "axis": {"name": "Generation", "unit": "", "whole": True},
        "legend": [{"name": "best of a population"}, {"name": "median of a population"}],
        "tables": tables,
        "explained": [f"{sentence}." for sentence in sentences(found)],
        "notes": list(found.notes),
        "sections": [
            section("Before and after", changes, columns=2),
            section("The search", [_history(found, pool)], columns=1),
        ],
        "arrays": pool.as_json(),
    }


def _history(found: Tuning, pool: Pool) -> dict[str, Any]:
    generations = np.arange(1.0, len(found.history) + 1)
    panel = TimePanel(pool, f"Objective on {found.trained_on}", "1", generations)
    panel.curve(TRUTH_GROUP, np.full(len(generations), found.start))
    for group in (1, 0):
        panel.curve(group, found.history[:, group])
    return panel.as_json()

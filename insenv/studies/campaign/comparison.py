"""Several estimators on the same runs: is the difference real?

Run i of every estimator has the same plant, to the bit.  What the runs have in common, a bias that was drawn large or an outage
at a bad time, therefore drops out of a paired difference.  With the mean squares a_i and b_i of the errors of two estimators in
run i, and their means A and B, the difference is D = sqrt(B) - sqrt(A).  Its standard deviation is that of the jackknife, from
the n differences that leave out one run each, and its interval is Student's.  Ratios are treated alike in their logarithm.  The
linear formula (the delta method) misses the true ratio of 8 runs of a constant error each in 10 %, the jackknife in 6 to 7 %.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.remarks import Remark, as_json, declared
from insenv.core.tables import Array
from insenv.report import Document, FilesWritten, OutputFolder, Shown, write_document
from insenv.report.document import Block, Line, Page, Sentences, Table, page_of
from insenv.report.panels import IntervalsPanel, Section
from insenv.report.tables import label, number, since
from insenv.studies.campaign.presentation import campaign_blocks, campaign_page, course_sections
from insenv.studies.campaign.statistics import Estimate, jackknifed
from insenv.studies.campaign.summary import Summary

NAME = "comparison"
PAIR_COLUMNS = ("rms", "ratio", "from", "to", "difference", "smaller in")
PAIR_MEANINGS = (
    "ratio: of the rms to that of the first, with its 95 % interval",
    "smaller in: share of the runs in which this estimator has the smaller rms",
)


@dataclass(frozen=True)
class Paired:
    """The difference between two estimators in one channel, over the runs in which neither diverged.

    difference: of the root mean squares, the second minus the first; ratio: the second over the first; smaller: number of runs
    in which the second has the smaller rms; runs: number of runs.
    """

    difference: Estimate
    ratio: Estimate
    smaller: int
    runs: int

    @property
    def is_real(self) -> bool:
        """Whether the interval of the ratio excludes 1."""
        return self.ratio.low > 1.0 or self.ratio.high < 1.0

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "difference": self.difference.as_json(),
            "ratio": self.ratio.as_json(),
            "smaller_in": self.smaller,
            "runs": self.runs,
            "real": self.is_real,
        }


def paired(first: Array, second: Array) -> Paired:
    """The difference of the root mean squares of two estimators from the mean squares of each run (n,)."""
    n = len(first)
    nothing = float("nan")
    A, B = (float(np.mean(squares)) if n else nothing for squares in (first, second))
    difference = float(np.sqrt(B) - np.sqrt(A))
    smaller = int(np.sum(second < first))
    if n < 2 or not (A > 0.0 and B > 0.0):
        return Paired(Estimate(difference, nothing, nothing), Estimate(nothing, nothing, nothing), smaller, n)
    left_a, left_b = ((squares.sum() - squares) / (n - 1) for squares in (first, second))
    with np.errstate(divide="ignore", invalid="ignore"):  # a single run may have all of the error: no interval
        logarithm = jackknifed(float(np.log(B / A)) / 2.0, np.log(left_b / left_a) / 2.0)
    ratio = Estimate(*(float(np.exp(end)) for end in (logarithm.value, logarithm.low, logarithm.high)))
    return Paired(jackknifed(difference, np.sqrt(left_b) - np.sqrt(left_a)), ratio, smaller, n)


_TIMES_DIFFER = declared(
    "times-differ", "the rms of {id} counts {time}, that of {first} {other}: their ratio compares different times"
)


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Campaigns of several estimators on the same runs.

    summaries: by estimator, in the order of the call.  pairs: by estimator (all but the first), then by channel that both
    have: its difference to the first.
    """

    summaries: Mapping[str, Summary]
    pairs: Mapping[str, Mapping[str, Paired]]

    @property
    def first(self) -> str:
        """The estimator that the others are compared with."""
        return next(iter(self.summaries))

    @property
    def notes(self) -> tuple[Remark, ...]:
        """What must be said of the pairs: the errors of an alignment count from later on than those of a navigation."""
        first, *others = self.summaries.values()
        return tuple(
            _TIMES_DIFFER.filled(id=one.plan.estimator, time=since(one.from_s), first=self.first, other=since(first.from_s))
            for one in others
            if one.from_s != first.from_s
        )

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "campaigns": [summary.document().as_json() for summary in self.summaries.values()],
            "compared_with": self.first,
            "paired": [
                {"estimator": id, "errors": {name: pair.as_json() for name, pair in pairs.items()}}
                for id, pairs in self.pairs.items()
            ],
            **as_json(self.notes),
        }

    def save(self, folder: str | Path, figure: bool = True, table: str = "") -> FilesWritten:
        """Write the files of each campaign to a folder of its estimator, comparison.json and, if `figure`, the page.

        table: as of `Summary.save`.  Raises `InputError` if the folder cannot be written to, `InsenvError` if writing fails.
        """
        return write_comparison(self, OutputFolder(folder), figure, table)

    def document(self) -> Document:
        """What is printed and finite of it, beside the documents of the campaigns."""
        page, undrawn = partial(comparison_page, self), "no figure of a comparison: each of its campaigns has one"
        return Document(NAME, self.as_json(), partial(comparison_blocks, self), page=page, undrawn=undrawn)

    def __repr__(self) -> str:
        lines = [repr(summary) for summary in self.summaries.values()]
        for id, pairs in self.pairs.items():
            said = [f"{name} {p.ratio.value:.3g} ({p.ratio.low:.3g} to {p.ratio.high:.3g})" for name, p in pairs.items()]
            lines.append(f"{id} / {self.first}: {', '.join(said)}")
        return "\n".join(lines)


def compare(summaries: Sequence[Summary]) -> Comparison:
    """Compare campaigns that have the same runs; the first is what the others are compared with."""
    first, pairs = summaries[0], {}
    for other in summaries[1:]:
        finite = first.whole & other.whole
        common = [name for name in first.channels if name in other.channels]
        places = [(name, first.channels.index(name), other.channels.index(name)) for name in common]
        pairs[other.plan.estimator] = {
            name: paired(first.rms[finite, a] ** 2, other.rms[finite, b] ** 2) for name, a, b in places
        }
    return Comparison({summary.plan.estimator: summary for summary in summaries}, pairs)


def comparison_blocks(comparison: Comparison) -> Iterator[Block]:
    """The printed lines and tables: those of each campaign, then the paired differences."""
    for summary in comparison.summaries.values():
        yield from campaign_blocks(summary)
        yield Line()
    yield from pair_blocks(comparison)


def pair_blocks(comparison: Comparison) -> Iterator[Block]:
    """The paired differences."""
    for id, pairs in comparison.pairs.items():
        caption = f"{id} compared with {comparison.first}, run by run"
        rows: list[Sequence[str | Line]] = [
            (
                label(name),
                Line(number(pair.ratio.value), "bold" if pair.is_real else ""),
                *map(number, (pair.ratio.low, pair.ratio.high, pair.difference.value)),
                f"{100 * pair.smaller / pair.runs:.0f} %" if pair.runs else "-",
            )
            for name, pair in pairs.items()
        ]
        yield Line(caption, "bold")
        yield Table(PAIR_COLUMNS, rows, caption=caption, group=list(comparison.summaries).index(id))
        yield Line()
    yield Line(f"{PAIR_MEANINGS[0]}; bold: not 1", "dim")
    yield Line(PAIR_MEANINGS[1], "dim")
    yield Sentences("notes", comparison.notes, head="note: ")


def write_comparison(comparison: Comparison, folder: OutputFolder, figure: bool = True, table: str = "") -> FilesWritten:
    """Write the files of each campaign to DIR/ID and comparison.json to DIR; if `figure`, the page comparison.html too."""
    parts = [
        write_document(one.document(table), OutputFolder(folder.path / id), figure) for id, one in comparison.summaries.items()
    ]
    written = write_document(comparison.document(), folder, figure)
    return FilesWritten((*written.paths, *(path for part in parts for path in part.paths)), parts[0].note)


# The page of a comparison of estimators on the same runs: their tables, paired differences and errors over time.


def comparison_page(comparison: Comparison) -> Page:
    """The page of a comparison."""
    ids, campaigns = list(comparison.summaries), list(comparison.summaries.values())
    plan, name = campaigns[0].plan, f"{campaigns[0].plan.name}: {' and '.join(ids)}"
    pages = [campaign_page(one, id, place) for place, (id, one) in enumerate(comparison.summaries.items())]
    ratios = [
        IntervalsPanel(
            f"{id}: rms over that of {comparison.first}, 95 %",
            [(label(name), pair.ratio.value, pair.ratio.low, pair.ratio.high) for name, pair in pairs.items()],
        )
        for id, pairs in comparison.pairs.items()
    ]
    return page_of(
        pair_blocks(comparison),
        tab=name,
        name=name,
        title=str(plan.scenario.get("title", "")),
        facts=pages[0].facts,
        legend=[{"name": f"{id}, median of the runs"} for id in ids],
        tables=[table for page in pages for table in page.tables],
        explained=[*(f"{each}." for each in PAIR_MEANINGS), *dict.fromkeys(text for page in pages for text in page.explained)],
        notes=[f"{id}: {note}" for id, page in zip(ids, pages, strict=True) for note in page.notes],
        sections=[Section("The difference", ratios, columns=2), *course_sections(campaigns)],
        more={"shares": True},
    )

"""`Proof`: what public logs say of the estimators, to be printed, kept as JSON, and shown as a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import numpy as np

from insenv.evaluation.errors import ATTITUDE, CHANNELS, POSITION
from insenv.report.document import Block, Document, Line, Page, Sentences, Table, page_of
from insenv.report.notebook import Shown
from insenv.report.tables import label as channel_label

NOTABLE = 0.01
"""Share of errors beyond 3 stated sigmas from which a run states too little; of true sigmas of a normal error it is 0.0027."""
AGAINST = ("tilt [deg]", "heading", "pos. [m]", ">3s", "verdict")
LACKING = ("hor. [m]", "max", "down [m]", "ratio", ">3s", "verdict")
EXPLAINED = (
    "against references: rms of the errors / of the stated sigmas; tilt: roll and pitch; pos.: north and east",
    "fixes withheld: the same at the ends of the outages, the largest error, and the rms of all errors over their sigmas",
    ">3s: share of the errors beyond 3 stated sigmas, of the angle, position or velocity with the largest one; the error "
    "that a reference states counts with them",
    "verdict: on the innovations and on what contradicts the estimate; (!): a note says that the errors are larger than stated",
)
REFERENCE_DOUBTS = ("reference-clock", "reference-axes", "reference-contradicted")
"""Codes of remarks that name a reference that the log contradicts."""
USES = ("developed on", "reported on")


@dataclass(frozen=True)
class Compared:
    """Root mean squares of an error and of its stated sigma, in the unit of its name, and the share beyond 3 of these."""

    rms: float
    stated: float
    beyond: float


@dataclass(frozen=True)
class Withheld:
    """Where fixes were withheld.

    outages: their number.  errors: at their ends (horizontal_m, down_m); `beyond`: of the errors north, east, down at all
    withheld fixes.  largest: of the errors in an outage.  ratio: rms of all errors over their sigmas; 1 of true ones.
    verdict, warned: on that run, and whether it says that it states too little.
    """

    outages: int
    ratio: float
    errors: Mapping[str, Compared]
    largest: Mapping[str, float]
    verdict: str
    warned: bool


@dataclass(frozen=True)
class Judged:
    """An estimator on a log.

    verdict, warned: with all fixes, as of `Withheld`.  by_reference: whether nothing but the reference warns.  errors: against
    the reference, by channel.  force, force_of_reference: what the attitudes leave of the changes of the receiver's velocity,
    m/s2.  fixes_late_s: delay of the fixes that it finds, s; None if it does not estimate one.  notes: codes of its remarks.
    refused: why the log is not for it, or what became of it; then there is nothing else.
    """

    estimator: str
    verdict: str = ""
    warned: bool = False
    by_reference: bool = False
    errors: Mapping[str, Compared] = field(default_factory=dict)
    force: float | None = None
    force_of_reference: float | None = None
    fixes_late_s: float | None = None
    notes: tuple[str, ...] = ()
    withheld: Withheld | None = None
    refused: str = ""

    @property
    def beyond(self) -> float:
        """The largest share of errors against the reference beyond 3 stated sigmas; 0 without a reference."""
        return max((each.beyond for each in self.errors.values()), default=0.0)

    @property
    def silent(self) -> bool:
        """Whether more errors than `NOTABLE` are beyond 3 stated sigmas in a run that does not say so."""
        in_outages = self.withheld is not None and not self.withheld.warned and _share(self.withheld) > NOTABLE
        return in_outages or (not self.warned and self.beyond > NOTABLE)


@dataclass(frozen=True)
class LogProof:
    """A log: where it is from, what it was used for, and how estimators did on it.  missing: where its data can be had, if they
    are not there; then there are no runs.
    """

    name: str
    title: str
    source: str
    licence: str
    used: str
    get: str
    grade: str = ""
    reference: str = ""
    outages: str = ""
    duration_s: float = 0.0
    missing: str = ""
    runs: tuple[Judged, ...] = ()


@dataclass(frozen=True, repr=False)
class Proof(Shown):
    """What public logs say of this version of insenv."""

    insenv: str
    logs: tuple[LogProof, ...]

    @property
    def missing(self) -> list[str]:
        """The sentences on logs whose data are not there."""
        return [log.missing for log in self.logs if log.missing]

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return asdict(self)

    @classmethod
    def of_json(cls, values: Mapping[str, Any]) -> Proof:
        """The proof that `as_json` has written."""
        return cls(values["insenv"], tuple(_log_of(each) for each in values["logs"]))

    def document(self) -> Document:
        """What the command prints and writes."""
        return Document("proof", self.as_json(), partial(proof_blocks, self), page=partial(proof_page, self))


def proof_blocks(proof: Proof) -> Iterator[Block]:
    """The tables, those of logs developed on first, what they mean, where the logs are from, and which are not there."""
    yield Line("insenv on public logs", "bold")
    for used, logs in _by_use(proof).items():
        for table in _tables(used, logs):
            yield Line()
            yield Line(table.caption, "bold")
            yield table
    if any(log.runs for log in proof.logs):
        yield Line()
        yield from (Line(sentence, "dim") for sentence in EXPLAINED)
        yield Line()
        yield Sentences("facts", summary(proof))
    yield Line()
    yield Sentences("notes", origins(proof))
    yield Sentences("notes", _notes(proof), head="note: ")


def proof_page(proof: Proof) -> Page:
    """The page: the tables, each error by itself."""
    return page_of(
        proof_blocks(proof),
        name="proof",
        title=f"insenv {proof.insenv} on public logs",
        legend=[],
        tables=[_log_table(log) for log in proof.logs if log.runs],
        sections=[],
        explained=[f"{sentence}." for sentence in EXPLAINED],
    )


def summary(proof: Proof) -> list[str]:
    """By use of the logs: how many runs state too little, and which of these do not say so."""
    lines = []
    for used, logs in _by_use(proof).items():
        runs = [(log, run) for log in logs for run in log.runs if not run.refused]
        over = [(log, run) for log, run in runs if run.beyond > NOTABLE or _share(run.withheld) > NOTABLE]
        silent, shown = (
            [f"{log.name} {run.estimator}" for log, run in over if said(run)]
            for said in (lambda run: run.silent, lambda run: run.by_reference and not run.silent)
        )
        if runs:
            lines.append(
                f"{used}: {len(over)} of {len(runs)} runs have more than {NOTABLE:.0%} of errors beyond 3 stated sigmas; "
                f"{len(silent)} of these do not say so{': ' if silent else ''}{', '.join(silent)}; {len(shown)} say so only "
                f"because of their reference{': ' if shown else ''}{', '.join(shown)}"
            )
    return lines


def origins(proof: Proof) -> list[str]:
    """Source and licence, one line for all logs that share them, and what their references are."""
    families: dict[tuple[str, str, str], list[str]] = {}
    for log in proof.logs:
        families.setdefault((log.source, log.licence, log.reference), []).append(log.name)
    return [
        f"{', '.join(names)}: {source}; licence: {licence}{f'; reference: {reference}' if reference else ''}"
        for (source, licence, reference), names in families.items()
    ]


def _by_use(proof: Proof) -> dict[str, list[LogProof]]:
    return {used: logs for used in USES if (logs := [log for log in proof.logs if log.used == used])}


def _tables(used: str, logs: Sequence[LogProof]) -> Iterator[Table]:
    """Against references, and where fixes are withheld; the name of a log precedes its runs."""
    for heading, columns, cells in (("against references", AGAINST, _against), ("fixes withheld", LACKING, _lacking)):
        rows: list[tuple[str, ...]] = []
        for log in logs:
            runs = [(f"  {run.estimator}", *shown) for run in log.runs if (shown := cells(run))]
            rows += [(log.name, *[""] * len(columns)), *runs] if runs else []
        if rows:
            yield Table(("", *columns), rows, least=5, gap=1, caption=f"{used}, {heading}", wide=True)


def _against(run: Judged) -> tuple[str, ...]:
    if not run.errors:
        return ()
    tilt, heading, position = (_pair(run.errors, names) for names in (ATTITUDE[:2], ATTITUDE[2:], POSITION[:2]))
    return tilt, heading, position, f"{100 * run.beyond:.0f} %", _said(run.verdict, run.warned)


def _lacking(run: Judged) -> tuple[str, ...]:
    lost = run.withheld
    if lost is None:
        return ()
    horizontal, down = (_pair(lost.errors, (name,)) for name in ("horizontal_m", "down_m"))
    largest, ratio, share = _short(lost.largest["horizontal_m"]), _short(lost.ratio), f"{100 * _share(lost):.0f} %"
    return horizontal, largest, down, ratio, share, _said(lost.verdict, lost.warned)


def _said(verdict: str, warned: bool) -> str:
    """The verdict, and whether a note alone warns."""
    return f"{verdict or 'none'}{' (!)' if warned and verdict in ('', 'consistent', 'untested') else ''}"


def _pair(errors: Mapping[str, Compared], names: Sequence[str]) -> str:
    """Error and stated sigma of some components together; a dash if the reference does not have them."""
    if not all(name in errors for name in names):
        return "-"
    rms, stated = (np.sqrt(np.mean([getattr(errors[name], kind) ** 2 for name in names])) for kind in ("rms", "stated"))
    return f"{_short(rms)}/{_short(stated)}"


def _short(value: float) -> str:
    """Two significant digits."""
    return f"{value:.0f}" if value >= 99.5 else f"{value:.2g}"


def _log_table(log: LogProof) -> Table:
    """By error against the reference: rms, stated sigma and share beyond 3 sigmas of each estimator; and the specific force."""
    columns = ["", *(name for run in log.runs for name in (run.estimator, "stated", ">3s"))]
    names = [name for name in CHANNELS if any(name in run.errors for run in log.runs)]
    rows = [(channel_label(name), *(cell for run in log.runs for cell in _details(run.errors.get(name)))) for name in names]
    if any(run.force is not None for run in log.runs):
        rows.append(("force [m/s2]", *(cell for run in log.runs for cell in (_known(run.force), "", ""))))
    of_reference = next((run.force_of_reference for run in log.runs if run.force_of_reference is not None), None)
    below = [
        f"{log.title}, {log.duration_s:.0f} s: {log.used}; grade: {log.grade or 'none'}; fixes withheld: {log.outages}",
        f"reference: {log.reference or 'none'}; licence: {log.licence}",
        "force: what the attitude leaves of the changes of the receiver's velocity"
        + ("" if of_reference is None else f"; that of the reference leaves {_known(of_reference)}"),
    ]
    return Table(columns, rows, caption=log.name, below=below, wide=True)


def _details(each: Compared | None) -> tuple[str, str, str]:
    return ("-", "-", "-") if each is None else (_short(each.rms), _short(each.stated), f"{100 * each.beyond:.1f} %")


def _known(value: float | None) -> str:
    return "-" if value is None else _short(value)


def _share(withheld: Withheld | None) -> float:
    return 0.0 if withheld is None else max(each.beyond for each in withheld.errors.values())


def _notes(proof: Proof) -> list[str]:
    """Estimators that a log is not for, references that a log contradicts, and logs that are not there."""
    runs = [(log.name, run) for log in proof.logs for run in log.runs]
    notes = [f"{name}: {run.estimator} left out: {run.refused}" for name, run in runs if run.refused]
    doubted = {name: None for name, run in runs if any(note in REFERENCE_DOUBTS for note in run.notes)}
    notes += [f"{name}: the log contradicts its reference, as `insenv replay` says" for name in doubted]
    return [*notes, *proof.missing]


def _log_of(values: Mapping[str, Any]) -> LogProof:
    return LogProof(**{**values, "runs": tuple(_judged_of(each) for each in values["runs"])})


def _judged_of(values: Mapping[str, Any]) -> Judged:
    withheld = values["withheld"]
    if withheld is not None:
        withheld = Withheld(**{**withheld, "errors": _errors_of(withheld["errors"])})
    return Judged(**{**values, "errors": _errors_of(values["errors"]), "notes": tuple(values["notes"]), "withheld": withheld})


def _errors_of(values: Mapping[str, Any]) -> dict[str, Compared]:
    return {name: Compared(**each) for name, each in values.items()}

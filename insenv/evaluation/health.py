"""Health of a filter: are its innovations as large as it states, and does it still use its instruments?

A filter that reports its health sums the squared test ratios over every measurement of GNSS
(`insenv.estimators.parts.rows.FIX_HEALTH`) and of every other aid (`insenv.estimators.parts.rows.aid_health`), so records may
be sparse.  `insenv.evaluation.nis` judges each instrument; the filter has the worst of these verdicts.

What it cannot see: an innovation is the difference of estimate and measurement.  An error of the fixes that is slow enough for
the estimate to follow is in neither, and makes the NIS smaller than 1 (`Health.notes`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation import sentences
from insenv.evaluation.nis import APART as APART
from insenv.evaluation.nis import BLOCKS as BLOCKS
from insenv.evaluation.nis import VERDICTS as VERDICTS
from insenv.evaluation.nis import WRONG as WRONG
from insenv.evaluation.nis import Array, Counts, Nis, figure
from insenv.evaluation.nis import Verdict as Verdict

GROUPS = ("position", "velocity")
_NONE = Nis(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True)
class AidHealth:
    """The health of a filter by the measurements of one aid other than GNSS: fields as those of `Health`."""

    measurements: int
    refused: int
    nis: Nis
    verdict: Verdict
    factor: float

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "measurements": self.measurements,
            "refused": self.refused,
            **self.nis.as_json(),
            "verdict": self.verdict,
            "factor": self.factor,
        }

    @property
    def summary(self) -> str:
        """One line: verdict, share refused, NIS with bounds."""
        return _summary(self.verdict, self.factor, self.refused, self.measurements, "measurements", self.nis)


@dataclass(frozen=True)
class Health:
    """The health of a filter over a run.

    fixes, refused: number of fixes, and of those of which the gate refused a component; 0 of a filter without GNSS.
    nis: of all components of the fixes used.  groups: of position and of velocity ("position", "velocity").
    verdict: the worst of those of GNSS and of `aids`, each of which is
        "diverged": over the run, or over the last quarter of its measurements, most are refused, or over that quarter the
            innovations used are `APART` times as large as stated;
        "overconfident": a NIS above its bounds and a factor of at least `insenv.evaluation.nis.NOTABLE`, or a share above
            `insenv.evaluation.nis.MANY` refused;
        "untested": no measurement was compared with an estimate: each started the filter anew; else
        "consistent".
    factor: by which the stated standard deviations of innovations must be multiplied; 1 if consistent or untested.  Of the
        root mean squares of the test ratios of position, velocity and aids, refused components included, it is the largest of
        those that are overconfident or diverged.
    aids: of every other aid that measured, by id.
    fix_verdict, fix_factor: of GNSS alone.
    """

    fixes: int
    refused: int
    nis: Nis
    groups: Mapping[str, Nis]
    verdict: Verdict
    factor: float
    aids: Mapping[str, AidHealth] = field(default_factory=dict)
    fix_verdict: Verdict = "untested"
    fix_factor: float = 1.0

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "fixes": self.fixes,
            "refused": self.refused,
            **self.nis.as_json(),
            "verdict": self.verdict,
            "factor": self.factor,
            **{name: nis.as_json() for name, nis in self.groups.items()},
            "aids": {id: aid.as_json() for id, aid in self.aids.items()},
        }

    @property
    def summary(self) -> str:
        """One line: verdict, share of the fixes refused, NIS with bounds; then one line for each other aid."""
        return "\n".join(self.lines)

    @property
    def lines(self) -> tuple[str, ...]:
        """The lines of `summary`."""
        named = tuple(f"{id}: {aid.summary}" for id, aid in self.aids.items())
        if not self.fixes:
            return (_called(self.verdict, self.factor), *named)
        own = _summary(self.fix_verdict, self.fix_factor, self.refused, self.fixes, "fixes", self.nis)
        if self.verdict != self.fix_verdict:
            own = sentences.WHOLE_AND_GNSS.format(called=_called(self.verdict, self.factor), own=own)
        return (own, *named)

    @property
    def apart(self) -> tuple[str, ...]:
        """What the filter has diverged from: "its fixes", ids of aids."""
        return self.judged("diverged")

    def judged(self, verdict: Verdict) -> tuple[str, ...]:
        """The measurements that got this verdict: "its fixes", ids of aids."""
        fixes = ("its fixes",) if self.fixes and self.fix_verdict == verdict else ()
        return (*fixes, *(id for id, aid in self.aids.items() if aid.verdict == verdict))

    @property
    def _or_aids(self) -> str:
        return sentences.OR_AIDS.format(aids=", ".join(self.aids)) if self.aids else ""

    def notes(self, models_slow_errors: bool = False, causes: Mapping[str, str] | None = None) -> tuple[str, ...]:
        """Sentences for the reader; none for a filter whose innovations are as stated.

        models_slow_errors: whether the filter models slow errors of the fixes, which then cause no note.
        causes: by id of an aid, what to look at where its measurements do not fit.
        """
        wrong = sorted((aid.factor, id) for id, aid in self.aids.items() if aid.verdict in WRONG)
        of_aids = tuple(_aid_note(id, self.aids[id], (causes or {}).get(id, "")) for _, id in reversed(wrong))
        if self.fix_verdict in WRONG:
            told = sentences.FIXES_DIVERGED if self.fix_verdict == "diverged" else sentences.FIXES_OVERCONFIDENT
            factor = figure(self.fix_factor)
            return (told.format(factor=factor, refused=self.refused, count=self.fixes, or_aids=self._or_aids), *of_aids)
        position = self.groups["position"]
        if position.below and not models_slow_errors:
            return (sentences.SLOW.format(mean=f"{position.mean:.2g}"), *of_aids)
        return of_aids


def _aid_note(id: str, aid: AidHealth, causes: str) -> str:
    told = sentences.AID.format(
        id=id, verdict=aid.verdict, factor=figure(aid.factor), refused=aid.refused, count=aid.measurements
    )
    return told + (sentences.CAUSES.format(causes=causes) if causes else "")


def models_slow_errors(parameters: Mapping[str, Any]) -> bool:
    """Whether a filter with these parameters (by row name) models slow errors of the fixes."""
    return bool(np.any(parameters.get("fix_wander_sigma", 0.0)))


def health(outputs: Mapping[str, Array]) -> Health | None:
    """The health of a run from the recorded rows of `FIX_HEALTH` and of aids, (records, ...) by name.

    None if nothing was measured.
    """
    fixes = Counts.of(outputs, FIX_HEALTH.names) if all(name in outputs for name in FIX_HEALTH.names) else None
    counted = fixes is not None and fixes.count[-1] > 0
    aids = {
        id: _of_aid(counts) for id in reported_aids(outputs) if (counts := Counts.of(outputs, aid_health(id))).count[-1] > 0
    }
    if not counted and not aids:
        return None
    fix_verdict: Verdict = fixes.verdict if fixes is not None and counted else "untested"
    fix_factor = fixes.factor if fixes is not None and fix_verdict in WRONG else 1.0
    verdicts = (fix_verdict, *(aid.verdict for aid in aids.values()))
    return Health(
        fixes=int(fixes.count[-1]) if fixes is not None else 0,
        refused=int(fixes.refused[-1]) if fixes is not None else 0,
        nis=fixes.nis() if fixes is not None and counted else _NONE,
        groups={name: fixes.nis(group) if fixes is not None and counted else _NONE for group, name in enumerate(GROUPS)},
        verdict=max(verdicts, key=VERDICTS.index),
        factor=max(fix_factor, *(aid.factor for aid in aids.values()), 1.0),
        aids=aids,
        fix_verdict=fix_verdict,
        fix_factor=fix_factor,
    )


def _of_aid(counts: Counts) -> AidHealth:
    verdict = counts.verdict
    factor = counts.factor if verdict in WRONG else 1.0
    return AidHealth(int(counts.count[-1]), int(counts.refused[-1]), counts.nis(), verdict, factor)


def no_fix(found: Health | None) -> str:
    """The sentence about a filter with GNSS and this health to which no fix came; empty if one did."""
    if found is None:
        return sentences.NO_FIX
    return "" if found.fixes else sentences.NO_FIX_BUT_AIDS


def course(outputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """RMS of all test ratios since the previous record, and the fixes refused since then, (records,); NaN without a fix.

    outputs: rows of `FIX_HEALTH` as for `health`.  The first record has no previous one: NaN.
    """
    square = (outputs["nis_used"] + outputs["nis_refused"]).sum(axis=-1)
    number = (outputs["nis_used_count"] + outputs["nis_refused_count"]).sum(axis=-1)
    squares, numbers, refused = (np.diff(total, prepend=np.nan) for total in (square, number, outputs["fix_refused_count"]))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(numbers > 0, np.sqrt(squares / numbers), np.nan), np.nan_to_num(refused)


def _called(verdict: Verdict, factor: float) -> str:
    return sentences.CALLED.format(verdict=verdict, factor=figure(factor)) if verdict in WRONG else verdict


def _summary(verdict: Verdict, factor: float, refused: int, count: int, what: str, nis: Nis) -> str:
    if verdict == "untested":
        return sentences.UNTESTED.format(count=count, what=what)
    called = f"{_called(verdict, factor)}{nis.qualified if verdict == 'consistent' else ''}"
    share = 100 * refused / count
    shown = f"{share:.2g}" if share < 99.5 else "100"
    return sentences.SUMMARY.format(called=called, share=shown, count=count, what=what, nis=nis.text)

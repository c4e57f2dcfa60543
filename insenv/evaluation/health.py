"""Health of a filter: are its innovations as large as it states, and does it still use its instruments?

A filter that reports its health sums the squared test ratios over every measurement of GNSS
(`insenv.estimators.parts.rows.FIX_HEALTH`) and of every other aid (`insenv.estimators.parts.rows.aid_health`), so records may
be sparse.  `insenv.evaluation.nis` judges each instrument; the filter has the worst of these verdicts.

The rules (`of_instrument`, `of_filter`, `of_fixes`, `counted_less`) take numbers or symbols and give numbers, also those that
choose among words: Python evaluates them after a run and while a vehicle is streamed, a live page runs them compiled
(`insenv.web.judging`).

What it cannot see: an innovation is the difference of estimate and measurement.  An error of the fixes that is slow enough for
the estimate to follow is in neither, and makes the NIS smaller than 1 (`slow_errors`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

import numpy as np

from insenv.base.remarks import Doubt, Remark, declared, filled, remark, worded
from insenv.core.elementary import maximum, select
from insenv.core.tables import Array
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation.nis import APART as APART
from insenv.evaluation.nis import BLOCKS as BLOCKS
from insenv.evaluation.nis import NO_NIS, NOTABLE, Judgement, Nis, of_records, sums_of
from insenv.evaluation.nis import VERDICTS as VERDICTS
from insenv.evaluation.nis import WRONG as WRONG
from insenv.evaluation.nis import Verdict as Verdict

GROUPS = ("position", "velocity")
CONTRADICTED = "contradicted"
"""Verdict on a filter whose innovations are as it states, and whose estimate something else contradicts."""
NAMES = (*VERDICTS, CONTRADICTED)
"""Of a filter's verdict, by its place."""

# The lines that tell a health, from the numbers of the rules: see `insenv.base.remarks.worded`.

_CALLED = {
    "verdict": f"{{place|{'|'.join(NAMES)}}}",
    "factor": "{ratio:3 digits}",
    "called": "{wrong|{verdict}|{verdict}, factor {factor}}",
}
UNTESTED = "untested: none of {count} {what} was compared with an estimate"
INSTRUMENT = {
    **_CALLED,
    "qualified": f"{{outside||, innovations smaller than stated| within {100 * (NOTABLE - 1):.0f} % of sigma}}",
    "nis": "{used|none used|NIS {whole:3 digits} ({low:.3g} to {high:.3g})}",
    "summary": f"{{tested|{UNTESTED}|{{called}}{{qualified}}: {{share:2 digits}} % of {{count}} {{what}} refused, {{nis}}}}",
    "look": "{caused||. Look at {causes}}",
}
"""Of an instrument; what: its measurements; causes: what to look at, if it is `caused`."""
FILTER = {**_CALLED, "line": "{first|{called}|{of_gnss}|{called}; gnss: {of_gnss}}"}
"""Of a filter; of_gnss: the summary of GNSS."""
OR_AIDS = "{others||, and at the other aids, whose stated sigmas may be too small: {aids}}"

Numbers = dict[str, Any]


def of_instrument(judgement: Judgement, count: Any, refused: Any) -> Numbers:
    """What is said of an instrument with so many measurements, at least one, of which `refused` are refused.

    smaller, mean: whether innovations of its first group are notably smaller than stated, and their NIS.
    """
    place, rms, (whole, first, *_) = judgement
    wrong = _wrong(place)
    outside = select(whole.mean < whole.low, 1, select(whole.mean > whole.high, 2, 0))
    return {
        "place": place,
        "wrong": wrong,
        "ratio": select(wrong, rms, 1.0),
        "tested": place > 0,
        "count": count,
        "refused": refused,
        "share": 100 * refused / count,
        "used": whole.mean >= 0,
        "whole": whole.mean,
        "low": whole.low,
        "high": whole.high,
        "outside": (place == 1) * outside,
        "smaller": first.below,
        "mean": first.mean,
    }


def of_filter(places: Sequence[Any], ratios: Sequence[Any], fixes: Any, contradicted: Any) -> Numbers:
    """What is said of a filter: it has the worst verdict of its instruments, and the largest factor.

    places, ratios: of its instruments, GNSS first; 0 and 1 of one without measurements.  fixes: their number.
    first: which line comes first, of the filter, of GNSS, or both.
    """
    worst = reduce(maximum, places)
    place = select(contradicted * (_wrong(worst) == 0), len(VERDICTS), worst)
    first = select(fixes > 0, select(place == places[0], 1, 2), 0)
    return {"place": place, "wrong": _wrong(place), "ratio": reduce(maximum, ratios, 1.0), "first": first}


def _wrong(place: Any) -> Any:
    return sum(place == VERDICTS.index(verdict) for verdict in WRONG)


@dataclass(frozen=True)
class AidHealth:
    """The health of a filter by the measurements of one aid.

    measurements, refused: their number, and of those of which the gate refused a component.  nis: of all components used;
    groups: of each group of components.
    verdict: "diverged": over the run, or over the last quarter of the measurements, most are refused, or over that quarter the
            innovations used are `insenv.evaluation.nis.APART` times as large as stated;
        "overconfident": a NIS above its bounds and a factor of at least `insenv.evaluation.nis.NOTABLE`, or a share above
            `insenv.evaluation.nis.REFUSED_OVERCONFIDENT` refused;
        "untested": no measurement was compared with an estimate: each started the filter anew; else
        "consistent".
    factor: by which the stated standard deviations of innovations must be multiplied; 1 if consistent or untested: the largest
        root mean square of the test ratios of a group, refused components included.
    """

    measurements: int
    refused: int
    nis: Nis
    groups: tuple[Nis, ...]
    verdict: Verdict
    factor: float

    @classmethod
    def of(cls, sums: Array) -> AidHealth | None:
        """From the sums at the records of a run (`insenv.evaluation.nis`); None if nothing was measured."""
        count, refused = map(int, sums[-1, :2])
        if not count:
            return None
        judgement = of_records(sums)
        place, _, (nis, *groups) = judgement
        factor = float(of_instrument(judgement, count, refused)["ratio"])
        return cls(count, refused, nis, tuple(groups), VERDICTS[place], factor)

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "measurements": self.measurements,
            "refused": self.refused,
            **self.nis.as_json(),
            "verdict": self.verdict,
            "factor": self.factor,
        }

    def summary(self, what: str = "measurements") -> str:
        """One line: verdict, share refused, NIS with bounds; what: its measurements."""
        return str(self.worded(what)["summary"])

    @property
    def numbers(self) -> Numbers:
        """What the rule gives."""
        judgement = (VERDICTS.index(self.verdict), self.factor, [self.nis, *self.groups])
        return of_instrument(judgement, self.measurements, self.refused)

    def worded(self, what: str = "measurements", causes: str = "") -> dict[str, Any]:
        """The numbers and the texts that are made of them; causes: what to look at where its measurements do not fit."""
        return worded(INSTRUMENT, {**self.numbers, "what": what, "causes": causes, "caused": causes != ""})


NO_FIXES = AidHealth(0, 0, NO_NIS, (NO_NIS, NO_NIS), "untested", 1.0)


@dataclass(frozen=True)
class Health:
    """The health of a filter over a run: by GNSS (`NO_FIXES`: none came), and by every other aid that measured, by id.

    fixes, refused, nis: of GNSS.  groups: NIS of position and of velocity ("position", "velocity").  verdict, factor: the worst
    of those of GNSS and of `aids`; `CONTRADICTED` if none of these is wrong and something else contradicts the estimate.
    contradicted: the codes of the remarks that do.
    """

    gnss: AidHealth
    aids: Mapping[str, AidHealth] = field(default_factory=dict)
    contradicted: tuple[str, ...] = ()

    fixes = property(lambda self: self.gnss.measurements)
    refused = property(lambda self: self.gnss.refused)
    nis = property(lambda self: self.gnss.nis)
    groups = property(lambda self: dict(zip(GROUPS, self.gnss.groups, strict=True)))

    @property
    def numbers(self) -> Numbers:
        """What the rule gives."""
        each = (self.gnss, *self.aids.values())
        places, ratios = [VERDICTS.index(one.verdict) for one in each], [one.factor for one in each]
        return of_filter(places, ratios, self.fixes, bool(self.contradicted))

    @property
    def verdict(self) -> str:
        return NAMES[self.numbers["place"]]

    @property
    def wrong(self) -> bool:
        """Whether the verdict says that the filter states too little."""
        return self.verdict in (*WRONG, CONTRADICTED)

    def doubted(self, remarks: Iterable[Remark]) -> Health:
        """The health of a run on which these are the remarks."""
        return replace(self, contradicted=tuple(dict.fromkeys(each.code for each in remarks if isinstance(each, Doubt))))

    @property
    def factor(self) -> float:
        return float(self.numbers["ratio"])

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
            "contradicted": list(self.contradicted),
        }

    @property
    def summary(self) -> str:
        """One line: verdict, share of the fixes refused, NIS with bounds; then one line for each other aid."""
        return "\n".join(self.lines)

    @property
    def lines(self) -> tuple[str, ...]:
        """The lines of `summary`."""
        of_gnss = self.gnss.summary("fixes") if self.fixes else ""
        line = worded(FILTER, {**self.numbers, "of_gnss": of_gnss})["line"]
        return (line, *(f"{id}: {aid.summary()}" for id, aid in self.aids.items()))

    @property
    def apart(self) -> tuple[str, ...]:
        """What the filter has diverged from: "its fixes", ids of aids."""
        return self.judged("diverged")

    def judged(self, verdict: Verdict) -> tuple[str, ...]:
        """The measurements that got this verdict: "its fixes", ids of aids."""
        fixes = ("its fixes",) if self.fixes and self.gnss.verdict == verdict else ()
        return (*fixes, *(id for id, aid in self.aids.items() if aid.verdict == verdict))

    def notes(self, models_slow_errors: bool = False, causes: Mapping[str, str] | None = None) -> tuple[Remark, ...]:
        """Sentences for the reader; none for a filter whose innovations are as stated.

        models_slow_errors: whether the filter models slow errors of the fixes, which then cause no note.
        causes: by id of an aid, what to look at where its measurements do not fit.
        """
        worst_first = sorted(((aid.factor, id) for id, aid in self.aids.items()), reverse=True)
        of_aids = [aid_misfit(id, self.aids[id], (causes or {}).get(id, "")) for _, id in worst_first]
        return (*(fixes_remark(self, models_slow_errors) if self.fixes else ()), *(said for one in of_aids for said in one))


_LOOK = (
    "its innovations are {factor} times as large as stated, and it refused {refused} of {count} fixes. The errors may exceed "
    "the stated sigmas by more than that. Look at the grade of the inertial unit, the lever arm of the antenna, the time "
    "offset of the fixes, their stated sigmas and the start{or_aids}"
)
FIX_REMARKS = (
    declared("no-fix", "no fix was received: the estimate is that of the inertial unit alone"),
    declared("no-fix-but-aids", "no fix was received: the estimate is that of the inertial unit and the other aids"),
    declared("fixes-diverged", f"the filter has diverged from its fixes: {_LOOK}"),
    declared("fixes-overconfident", f"the filter is overconfident: {_LOOK}"),
    declared(
        "fixes-slow-errors",
        "positions scatter less than their sigmas say (mean NIS {mean:.2g}): their sigmas are too large, or part of their "
        "error is slow. A slow error does not average out: the position may then be wrong by the whole sigma of a fix, "
        "whatever the filter states",
    ),
)
"""What there is to say of fixes, of which one thing at most is said (`of_fixes`)."""


def of_fixes(fixes: Any, measured: Any, place: Any, smaller: Any, slow: Any) -> Numbers:
    """Which of `FIX_REMARKS` is said of a filter that takes fixes, from 1 on; 0: none.

    fixes, place, smaller: their number, and the verdict of GNSS, 0 if there are none.  measured: whether any of its
    instruments measured.  slow: whether it models slow errors of the fixes.
    """
    overconfident, diverged = (place == VERDICTS.index(verdict) for verdict in WRONG)
    misfit = select(diverged, 3, select(overconfident, 4, select(smaller * (slow == 0), 5, 0)))
    return {"said": select(fixes > 0, misfit, select(measured, 2, 1))}


def no_fix(health: Health | None) -> tuple[Remark, ...]:
    """A filter with GNSS and this health to which no fix came."""
    return () if health and health.fixes else fixes_remark(health)


def fixes_remark(health: Health | None, models_slow_errors: bool = False) -> tuple[Remark, ...]:
    """What is said of the fixes of a filter with GNSS and this health; None: nothing was measured."""
    values: dict[str, Any] = {"place": 0, "smaller": 0}
    if health and health.fixes:
        values = health.gnss.worded()
        values["or_aids"] = filled(OR_AIDS, {"others": len(health.aids) > 0, "aids": ", ".join(health.aids)})
    fixes = health.fixes if health else 0
    said = of_fixes(fixes, health is not None, values["place"], values["smaller"], models_slow_errors)["said"]
    return (FIX_REMARKS[said - 1].filled(**values),) if said else ()


@remark(
    "aid-misfit",
    "{id} does not fit the filter ({verdict}): its innovations are {factor} times as large as stated, and {refused} of its "
    "{count} measurements were refused. The errors may exceed the stated sigmas{look}",
)
def aid_misfit(id: str, aid: AidHealth, causes: str) -> dict[str, Any] | None:
    """Measurements of an aid other than GNSS that do not fit; causes: what to look at."""
    return {"id": id, **aid.worded(causes=causes)} if aid.verdict in WRONG else None


def models_slow_errors(parameters: Mapping[str, Any]) -> bool:
    """Whether a filter with these parameters (by row name) models or states slow errors of the fixes."""
    return any(np.any(parameters.get(name, 0.0)) for name in ("fix_wander_sigma", "fix_common_sigma"))


def counts_fixes_less(parameters: Mapping[str, Any], outputs: Iterable[str]) -> bool:
    """Whether a filter with these parameters and outputs (by row name) models slow errors of the fixes without estimating them.
    Its records count that a fix came."""
    stated = bool(np.any(parameters.get("fix_wander_sigma", 0.0)))
    return stated and "fix_count" in outputs and "gnss_wander" not in outputs


LARGER = 1.2
"""Ratio of the stated sigma of a position to that of one fix from which it is said."""


@remark(
    "fixes-count-less",
    "the stated sigma of the position, {stated:.2g} m in the median, is larger than that of one fix, {fix:.2g} "
    "m: this filter gives fixes with a slow error less weight the more often they come; `fusion` estimates that "
    "error",
)
def fixes_count_less(parameters: Mapping[str, Any], outputs: Mapping[str, Array], fix_sigma: Array) -> dict[str, float] | None:
    """A filter that models slow errors of the fixes and does not estimate them is worse than one fix.

    fix_sigma (k, 3): standard deviations of its fixes, m.
    """
    if not len(fix_sigma) or not counts_fixes_less(parameters, outputs):
        return None
    recent = np.flatnonzero(np.diff(np.ravel(outputs["fix_count"])) > 0) + 1
    if not len(recent):
        return None
    recent = recent[len(recent) // 2 :]
    numbers = counted_less(np.median(outputs["position_sigma"][recent], axis=0), np.median(fix_sigma, axis=0))
    return numbers if numbers["said"] else None


def counted_less(stated: Any, fix: Any) -> Numbers:
    """Whether a stated sigma of the position (3,) is larger than that of one fix (3,), and the two of the worst component."""
    worst, one = stated[0], fix[0]
    for other, of_fix in zip(stated[1:], fix[1:], strict=True):
        larger = other / of_fix > worst / one
        worst, one = select(larger, other, worst), select(larger, of_fix, one)
    return {"said": worst > LARGER * one, "stated": worst, "fix": one}


def health(outputs: Mapping[str, Array]) -> Health | None:
    """The health of a run from the recorded rows of `FIX_HEALTH` and of aids, (records, ...) by name.

    None if nothing was measured.
    """
    fixes = all(name in outputs for name in FIX_HEALTH.names)
    gnss = AidHealth.of(sums_of(outputs, FIX_HEALTH.names)) if fixes else None
    aids = {id: AidHealth.of(sums_of(outputs, aid_health(id))) for id in reported_aids(outputs)}
    measured = {id: one for id, one in aids.items() if one is not None}
    return Health(gnss or NO_FIXES, measured) if gnss or measured else None


def course(outputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """RMS of all test ratios since the previous record, and the fixes refused since then, (records,); NaN without a fix.

    outputs: rows of `FIX_HEALTH` as for `health`.  The first record has no previous one: NaN.
    """
    square = (outputs["nis_used"] + outputs["nis_refused"]).sum(axis=-1)
    number = (outputs["nis_used_count"] + outputs["nis_refused_count"]).sum(axis=-1)
    squares, numbers, refused = (np.diff(total, prepend=np.nan) for total in (square, number, outputs["fix_refused_count"]))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(numbers > 0, np.sqrt(squares / numbers), np.nan), np.nan_to_num(refused)

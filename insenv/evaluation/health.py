"""Health of a filter: are its innovations as large as it states, and does it still use its instruments?

A filter that reports its health sums the squared test ratios over every measurement of GNSS
(`insenv.estimators.parts.rows.FIX_HEALTH`) and of every other aid (`insenv.estimators.parts.rows.aid_health`), so records may
be sparse.  `insenv.evaluation.nis` judges each instrument; the filter has the worst of these verdicts.

What it cannot see: an innovation is the difference of estimate and measurement.  An error of the fixes that is slow enough for
the estimate to follow is in neither, and makes the NIS smaller than 1 (`slow_errors`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from insenv.base.remarks import Doubt, Remark, declared, remark
from insenv.core.tables import Array
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation.nis import APART as APART
from insenv.evaluation.nis import BLOCKS as BLOCKS
from insenv.evaluation.nis import NO_NIS, NOTABLE, Nis, of_records, sums_of
from insenv.evaluation.nis import VERDICTS as VERDICTS
from insenv.evaluation.nis import WRONG as WRONG
from insenv.evaluation.nis import Verdict as Verdict

GROUPS = ("position", "velocity")
CONTRADICTED = "contradicted"
"""Verdict on a filter whose innovations are as it states, and whose estimate something else contradicts."""
LINES = {
    "called": "{verdict}, factor {factor}",
    "summary": "{called}: {share} % of {count} {what} refused, {nis}",
    "whole-and-gnss": "{called}; gnss: {of_gnss}",
    "nis": "NIS {mean} ({low:.3g} to {high:.3g})",
    "none-used": "none used",
    "untested": "untested: none of {count} {what} was compared with an estimate",
    "smaller": ", innovations smaller than stated",
    "within": f" within {100 * (NOTABLE - 1):.0f} % of sigma",
}
"""What the line of an instrument is made of."""


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
        place, factor, (nis, *groups) = of_records(sums)
        verdict = VERDICTS[place]
        return cls(count, refused, nis, tuple(groups), verdict, factor if verdict in WRONG else 1.0)

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
        if self.verdict == "untested":
            return LINES["untested"].format(count=self.measurements, what=what)
        nis, share = self.nis, 100 * self.refused / self.measurements
        outside = "smaller" if nis.mean < nis.low else "within" if nis.mean > nis.high else ""
        qualified = LINES[outside] if outside and self.verdict == "consistent" else ""
        return LINES["summary"].format(
            called=_called(self.verdict, self.factor) + qualified,
            share=f"{share:.2g}" if share < 99.5 else "100",
            count=self.measurements,
            what=what,
            nis=LINES["nis"].format(mean=figure(nis.mean), low=nis.low, high=nis.high) if nis.mean >= 0 else LINES["none-used"],
        )


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
    def verdict(self) -> str:
        worst = max((self.gnss.verdict, *(aid.verdict for aid in self.aids.values())), key=VERDICTS.index)
        return CONTRADICTED if self.contradicted and worst not in WRONG else worst

    @property
    def wrong(self) -> bool:
        """Whether the verdict says that the filter states too little."""
        return self.verdict in (*WRONG, CONTRADICTED)

    def doubted(self, remarks: Iterable[Remark]) -> Health:
        """The health of a run on which these are the remarks."""
        return replace(self, contradicted=tuple(dict.fromkeys(each.code for each in remarks if isinstance(each, Doubt))))

    @property
    def factor(self) -> float:
        return max(self.gnss.factor, *(aid.factor for aid in self.aids.values()), 1.0)

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
        called = _called(self.verdict, self.factor)
        named = tuple(f"{id}: {aid.summary()}" for id, aid in self.aids.items())
        if not self.fixes:
            return (called, *named)
        of_gnss = self.gnss.summary("fixes")
        if self.verdict != self.gnss.verdict:
            of_gnss = LINES["whole-and-gnss"].format(called=called, of_gnss=of_gnss)
        return (of_gnss, *named)

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
        wrong = sorted((aid.factor, id) for id, aid in self.aids.items() if aid.verdict in WRONG)
        of_aids = [aid_misfit(id, self.aids[id], (causes or {}).get(id, "")) for _, id in reversed(wrong)]
        of_fixes = (*fixes_misfit(self), *(() if models_slow_errors else slow_errors(self)))
        return (*of_fixes, *(said for one in of_aids for said in one))


_LOOK = (
    "its innovations are {factor} times as large as stated, and it refused {refused} of {count} fixes. The errors may exceed "
    "the stated sigmas by more than that. Look at the grade of the inertial unit, the lever arm of the antenna, the time "
    "offset of the fixes, their stated sigmas and the start{or_aids}"
)
_FIXES = {
    "diverged": declared("fixes-diverged", f"the filter has diverged from its fixes: {_LOOK}"),
    "overconfident": declared("fixes-overconfident", f"the filter is overconfident: {_LOOK}"),
}
OR_AIDS, CAUSES = ", and at the other aids, whose stated sigmas may be too small: {aids}", ". Look at {causes}"


def fixes_misfit(health: Health) -> tuple[Remark, ...]:
    """Fixes of GNSS that do not fit the filter."""
    gnss = health.gnss
    if gnss.verdict not in WRONG:
        return ()
    or_aids = OR_AIDS.format(aids=", ".join(health.aids)) if health.aids else ""
    values = {"factor": figure(gnss.factor), "refused": gnss.refused, "count": gnss.measurements, "or_aids": or_aids}
    return (_FIXES[gnss.verdict].filled(**values),)


@remark(
    "aid-misfit",
    "{id} does not fit the filter ({verdict}): its innovations are {factor} times as large as stated, and {refused} of its "
    "{count} measurements were refused. The errors may exceed the stated sigmas{look}",
)
def aid_misfit(id: str, aid: AidHealth, causes: str) -> dict[str, Any] | None:
    """Measurements of an aid other than GNSS that do not fit; causes: what to look at."""
    look = CAUSES.format(causes=causes) if causes else ""
    factor = figure(aid.factor)
    return {"id": id, "verdict": aid.verdict, "factor": factor, "refused": aid.refused, "count": aid.measurements, "look": look}


@remark(
    "fixes-slow-errors",
    "positions scatter less than their sigmas say (mean NIS {mean:.2g}): their sigmas are too large, or part of their error is "
    "slow. A slow error does not average out: the position may then be wrong by the whole sigma of a fix, whatever the filter "
    "states",
)
def slow_errors(health: Health) -> dict[str, Any] | None:
    """Positions whose innovations are smaller than stated, of a filter that fits its fixes."""
    position = health.groups["position"]
    return {"mean": position.mean} if health.gnss.verdict not in WRONG and position.below else None


NO_FIX = declared("no-fix", "no fix was received: the estimate is that of the inertial unit alone")
NO_FIX_BUT_AIDS = declared(
    "no-fix-but-aids", "no fix was received: the estimate is that of the inertial unit and the other aids"
)


def no_fix(health: Health | None) -> tuple[Remark, ...]:
    """A filter with GNSS and this health to which no fix came."""
    if health is None:
        return (NO_FIX,)
    return () if health.fixes else (NO_FIX_BUT_AIDS,)


def models_slow_errors(parameters: Mapping[str, Any]) -> bool:
    """Whether a filter with these parameters (by row name) models slow errors of the fixes."""
    return bool(np.any(parameters.get("fix_wander_sigma", 0.0)))


def counts_fixes_less(parameters: Mapping[str, Any], outputs: Iterable[str]) -> bool:
    """Whether a filter with these parameters and outputs (by row name) models slow errors of the fixes without estimating them.
    Its records count that a fix came."""
    return models_slow_errors(parameters) and "fix_count" in outputs and "gnss_wander" not in outputs


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
    stated, fix = np.median(outputs["position_sigma"][recent], axis=0), np.median(fix_sigma, axis=0)
    worst = int(np.argmax(stated / fix))
    return {"stated": stated[worst], "fix": fix[worst]} if stated[worst] > LARGER * fix[worst] else None


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


def figure(value: float) -> str:
    """Three digits, and no exponent of a large value."""
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _called(verdict: str, factor: float) -> str:
    return LINES["called"].format(verdict=verdict, factor=figure(factor)) if verdict in WRONG else verdict

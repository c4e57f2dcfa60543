"""`prove`: estimators on public logs, against the references of these logs and against fixes withheld from the estimators."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from insenv.base.changes import changed
from insenv.base.errors import InputError, InsenvError, nearest
from insenv.base.output import as_path
from insenv.base.remarks import Remark
from insenv.base.resources import recordings_folder
from insenv.base.shipped import __version__
from insenv.base.toml import Section, key, read_toml, validated
from insenv.estimators.fusion.gnss import DELAY
from insenv.evaluation.errors import CHANNELS, Result
from insenv.evaluation.outages import SHOWN
from insenv.logs.files import PACKAGE, is_there
from insenv.logs.loading import load_data
from insenv.logs.recorded import RecordedLog
from insenv.runs.replayed import replay
from insenv.studies.proof_result import Compared, Judged, LogProof, Proof, Withheld

# The public logs of `insenv prove`: their descriptions, what is said of them, and whether their data are here.
#
# A file in the folder `recordings` is a description of docs/logs.md with a section [proof]: how to get the data, and the logs
# that it describes, which differ in parts of file names (`insert`) or in single keys (`set`).  No data are part of insenv.


class LogSection(Section):
    """One log of a description."""

    used: Literal["developed on", "reported on"] = key(
        ..., "developed on: insenv or the description was changed for it; reported on: neither was"
    )
    insert: dict[str, str] = key({}, "text for each {name} in the values of the description")
    set: dict[str, Any] = key({}, "other values of single keys, by dotted name")
    outages: str = key("", "times whose fixes are withheld, as of `insenv replay --outages`; absent: those of the family")


class ProofSection(Section):
    """What is said of a family of logs, and which they are."""

    get: str = key(..., "command that brings the data, run in the folder of --data")
    reference: str = key("", "what the reference is")
    outages: str = key("", "times whose fixes are withheld, as of `insenv replay --outages`")
    logs: dict[str, LogSection] = key(..., "the logs by name", min_length=1)


@dataclass(frozen=True)
class PublicLog:
    """A log: its name and description (values as of docs/logs.md), and what [proof] says of it."""

    name: str
    used: str
    get: str
    reference: str
    outages: str
    description: Mapping[str, Any]

    @property
    def grade(self) -> str:
        """The grade of the unit; empty if none is stated."""
        return str(self.description.get("imu", {}).get("grade", ""))

    def files(self) -> list[str]:
        """The files of the log, as the description names them."""
        sections = [each for each in self.description.values() if isinstance(each, Mapping) and "file" in each]
        names = [name for each in sections for name in ([each["file"]] if isinstance(each["file"], str) else each["file"])]
        return list(dict.fromkeys(names))

    def missing(self, folder: Path) -> str:
        """One sentence on how to get the data that are not here; empty if all are.  folder: that of the data."""
        files = self.files()
        lacking = [name for name in files if not is_there(name, folder)]
        if not lacking:
            return ""
        place = "the working folder" if folder == Path() else folder
        where = "" if all(name.startswith(PACKAGE) for name in lacking) else f" in {place}"
        share = (
            f"{len(lacking)} of its {len(files)} files are not here" if len(lacking) < len(files) else "its data are not here"
        )
        shown = dict.fromkeys(name.partition("/")[0] if len(lacking) == len(files) and not where else name for name in lacking)
        return f"{self.name}: {share}: {', '.join(shown)}; `{self.get}`{where} brings them"

    def load(self, folder: Path) -> RecordedLog:
        """The log.  folder: that of the data.  Raises `InputError` for files that are not those of the description."""
        return load_data(dict(self.description), folder, self.name)


def public_logs() -> dict[str, PublicLog]:
    """All of them by name, those developed on first."""
    logs = [log for path in sorted(recordings_folder().glob("*.toml")) for log in logs_of(path)]
    return {log.name: log for log in sorted(logs, key=lambda log: log.used)}


@cache
def logs_of(path: Path) -> tuple[PublicLog, ...]:
    """The logs of one file.  Raises `InputError` for a wrong section [proof]."""
    data = read_toml(path)
    proof = validated(ProofSection, data.pop("proof", {}), f"{path}: [proof]")
    return tuple(
        PublicLog(
            name,
            log.used,
            proof.get,
            proof.reference,
            log.outages or proof.outages,
            changed(_inserted(data, log.insert), log.set),
        )
        for name, log in proof.logs.items()
    )


def chosen_logs(names: Sequence[str] = ()) -> list[PublicLog]:
    """The logs of these names, all without names.  Raises one `InputError` for unknown names."""
    known = public_logs()
    wrong = [name for name in names if name not in known]
    if wrong:
        raise InputError("\n".join(f"no public log {name!r}{nearest(name, known)}" for name in wrong))
    return [known[name] for name in dict.fromkeys(names or known)]


def _inserted(value: Any, texts: Mapping[str, str]) -> Any:
    """The values with each {name} in a text replaced."""
    if isinstance(value, str):
        for name, text in texts.items():
            value = value.replace(f"{{{name}}}", text)
        return value
    if isinstance(value, Mapping):
        return {name: _inserted(each, texts) for name, each in value.items()}
    return [_inserted(each, texts) for each in value] if isinstance(value, Iterable) else value


ESTIMATORS = ("fusion", "fusion-smoother", "loosely-coupled")
WARNINGS = ("too-sure", "outages-too-sure")
"""Remarks that say that the errors are larger than stated, beside the verdict on the innovations."""

BY_REFERENCE = ("reference-contradicts", "too-sure")
"""Those that nobody has without a reference."""

Step = Callable[[str, int, int], None]


def prove(names: Sequence[str] = (), data: str | Path = ".", progress: Step | None = None) -> Proof:
    """Run the estimators of `ESTIMATORS` on public logs, with all fixes and with some withheld.

    names: of the logs; all without names.  data: folder that holds their data, as docs/accuracy.md says; nothing is fetched.
    progress: called with the log and the numbers of logs done and in all.

    A log whose data are not there has a sentence instead of results (`LogProof.missing`).  Raises `InputError` for an unknown
    name, a folder that is not there, and data that are not those of the description.
    """
    folder, logs = as_path("data", data), chosen_logs(names)
    if not folder.is_dir():
        raise InputError(
            f"data folder {str(data)!r}: no such folder; allowed is the one that holds the data (docs/accuracy.md)"
        )
    proofs = []
    for done, log in enumerate(logs):
        if progress is not None:
            progress(log.name, done, len(logs))
        proofs.append(_proof(log, folder))
    return Proof(__version__, tuple(proofs))


def _proof(public: PublicLog, folder: Path) -> LogProof:
    text = {name: str(public.description.get(name, "")) for name in ("title", "source", "licence")}
    about: dict[str, Any] = {**text, "used": public.used, "get": public.get, "grade": public.grade, "outages": public.outages}
    if missing := public.missing(folder):
        return LogProof(public.name, **about, missing=missing)
    log = public.load(folder)
    about["reference"] = public.reference if log.reference is not None else ""
    about["duration_s"] = float(log.imu_time[-1] - log.imu_time[0])
    judged = tuple(_judged(log, estimator, public.outages) for estimator in ESTIMATORS)
    return LogProof(public.name, **about, runs=judged)


def _judged(log: RecordedLog, estimator: str, outages: str) -> Judged:
    """One estimator on one log; why it is not for the log, or what it diverges from, is a result too."""
    try:
        report = replay(log, estimator)
        result = report.results[0]
        lacking = replay(log, estimator, outages=outages).results[0] if outages else None
    except InsenvError as error:
        return Judged(estimator, refused=" ".join(str(error).split()))
    force = result.specific_force
    return Judged(
        estimator,
        verdict=_verdict(result),
        warned=_is_warned(result),
        by_reference=_is_warned(result) and not _is_warned(result, BY_REFERENCE),
        errors={name: compared for name in CHANNELS if (compared := _compared(result, name)) is not None},
        force=None if force is None else force.estimate,
        force_of_reference=None if force is None else force.reference,
        fixes_late_s=_delay(result),
        notes=tuple(dict.fromkeys(note.code for note in (*result.notes, *report.notes) if isinstance(note, Remark))),
        withheld=None if lacking is None else _withheld(lacking),
    )


def _compared(result: Result, name: str) -> Compared | None:
    """The error of a channel against the reference; None if there is no reference, or no stated sigma."""
    if name not in result.errors or name not in result.sigma:
        return None
    late = result.time >= result.from_s - 1e-9
    error, sigma = result.errors[name][late], result.sigma[name][late]
    return Compared(_rms(error), _rms(sigma), result.beyond(name))


def _withheld(result: Result) -> Withheld | None:
    """The errors where fixes were withheld; None if no record of the estimate is between fixes."""
    outages = result.outages
    if outages is None or not outages.ratios.size:
        return None
    summary, share = outages.summary(), outages.beyond / outages.ratios.size
    errors = {name: Compared(summary["end"][name], summary["stated"][name], share) for name in SHOWN}
    largest = {name: summary["max"][name] for name in SHOWN}
    ratio = _rms(outages.ratios)
    return Withheld(len(outages.each), ratio, errors, largest, _verdict(result), _is_warned(result))


def _delay(result: Result) -> float | None:
    """The delay of the fixes at the end, s."""
    return float(np.ravel(result.outputs[DELAY.name])[-1]) if DELAY.name in result.outputs else None


def _verdict(result: Result) -> str:
    return "" if result.health is None else result.health.verdict


def _is_warned(result: Result, but: Sequence[str] = ()) -> bool:
    """Whether the run says that it states too little, by other notes than those of the codes in `but`."""
    notes = [note for note in result.notes if note.code not in but]
    wrong = result.health is not None and result.health.doubted(notes).wrong
    return wrong or any(note.code in WARNINGS for note in notes)


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))

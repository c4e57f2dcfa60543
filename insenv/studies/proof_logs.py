"""The public logs of `insenv prove`: their descriptions, what is said of them, and whether their data are here.

A file in the folder `recordings` is a description of docs/logs.md with a section [proof]: how to get the data, and the logs
that it describes, which differ in parts of file names (`insert`) or in single keys (`set`).  No data are part of insenv.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from insenv.base.changes import changed
from insenv.base.errors import InputError, nearest
from insenv.base.resources import recordings_folder
from insenv.base.toml import Section, key, read_toml, validated
from insenv.logs.files import PACKAGE, is_there
from insenv.logs.loading import load_data
from insenv.logs.recorded import RecordedLog


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

"""`Finding`: one thing that a log shows of itself, with its evidence; `UnclearError`: why a log cannot be described."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from insenv.base.errors import InputError

Confidence = Literal["measured", "named", "assumed", "open"]
"""measured: numbers of the log decide, by the threshold that the evidence states.  named: only a name in the log says so, and
no number contradicts.  assumed: nothing in the log shows it, the usual value is written.  open: it is left out."""


class UnclearError(InputError):
    """The log leaves open what its description must say.  The message says what, and what would settle it."""


@dataclass(frozen=True)
class Finding:
    """One finding.

    key: of the description, such as "imu.axes"; value: as in the description, None if it is left out; evidence: one
    sentence; confidence: what the value rests on.
    """

    key: str
    value: Any
    evidence: str
    confidence: Confidence = "measured"

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form (docs/json.md)."""
        return {"key": self.key, "value": self.value, "evidence": self.evidence, "confidence": self.confidence}


@dataclass(frozen=True, eq=False)
class Described:
    """A log and what was found in it: keys of the description by section, findings, text of the TOML file."""

    title: str
    keys: Mapping[str, Any]
    findings: tuple[Finding, ...]
    text: str


def listed(names: Iterable[object]) -> str:
    """Names of columns in a sentence."""
    return ", ".join(str(name) for name in names)

"""What `insenv.run` says of a run, of every run of a campaign, and of how many runs each sentence holds.

Nothing is run again: the sentences follow from what the batch keeps of a run, by the rules that `insenv.run` asks.  It does not
keep the outputs between records, so that sentences about the time at which a heading is found (`Reached`) are not among them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.remarks import Caveat, Doubt, Remark
from insenv.core.batch import Batch
from insenv.core.tables import Array, Table
from insenv.estimators import Estimator
from insenv.evaluation.errors import too_sure
from insenv.evaluation.health import Health, no_fix
from insenv.report.tables import runs_of, seed_list
from insenv.scenario.loop import PREFIX

_KINDS = {kind.__name__: kind for kind in (Remark, Caveat, Doubt)}


@dataclass(frozen=True)
class Said:
    """A sentence about one run, as `insenv.run` prints it.

    subject: what it is about where a run may have several of its code, such as the id of an aid; or empty.  size: of what it is
    about, by which the worst of several runs is found; 0: it has none.
    """

    remark: Remark
    subject: str = ""
    size: float = 0.0

    def stored(self) -> tuple[str, ...]:
        """What `read` makes it of: kind, code, sentence, subject, size."""
        return type(self.remark).__name__, self.remark.code, str(self.remark), self.subject, repr(self.size)

    @classmethod
    def read(cls, kind: str, code: str, sentence: str, subject: str, size: str) -> Said:
        """One that was `stored`."""
        return cls(_KINDS[kind](code, sentence), subject, float(size))


def as_text(said: Iterable[Said]) -> str:
    """The sentences about a run as a text, of which `of_text` makes them again."""
    return json.dumps([one.stored() for one in said])


def of_text(text: str) -> list[Said]:
    """The sentences in a text of `as_text`."""
    return [Said.read(*one) for one in json.loads(text)]


def of_batch(estimator: Estimator, batch: Batch, duration_s: float, differ: bool) -> list[list[Said]]:
    """What the estimator says of the runs at the end of a batch (`Estimator.held`); of one that has diverged nothing.

    differ: whether the runs differ in more than their seeds; then also what it says of its parameters (`Estimator.notes`),
    which else is the same for all runs.
    """
    if estimator.findings is None and not differ:
        return [[] for _ in range(batch.rows)]
    model = estimator.model
    p, x = (
        _part_of(*each)
        for each in ((model.parameters, batch.model.parameters, batch.p), (model.state, batch.model.state, batch.x))
    )
    shown = np.array(model.kernels["output"].function(p.T, x.T)).T
    said: list[list[Said]] = []
    for run in range(batch.rows):
        parameters = model.parameters.unpack(p[run])
        before = [Said(note) for note in estimator.notes(parameters, duration_s)] if differ else []
        held = estimator.held(parameters, model.outputs.unpack(shown[run : run + 1])) if np.isfinite(shown[run]).all() else {}
        at_end = [Said(each.filled(ratio=f"{ratio:.3g}"), row, ratio) for row, (each, ratio) in held.items()]
        said.append([*before, *at_end])
    return said


def estimator_parameters(estimator: Estimator, batch: Batch) -> Iterator[dict[str, Any]]:
    """The parameters of the estimator by row name, run by run."""
    table = estimator.model.parameters
    return map(table.unpack, _part_of(table, batch.model.parameters, batch.p))


def _part_of(part: Table, table: Table, values: Array) -> Array:
    """The estimator's part (runs, own.size) of the model's parameters or state."""
    return np.concatenate([values[:, table.slice(PREFIX + name)] for name in part.names], axis=1)


def of_health(estimator: Estimator, health: Health | None, models_slow: bool) -> list[Said]:
    """What the health of a run says (`Health.notes`), with its factors as sizes."""
    said = [Said(each) for each in no_fix(health)] if estimator.reports_fixes else []
    if health is None:
        return said
    factors = {id: aid.factor for id, aid in health.aids.items()}
    for note in health.notes(models_slow, estimator.causes):
        id = note.partition(" ")[0] if note.code == "aid-misfit" else ""
        said.append(Said(note, id, factors.get(id, health.gnss.factor)))
    return said


def of_errors(rms: Mapping[str, float], stated: Mapping[str, float]) -> list[Said]:
    """What the rms errors of a run say beside the stated standard deviations, by channel."""
    return [
        Said(each, size=max(rms[name] / sigma for name, sigma in stated.items() if sigma > 0)) for each in too_sure(rms, stated)
    ]


@dataclass(frozen=True)
class Share:
    """A sentence that holds of some runs.

    worst: the sentence of the run in which it is largest, `seed`.  alike: whether it is the same for all of them.  seeds: of
    the runs of which it holds; runs: number of runs.
    """

    worst: Said
    seed: int
    alike: bool
    seeds: tuple[int, ...]
    runs: int

    @property
    def remark(self) -> Remark:
        """The sentence with the number of runs and some of their seeds."""
        which = "" if len(self.seeds) == self.runs else f" ({seed_list(self.seeds)})"
        example = "" if self.alike else f", {'the largest' if self.worst.size else 'for example'} with seed {self.seed}"
        kind, said = type(self.worst.remark), self.worst.remark
        return kind(said.code, f"in {len(self.seeds)} of {runs_of(self.runs)}{which}{example}: {said}")

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        code, text = self.worst.remark.code, str(self.worst.remark)
        return {"code": code, "share": len(self.seeds) / self.runs, "seeds": list(self.seeds), "seed": self.seed, "text": text}


def shares(seeds: Sequence[int], said: Sequence[Sequence[Said]]) -> tuple[Share, ...]:
    """What is said of the runs of these seeds, each sentence once, in the order in which runs say them."""
    about: dict[tuple[str, str], list[tuple[int, Said]]] = {}
    for seed, of_run in zip(seeds, said, strict=True):
        for one in of_run:
            about.setdefault((one.remark.code, one.subject), []).append((int(seed), one))
    all_shares = []
    for each in about.values():
        seed, worst = max(each, key=lambda one: one[1].size)
        alike = len({one.remark for _, one in each}) == 1
        all_shares.append(Share(worst, seed, alike, tuple(dict.fromkeys(seed for seed, _ in each)), len(said)))
    return tuple(all_shares)

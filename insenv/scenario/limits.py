"""The limit of a scenario (`insenv.evaluation.limits`), computed once and kept."""

from __future__ import annotations

import contextlib
import hashlib
import time
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from insenv.base.errors import InputError
from insenv.base.output import atomic
from insenv.base.remarks import Remark, declared
from insenv.core.cache import cache_folder, source_digest
from insenv.core.model import Model
from insenv.core.runner import Progress, check_progress
from insenv.core.tables import Vector
from insenv.evaluation import limits
from insenv.evaluation.limits import Limit, Prior
from insenv.scenario.build import build, start_sigmas
from insenv.scenario.description import KnowledgeSection
from insenv.scenario.files import ScenarioLike, load
from insenv.scenario.plant import Plant
from insenv.sensors import registry

TRAJECTORY_SEED = 1
"""Seed of the trajectory along which a limit is taken: the limits along trajectories of other seeds agree to about 1 %."""
WORTH_KEEPING_S = 0.1
"""A limit that takes longer to compute is kept on disk, beside the compiled models."""


def limit(scenario: ScenarioLike, *, duration_s: float | None = None, progress: Progress | None = None) -> Limit:
    """The smallest standard deviation that any method can have in a scenario, by channel and time.

    Parameters
    ----------
    scenario: a name that ``insenv list`` shows, the path of a ``.toml`` file, a `Scenario`, or the values of such a file.
    duration_s: instead of the scenario's, s.
    progress: called with the numbers of inertial samples done and in all.

    It depends neither on the seed nor on an estimator: see docs/limits.md.  Raises `InputError` for what is unknown or wrong,
    and for a scenario with a sensor whose errors are not known.
    """
    check_progress(progress)
    plant = build(load(scenario), seed=TRAJECTORY_SEED, duration_s=duration_s)
    refusal = no_limit(plant)
    if refusal:
        raise InputError(refusal[0])
    return limit_of(plant, progress)


_COMMANDED = declared("no-limit-commanded", "no limit: limits are taken along the course of a scenario, not along commands")
_UNKNOWN_SENSOR = declared(
    "no-limit-unknown-sensor",
    "no limit: a limit needs the measurement equation of every sensor, there is none of {sensors}",
)


def no_limit(plant: Plant) -> tuple[Remark, ...]:
    """Why a plant has no limit; empty if it has one."""
    if plant.commands:
        return (_COMMANDED,)
    further = sorted(id for id in plant.sensors if id != "gnss" and id not in registry.instruments())
    return (_UNKNOWN_SENSOR.filled(sensors=", ".join(map(repr, further))),) if further else ()


def limit_of(plant: Plant, progress: Progress | None = None) -> Limit:
    """The limit of a plant for which `no_limit` is empty; the same for every seed."""
    rows = plant.model.parameters.pack(plant.parameters)
    return limit_along(plant.model, rows, prior_of(plant.scenario.knowledge), plant.samples, plant.in_place, progress)


def prior_of(known: KnowledgeSection) -> Prior:
    """The initial uncertainty that a scenario states."""
    attitude, position, velocity = np.split(start_sigmas(known), 3)
    return Prior(attitude, velocity, position)


def limit_along(
    model: Model, rows: Vector, prior: Prior, samples: int, in_place: bool, progress: Progress | None = None
) -> Limit:
    """The limit of a plant with the parameters `rows` (parameters.size,), except the seed, over `samples` samples."""
    rows = np.array(rows)
    rows[model.parameters.slice("seed")] = TRAJECTORY_SEED
    start = np.concatenate([prior.attitude, prior.velocity, prior.position, [samples, float(in_place)]])
    text = f"{_version()}{model.fingerprint}".encode()
    digest = hashlib.sha256(text + rows.tobytes() + start.tobytes()).hexdigest()[:32]
    return _stored(_Case(digest, model, rows, prior, samples, in_place, progress))


@dataclass(frozen=True)
class _Case:
    """Everything on which a limit depends; cases with the same digest are equal."""

    digest: str
    model: Model = field(compare=False)
    rows: Vector = field(compare=False)
    prior: Prior = field(compare=False)
    samples: int = field(compare=False)
    in_place: bool = field(compare=False)
    progress: Progress | None = field(compare=False)


@lru_cache(maxsize=32)
def _stored(case: _Case) -> Limit:
    path = cache_folder() / "limits" / f"{case.digest}.npz"
    limit = _read(path)
    if limit is not None:
        return limit
    begin = time.perf_counter()
    rows = case.model.parameters.unpack(case.rows)
    limit = limits.bound(case.model, rows, case.prior, case.samples, in_place=case.in_place, progress=case.progress)
    if time.perf_counter() - begin > WORTH_KEEPING_S:
        _write(path, limit)
    return limit


def _read(path: Path) -> Limit | None:
    """The limit in a file; None if there is none that can be read."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        return Limit(arrays.pop("time"), arrays.pop("rotation"), arrays)
    except (OSError, ValueError, KeyError, EOFError):
        return None


def _write(path: Path, limit: Limit) -> None:
    """Keep a limit; a folder that cannot be written to costs time only."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(mode=0o700, exist_ok=True)
        with atomic(path, private=True) as stream:
            np.savez(stream, allow_pickle=False, time=limit.time, rotation=limit.rotation, **limit.sigma)


@cache
def _version() -> str:
    """Hash of the source of the limits."""
    return source_digest(Path(limits.__file__).parent.glob("*.py"))

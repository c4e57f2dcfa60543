"""The document `live` of a page: a scenario and its estimators as WebAssembly, with what starts, steers and labels them."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.output import as_path, atomic, check_output_file
from insenv.base.remarks import Remark, declared
from insenv.base.shipped import __version__
from insenv.base.toml import validated
from insenv.core.compile import wasm, wasm_source
from insenv.core.model import Model
from insenv.core.runner import Progress, check_progress
from insenv.core.tables import Table, Vector
from insenv.estimators import Estimator, EstimatorsLike, get_all, registry
from insenv.estimators.registry import knowing_objects
from insenv.estimators.settings import Settings, setting_rows
from insenv.evaluation.errors import CHANNELS
from insenv.report.of_run import AXES, BIASES, EXPLAINED, NAMES
from insenv.report.page import assembled, check_size, compressed
from insenv.report.tables import MARKED, label, unit_of, within
from insenv.scenario import Plant, Scenario, ScenarioLike, build, load, no_limit
from insenv.scenario.build import start_normals, start_sigmas, stated_start_errors
from insenv.scenario.description import scenario_class
from insenv.scenario.files import named_estimators
from insenv.scenario.inputs import PREFIX, VALID, recording_interval
from insenv.web.controls import Control, Option, Trials, with_values
from insenv.web.judging import findings, health_rows, judged, limit_along, limit_document, rules
from insenv.web.model import PageModel, page_model
from insenv.web.start import known_vector, not_computed, reported_places, start_source

SEEDS = 1024
"""Seeds that a page offers, from 0 on, beside that of the scenario."""


@dataclass(frozen=True, eq=False)
class Live:
    """A scenario ready to run in a page.

    plain: the scenario as it stands.  plant: the same to the bit, with every command that the vehicle can take.
    parameters: of the page's model, with the initial knowledge of the estimators at the scenario's seed.
    known: see `insenv.web.start.known_vector`.  seeds (n,): those offered; normals (n, 9): behind their start errors.
    trials: find `controls`.  settings: of the estimators.
    """

    plain: Plant
    plant: Plant
    page: PageModel
    wasm: bytes
    parameters: Vector
    known: Vector
    seeds: tuple[int, ...]
    normals: Vector
    trials: Trials
    settings: Settings | None

    @property
    def values(self) -> Mapping[str, Any]:
        """The values of the scenario's file, with the page's seed, duration, estimators and settings."""
        return self.trials.values

    @cached_property
    def controls(self) -> tuple[Control, ...]:
        """What the page may change."""
        return self.trials.controls()

    @property
    def every(self) -> int:
        """Samples from one record to the next, as `insenv.run` records them."""
        return recording_interval(self.plant.samples)


def live(
    scenario: ScenarioLike,
    estimators: EstimatorsLike | None = None,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
) -> Live:
    """Compile a scenario and estimators for a page; the arguments are those of `insenv.run`.

    Raises `InputError` for what is unknown or wrong, and for an estimator that goes back over a whole run; `InsenvError`
    without the compiler.
    """
    loaded = load(scenario)
    chosen = get_all(named_estimators(loaded) if estimators is None else estimators)
    plain = build(loaded, seed=seed, duration_s=duration_s, driven=True)
    loaded = loaded.model_copy(update={"vehicle": loaded.vehicle.steerable()})
    plant = build(loaded, seed=seed, duration_s=duration_s, driven=True)
    rows = setting_rows(settings, chosen)
    chosen = [plant.adapted(estimator, settings, offline=False) for estimator in chosen]
    page = page_model(plant.model, tuple(chosen))
    parameters = page_parameters(page, plant, chosen, rows)
    starts = [place for place, _ in reported_places(page, plant)]
    trials = Trials(with_run(loaded, plant, chosen, settings), lambda values: numbers(values, page, settings), starts)
    known = loaded.knowledge
    seeds = (*range(SEEDS), *((plant.seed,) if plant.seed >= SEEDS else ()))
    return Live(
        plain=plain,
        plant=plant,
        page=page,
        wasm=wasm(wasm_source(page.model, start_source(page, plant))),
        parameters=parameters,
        known=known_vector(start_sigmas(known), stated_start_errors(known), start_normals(known, plant.seed)),
        seeds=seeds,
        normals=start_normals(known, np.array(seeds)),
        trials=trials,
        settings=settings,
    )


def numbers(values: Mapping[str, Any], page: PageModel, settings: Settings | None = None) -> tuple[Vector, Vector]:
    """Parameters and `known_vector` of a page's model for the values of a scenario.

    Raises `InputError` for values that are not allowed, or that another model would run.
    """
    plant, chosen = _prepared(values, page, settings)
    known = plant.scenario.knowledge
    vector = known_vector(start_sigmas(known), stated_start_errors(known), start_normals(known, plant.seed))
    return page_parameters(page, plant, chosen, setting_rows(settings, chosen)), vector


def _prepared(values: Mapping[str, Any], page: PageModel, settings: Settings | None) -> tuple[Plant, list[Estimator]]:
    """The plant of these values and the estimators as they run on it; errors as of `numbers`."""
    plant = build(validated(scenario_class(), dict(values), "scenario"), driven=True)
    compiled = [member.estimator for member in page.members]
    chosen = [plant.adapted(estimator, settings, offline=False) for estimator in compiled]
    if plant.model is not page.plant or any(one.model is not other.model for one, other in zip(chosen, compiled, strict=True)):
        raise InputError("these values are run by another model than that of the page")
    return plant, chosen


def with_run(scenario: Scenario, plant: Plant, chosen: Sequence[Estimator], settings: Settings | None) -> Scenario:
    """The scenario with the seed, duration, estimators and settings of a page, as a file would have them.

    Estimators that are not registered are in no file.
    """
    values = scenario.model_dump(mode="json", exclude_unset=True)
    known = registry.names()
    named = [estimator.id for estimator in chosen if estimator.id in known]
    values |= {"seed": plant.seed, "duration_s": plant.duration_s, "estimators": named}
    for id, table in (settings or {}).items():
        if id in known:
            values.setdefault("estimator", {}).setdefault(id, {}).update(table)
    return load(values)


def page_parameters(
    page: PageModel, plant: Plant, chosen: Sequence[Estimator], rows: Mapping[str, Mapping[str, Any]]
) -> Vector:
    """Parameters of a page's model: those of `insenv.run`."""
    parts = [plant.model.parameters.pack(plant.parameters)]
    for estimator in chosen:
        parts.append(estimator.model.parameters.pack(plant.parameters_of(estimator, rows[estimator.id], offline=False)))
    return np.concatenate(parts)


def live_document(live: Live, progress: Progress | None = None) -> dict[str, Any]:
    """The document that a page embeds: see docs/page.md."""
    plant, model = live.plant, live.page.model
    scenario = plant.scenario
    if not 0 < plant.samples < 2**31:
        raise InputError(f"duration_s = {plant.duration_s:g} s: a page runs at most 2^31 samples")
    limit = limit_along(live.plain, progress)
    named = model.parameters.unpack(live.parameters)
    rows = {
        member.prefix: {row.name: named[member.prefix + row.name] for row in member.estimator.model.parameters}
        for member in live.page.members
    }
    return {
        "kind": "live",
        "version": __version__,
        "name": scenario.name,
        "title": scenario.title,
        "vehicle": scenario.vehicle.kind,
        "shape": scenario.vehicle.traits.shape,
        "seed": plant.seed,
        "rate_hz": scenario.rate_hz,
        "duration_s": plant.duration_s,
        "samples": plant.samples // live.every * live.every,
        "every": live.every,
        "wasm": base64.b64encode(compressed(live.wasm)).decode(),
        "start": {"p": _base64(live.parameters), "known": _base64(live.known), "u": _base64(model.inputs.start_vector())},
        "sizes": {"p": model.parameters.size, "x": model.state.size, "u": model.inputs.size, "y": model.outputs.size},
        "seed_place": model.parameters.slice("seed").start,
        "seeds": {"numbers": _ranges(live.seeds), "others": [_base64(each) for each in not_computed(live.normals, live.seeds)]},
        "tables": {"inputs": _rows(model.inputs), "outputs": _rows(model.outputs)},
        "estimators": [
            {
                "id": member.estimator.id,
                "title": member.estimator.title,
                "group": group,
                "kind": member.estimator.kind,
                "prefix": member.prefix,
                "channels": list(member.channels),
                "stated": list(member.stated),
                "settled": not member.estimator.too_short(rows[member.prefix], plant.duration_s),
                "health": health_rows(member.estimator, rows[member.prefix]),
                "findings": findings(member.estimator, rows[member.prefix]),
                **judged(member, plant, live.every, limit),
            }
            for group, member in enumerate(live.page.members)
        ],
        "commands": _commands(plant, model),
        "values": _downloaded(live),
        "outages": [
            _outages(model.parameters, id) for id in plant.scenario.sensors if f"{id}_outage_start" in model.parameters
        ],
        "controls": [_control(control, live) for control in live.controls],
        "limit": limit_document(limit, plant.duration_s),
        "rules": rules(live.page.members),
        "channels": {name: {"label": label(name), "title": NAMES[name], "unit": unit_of(name)} for name in CHANNELS},
        "biases": {"rows": BIASES, "axes": AXES},
        "marked": MARKED,
        "explained": EXPLAINED | {"within": f"{within(1)}."},
        "notes": _notes(plant, [member.estimator for member in live.page.members], live.settings),
    }


def _downloaded(live: Live) -> dict[str, Any]:
    """The values of the scenario's file as the page downloads it: the file of a track stands beside it, wherever that is."""
    file = _track_file(live.plant)
    return dict(live.values) if file is None else with_values(live.values, {"vehicle.file": file})


def _track_file(plant: Plant) -> str | None:
    """The name of the file that the vehicle's motion comes from."""
    file = getattr(plant.scenario.vehicle, "file", None)
    return Path(file).name if file else None


def _commands(plant: Plant, model: Model) -> dict[str, Any] | None:
    """The commands of the vehicle, the sticks that set them, and those of the scenario; None if it takes none."""
    names = [name.removeprefix(PREFIX) for name in model.inputs.names if name.startswith(PREFIX) and name != VALID]
    if not names:
        return None
    rows = [
        {
            "name": name,
            "at": model.inputs.slice(PREFIX + name).start,
            "state": model.state.slice(f"commanded_{name}").start,
        }
        for name in names
    ]
    sticks = [
        {**vars(stick), "scale": stick.value(1.0, 1.0) * stick.sign}
        for stick in plant.scenario.vehicle.sticks
        if stick.command in names
    ]
    prepared = [
        {"sample": sample, "values": {row["name"]: float(values[row["at"]]) for row in rows}}
        for sample, values in plant.commands
    ]
    return {"valid": model.inputs.slice(VALID).start, "rows": rows, "sticks": sticks, "given": prepared}


def _outages(parameters: Table, id: str) -> dict[str, Any]:
    """Where the outage windows of a sensor are among the parameters."""
    begin, end = (parameters.slice(f"{id}_outage_{name}") for name in ("start", "end"))
    name = "GNSS" if id == "gnss" else id
    where = {"start": begin.start, "end": end.start, "most": begin.stop - begin.start}
    return {"sensor": id, "name": name, "key": f"{id}.outages_s", **where}


def _control(control: Control, live: Live) -> dict[str, Any]:
    common = {name: getattr(control, name) for name in ("key", "label", "group", "meaning", "value")}
    if control.options:
        return common | {"options": [_option(option, live) for option in control.options]}
    bounds = {name: getattr(control, name) for name in ("unit", "minimum", "maximum", "low", "high")}
    return common | bounds | {"targets": [vars(target) | vars(control.conversion) for target in control.targets]}


def _option(option: Option, live: Live) -> dict[str, Any]:
    """An option, with the notes of the scenario in which nothing else is changed."""
    plant, chosen = _prepared(with_values(live.values, option.setting), live.page, live.settings)
    notes = _notes(plant, chosen, live.settings)
    return {"value": option.value, "label": option.value, "set": dict(option.setting), "p": option.p, "notes": notes}


def _notes(plant: Plant, chosen: Sequence[Estimator], settings: Settings | None) -> list[Remark]:
    """What must be said of a scenario and of the estimators that run on it, as in a run."""
    rows, notes = setting_rows(settings, chosen), _notes_of_page(plant)
    for estimator in chosen:
        notes += [note.of(estimator.id) for note in plant.notes_of(estimator, rows[estimator.id])]
    return notes


_KEEP_TRACK = declared("track-beside", "the downloaded scenario reads its track from {file}: keep that file beside it")
_REPEATED = declared(
    "samples-repeated",
    "lost inertial samples: the page repeats the last sample; `insenv run` interpolates, so its numbers differ",
)


def _notes_of_page(plant: Plant) -> list[Remark]:
    """What a reader of the page must know of a scenario."""
    notes = [*plant.scenario.notes, *no_limit(plant)]
    if file := _track_file(plant):
        notes.append(_KEEP_TRACK.filled(file=file))
    if plant.parameters["imu_drop_probability"] > 0.0:
        notes.append(_REPEATED)
    return notes


def _rows(table: Table) -> list[dict[str, Any]]:
    rows = []
    for row in table:
        start = table.slice(row.name).start
        bounds = {k: v for k, v in (("minimum", row.lower), ("maximum", row.upper)) if np.isfinite(v)}
        rows.append(
            {"name": row.name, "meaning": row.meaning, "unit": row.unit, "frame": row.frame, "at": start, "size": row.size}
            | bounds
            | ({"flag": True} if row.flag else {})
        )
    return rows


def _ranges(seeds: Sequence[int]) -> list[list[int]]:
    """Seeds as ranges [first, last]."""
    ranges: list[list[int]] = []
    for seed in seeds:
        if ranges and seed == ranges[-1][1] + 1:
            ranges[-1][1] = seed
        else:
            ranges.append([seed, seed])
    return ranges


def _base64(numbers: Vector) -> str:
    """The bytes of float64 numbers, little endian."""
    return base64.b64encode(np.ascontiguousarray(numbers, dtype="<f8").tobytes()).decode()


# `page`: a scenario and its estimators as one HTML file that simulates in a browser.


@knowing_objects
def page(
    scenario: ScenarioLike,
    output: str | Path,
    estimators: EstimatorsLike | None = None,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write a scenario and estimators as one HTML file that simulates in a browser, with the numbers of `insenv.run`.

    output: the file.  The other arguments are those of `insenv.run`.  The file needs no network and no other file; a browser
    opens it from a disk or from a server.

    Returns the path.  Raises `InputError` for an unknown name, a wrong value, an estimator that cannot run on this scenario
    or goes back over a whole run, and for a file that cannot be written; `InsenvError` if there is no compiler to WebAssembly,
    or if the page is too large.
    """
    check_progress(progress)
    path = as_path("output", output)
    check_output_file(path, ".html")
    made = live(scenario, estimators, seed=seed, duration_s=duration_s, settings=settings)
    text = assembled(made.plant.scenario.title, {"live": live_document(made, progress)})
    check_size(text)
    with atomic(path) as stream:
        stream.write(text.encode("utf-8"))
    return path

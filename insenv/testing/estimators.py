"""What insenv promises of every estimator."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insenv.core.runner import make_runner
from insenv.estimators import Estimator, get
from insenv.scenario import Plant, ScenarioLike, build, load, names
from insenv.scenario.chunks import input_rows
from insenv.testing.models import check_backends, check_inputs, check_snapshots, check_tables

DURATION_S = 2.0
OUTPUTS = {"alignment": ("q_nb",), "navigation": ("q_nb", "velocity_n", "latitude", "longitude", "height")}


def check_estimator(
    estimator: str | Estimator, scenario: ScenarioLike | None = None, *, pages: str | Path | None = None, compiled: bool = True
) -> None:
    """Check an estimator's tables, outputs, refusals, snapshots, and its bits on every backend, on 2 s of a scenario.

    scenario: one that it runs on; None: the first of insenv's.  pages: folder of which a page must name it.  compiled:
    whether native code and batches are compared too.  Raises `AssertionError`.
    """
    chosen = get(estimator)
    this = f"estimator {chosen.id!r}"
    assert chosen.title.strip(), f"{this} has no title"
    assert chosen.kind in OUTPUTS, f"{this}: kind = {chosen.kind!r}"
    if pages is not None:
        described = [page.name for page in Path(pages).glob("*.md") if f"`{chosen.id}`" in page.read_text(encoding="utf-8")]
        assert described, f"{this}: no page in {pages} names it"
    plant = _plant(chosen, scenario)
    adapted = plant.adapted(chosen)
    model = adapted.model
    check_tables(model)
    parameters = model.parameters.pack(plant.parameters_of(adapted))
    check_inputs(model, parameters)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters, "interpreter").run(plant.samples))
    rows = input_rows(model, {**columns, "dt": np.full(plant.samples, plant.sample_interval)}, plant.samples)
    _check_outputs(this, adapted, model.outputs.unpack(make_runner(model, parameters, "interpreter").run(len(rows), rows)))
    check_snapshots(model, parameters, rows)
    if compiled:
        check_backends(model, parameters, rows)


def _plant(estimator: Estimator, scenario: ScenarioLike | None) -> Plant:
    """A short plant that the estimator runs on.  Raises `AssertionError` if there is none."""
    for loaded in map(load, names() if scenario is None else (scenario,)):
        if not estimator.refusal(loaded.drive()):
            return build(loaded, duration_s=DURATION_S)
    raise AssertionError(f"estimator {estimator.id!r} runs on no scenario")


def _check_outputs(this: str, estimator: Estimator, outputs: dict[str, np.ndarray]) -> None:
    for name in OUTPUTS[estimator.kind]:
        assert name in outputs, f"{this}: an estimator of kind {estimator.kind!r} has no output {name!r}"
    for name, values in outputs.items():
        assert np.isfinite(values).all(), f"{this}: output {name!r} is not finite"
        if name.endswith("_sigma"):
            assert np.all(values >= 0.0), f"{this}: output {name!r} is negative"
    norm = np.sqrt(np.sum(np.square(outputs["q_nb"]), axis=1))
    assert np.allclose(norm, 1.0, rtol=0, atol=1e-6), f"{this}: q_nb is not of unit norm: {norm.min()} to {norm.max()}"

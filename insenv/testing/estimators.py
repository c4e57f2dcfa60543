"""What insenv promises of every estimator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from insenv.attitude import numeric as attitude
from insenv.core.runner import make_runner
from insenv.core.tables import Vector
from insenv.estimators import Estimator, get
from insenv.estimators.parts.fed import misfed
from insenv.scenario import Plant, ScenarioLike, build, load, names
from insenv.scenario.inputs import input_rows
from insenv.testing.models import check_backends, check_inputs, check_snapshots, check_tables, promised

DURATION_S = 2.0
TURN, PUSH = 0.01, 1.0
"""What is added to each gyro increment (rad) and accelerometer increment (m/s), to see what an estimator makes of them."""
TURNED = {"alignment": (0.0, 20.0), "navigation": (0.5, 2.0)}
PUSHED = (0.0, 2.0)
"""What an attitude and the velocity of a navigation may change by over the increments.

It is 1 where the increments are integrated, up to 8 where an alignment averages them, and near 0 where an aid holds the
velocity; 57 where degrees are mistaken for radians, 9.8 where g is mistaken for m/s^2.
"""


def check_estimator(
    estimator: str | Estimator, scenario: ScenarioLike | None = None, *, pages: str | Path | None = None, compiled: bool = True
) -> None:
    """Check an estimator's tables, inputs, outputs, refusals, snapshots, and its bits on every backend, on 2 s of a scenario.

    scenario: one that it runs on; None: the first of insenv's.  pages: folder of which a page must name it.  compiled:
    whether native code and batches are compared too.  Raises `AssertionError` for a promise that it breaks, `InputError` for an
    estimator or a scenario that does not exist.
    """
    chosen = get(estimator)
    this = f"estimator {chosen.id!r}"
    assert chosen.title.strip(), f"{this}: title = {chosen.title!r}: allowed is one line"
    if pages is not None:
        described = [page.name for page in Path(pages).glob("*.md") if f"`{chosen.id}`" in page.read_text(encoding="utf-8")]
        assert described, f"{this}: no page in {pages} names it: one must have `{chosen.id}`"
    wrong = misfed(chosen.model)
    assert not wrong, wrong
    plant = _plant(chosen, scenario)
    with promised(this):
        adapted = plant.adapted(chosen)
        model = adapted.model
        check_tables(model)
        parameters = model.parameters.pack(plant.parameters_of(adapted))
        check_inputs(model, parameters)
        columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters, "interpreter").run(plant.samples))
        rows = input_rows(model, {**columns, "dt": np.full(plant.samples, plant.sample_interval)}, plant.samples)
        _check_outputs(this, model.outputs.unpack(make_runner(model, parameters, "interpreter").run(len(rows), rows)))
        _check_increments(this, adapted, parameters, rows)
        check_snapshots(model, parameters, rows)
        if compiled:
            check_backends(model, parameters, rows)


def _plant(estimator: Estimator, scenario: ScenarioLike | None) -> Plant:
    """A short plant that the estimator runs on.  Raises `AssertionError` if there is none."""
    refusals = []
    for loaded in map(load, names() if scenario is None else (scenario,)):
        refusals.append(estimator.refusal(loaded.drive()))
        if not refusals[-1]:
            return build(loaded, duration_s=DURATION_S)
    others = "" if scenario is not None else f"; the other {len(refusals) - 1} scenarios of insenv are refused too"
    raise AssertionError(f"{refusals[0]}{others}")


def _check_outputs(this: str, outputs: dict[str, Vector]) -> None:
    for name, values in outputs.items():
        bad = values[~np.isfinite(values)]
        assert not bad.size, f"{this}: output {name!r} = {bad[0]}: allowed is a finite number"
        least = float(np.min(values, initial=0.0))
        assert not name.endswith("_sigma") or least >= 0.0, f"{this}: output {name!r} = {least:g}: allowed is 0 or more"
    norm = np.sqrt(np.sum(np.square(outputs["q_nb"]), axis=1))
    worst = float(norm[np.argmax(np.abs(norm - 1.0))])
    assert abs(worst - 1.0) <= 1e-6, f"{this}: output 'q_nb' has the norm {worst:.9g}: q_nb is not of unit norm"


def _check_increments(this: str, estimator: Estimator, parameters: Vector, rows: Vector) -> None:
    """Check that the attitude turns, and the velocity of a navigation changes, by what is added to the increments."""
    model, half = estimator.model, len(rows) // 2

    def check(name: str, output: str, added: Vector, steps: Callable[[Vector], Vector], allowed: tuple[float, float]) -> None:
        if name not in model.inputs:
            return
        changed = rows.copy()
        changed[:, model.inputs.slice(name)] += added
        values = model.outputs.unpack(make_runner(model, parameters, "interpreter").run(len(rows), changed))[output]
        fed = np.linalg.norm(changed[half + 1 :, model.inputs.slice(name)], axis=1)
        ratio = float(np.median(np.linalg.norm(steps(values[half:]), axis=1) / fed))
        assert allowed[0] <= ratio <= allowed[1], (
            f"{this}, input {name!r}: {output} changes by {ratio:.3g} times the increments, which are in "
            f"{model.inputs[name].unit}: allowed is {allowed[0]:g} to {allowed[1]:g}"
        )

    phase = np.arange(len(rows)) * (2.0 * np.pi / 64)
    cone = np.stack([np.cos(phase), np.sin(phase), np.ones(len(rows))], axis=1) * np.sqrt(0.5)
    check("delta_angle", "q_nb", TURN * cone, _turns, TURNED[estimator.kind])
    if estimator.kind == "navigation":
        check("delta_velocity", "velocity_n", np.full(3, PUSH), lambda v: np.diff(v, axis=0), PUSHED)


def _turns(q: Vector) -> Vector:
    """Rotation vectors (k - 1, 3), rad, from each of k attitudes to the next."""
    return attitude.to_rotation_vector(attitude.multiply(attitude.conjugate(q[:-1]), q[1:]))

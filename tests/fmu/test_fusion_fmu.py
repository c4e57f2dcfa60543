"""FMUs of composed filters: the choice of states and aids, and what `insenv fmu run` says of a wrong start."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import call

from insenv.cli.fmu import _health, _settings
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.estimators.parts.rows import FIX_HEALTH
from insenv.fmu import export_fmu
from insenv.fmu.running import Outputs, run
from insenv.fmu.subject import subject
from insenv.plant.feeding import input_rows
from insenv.scenario import build, load


def test_states_and_aids_of_an_fmu_are_chosen_as_in_a_run():
    made = subject("fusion", _settings(['fusion.aids=["odometer", "gnss"]', 'states=["odometer_scale"]']))
    assert made.model.title == "16 states: navigation, biases, odometer_scale; aids: gnss, odometer"
    loop = subject("car-odometer", {"estimator.aids": ["gnss"], "estimator.states": []}, "fusion")
    outputs = loop.model.outputs.names
    assert "estimator_odometer_count" not in outputs and "estimator_fix_count" in outputs
    with pytest.raises(InputError, match="unknown name 'sonar'"):
        subject("fusion", _settings(['aids=["sonar"]']))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "car-city-drive", "car-survey", "car-odometer", "car-unknown-receiver", "multirotor-hover", "ship-dvl", "ship-at-sea",
        "ship-log-alignment",
        "turntable-calibration", "aircraft-free-inertial",
    ],
)  # fmt: skip
def test_every_preset_gives_the_same_bits_everywhere(name, tmp_path):
    """Interpreter, native code, batch and FMU, over 15 s with all its aids."""
    plant = build(load(name), duration_s=15.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    filter = plant.adapted("fusion")
    filter = replace(filter, model=replace(filter.model, id=f"preset-{name}"))
    parameters, model = plant.parameters_of(filter), filter.model
    rows = input_rows(model, columns, plant.samples)
    native = make_runner(model, parameters, "native").run(plant.samples, rows)
    assert np.isfinite(native).all()
    np.testing.assert_array_equal(make_runner(model, parameters, "interpreter").run(plant.samples, rows), native)
    packed = np.tile(model.parameters.pack(parameters), (3, 1))
    for row in make_batch(model, 3, packed, threads=1).run(plant.samples, np.tile(rows, (3, 1, 1)), every=1):
        np.testing.assert_array_equal(row, native)
    given = {"sample_interval": plant.sample_interval, "step_is_one_increment": True}
    fmu = export_fmu(filter, tmp_path / "preset.fmu", settings={**parameters, **given})
    shown = run(fmu, {row.name: columns[row.name] for row in model.inputs if row.name in columns}).named()
    for row, column in model.outputs.unpack(native).items():
        np.testing.assert_array_equal(np.ravel(shown[row]), np.ravel(column), row)


def test_a_list_that_is_none_is_named():
    status, _, said = call("fmu", "export", "fusion", "--set", 'aids=["gnss"', "-o", "x.fmu")
    assert status == 2 and "is no list: allowed is" in said


def judged(ratio, refused):
    """The notes on 100 fixes whose test ratios are `ratio`, of which a share is refused."""
    count = np.arange(1.0, 101.0)[:, None]
    used = count * (1 - refused)
    columns = {
        "fix_count": count,
        "fix_refused_count": count * refused,
        "nis_used": np.tile(3 * ratio**2 * used, 2),
        "nis_used_count": np.tile(3 * used, 2),
        "nis_refused": np.tile(3 * ratio**2 * count * refused, 2),
        "nis_refused_count": np.tile(3 * count * refused, 2),
    }
    assert tuple(columns) == FIX_HEALTH.names
    names = [e for n, c in columns.items() for e in ([n] if c.shape[1] == 1 else [f"{n}[1]", f"{n}[2]"])]
    values = np.hstack(list(columns.values()))
    return _health(Outputs(count[:, 0], tuple(names), values, dict.fromkeys(names, "1"), 1.0, 100, 1.0, (), ()))


def test_a_run_of_an_fmu_far_from_its_start_names_the_start():
    assert judged(1.0, 0.0) == []
    first, why, start = judged(1e4, 0.9)
    assert first.startswith("health: diverged, factor 10000") and "has diverged from its fixes" in why
    assert "parameters.start_latitude" in start and "--set" in start


def test_outputs_that_are_no_numbers_are_named():
    found = Outputs(np.arange(3.0), ("a",), np.array([[1.0], [np.nan], [np.nan]]), {"a": "1"}, 1.0, 3, 1.0, (), ())
    (said,) = _health(found)
    assert said.startswith("outputs are no longer finite from 1 s on") and "start_latitude" in said

"""Plain functions as estimators of a run: the same errors as those of the model with the same equations, and clear refusals."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import insenv
from insenv.base.errors import InputError, InsenvError
from insenv.core.runner import make_runner
from insenv.scenario import build, load
from insenv.scenario.inputs import input_rows


def stepped(scenario: str, id: str, seed: int) -> Any:
    """A function that steps the model of an estimator, one sample a call, started as a run starts it."""
    plant = build(load(scenario), seed=seed)
    estimator = plant.adapted(id)
    runner = make_runner(estimator.model, plant.parameters_of(estimator))
    names = estimator.model.inputs.names

    def stepper(sample: Any) -> dict[str, Any]:
        columns = {name: np.asarray(getattr(sample, name))[None] for name in names if name in dir(sample)}
        outputs = estimator.model.outputs.unpack(runner.run(1, input_rows(estimator.model, columns, 1)))
        rows = ("q_nb", "velocity_n", "latitude", "longitude", "height", "attitude_sigma", "position_sigma", "velocity_sigma")
        return {name: outputs[name][0] for name in rows if name in outputs}

    return stepper


def test_a_function_with_the_equations_of_a_filter_gives_its_results_to_the_bit() -> None:
    ids = ["loosely-coupled", stepped("car-city-drive", "loosely-coupled", 5)]
    model, function = insenv.run("car-city-drive", ids, seed=5, duration_s=3.0).results
    assert function.estimator == "stepper"
    for name, values in model.errors.items():
        np.testing.assert_allclose(function.errors[name], values, atol=1e-12, err_msg=name)
        np.testing.assert_array_equal(function.sigma[name], model.sigma[name])
    assert function.limit == model.limit and function.from_s == model.from_s == 0.0
    assert "called 600 times" in function.notes[0] and "real time" in function.notes[0]


def test_an_attitude_may_have_any_of_its_forms() -> None:
    known = build(load("ship-swaying"), duration_s=0.1).knowledge
    rotation = Rotation.from_euler("ZYX", [known.heading, known.pitch, known.roll])
    expected, C_nb = rotation.as_quat(scalar_first=True), rotation.as_matrix()
    for form in (expected, C_nb, rotation, {"C_nb": C_nb}):
        q = insenv.run("ship-swaying", lambda sample, form=form: form, duration_s=0.1).results[0].outputs["q_nb"][0]
        np.testing.assert_allclose(abs(q @ expected), 1.0, atol=1e-14)


def test_nothing_is_scored_before_the_first_estimate_and_no_truth_is_in_a_sample() -> None:
    """The latest estimate holds."""
    seen: set[str] = set()

    def slow(sample: Any) -> Any:
        seen.update(dir(sample))
        with pytest.raises(ValueError, match="read-only"):
            sample.delta_angle[0] = 1.0
        return [1.0, 0.0, 0.0, 0.0] if abs(sample.time - 0.5) < 1e-9 else None

    result = insenv.run("car-city-drive", slow, duration_s=1.0).results[0]
    assert result.time[0] == pytest.approx(0.5) and len(result.time) == 101
    assert {"known", "time", "dt", "delta_angle", "delta_velocity", "gnss_valid", "gnss_latitude"} <= seen
    assert not [name for name in seen if "true" in name or name in ("q_nb", "velocity_n", "latitude", "gyro_bias_true")]


@pytest.mark.parametrize(("value", "message"), [
    ([np.nan, 0, 0, 0], r"q_nb = \[nan, 0.0, 0.0, 0.0\]"),
    ([2.0, 0, 0, 0], "has the norm 2"),
    ([1.0, 0.0], r"q_nb has shape \(2,\)"),
    (np.diag([1.0, 1.0, -1.0]), "a rotation matrix, right-handed"),
    ({"q_bn": [1, 0, 0, 0]}, "'q_bn': unknown row of an estimate; did you mean 'q_nb'"),
    ({"q_nb": [1, 0, 0, 0], "latitude": 0.5}, "latitude without longitude, height"),
    ({"q_nb": [1, 0, 0, 0], "latitude": 48.0, "longitude": 11.0, "height": 0.0}, "allowed is up to 1.5708"),
    ({"velocity_n": [0, 0, 0]}, "allowed is one with q_nb"),
    (None, "returned no estimate in 0.1 s"),
])  # fmt: skip
def test_a_wrong_estimate_is_refused_in_one_sentence(value: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        insenv.run("ship-swaying", lambda sample: value, duration_s=0.1)
    assert "\n" not in str(error.value)


def test_a_function_that_fails_or_changes_its_rows_is_named() -> None:
    def broken(sample: Any) -> Any:
        return 1 / 0

    def changing(sample: Any) -> Any:
        return {"q_nb": [1, 0, 0, 0], **({"velocity_n": [0, 0, 0]} if sample.time > 0.05 else {})}

    for function, said in (
        (broken, r"estimator 'broken' failed at 0.005 s: ZeroDivisionError"),
        (changing, r"estimator 'changing' at .*: the estimate has q_nb, velocity_n"),
        ([broken, type("broken", (), {"__call__": lambda self, s: None})()], "two functions have the name 'broken'"),
    ):
        with pytest.raises(InsenvError, match=said):
            insenv.run("car-city-drive", function, duration_s=0.1)

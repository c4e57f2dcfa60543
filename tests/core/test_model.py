"""What a model must be: conditions, seeds, rows, finite constants."""

import numpy as np
import pytest

from insenv.core.model import Model, Step, derived
from insenv.core.tables import Row, Table

STATE = Table((Row("speed", "Speed", "m/s", start=1.0), Row("q", "Attitude", shape=(4,), start=(1, 0, 0, 0))))


def model(step):
    return Model("m", "", Table(), STATE, Table(), Table(), {"s": step}, lambda p, x: {})


@pytest.mark.parametrize(("step", "said"), [
    (Step(lambda p, x, u: {}, when="nowhere"), "'nowhere' must be one state or one input row"),
    (Step(lambda p, x, u, r: {}, uniforms=1), "needs the parameter 'seed'"),
    (Step(lambda p, x, u: {"q": x.q / 0}), "model 'm', step 's': row 'q' contains a constant that is not finite"),
])  # fmt: skip
def test_a_wrong_step_is_named(step, said):
    with pytest.raises(ValueError, match=said):
        _ = model(step).kernels


def test_functions_give_the_whole_state_and_a_derived_table_has_other_start_values():
    function = model(Step(lambda p, x, u: {"speed": 2 * x.speed})).functions["s"]
    assert function([], np.arange(1.0, 6.0), [], []).full().ravel().tolist() == [2.0, 2.0, 3.0, 4.0, 5.0]
    assert derived(STATE, speed=3.0).start_vector().tolist() == [3.0, 1.0, 0.0, 0.0, 0.0]

"""FMUs of composed filters: the choice of states and aids, and what `insenv fmu run` says of a wrong start."""

import numpy as np
import pytest
from command_line import call

from insenv.cli.fmu import _health, _settings
from insenv.errors import InputError
from insenv.estimators.parts.rows import FIX_HEALTH
from insenv.fmu.running import Outputs
from insenv.fmu.subject import subject


def test_states_and_aids_of_an_fmu_are_chosen_as_in_a_run():
    made = subject("fusion", _settings(['fusion.aids=["odometer", "gnss"]', 'states=["odometer_scale"]']))
    assert made.model.title == "16 states: navigation, biases, odometer_scale; aids: gnss, odometer"
    loop = subject("car-odometer", {"estimator.aids": ["gnss"], "estimator.states": []}, "fusion")
    outputs = loop.model.outputs.names
    assert "estimator_odometer_count" not in outputs and "estimator_fix_count" in outputs
    with pytest.raises(InputError, match="unknown name 'sonar'"):
        subject("fusion", _settings(['aids=["sonar"]']))


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

"""The environments: Gymnasium's contract, both faces, bad input, and what episodes are made of."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import insenv
from insenv import testing
from insenv.envs import IDS, estimate_action
from insenv.errors import InputError
from insenv.run import run
from insenv.scenario import build, load

SHORT = {"samples_per_step": 7, "duration_s": 0.3}
ESTIMATION = [id for id in IDS if id.split("/")[1].endswith(("Alignment-v0", "Navigation-v0"))]


@pytest.mark.parametrize("id", ESTIMATION)
def test_every_environment_conforms(id):
    testing.check_id(id, **SHORT)


@pytest.mark.parametrize("id", ESTIMATION[:1])
def test_a_random_start_conforms(id):
    testing.check_id(id, **SHORT, imu="random", heading_deg=(0.0, 360.0), sea_state=(0.5, 1.5), initial_error=(1.0, 90.0))


def test_interpreter_equals_native_to_the_bit():
    envs = [gymnasium.make(IDS[0], backend=backend, **SHORT) for backend in ("native", "interpreter")]
    shown = [testing._episodes(env, 3) for env in envs]
    testing._assert_same(*shown, "native and interpreter")

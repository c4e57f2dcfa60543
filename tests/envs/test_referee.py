"""The referees of the environments against their documentation: all nine components of a navigation, and new fixes."""

import gymnasium
import numpy as np
import pytest

from insenv import attitude
from insenv.core.runner import make_runner
from insenv.envs import estimate_action
from insenv.scenario import build, load

DRIVE = "insenv/VehicleNavigation-v0"


@pytest.fixture(autouse=True)
def interpreted(monkeypatch):
    """These episodes are short: compiling would take longer than running them."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")


def test_reward_of_a_navigation_counts_nine_components():
    """-ln(1 + sqrt(mean((e / s)^2))) / T with e of attitude, velocity and position, each off on its own."""
    env = gymnasium.make(DRIVE, samples_per_step=20, duration_s=2.0).unwrapped
    _, info = env.reset(seed=4)
    for k in (0, 1, 2, 4, 5, 6, 8):
        e = 0.5 * info["limit"]
        e[k] *= 20.0
        q_nb = attitude.numeric.multiply(attitude.numeric.from_rotation_vector(e[:3]), info["q_nb"])
        action = estimate_action(
            env.setup.task, q_nb, velocity_n=info["velocity_n"] + e[3:6], position=info["position"] + e[6:9]
        )
        _, reward, terminated, _, info = env.step(action)
        assert not terminated and info["error"] == pytest.approx(e, rel=1e-3, abs=1e-9)
        measure = np.log(1.0 + np.sqrt(np.mean((e / info["limit"]) ** 2)))
        assert reward == pytest.approx(-measure / 20.0, rel=1e-3)


def test_a_fix_is_new_in_one_observation():
    """Steps of 0.3 s, fixes of 1 Hz: new once, then the same fix grows older."""
    env = gymnasium.make(DRIVE, samples_per_step=60, duration_s=9.0).unwrapped
    env.reset(seed=1, options={"run_seed": 12})
    plant = build(load("car-city-drive"), seed=12)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(1800))
    new, held, before = 0, 0, None
    for step in range(29):
        observation, *_ = env.step(np.eye(10)[0])
        seen, now = env.named(observation), slice(60 * step, 60 * (step + 1))
        delivered = np.flatnonzero(shown["gnss_valid"][now])
        assert seen["fix_new"] == float(len(delivered) > 0)
        if len(delivered):
            new += 1
            since = (59 - delivered[-1]) * plant.sample_interval + shown["gnss_age"][now][delivered[-1]]
            assert seen["fix_age"] == pytest.approx(since, abs=1e-9)
        elif before is not None and new:
            held += 1
            assert seen["fix_age"] == pytest.approx(before["fix_age"] + 0.3, abs=1e-9)
            assert np.array_equal(seen["fix_position"], before["fix_position"])
        before = seen
    assert new >= 7 and held >= 15


def test_measure_of_a_tuned_filter_counts_nine_components():
    """ln(1 + sqrt(mean((e / s)^2))): errors every second, over one evaluation and over two of the same drive."""
    found = {}
    for samples in (200, 400):
        env = gymnasium.make("insenv/Tuning-v0", samples_per_step=samples, duration_s=4.0, mistuning_decades=0.0).unwrapped
        env.reset(seed=3)
        found[samples] = [env.step(np.zeros(6))[-1] for _ in range(400 // samples)]
        for info in found[samples]:
            measure = np.log(1.0 + np.sqrt(np.mean((info["error_rms"] / info["limit"]) ** 2)))
            assert info["measure"] == pytest.approx(measure, rel=1e-9)
            assert info["limit"].shape == (9,) and (info["error_rms"] > 0).all()
    each = [info["error"] for info in found[200]]
    assert found[200][0]["error_rms"] == pytest.approx(np.abs(each[0]), rel=1e-9)
    assert found[400][0]["error_rms"] == pytest.approx(np.sqrt(np.mean(np.square(each), axis=0)), rel=1e-6)

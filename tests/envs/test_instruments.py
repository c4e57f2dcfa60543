"""Aiding instruments in environments: what an observation shows of them, and what an estimator in an environment is told."""

import warnings

import casadi as ca
import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import check_env

import insenv
from insenv import Row, Step, Table
from insenv.core.model import Model
from insenv.envs import agents
from insenv.estimators import Estimator
from insenv.estimators.parts.rows import SAMPLE_INPUTS
from insenv.instruments import INSTRUMENTS, ODOMETER
from insenv.scenario import load

SCENARIO = {
    "title": "Car",
    "duration_s": 20.0,
    "rate_hz": 100.0,
    "start": {"latitude_deg": 48.0, "longitude_deg": 11.0},
    "vehicle": {"kind": "car", "legs": [{"accelerate_to_mps": 15.0}, {"drive_s": 60.0}]},
    "imu": {"grade": "tactical"},
    "gnss": {"grade": "rtk"},
    **{id: {} for id in INSTRUMENTS},
}


def speedometer() -> Estimator:
    """An estimator that gives back what it is fed and told."""
    told = Table((ODOMETER.told["odometer_scale_factor_sigma"],))
    rows = ("latitude", "longitude", "height")
    state = Table((Row("speed", "Speed", "m/s"), Row("count", "Speeds so far")))
    outputs = Table(
        (
            Row("q_nb", "q", "1", (4,), start=(1, 0, 0, 0)),
            Row("velocity_n", "v", "m/s", (3,)),
            *(Row(name, name) for name in rows),
        )
    )
    model = Model(
        "speedometer",
        "Speedometer",
        told,
        state,
        SAMPLE_INPUTS + ODOMETER.measurement,
        outputs,
        {"take": Step(lambda p, x, u: {"speed": u.odometer_speed, "count": x.count + 1}, when="odometer_new")},
        lambda p, x: {
            "q_nb": ca.DM([1, 0, 0, 0]),
            "velocity_n": ca.vertcat(x.speed, x.count, p.odometer_scale_factor_sigma),
            **dict.fromkeys(rows, 0.0),
        },
    )
    return Estimator(model, kind="navigation", sensors=("odometer",))


def test_observations_show_the_measurements_and_no_truth() -> None:
    env = gym.make("insenv/VehicleNavigation-v0", scenario=SCENARIO, samples_per_step=10)
    names = env.unwrapped.setup.task.watched.names
    for instrument in INSTRUMENTS.values():
        assert set(instrument.measurement.names) <= set(names)
    assert not [name for name in names if "true" in name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


def test_an_estimator_in_an_environment_gets_what_it_gets_in_a_run() -> None:
    """Measurements on their own samples, to the bit, and what is told of the instrument."""
    estimator = speedometer()
    env = gym.make("insenv/VehicleNavigation-v0", scenario=SCENARIO, samples_per_step=7)
    agent = agents.make(estimator, env)
    observation, info = env.reset(seed=0, options={"run_seed": 0})
    for _ in range(50):
        action = agent.act(observation, info)
        observation, _, _, _, info = env.step(action)
    agent.act(observation, info)
    shown = estimator.model.outputs.unpack(agent._runner.output())["velocity_n"]
    seen = insenv.run(load(SCENARIO), estimator, duration_s=3.5).results[0].outputs["velocity_n"]
    assert seen[-1, 1] == 35, "10 Hz over 3.5 s"
    assert seen[-1, 2] == 0.01, "the grade's scale factor"
    np.testing.assert_array_equal(shown, seen[-1])

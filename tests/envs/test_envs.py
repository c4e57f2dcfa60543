"""The environments: Gymnasium's contract, both interfaces, wrong actions and arguments, starts of episodes."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from insenv import attitude
from insenv.envs import IDS, AlignmentEnv, AlignmentVectorEnv, agents, estimate_action, knowledge_of, testing
from insenv.errors import InputError
from insenv.scenario import build, load

SHORT = {"samples_per_step": 7, "duration_s": 0.3}
ESTIMATION = [id for id in IDS if id.split("/")[1].endswith(("Alignment-v0", "Navigation-v0"))]
SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
LEVEL = np.array([1.0, 0.0, 0.0, 0.0, -1.0])


NATIVE = [pytest.param(id, marks=[] if id in (SHIP, DRIVE) else [pytest.mark.slow]) for id in ESTIMATION]
"""Compiling one takes 5 to 50 s; `make test-slow` runs all of them."""


@pytest.mark.parametrize("id", NATIVE)
def test_every_environment_conforms(id):
    testing.check_id(id, **SHORT)


@pytest.mark.parametrize("id", [id for id in ESTIMATION if id not in (SHIP, DRIVE)])
def test_every_environment_conforms_on_the_interpreter(id):
    testing.check_id(id, **SHORT, backend="interpreter")


def test_a_random_start_conforms():
    testing.check_id(SHIP, **SHORT, imu="random", heading_deg=(0.0, 360.0), sea_state=(0.5, 1.5), initial_error=(1.0, 90.0))


def test_interpreter_and_native_are_bit_identical():
    envs = [gymnasium.make(SHIP, backend=backend, **SHORT) for backend in ("native", "interpreter")]
    testing.assert_same(*(testing.episodes(env, 3) for env in envs), "native and interpreter")


def test_the_kit_finds_an_environment_that_ignores_its_seed():
    class Deaf(gymnasium.Wrapper):
        def reset(self, *, seed=None, options=None):
            return self.env.reset(seed=None if seed is None else 1, options=options)

    with pytest.raises(AssertionError, match="the seed is not used"):
        testing.check_deterministic(lambda: Deaf(gymnasium.make(SHIP, **SHORT)))


def test_the_kit_finds_rows_that_share_a_stream():
    def skewed(num_envs, **kwargs):
        venv = gymnasium.make_vec(SHIP, num_envs, **SHORT, **kwargs)
        reset = venv.reset
        venv.reset = lambda *, seed=None, options=None: reset(seed=None if seed is None else [seed] * num_envs, options=options)
        return venv

    with pytest.raises(AssertionError, match="make_vec and SyncVectorEnv"):
        testing.check_rows(lambda: gymnasium.make(SHIP, **SHORT), skewed)


def test_observations_equal_the_sensor_outputs_of_a_run():
    env = gymnasium.make(DRIVE, samples_per_step=300, duration_s=20.0).unwrapped
    observation, _ = env.reset(seed=1, options={"run_seed": 12})
    plant = build(load("car-city-drive"), seed=12)
    from insenv.core.runner import make_runner

    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(3000))
    known = knowledge_of(env.named(observation))
    assert known.latitude == pytest.approx(plant.knowledge.latitude, abs=1e-15)
    assert known.heading == pytest.approx(plant.knowledge.heading, abs=1e-15)
    assert known.sensors == plant.knowledge.sensors
    fixes = 0
    for step in range(10):
        observation, _, _, _, info = env.step(env.action_space.sample() * 0 + np.eye(10)[0])
        seen, now = env.named(observation), slice(300 * step, 300 * (step + 1))
        assert np.array_equal(seen["imu"][:, 0:3], shown["delta_angle"][now])
        assert np.array_equal(seen["imu"][:, 3:6], shown["delta_velocity"][now])
        assert np.array_equal(info["q_nb"], shown["q_nb"][now][-1])
        delivered = np.flatnonzero(shown["gnss_valid"][now])
        assert seen["fix_new"] == bool(len(delivered))
        if len(delivered):
            fixes += 1
            at = 300 * step + delivered[-1]
            since = (300 * (step + 1) - 1 - at) * plant.sample_interval
            assert seen["fix_age"] == pytest.approx(since + shown["gnss_age"][at], abs=1e-9)
            assert seen["fix_delay"] == shown["gnss_age"][at]
            assert np.array_equal(seen["fix_velocity_n"], shown["gnss_velocity_n"][at])
            # a fix of the last 1.5 s lies near the vehicle
            assert np.linalg.norm(seen["fix_position"] - info["position"]) < 40.0
    assert fixes >= 8


def test_the_reward_follows_its_documentation():
    env = gymnasium.make(SHIP, samples_per_step=50, duration_s=10.0, time_weight=2.0).unwrapped
    observation, info = env.reset(seed=4)
    reported = attitude.numeric.from_euler(*env.named(observation)["known_attitude"])
    error = attitude.numeric.error_rotation_vector(reported, info["q_nb"])
    told = before = np.log(1.0 + np.sqrt(np.mean((error / info["limit"]) ** 2)))
    assert info["measure"] == pytest.approx(told, rel=1e-9)
    total, decisions = 0.0, 40
    for step in range(decisions):
        q_nb = attitude.numeric.multiply(attitude.numeric.from_rotation_vector(np.array([0.0, 0.0, 0.01])), info["q_nb"])
        _, reward, terminated, truncated, info = env.step(estimate_action(env.setup.task, q_nb))
        assert info["error"] == pytest.approx([0.0, 0.0, 0.01], abs=1e-12)
        measure = np.log(1.0 + np.sqrt(np.mean((info["error"] / info["limit"]) ** 2)))
        last = step == decisions - 1
        assert info["measure"] == pytest.approx(measure, rel=1e-9)
        assert reward == pytest.approx(before - measure - 2.0 / decisions, rel=1e-8)
        before = measure
        assert not terminated and truncated == last
        total += reward
    assert total == pytest.approx(told - measure - 2.0, rel=1e-8)


def test_stating_what_was_reported_returns_nothing():
    env = gymnasium.make(SHIP, samples_per_step=50, duration_s=10.0)
    observation, _ = env.reset(seed=4)
    reported = attitude.numeric.from_euler(*env.unwrapped.named(observation)["known_attitude"])
    _, reward, terminated, _, _ = env.step(estimate_action(env.unwrapped.setup.task, reported, declare=1.0))
    assert terminated and reward == pytest.approx(-1.0 / 40.0, abs=1e-9)


def test_no_constant_attitude_is_an_estimate():
    """Heading, sway phases and mounting differ between episodes, unless options keep the scenario's."""
    venv = gymnasium.make_vec(SHIP, 64, **SHORT)
    _, info = venv.reset(seed=1)
    roll, pitch, heading = attitude.numeric.to_euler(info["q_nb"])
    # half the width of the mounting draws, 11.5 deg RMS, with a sway of 7 and 3.5 deg RMS
    assert np.std(roll) > np.radians(10.0) and np.std(pitch) > np.radians(8.0) and np.std(heading) > 1.4
    as_told = {"heading_deg": None, "sway_phases": False, "mounting_deg": None}
    _, info = venv.reset(seed=1, options=as_told)
    assert np.ptp(attitude.numeric.to_euler(info["q_nb"]), axis=1) == pytest.approx(0.0, abs=1e-12)


def test_reported_headings_are_wrapped():
    """At a sigma of 360 deg a reported heading may be beyond a full turn, which no estimator takes."""
    venv = gymnasium.make_vec(SHIP, 64, **SHORT, initial_error=(30.0, 360.0))
    observation, info = venv.reset(seed=1)
    known = venv.unwrapped.named(observation)["known_attitude"]
    assert np.abs(known).max() <= 2.0 * np.pi and np.abs(known[:, 2]).max() > np.pi
    venv.step(agents.make("gyrocompass", venv).act(observation, info))


def test_declaring_ends_an_alignment_and_stops_the_cost_of_time():
    env = gymnasium.make(SHIP, samples_per_step=50, duration_s=10.0)
    _, info = env.reset(seed=4)
    told = info["measure"]
    action = estimate_action(env.unwrapped.setup.task, info["q_nb"], declare=1.0)
    _, reward, terminated, truncated, info = env.step(action)
    assert terminated and not truncated and info["declared"] == 1.0
    assert reward == pytest.approx(told - 1.0 / 40.0, abs=1e-6)  # a perfect estimate costs only the time of one step


@pytest.mark.parametrize("id", [SHIP, DRIVE])
@pytest.mark.parametrize("fault", [0.0, np.nan, np.inf, -np.inf])
def test_an_invalid_estimate_ends_the_episode_with_a_finite_reward(id, fault):
    for env in (gymnasium.make(id, **SHORT), gymnasium.make_vec(id, 3, **SHORT)):
        _, info = env.reset(seed=1)
        lowest = -21.0 + info["measure"] if id == SHIP else -20.0
        action = np.zeros(env.action_space.shape)
        action[..., -1] = fault
        action[..., 0] = 0.0 if fault == 0.0 else 1.0
        _, reward, terminated, truncated, info = env.step(action)
        assert reward == pytest.approx(lowest)
        assert np.all(terminated) and not np.any(truncated)
        assert np.all(info["diverged"] == 1.0) and np.isfinite(info["error"]).all()


@pytest.mark.parametrize("id", [SHIP, DRIVE])
def test_an_action_outside_the_space_is_clipped_and_a_quaternion_normalized(id):
    env, found = gymnasium.make(id, **SHORT), []
    for scale, beyond in ((1.0, 1.0), (7.0, 3.0), (1e200, 1e200)):
        env.reset(seed=1)
        action = np.full(env.action_space.shape, -beyond)
        action[:4] = scale * np.array([0.5, -0.25, 0.75, 0.125])
        *_, info = env.step(action)
        assert info["diverged"] == 0.0
        found.append(info["error"])
    assert found[1] == pytest.approx(found[0], rel=1e-12) and found[2] == pytest.approx(found[0], rel=1e-12)


def test_an_invalid_estimate_is_worse_than_any_valid_one():
    env = gymnasium.make(SHIP, **SHORT)
    returns = []
    for action in (np.zeros(5), np.array([0.0, 1.0, 0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0, 0.0, 1.0])):
        env.reset(seed=2)
        total, over = 0.0, False
        while not over:
            _, reward, terminated, truncated, _ = env.step(action)
            total, over = total + reward, terminated or truncated
        returns.append(total)
    assert returns[0] < min(returns[1:])


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(4), r"action of shape \(4,\): allowed is \(5,\)"),
        ("north", "action = 'north'"),
    ],
)
def test_a_wrong_action_is_an_error_and_changes_nothing(action, message):
    env, other = (gymnasium.make(SHIP, **SHORT) for _ in range(2))
    for e in (env, other):
        e.reset(seed=1)
    with pytest.raises(InputError, match=message):
        env.step(action)
    testing.assert_same([env.step(LEVEL)], [other.step(LEVEL)], "after a wrong action")


def test_a_nan_in_one_row_ends_that_row_alone():
    venv = gymnasium.make_vec(SHIP, 3, **SHORT)
    venv.reset(seed=1)
    actions = np.tile(LEVEL, (3, 1))
    actions[2, 1] = np.nan
    _, _, terminated, _, info = venv.step(actions)
    assert terminated.tolist() == [False, False, True] and info["diverged"].tolist() == [0.0, 0.0, 1.0]


def test_step_before_reset_and_after_the_end():
    env = gymnasium.make(SHIP, **SHORT).unwrapped
    with pytest.raises(ResetNeeded, match="before reset"):
        env.step(LEVEL)
    env.reset(seed=1)
    env.step(np.array([1.0, 0, 0, 0, 1.0]))
    with pytest.raises(ResetNeeded, match="after the end"):
        env.step(LEVEL)
    venv = gymnasium.make_vec(SHIP, 3, autoreset_mode=AutoresetMode.DISABLED, **SHORT)
    with pytest.raises(ResetNeeded, match="before reset"):
        venv.step(np.tile(LEVEL, (3, 1)))
    venv.reset(seed=1)
    actions = np.tile(LEVEL, (3, 1))
    actions[1, -1] = 1.0
    venv.step(actions)
    with pytest.raises(ResetNeeded, match=r"rows \[1\] have ended"):
        venv.step(actions)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"scenario": "car-parked"}, "kind 'car': this environment is for 'ship'"),
        ({"scenario": "ship-underway"}, "needs a vehicle in place"),
        ({"scenario": "nowhere"}, "nowhere"),
        ({"imu": "gold"}, "gold"),
        ({"samples_per_step": 0}, "samples_per_step = 0"),
        ({"duration_s": 1e-9}, "duration_s = 1e-09 s"),
        ({"heading_deg": (10.0, 5.0)}, "heading_deg"),
        ({"sea_state": (0.0, 99.0)}, "sea_state"),
        ({"initial_error": (0.0, 5.0)}, "initial_error"),
        ({"gnss_outages_s": ((1.0, 2.0),)}, r"no \[gnss\]"),
        ({"time_weight": -1.0}, "time_weight"),
        ({"backend": "quantum"}, "quantum"),
    ],
)
def test_arguments_that_are_not_allowed(kwargs, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make(SHIP, **{**SHORT, **kwargs})


def test_max_episode_steps_acts_like_the_wrapper():
    testing.check_rows(
        lambda: gymnasium.make(SHIP, max_episode_steps=4, **SHORT),
        lambda n, **more: gymnasium.make_vec(SHIP, n, max_episode_steps=4, **SHORT, **more),
    )
    with pytest.raises(InputError, match="max_episode_steps = 0"):
        AlignmentVectorEnv(2, max_episode_steps=0, **SHORT)


def test_an_unknown_render_mode_is_refused():
    with pytest.raises(InputError, match="hologram"):
        AlignmentEnv(render_mode="hologram", **SHORT)
    with pytest.raises(InputError, match="rgb_array"):
        AlignmentVectorEnv(2, render_mode="rgb_array", **SHORT)


def test_a_navigation_environment_without_gnss():
    with pytest.raises(InputError, match=r"needs GNSS fixes: the scenario has no \[gnss\]"):
        gymnasium.make("insenv/AircraftNavigation-v0", scenario="aircraft-free-inertial")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colour": 1}, "unknown option 'colour' .allowed: imu"),
        ({"run_seed": -1}, "run_seed"),
        ({"imu": "gold"}, "gold"),
        ({"sea_state": 11}, "sea"),
    ],
)
def test_options_that_are_not_allowed(options, message):
    for env in (gymnasium.make(SHIP, **SHORT), gymnasium.make_vec(SHIP, 2, **SHORT)):
        with pytest.raises(InputError, match=message):
            env.reset(seed=1, options=options)


def test_options_hold_for_one_episode():
    env = gymnasium.make(SHIP, **SHORT)
    plain, _ = env.reset(seed=1)
    turned, info = env.reset(seed=1, options={"heading_deg": 200.0, "imu": "tactical", "initial_error": (2.0, 45.0)})
    seen = env.unwrapped.named(turned)
    # the option replaces the mean heading of the scenario; sway adds up to 3 deg at time 0
    assert np.degrees(attitude.numeric.to_euler(info["q_nb"])[2]) % 360.0 == pytest.approx(200.0, abs=3.1)
    assert seen["known_heading_sigma"] == pytest.approx(np.radians(45.0))
    assert seen["known_gyro_bias_sigma"] > env.unwrapped.named(plain)["known_gyro_bias_sigma"]
    assert np.array_equal(env.reset(seed=1)[0], plain)


def test_random_grades_lie_between_the_two_of_the_range():
    env = gymnasium.make_vec(SHIP, 64, **SHORT, imu="random", imu_range=("marine", "tactical"), heading_deg=(0.0, 360.0))
    seen = env.unwrapped.named(env.reset(seed=3)[0])
    ends = [
        gymnasium.make_vec(SHIP, 1, **SHORT, imu=grade).reset(seed=0)[0] for grade in ("marine", "tactical")
    ]  # fmt: skip
    low, high = (env.unwrapped.named(end)["known_angle_random_walk"][0] for end in ends)
    drawn = seen["known_angle_random_walk"]
    assert np.all((drawn >= low * 0.999) & (drawn <= high * 1.001)) and len(np.unique(drawn)) == 64
    # half of the logarithmic draws lie below the geometric mean; 64 draws, 4 sigma
    assert abs(np.mean(drawn < np.sqrt(low * high)) - 0.5) < 4 * 0.5 / 8


def test_a_snapshot_of_another_environment_is_refused():
    ship, car = gymnasium.make(SHIP, **SHORT).unwrapped, gymnasium.make(DRIVE, **SHORT).unwrapped
    ship.reset(seed=1)
    with pytest.raises(InputError, match="snapshot"):
        car.restore(ship.snapshot())


def test_import_registers_and_registering_again_changes_nothing():
    from insenv.envs import register

    before = dict(gymnasium.envs.registration.registry)
    register()
    assert gymnasium.envs.registration.registry == before
    assert gymnasium.make("insenv:insenv/ShipAlignment-v0", **SHORT).spec.id == SHIP

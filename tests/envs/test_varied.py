"""Keys of the scenario that differ from episode to episode, in all interfaces, hidden or told."""

import gymnasium
import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.envs import testing
from insenv.scenario import load
from insenv.scenario.variation import variation_of
from insenv.studies.campaign import make_plan

SHIP, DRIVE, TUNING = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0", "insenv/Tuning-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
VARY = {
    "imu.grade": ["tactical", "industrial"],
    "imu.gyro_bias_deg_h": (0.3, 3.0),
    "gnss.interval_s": [1, 5],
    "gnss.position_noise_m.2": "lognormal(3, 0.5)",
    "vehicle.engine.0.frequency_hz": "loguniform(10, 40)",
}
UNIT = {"imu.gyro_bias_sigma_deg_h": "loguniform(0.5, 50)", "gnss.wander_sigma_m": (1.0, 9.0)}


def _plant_of(env, seed: int, vary) -> tuple:
    """The plant of a campaign in the run of a seed."""
    variations = [variation_of(key, value) for key, value in vary.items()]
    scenario = env.setup.scenario
    plan = make_plan(scenario, "loosely-coupled", 1, first_seed=seed, duration_s=1.0, variations=variations)
    return plan.plant_of(0)


SOME = {key: value for key, value in VARY.items() if "vehicle" not in key}


@pytest.mark.parametrize("vary", [pytest.param(VARY, marks=pytest.mark.slow), SOME])
def test_the_run_of_a_seed_has_the_values_of_a_campaign(vary):
    """To the bit, whether all of the plant is made anew or only the rows of the sections that vary."""
    env, seen = gymnasium.make(DRIVE, **SHORT, vary={"imu.gyro_bias_deg_h": (7.0, 8.0)}).unwrapped, set()
    for seed in range(4):
        env.reset(options={"run_seed": seed, "vary": vary})
        plant = _plant_of(env, seed, vary)
        table, drawn = plant.model.parameters, env.snapshot().parameters
        assert np.array_equal(drawn[: table.size], table.pack({**plant.parameters, "seed": seed}))
        seen.add((plant.parameters["gyro_bias_sigma"], float(np.max(plant.parameters["gnss_interval"]))))
    assert len(seen) > 1
    env.reset(options={"run_seed": 1})  # nothing is drawn that the options do not name
    assert not env.setup.task.model.parameters.unpack(env.snapshot().parameters)["gyro_bias"].any()


def test_ranges_that_are_set_hold_for_all_episodes_that_follow():
    """Over autoresets, in all interfaces, and in copies; varied keys too."""
    vary = {"imu.gyro_bias_deg_h": (0.0, 9.0), "vehicle.sway.roll.0.amplitude_deg": [2, 8]}

    def varied(env):
        env.unwrapped.set_ranges(initial_error=(3.0, 4.0), imu="random", imu_sheet="middle", vary=vary)
        return env

    testing.check_rows(
        lambda: varied(gymnasium.make(SHIP, **SHORT)), lambda n, **more: varied(gymnasium.make_vec(SHIP, n, **SHORT, **more))
    )
    testing.check_pickling(lambda: varied(gymnasium.make(SHIP, **SHORT)))
    env = varied(gymnasium.make(SHIP, **SHORT)).unwrapped
    for _ in range(2):
        assert env.named(env.reset()[0])["known_heading_sigma"] == pytest.approx(np.radians(4.0))
    starts = env.setup.starts
    drawn = starts.draw([np.random.default_rng(seed) for seed in range(256)])
    bias, roll = (drawn[:, starts._plant.parameters.slice(name)][:, 0] for name in ("gyro_bias", "roll_amplitude"))
    turn = np.degrees(bias) * 3600.0
    # 256 independent draws; the mean within 4 standard errors, 9 / sqrt(12 * 256)
    assert len(np.unique(turn)) == 256 and turn.min() >= 0.0 and turn.max() <= 9.0 and abs(turn.mean() - 4.5) < 0.65
    assert set(np.round(np.degrees(roll), 9)) == {2.0, 8.0} and abs(np.corrcoef(bias, roll)[0, 1]) < 0.25


@pytest.mark.parametrize("known", [False, True, ["gnss.wander_sigma_m"]])
def test_varied_keys_are_hidden_from_the_filter_or_told(known):
    untuned = load("car-city-drive").stated() | {"estimator": {}}
    env = gymnasium.make(TUNING, scenario=untuned, **SHORT, mistuning_decades=0.0).unwrapped
    told = {key for key in UNIT if known is True or (known and key in known)}
    for seed in (1, 2):
        env.reset(options={"run_seed": seed, "vary": UNIT, "known": known})
        parameters = env.setup.task.model.parameters.unpack(env.snapshot().parameters)
        assert parameters["gnss_wander_sigma"][0] == _plant_of(env, seed, UNIT).parameters["gnss_wander_sigma"][0]
        plant = _plant_of(env, seed, {key: UNIT[key] for key in told})
        wanted = plant.parameters_of(env.setup.starts._estimator, offline=False)
        for name in ("gyro_bias_sigma", "fix_wander_sigma"):
            assert parameters[f"estimator_{name}"] == pytest.approx(wanted[name], rel=1e-12), name


def test_what_is_reported_is_told():
    env = gymnasium.make(SHIP, **SHORT, initial_error=None, vary={"knowledge.heading_sigma_deg": (10.0, 90.0)}).unwrapped
    sigmas = {env.named(env.reset(seed=seed)[0])["known_heading_sigma"].item() for seed in range(3)}
    assert len(sigmas) == 3 and all(np.radians(10.0) <= sigma <= np.radians(90.0) for sigma in sigmas)


@pytest.mark.parametrize(("given", "message"), [
    ({"vary": [("imu.gyro_bias_deg_h", (0, 1))]}, "vary = .*: allowed is a mapping of distributions by key"),
    ({"vary": {"imu.gyro_bias_deg_h": (3, 1)}}, r"vary\['imu.gyro_bias_deg_h'\] = \(3, 1\): .*the lower first"),
    ({"vary": {"imu.gyro_bias_deg": (1, 3)}}, "vary imu.gyro_bias_deg=.*no key 'gyro_bias_deg'; .*gyro_bias_deg_h"),
    ({"vary": {"imu.gyro_arw_deg_sqrt_h": (-1, 3)}}, r"vary imu.gyro_arw_deg_sqrt_h=uniform\(-1, 3\): .* = -1"),
    ({"vary": {"gnss.interval_s": (1, 5)}}, "vary 'gnss.interval_s': allowed in an environment are the keys of start, vehicle"),
    ({"vary": {"seed": (1, 5)}}, "vary 'seed': "),
    ({"vary": {"start.heading_deg": (0, 5)}}, "vary 'start.heading_deg' and heading_deg = .*: allowed is one of them"),
    ({"vary": {"knowledge.tilt_sigma_deg": (1, 5)}}, "tilt_sigma_deg' and initial_error = .*: allowed is one of them"),
    ({"vary": {"imu.gyro_arw_deg_sqrt_h": (1, 5)}, "imu": "random"}, "gyro_arw_deg_sqrt_h' and imu = 'random'"),
    ({"vary": {"imu.gyro_bias_deg_h": (1, 3)}, "known": ["gyro"]}, "known: 'gyro' is not a key of vary"),
    ({"vary": {"imu.gyro_bias_deg_h": (1, 3)}, "known": "yes"}, "known = 'yes': allowed is True, False or a sequence"),
])  # fmt: skip
def test_a_wrong_variation_names_key_value_and_what_is_allowed(given, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make(SHIP, **SHORT, **given)


def test_a_draw_that_the_scenario_does_not_take_names_its_episode():
    """A time between the ends of a range that no whole number of samples fits."""
    assert load("car-city-drive").gnss.interval_s == 1.0
    env = gymnasium.make(DRIVE, **SHORT, vary={"gnss.interval_s": (1, 2)})
    with pytest.raises(InputError, match=r"interval_s=uniform\(1, 2\), in the episode of seed \d+: .*interval_s = 1\."):
        env.reset(seed=1)

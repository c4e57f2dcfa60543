"""Keys that vary from run to run: their distributions, and values that are refused."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan_of, slow_ship
from scipy import stats

import insenv
from insenv.campaigns import Distribution, parse_variation
from insenv.errors import InputError
from insenv.sensors import gnss_grade, imu_grade


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("normal(2, 0.5)", stats.norm(2.0, 0.5)),
        ("lognormal(2, 0.5)", stats.lognorm(0.5, scale=2.0)),
        ("uniform(-1, 3)", stats.uniform(-1.0, 4.0)),
        ("-1:3", stats.uniform(-1.0, 4.0)),
        ("loguniform(0.1, 10)", stats.loguniform(0.1, 10.0)),
    ],
)
def test_values_have_their_distribution(text, law):
    numbers = parse_variation(f"x={text}").distribution.numbers(parse_variation("x=0:1").uniforms(range(4000)))
    assert stats.kstest(numbers, law.cdf).pvalue > 1e-3
    assert np.allclose(law.cdf(numbers), parse_variation("x=0:1").uniforms(range(4000)), atol=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("imu.accel_bias_ug=gauss(0, 1)", "no such distribution"),
        ("imu.accel_bias_ug=normal(0)", "two finite numbers, MEAN, SIGMA"),
        ("imu.accel_bias_ug=normal(0, -1)", "sigma of 0 or more"),
        ("imu.accel_bias_ug=loguniform(0, 1)", "first number above 0"),
        ("imu.accel_bias_ug=uniform(2, 1)", "lower first"),
        ("imu.accel_bias_ug=normal(0, inf)", "two finite numbers"),
        ("imu.grade=choice(tactical)", "two or more different values"),
        ("imu.grade=choice(tactical, 3)", "of one kind"),
        ("imu.grade=choice(tactical, tactcal)", "did you mean 'tactical'"),
        ("imu.drop_probability=choice(a, b)", "is a name, which the value of this key is not"),
        ("imu.grade=0:1", "value is a number"),
        ("gnss.position_noise_m.3=0:1", "not an element of a list of 3"),
        ("knowledge.position_error_m.0=0:1", "the scenario gives no knowledge.position_error_m"),
        (
            "gnss.position_noise_m.0=normal(2, 1)",
            r"^vary .*m.0=normal\(2, 1\), the smallest of 64 values drawn: .*must be",
        ),
        ("gnss.interval_s.0=0:1", "a number has no key"),
    ],
)
def test_wrong_variations_are_refused(text, said):
    with pytest.raises(InputError, match=said):
        plan_of(text)


def test_a_value_that_is_refused_in_one_run_says_from_what_it_was_drawn():
    plan = plan_of("imu.gyro_bias_deg_h=-1:1")
    wrong = replace(plan, variations=(parse_variation("imu.gyro_arw_deg_sqrt_h=-2:-1"),))
    with pytest.raises(InputError, match=r"^vary imu.gyro_arw_deg_sqrt_h=uniform\(-2, -1\), in the run of seed 5: .* = -1"):
        wrong.plant_of(0)


def test_a_vector_and_its_element_cannot_both_be_varied():
    with pytest.raises(InputError, match="the whole or its elements"):
        plan_of("gnss.position_noise_m=1:2", "gnss.position_noise_m.0=1:2")


def test_an_element_of_a_vector_replaces_that_of_the_grade():
    plan = plan_of("gnss.position_noise_m.0=1:2", "imu.gyro_bias_deg_h.2=-1:1", "gnss.wander_sigma_m.2=0:1")
    grade = gnss_grade("spp")
    for run in range(3):
        rows = plan.plant_of(run).parameters
        values = dict(zip([v.key for v in plan.variations], plan.numbers([run])[0], strict=True))
        assert np.allclose(rows["gnss_position_noise"], [values["gnss.position_noise_m.0"], *grade.position_noise_m[1:]])
        assert np.allclose(rows["gnss_wander_sigma"], [*grade.wander_sigma_m[:2], values["gnss.wander_sigma_m.2"]])
        bias = np.radians(values["imu.gyro_bias_deg_h.2"]) / 3600.0
        assert np.allclose(rows["gyro_bias"], [0.0, 0.0, bias])


def test_grades_are_chosen_run_by_run_and_elements_follow_them():
    plan = plan_of("gnss.grade=choice(spp, rtk)", "imu.grade=choice(tactical, industrial)", "gnss.position_noise_m.2=7:8")
    drawn = plan.numbers(range(plan.runs))
    keys = [v.key for v in plan.variations]
    seen = set()
    for run in range(12):
        rows = plan.plant_of(run).parameters
        receiver = ("spp", "rtk")[int(drawn[run, keys.index("gnss.grade")])]
        unit = ("tactical", "industrial")[int(drawn[run, keys.index("imu.grade")])]
        seen.add((receiver, unit))
        assert np.allclose(rows["gnss_position_noise"][:2], gnss_grade(receiver).position_noise_m[:2])
        assert 7.0 <= rows["gnss_position_noise"][2] <= 8.0
        assert rows["gyro_bias_sigma"] == imu_grade(unit).parameters()["gyro_bias_sigma"]
    assert len(seen) == 4
    assert stats.binomtest(int(drawn[:, keys.index("gnss.grade")].sum()), plan.runs).pvalue > 1e-3


def test_extremes_that_a_distribution_draws_are_tried_before_the_campaign():
    """Of 4000 normal values of a probability near 0 some are negative: refused at once, by name."""
    with pytest.raises(InputError, match="drop_probability = -"):
        plan_of("imu.drop_probability=normal(0.003, 0.001)", runs=4000)


def test_a_distribution_is_what_python_takes_too():
    found = insenv.campaign(slow_ship(), "analytic", 4, duration_s=1.0,
                            vary={"start.latitude_deg": Distribution("normal", (30.0, 1.0))})  # fmt: skip
    assert abs(found.values.mean() - 30.0) < 3.0
    with pytest.raises(InputError, match=r"vary\['start.latitude_deg'\] = 3"):
        insenv.campaign(slow_ship(), "analytic", 4, vary={"start.latitude_deg": 3})

"""Keys that vary from run to run: their distributions, values that are refused, and the scenarios that they give."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import plan_of, same, slow_ship, small_plan
from scipy import stats

from insenv.base.errors import InputError
from insenv.sensors import gnss_grade, imu_grade
from insenv.studies.campaign import make_plan, parse_variation, run_campaign, threads
from insenv.studies.campaign import plan as plan_module
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.presentation import campaign_facts


@pytest.mark.parametrize(("text", "law"), [
    ("normal(2, 0.5)", stats.norm(2.0, 0.5)), ("lognormal(2, 0.5)", stats.lognorm(0.5, scale=2.0)),
    ("uniform(-1, 3)", stats.uniform(-1.0, 4.0)), ("-1:3", stats.uniform(-1.0, 4.0)),
    ("loguniform(0.1, 10)", stats.loguniform(0.1, 10.0)),
])  # fmt: skip
def test_values_have_their_distribution(text, law):
    uniforms = parse_variation("x=0:1").uniforms(range(4000))
    numbers = parse_variation(f"x={text}").distribution.numbers(uniforms)
    assert stats.kstest(numbers, law.cdf).pvalue > 1e-3 and np.allclose(law.cdf(numbers), uniforms, atol=1e-9)


@pytest.mark.parametrize(("text", "expected"), [
    ("normal(2, 0.5)", [(-3.5, "the smallest of 4 values drawn"), (8.25, "the largest of 4 values drawn")]),
    ("lognormal(2, 0.5)", [(-3.5, "the smallest of 4 values drawn"), (8.25, "the largest of 4 values drawn")]),
    ("-1:3", [(-1.0, ""), (3.0, "")]), ("loguniform(0.1, 10)", [(0.1, ""), (10.0, "")]),
    ("choice(spp, rtk, ppp)", [("spp", ""), ("rtk", ""), ("ppp", "")]),
])  # fmt: skip
def test_a_plan_is_checked_with_ends_choices_and_the_extremes_drawn(text, expected):
    assert parse_variation(f"x={text}").distribution.tried(np.array([1.0, 8.25, -3.5, 2.0])) == expected


def test_values_that_some_runs_refuse_are_named():
    plan = plan_of("imu.gyro_bias_deg_h=-1:1")
    wrong = replace(plan, variations=(parse_variation("imu.gyro_arw_deg_sqrt_h=-2:-1"),))
    with pytest.raises(InputError, match=r"^vary imu.gyro_arw_deg_sqrt_h=uniform\(-2, -1\), in the run of seed 5: .* = -1"):
        wrong.plant_of(0)


def test_elements_of_a_vector_and_grades_are_drawn_run_by_run():
    """An element replaces that of the grade, which is chosen run by run."""
    plan = plan_of("gnss.grade=choice(spp, rtk)", "imu.grade=choice(tactical, industrial)", "gnss.position_noise_m.2=7:8",
                   "imu.gyro_bias_deg_h.2=-1:1", "gnss.wander_sigma_m.2=0:1")  # fmt: skip
    keys, drawn = [v.key for v in plan.variations], plan.numbers(range(plan.runs))
    seen = set()
    for run in range(12):
        rows, values = plan.plant_of(run).parameters, dict(zip(keys, drawn[run], strict=True))
        receiver = ("spp", "rtk")[int(values["gnss.grade"])]
        unit = ("tactical", "industrial")[int(values["imu.grade"])]
        seen.add((receiver, unit))
        figures = {"wander_sigma_m": (0.0, 0.0, 0.0), **gnss_grade(receiver).figures}
        for key, row in (("position_noise_m", "gnss_position_noise"), ("wander_sigma_m", "gnss_wander_sigma")):
            assert np.allclose(rows[row], [*figures[key][:2], values[f"gnss.{key}.2"]])
        assert np.allclose(rows["gyro_bias"], [0.0, 0.0, np.radians(values["imu.gyro_bias_deg_h.2"]) / 3600.0])
        assert rows["gyro_bias_sigma"] == imu_grade(unit).parameters()["gyro_bias_sigma"]
        assert 7.0 <= rows["gnss_position_noise"][2] <= 8.0
    assert len(seen) == 4
    assert stats.binomtest(int(drawn[:, keys.index("gnss.grade")].sum()), plan.runs).pvalue > 1e-3


def test_varied_keys_are_drawn_from_seed_and_key_alone():
    first, second = parse_variation("imu.gyro_bias_deg_h=-1.0:3.0"), parse_variation("start.latitude_deg=10.0:50.0")
    drawn = np.array([first.value(seed) for seed in range(1000)])
    assert drawn.min() >= -1 and drawn.max() <= 3
    assert drawn.mean() == pytest.approx(1.0, abs=5 * 4 / np.sqrt(12 * 1000))
    assert abs(np.corrcoef(drawn, [second.value(seed) for seed in range(1000)])[0, 1]) < 5 / np.sqrt(1000)
    alone, both = small_plan(12, variations=[first]), small_plan(12, variations=[second, first])
    values = run_campaign(alone).values
    assert np.array_equal(values, both.numbers(range(12))[:, [v.key for v in both.variations].index(first.key)][:, None])
    assert values[:, 0].tolist() == [first.value(seed) for seed in range(3, 15)]


def test_a_varied_run_is_the_scenario_with_that_value():
    variation = parse_variation("vehicle.sway.roll.0.amplitude_deg=1.0:10.0")
    plan = small_plan(9, variations=[variation, parse_variation("imu.gyro_bias_deg_h=0.0:5.0")])
    data = json.loads(json.dumps(dict(plan.scenario)))
    data["imu"]["gyro_bias_deg_h"] = plan.variations[0].value(5)
    data["vehicle"]["sway"]["roll"][0]["amplitude_deg"] = variation.value(5)
    other = make_plan(type(slow_ship()).model_validate(data), "analytic", 1, first_seed=5, duration_s=2.0)
    assert np.array_equal(run_block(plan, 0)["error"][2], run_block(other, 0)["error"][0])


def test_a_parameter_of_an_estimator_can_be_varied():
    varied, fixed = (
        run_campaign(make_plan(slow_ship(), "q-method", 3, first_seed=3, duration_s=2.0, variations=variations))
        for variations in ([parse_variation("estimator.q-method.smoothing_time_s=0.01:0.3")], [])
    )
    assert (varied.final[:, 2] != fixed.final[:, 2]).all() and ((varied.values > 0.01) & (varied.values < 0.3)).all()


def test_the_parts_of_the_plant_must_stay_the_same(monkeypatch):
    models, original = iter([1, 2, 3, 4]), plan_module.build

    def changing(*arguments):
        plant = original(*arguments)
        return replace(plant, model=replace(plant.model, id=f"plant-{next(models)}"))

    monkeypatch.setattr(plan_module, "build", changing)
    with pytest.raises(InputError, match="parts of 'ship-swaying' change"):
        small_plan(8, variations=[parse_variation("start.latitude_deg=0:1")])


def test_a_latin_hypercube_hits_every_part_once():
    plan = plan_of("start.latitude_deg=0:50", "start.height_m=0:100", runs=50, design="latin")
    numbers = plan.numbers(range(50))
    for place, variation in enumerate(plan.variations):
        parts = np.floor(np.sort(numbers[:, place]) / variation.distribution.parameters[1] * 50)
        assert np.array_equal(parts, np.arange(50))
    assert np.array_equal(numbers[7:9], plan.numbers([7, 8])) and abs(np.corrcoef(numbers.T)[0, 1]) < 0.4


def test_a_sobol_sequence_is_more_even_than_chance():
    even, chance = (
        plan_of("start.latitude_deg=0:1", "start.height_m=0:1", runs=64, design=design).numbers(range(64))
        for design in ("sobol", "random")
    )
    assert stats.qmc.discrepancy(even) < 0.2 * stats.qmc.discrepancy(chance)


def test_the_results_of_a_design_do_not_depend_on_the_blocks(monkeypatch):
    monkeypatch.setattr("insenv.studies.campaign.summary.VARIED_RUNS", 1)
    plan = make_plan(slow_ship(), "analytic", 16, first_seed=3, duration_s=2.0, design="latin",
                     variations=[parse_variation("start.latitude_deg=0:60")])  # fmt: skip
    assert same(run_campaign(plan), run_campaign(replace(plan, block_samples=1), workers=threads(2)))


def test_the_seeds_of_a_saltelli_design_are_stated_as_they_are():
    plan = plan_of("start.latitude_deg=0:1", runs=12, design="saltelli")
    assert [plan.seed_of(run) for run in range(plan.runs)] == [5, 5, 6, 7, 7, 8, 9, 9, 10, 11, 11, 12]
    assert "seeds 5 to 12," in campaign_facts(SimpleNamespace(plan=plan))

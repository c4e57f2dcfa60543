"""Campaigns that answer: distributions, designs, intervals, sensitivities, paired differences, tables, interrupted blocks."""

import csv
import io
import json
import signal
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import same, slow_ship, small_plan
from command_line import call, strict
from rich.console import Console
from scipy import stats

import insenv
from insenv import attitude
from insenv.campaigns import Distribution, Folder, make_plan, parse_variation, pieces, run_campaign, running, threads
from insenv.campaigns import block as block_module
from insenv.campaigns.block import StoppedError, run_block
from insenv.campaigns.campaign_page import campaign_page_document
from insenv.campaigns.comparison import compare, comparison_tables, paired
from insenv.campaigns.comparison_page import comparison_page_document
from insenv.campaigns.intervals import horizontal, percentile, root_mean_square
from insenv.campaigns.presentation import campaign_facts, campaign_tables
from insenv.campaigns.sensitivity import sensitivities
from insenv.errors import InputError
from insenv.estimators import get
from insenv.scenario import load
from insenv.sensors import gnss_grade, imu_grade


@pytest.fixture(autouse=True)
def interpreted(monkeypatch):
    """These campaigns are short: compiling would take longer than running them."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")


def car(**more):
    """A car with a receiver, at 20 Hz."""
    data = json.loads(load("car-city-drive").model_dump_json())
    data["gnss"] |= {"epoch_offset_s": 0.0}
    data["vehicle"] |= {"engine": [], "legs": [{"wait_s": 60.0}]}
    return load(data | {"rate_hz": 20.0} | more)


def plan_of(*vary, runs=64, scenario=None, estimator="loosely-coupled", **more):
    variations = [parse_variation(text) for text in vary]
    scenario = car() if scenario is None else scenario
    return make_plan(scenario, estimator, runs, first_seed=5, duration_s=2.0, variations=variations, **more)


# --- distributions ------------------------------------------------------------------------------------


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


# --- designs ------------------------------------------------------------------------------------------


def test_a_latin_hypercube_hits_every_part_once():
    plan = plan_of("start.latitude_deg=0:50", "start.height_m=0:100", runs=50, design="latin")
    numbers = plan.numbers(range(50))
    for place, variation in enumerate(plan.variations):
        parts = np.floor(np.sort(numbers[:, place]) / variation.distribution.parameters[1] * 50)
        assert np.array_equal(parts, np.arange(50))
    assert np.array_equal(numbers[7:9], plan.numbers([7, 8]))
    assert abs(np.corrcoef(numbers.T)[0, 1]) < 0.4


def test_a_sobol_sequence_is_more_even_than_chance():
    even, chance = (
        plan_of("start.latitude_deg=0:1", "start.height_m=0:1", runs=64, design=design).numbers(range(64))
        for design in ("sobol", "random")
    )
    assert stats.qmc.discrepancy(even) < 0.2 * stats.qmc.discrepancy(chance)


def test_the_results_of_a_design_do_not_depend_on_the_blocks():
    plan = make_plan(slow_ship(), "analytic", 16, first_seed=3, duration_s=2.0, design="latin",
                     variations=[parse_variation("start.latitude_deg=0:60")])  # fmt: skip
    assert same(run_campaign(plan), run_campaign(replace(plan, block_samples=1), workers=threads(2)))


@pytest.mark.parametrize(
    ("design", "runs", "vary", "said"),
    [
        ("latn", 8, ("start.height_m=0:1",), "allowed is one of random, latin, sobol, saltelli"),
        ("latin", 8, (), "a design spreads varied keys"),
        (
            "saltelli",
            10,
            ("start.height_m=0:1",),
            "of 1 key has groups of 3 runs, and their number is a power of 2",
        ),
    ],
)
def test_designs_that_do_not_fit_are_refused(design, runs, vary, said):
    with pytest.raises(InputError, match=said):
        plan_of(*vary, runs=runs, design=design)


# --- sensitivity --------------------------------------------------------------------------------------


def of_function(design, runs, function):
    """Sensitivities of a function of two uniform keys."""
    plan = plan_of("start.latitude_deg=0:1", "start.height_m=0:1", runs=runs, design=design)
    values = plan.numbers(range(runs))
    keys = [v.key for v in plan.variations]
    x, y = (values[:, keys.index(key)] for key in ("start.latitude_deg", "start.height_m"))
    found = sensitivities(plan, ("heading_deg",), values, function(x, y)[:, None], np.full(runs, True))
    return {one.key: one for one in found}


@pytest.mark.parametrize("design", ["random", "latin", "sobol"])
def test_first_order_indices_are_the_shares_of_a_sum(design):
    """Of 3 x - y, x and y uniform, the variances are 9/12 and 1/12: 0.9 and 0.1."""
    found = of_function(design, 1024, lambda x, y: 3.0 * x - y)
    first, second = found["start.latitude_deg"], found["start.height_m"]
    assert first.first.value == pytest.approx(0.9, abs=0.05) and second.first.value == pytest.approx(0.1, abs=0.05)
    assert first.correlation > 0.9 and -0.45 < second.correlation < -0.2
    assert first.chance < 1e-6 and first.total is None


def test_total_indices_count_interactions():
    """Of (x - 1/2)(y - 1/2): neither key explains anything alone, both everything together."""
    found = of_function("saltelli", 4 * 512, lambda x, y: (x - 0.5) * (y - 0.5))
    for one in found.values():
        assert abs(one.first.value) < 0.1
        assert one.total.value == pytest.approx(1.0, abs=0.15)


def test_the_noise_of_the_runs_is_left_to_one():
    """Half of the variance by a key, half by the seed: runs A and their crossed ones share the noise, B has its own."""
    plan = plan_of("start.latitude_deg=0:1", runs=3 * 1024, design="saltelli")
    seeds = np.array([plan.seed_of(run) for run in range(plan.runs)])
    assert np.array_equal(seeds[:6], [5, 5, 6, 7, 7, 8])
    noise = np.random.default_rng(1).normal(0.0, 12.0**-0.5, int(seeds.max()) + 1)[seeds]
    values = plan.numbers(range(plan.runs))
    (found,) = sensitivities(plan, ("heading_deg",), values, values + noise[:, None], np.full(plan.runs, True))
    assert found.first.value == pytest.approx(0.5, abs=0.1) and found.total.value == pytest.approx(0.5, abs=0.1)


def test_the_seeds_of_a_saltelli_design_are_stated_as_they_are():
    plan = plan_of("start.latitude_deg=0:1", runs=12, design="saltelli")
    seeds = [plan.seed_of(run) for run in range(plan.runs)]
    assert seeds == [5, 5, 6, 7, 7, 8, 9, 9, 10, 11, 11, 12]
    assert "seeds 5 to 12," in campaign_facts(SimpleNamespace(plan=plan))


def test_a_campaign_says_which_key_matters(monkeypatch):
    """The heading of an analytic alignment depends on the gyro bias to the east, b / (Omega cos L), and not on the height."""
    monkeypatch.setattr("insenv.campaigns.limits.VARIED_RUNS", 1)
    data = json.loads(load("static-ecef").model_dump_json())
    data["start"] |= {"heading_deg": 0.0}
    vary = {"imu.gyro_bias_deg_h.1": (0.0, 2.0), "start.height_m": (0.0, 100.0)}
    found = insenv.campaign(load(data | {"rate_hz": 20.0}), "analytic", 64, seed=1, duration_s=10.0, vary=vary)
    own = {one.key: one for one in found.sensitivity if one.channel == "heading_deg"}
    assert own["imu.gyro_bias_deg_h.1"].correlation > 0.95 and own["imu.gyro_bias_deg_h.1"].first.value > 0.8
    assert abs(own["start.height_m"].correlation) < 0.4 and own["start.height_m"].first.value < 0.2
    first = own["start.height_m"].first
    told = printed(campaign_tables(found))
    assert f"{first.value:.2f} ±{first.reach:.2f}" in told and "(alone), ±: half" in told
    assert_shows(campaign_page_document(found), campaign_tables(found))
    document = found.as_json()
    assert document["design"] == "random" and len(document["sensitivity"]) == 6


def words(text):
    return [line.split() for line in text.splitlines()]


def printed(parts):
    console = Console(record=True, width=200, file=io.StringIO(), markup=False)
    for part in parts:
        console.print(part)
    return console.export_text()


def assert_shows(document, parts):
    """Every row of the page's tables is a line that is printed; so is every table's end."""
    told = words(printed(parts))
    rows = [row for one in document["tables"] for row in one["rows"]]
    assert rows and [row for row in rows if " ".join(row).split() not in told] == []
    below = [sentence for one in document["tables"] for sentence in one["below"] if not sentence.startswith("Statistics from")]
    assert [sentence for sentence in below if sentence.split() not in told] == []
    # the lines of numbers that are printed, less titles and the header: as many as on the page
    labels = {row[0].split()[0] for row in rows}
    assert len(rows) == len([line for line in told if line and line[0] in labels and "drawn" not in line])


# --- intervals ----------------------------------------------------------------------------------------


def test_intervals_cover_the_truth_as_often_as_they_say():
    """1000 ensembles of 64 Gaussian runs."""
    drawn = np.random.default_rng(3).normal(size=(1000, 64))
    true = {50.0: 0.0, 84.0: stats.norm.ppf(0.84)}
    for percent, value in true.items():
        inside = [e.low <= value <= e.high for e in (percentile(values, percent) for values in drawn)]
        assert 0.935 <= np.mean(inside) <= 0.99, percent
    inside = [e.low <= 1.0 <= e.high for e in (root_mean_square(values**2) for values in drawn)]
    assert 0.92 <= np.mean(inside) <= 0.98


def test_so_few_runs_give_no_end():
    found = percentile(np.arange(8.0), 97.5)
    assert np.isnan(found.high) and np.isfinite(found.low)
    assert np.isnan(percentile(np.zeros(0), 50.0).value) and np.isnan(root_mean_square(np.array([2.0])).low)


def test_cep_and_2drms_of_a_circular_gaussian():
    """sigma sqrt(2 ln 2) and 2 sqrt(2) sigma (Kaplan and Hegarty 2017, section 11.2)."""
    north, east = np.random.default_rng(4).normal(0.0, 3.0, (2, 4000))
    found = horizontal(north, east)
    for name, true in (("cep", 3.0 * 1.17741), ("r95", 3.0 * np.sqrt(-2.0 * np.log(0.05))), ("2drms", 6.0 * np.sqrt(2.0))):
        assert found[name].low <= true <= found[name].high, name
        assert found[name].high - found[name].low < 0.1 * true


def test_a_campaign_states_them():
    found = run_campaign(make_plan(car(), "loosely-coupled", 12, first_seed=1, duration_s=3.0))
    document = found.as_json()
    row, north = document["errors"]["north_m"], found.final[:, found.channels.index("north_m")]
    assert row["rms_95"][0] < row["rms"] < row["rms_95"][1]
    assert row["percentiles_95"]["50"] == [percentile(north, 50.0).low, percentile(north, 50.0).high]
    assert document["horizontal"]["cep"]["value"] == pytest.approx(np.median(np.hypot(*found.final[:, 3:5].T)))
    assert run_campaign(small_plan(8)).as_json()["horizontal"] is None


# --- paired differences -------------------------------------------------------------------------------


def test_paired_intervals_cover_a_known_difference():
    """b = 1.2 (a + small change): the ratio of the rms is known, and pairing makes the interval far narrower."""
    rng, truth, inside, alone = np.random.default_rng(5), 1.2 * np.sqrt(1.01), 0, 0
    for _ in range(600):
        a = rng.normal(size=48)
        b = 1.2 * (a + 0.1 * rng.normal(size=48))
        found = paired(a**2, b**2)
        inside += found.ratio.low <= truth <= found.ratio.high
        alone += paired(a**2, rng.permutation(b) ** 2).is_real
        assert found.is_real
    assert 0.92 <= inside / 600 <= 0.98
    assert alone / 600 < 0.5  # unpaired, the same runs would mostly not tell


def turned(angle_deg):
    """`wander-sins`, its heading turned by an angle."""
    base = get("wander-sins")
    half = np.radians(angle_deg) / 2.0

    def output(p, x):
        rows = dict(base.model.output(p, x))
        return rows | {"q_nb": attitude.multiply(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), rows["q_nb"])}

    return replace(base, model=replace(base.model, id="turned", output=output))


def test_two_estimators_with_a_known_difference():
    """The heading error of a perfect unit is that of its start, N(0, s^2); turned by d its rms is sqrt(s^2 + d^2)."""
    data = json.loads(car().model_dump_json())
    data |= {"imu": {"grade": "perfect"}, "gnss": None, "knowledge": {"heading_sigma_deg": 0.5, "tilt_sigma_deg": 1e-3}}
    found = insenv.campaign(load(data), ["wander-sins", turned(0.4)], 96, seed=1, duration_s=0.5)
    pair = found.pairs["turned"]["heading_deg"]
    assert pair.ratio.low <= np.hypot(0.5, 0.4) / 0.5 <= pair.ratio.high
    assert pair.difference.low <= np.hypot(0.5, 0.4) - 0.5 <= pair.difference.high
    assert pair.is_real and pair.runs == 96 and pair.smaller < 48
    assert not found.pairs["turned"]["north_m"].is_real
    assert found.first == "wander-sins" and "turned / wander-sins" in repr(found)
    document = comparison_page_document(found)
    assert_shows(document, comparison_tables(found))
    assert document["tables"][0]["caption"] == "turned compared with wander-sins, run by run"
    (panel,) = document["sections"][0]["panels"]
    assert {"name": "heading [deg]", "value": pair.ratio.value, "low": pair.ratio.low, "high": pair.ratio.high} in panel["rows"]
    # the same runs, to the bit, as of a campaign of one
    alone = insenv.campaign(load(data), "wander-sins", 96, seed=1, duration_s=0.5)
    assert same(alone, found.summaries["wander-sins"])


def test_a_run_that_diverged_for_one_is_left_out_of_the_pair():
    first, second = run_campaign(small_plan(12)), run_campaign(small_plan(12))
    second.whole[3] = False
    second.rms[3] = np.nan
    found = compare([first, replace(second, plan=replace(second.plan, estimator="other"))])
    pair = found.pairs["other"]["heading_deg"]
    assert pair.runs == 11 and pair.ratio.value == 1.0 and not pair.is_real


def test_a_comparison_over_different_times_says_so():
    """The rms of an alignment is that of the last quarter."""
    found = insenv.campaign(car(), ["wander-sins", "analytic"], 2, duration_s=8.0)
    note = "rms from 6 s on of analytic, over the whole runs of wander-sins: their ratio compares different times"
    assert found.notes == (note,) and found.as_json()["notes"] == [note]
    assert note in comparison_page_document(found)["notes"] and f"note: {note}" in printed(comparison_tables(found))


def test_the_command_compares(tmp_path):
    given = ("campaign", "ship-swaying", "-e", "q-method", "-e", "analytic", "-n", "4", "--duration", "1")
    status, out, err = call(*given, "--out", tmp_path / "out", "--table", "csv")
    assert (status, err) == (0, "") and "analytic compared with q-method, run by run" in out
    assert max(map(len, out.splitlines()[:-1])) <= 80
    names = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.*")}
    assert {"comparison.json", "q-method/campaign.json", "analytic/runs.csv", "analytic/blocks/000000.npz"} <= names
    assert {"comparison.html", "q-method/campaign.html"} <= names
    status, out, _ = call(*given, "--out", tmp_path / "out", "--resume", "--json", "--no-figure")
    document = strict(out)
    assert status == 0 and [one["estimator"] for one in document["campaigns"]] == ["q-method", "analytic"]
    assert set(document["paired"][0]["errors"]) == {"roll_deg", "pitch_deg", "heading_deg"}


def test_a_folder_with_a_comparison_takes_no_other_campaign(tmp_path):
    def command(scenario, *ids, **more):
        given = ("campaign", scenario, *(part for id in ids for part in ("-e", id)), "-n", "2", "--duration", "1")
        return call(*given, "--out", tmp_path / "out", "--no-figure", *more.get("more", ()))

    assert command("ship-swaying", "q-method", "analytic")[::2] == (0, "")
    before = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.*")}
    status, _, err = command("car-city-drive", "loosely-coupled")
    assert status == 2 and "holds the comparison of analytic, q-method: choose another folder for one estimator" in err
    status, _, err = command("car-city-drive", "loosely-coupled", "fusion")
    assert status == 2 and "holds another comparison: its campaign of analytic differs in scenario, name" in err
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.*")} == before
    added = command("ship-swaying", "q-method", "analytic", "wander-sins", more=("--resume",))
    assert added[::2] == (0, ""), added  # the same runs: one comparison
    alone = ("campaign", "ship-swaying", "-e", "analytic", "-n", "2", "--duration", "1", "--no-figure", "--out")
    assert call(*alone, tmp_path / "other" / "run-1")[0] == 0
    assert call(*alone, tmp_path / "other")[0] == 0  # a folder that only has campaigns in folders of its own


def test_settings_are_those_of_a_run_and_of_the_scenario(tmp_path):
    settings = {"loosely-coupled": {"arw_deg_sqrt_h": 15.0, "innovation_gate": 4.0}}
    given = {"seed": 5, "duration_s": 2.0}
    other = car(estimator={"loosely-coupled": {"arw_deg_sqrt_h": 2.0}})
    found = insenv.campaign(other, "loosely-coupled", 3, settings=settings, **given)
    assert same(found, insenv.campaign(car(estimator=settings), "loosely-coupled", 3, **given))
    assert not same(found, insenv.campaign(other, "loosely-coupled", 3, **given))
    alone = insenv.run(other, "loosely-coupled", seed=6, duration_s=2.0, settings=settings).results[0]
    assert found.final[1] == pytest.approx([alone.errors[name][-1] for name in found.channels], rel=1e-9)
    with pytest.raises(InputError, match="'q-metod' is not an estimator of this run"):
        insenv.campaign(car(), "loosely-coupled", 3, settings={"q-metod": {}})
    command = ("campaign", "car-city-drive", "-e", "loosely-coupled", "-n", "1", "--duration", "1", "--out", tmp_path / "out")
    assert call(*command, "--set", "loosely-coupled.innovation_gate=4", "--no-figure")[::2] == (0, "")
    status, _, err = call(*command, "--resume")
    assert status == 2 and "holds another campaign: it differs in" in err and "scenario" in err


def test_an_estimator_that_is_named_twice_runs_once_in_every_command(tmp_path):
    twice = ("ship-swaying", "-e", "q-method", "-e", "q-method", "--duration", "10")
    status, out, err = call("campaign", *twice, "-n", "4", "--out", tmp_path / "out")
    assert (status, err) == (0, "") and "compared with" not in out and (tmp_path / "out" / "campaign.json").is_file()
    status, out, err = call("run", *twice, "--json")
    assert (status, err) == (0, "") and [one["estimator"] for one in strict(out)["results"]] == ["q-method"]
    assert call("budget", *twice, "-n", "2")[::2] == (0, "")


# --- tables -------------------------------------------------------------------------------------------


def test_tables_hold_every_run_with_all_digits(tmp_path):
    vary = {"imu.grade": "choice(tactical, industrial)", "start.latitude_deg": (0.0, 50.0)}
    found = insenv.campaign(car(), "loosely-coupled", 6, seed=1, duration_s=2.0, vary=vary)
    frame = found.runs_to_dataframe()
    for kind in ("csv", "parquet"):
        found.save(tmp_path / kind, figure=False, table=kind)
    with (tmp_path / "csv" / "runs.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(tmp_path / "parquet" / "runs.parquet")
    assert [int(row["seed"]) for row in rows] == list(found.seeds) == table["seed"].to_pylist()
    assert {row["imu.grade"] for row in rows} <= {"tactical", "industrial"} and set(frame["imu.grade"]) <= {
        "tactical",
        "industrial",
    }
    heading = found.final[:, 2].tolist()
    assert [float(row["final_heading_deg"]) for row in rows] == heading == table["final_heading_deg"].to_pylist()
    assert list(frame["final_heading_deg"]) == heading and rows[0]["diverged"] == "false"
    with pytest.raises(InputError, match="allowed is csv or parquet"):
        found.save(tmp_path, figure=False, table="xls")


# --- interrupted blocks -------------------------------------------------------------------------------


@pytest.mark.parametrize("looks", [1, 3, 30])
def test_a_block_goes_on_from_where_it_was_stopped(monkeypatch, looks):
    monkeypatch.setattr(pieces, "PIECE_S", 1e-9)  # one sample a piece
    plan = small_plan(8)
    asked = []

    def stopped():
        asked.append(1)
        return len(asked) > 8 + looks

    with pytest.raises(StoppedError) as caught:
        run_block(plan, 0, stopped)
    part = caught.value.part
    assert part["samples"] > 0
    whole, continued = run_block(plan, 0), run_block(plan, 0, part=part)
    assert all(np.array_equal(whole[name], continued[name], equal_nan=True) for name in whole)


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="signals of POSIX")
def test_an_interrupted_block_is_kept_and_finished(tmp_path, monkeypatch):
    monkeypatch.setattr(pieces, "PIECE_S", 1e-9)
    plan = replace(small_plan(8), block_samples=1000)
    original, asked = block_module.run_block, []

    def interrupting(plan, number, stopped, part=None):
        def look():
            asked.append(1)
            if len(asked) == 20:
                signal.pthread_kill(threading.main_thread().ident, signal.SIGALRM)
            for _ in range(1000):  # until the main thread has seen it
                if len(asked) < 20 or stopped():
                    break
                time.sleep(0.01)
            return stopped()

        return original(plan, number, look, part)

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "run_block", interrupting)
    before = signal.signal(signal.SIGALRM, interrupted)
    try:
        with pytest.raises(KeyboardInterrupt, match="0 of 1 blocks are finished and kept, and 1 begun: --resume continues"):
            run_campaign(plan, store=Folder(tmp_path, plan), workers=threads(1))
    finally:
        signal.signal(signal.SIGALRM, before)
    assert [path.name for path in (tmp_path / "blocks").iterdir()] == ["000000.begun.npz"]
    done = len(asked)
    monkeypatch.setattr(running, "run_block", original)
    resumed = run_campaign(plan, store=Folder(tmp_path, plan, resume=True))
    assert [path.name for path in (tmp_path / "blocks").iterdir()] == ["000000.npz"]
    assert done >= 20 and same(resumed, run_campaign(plan))


def test_a_damaged_part_is_begun_again(tmp_path):
    plan = small_plan(8)
    store = Folder(tmp_path, plan)
    store.put_part(0, {"state": np.zeros((8, 3)), "samples": np.array(4.0), "outputs": np.zeros((8, 0, 1))})
    (tmp_path / "blocks" / "000000.begun.npz").write_bytes(b"nothing")
    assert store.part(0) is None
    assert same(run_campaign(plan, store=Folder(tmp_path, plan, resume=True)), run_campaign(plan))


def test_a_distribution_is_what_python_takes_too():
    found = insenv.campaign(slow_ship(), "analytic", 4, duration_s=1.0,
                            vary={"start.latitude_deg": Distribution("normal", (30.0, 1.0))})  # fmt: skip
    assert abs(found.values.mean() - 30.0) < 3.0
    with pytest.raises(InputError, match=r"vary\['start.latitude_deg'\] = 3"):
        insenv.campaign(slow_ship(), "analytic", 4, vary={"start.latitude_deg": 3})

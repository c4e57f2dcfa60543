"""Estimators on the same runs: paired differences, and the command that compares."""

import json
from dataclasses import replace

import numpy as np
import pytest
from campaigns import car, same, small_plan
from command_line import call, strict
from scipy.stats import ttest_1samp

import insenv
from insenv import attitude
from insenv.base.errors import InputError
from insenv.estimators import get
from insenv.scenario import load
from insenv.studies.campaign import run_campaign
from insenv.studies.campaign.comparison import compare, comparison_page, paired
from insenv.studies.campaign.statistics import jackknifed


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
    assert 0.93 <= inside / 600 <= 0.97
    drawn = rng.normal(size=(1500, 2, 8)) ** 2  # 8 runs of a constant error each
    mean = jackknifed(0.0, (drawn[0, 0].sum() - drawn[0, 0]) / 7.0)  # of a mean: Student's interval
    assert mean.high - mean.low == pytest.approx(np.ptp(ttest_1samp(drawn[0, 0], 0.0).confidence_interval()))
    inside = sum(found.ratio.low <= 2.0 <= found.ratio.high for found in (paired(a, 4.0 * b) for a, b in drawn))
    assert 0.92 <= inside / 1500 <= 0.96
    assert np.isnan(paired(np.array([0.0, 0.0, 1.0]), np.ones(3)).ratio.low)  # one run has all of the error
    assert alone / 600 < 0.5  # unpaired, the same runs would mostly not tell


def turned(angle_deg):
    """`wander-sins`, its heading turned by an angle."""
    base = get("wander-sins")
    half = np.radians(angle_deg) / 2.0

    def output(p, x):
        rows = dict(base.model.output(p, x))
        return rows | {"q_nb": attitude.multiply(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), rows["q_nb"])}

    return replace(base, model=replace(base.model, id="turned", output=output))


@pytest.mark.slow
def test_two_estimators_with_a_known_difference():
    """The heading error of a perfect unit is that of its start, N(0, s^2); turned by d its rms is sqrt(s^2 + d^2)."""
    data = json.loads(car().model_dump_json())
    data |= {"imu": {"grade": "perfect"}, "gnss": None, "knowledge": {"heading_sigma_deg": 0.5, "tilt_sigma_deg": 1e-3}}
    found = insenv.campaign(load(data), ["wander-sins", turned(0.4)], 96, seed=1, duration_s=0.5)
    pair = found.pairs["turned"]["heading_deg"]
    assert pair.ratio.low <= np.hypot(0.5, 0.4) / 0.5 <= pair.ratio.high
    assert pair.difference.low <= np.hypot(0.5, 0.4) - 0.5 <= pair.difference.high
    assert pair.is_real and pair.runs == 96 and pair.smaller < 48 and not found.pairs["turned"]["north_m"].is_real
    (panel,) = comparison_page(found).sections[0].panels
    assert ("heading [deg]", pair.ratio.value, pair.ratio.low, pair.ratio.high) in panel.rows
    # the same runs, to the bit, as of a campaign of one
    assert same(insenv.campaign(load(data), "wander-sins", 96, seed=1, duration_s=0.5), found.summaries["wander-sins"])


def test_a_run_that_diverged_for_one_is_left_out_of_the_pair():
    first, second = run_campaign(small_plan(12)), run_campaign(small_plan(12))
    second.whole[3], second.rms[3] = False, np.nan
    found = compare([first, replace(second, plan=replace(second.plan, estimator="other"))])
    pair = found.pairs["other"]["heading_deg"]
    assert pair.runs == 11 and pair.ratio.value == 1.0 and not pair.is_real


@pytest.mark.slow
def test_the_command_compares_and_its_folder_takes_no_other_campaign(tmp_path):
    def command(scenario, *ids, more=("--no-figure",)):
        given = ("campaign", scenario, *(part for id in ids for part in ("-e", id)), "-n", "2", "--duration", "1")
        return call(*given, "--out", tmp_path / "out", *more)

    status, out, err = command("ship-swaying", "q-method", "analytic", more=("--table", "csv"))
    assert (status, err) == (0, "") and "analytic compared with q-method, run by run" in out
    before = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.*")}
    names = {path.relative_to(tmp_path / "out").as_posix() for path in before}
    assert {"comparison.json", "comparison.html", "q-method/campaign.json", "analytic/blocks/000000.npz"} <= names
    status, _, err = command("car-city-drive", "loosely-coupled")
    assert status == 2 and "holds the comparison of analytic, q-method: choose another folder for one estimator" in err
    status, _, err = command("car-city-drive", "loosely-coupled", "fusion")
    assert status == 2 and "holds another comparison: its campaign of analytic differs in scenario, name" in err
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.*")} == before
    # the same runs: one comparison
    status, out, _ = command("ship-swaying", "q-method", "analytic", "wander-sins", more=("--resume", "--json", "--no-figure"))
    document = strict(out)
    assert status == 0 and [one["estimator"] for one in document["campaigns"]] == ["q-method", "analytic", "wander-sins"]
    assert set(document["paired"][0]["errors"]) == {"roll_deg", "pitch_deg", "heading_deg"}


def test_settings_are_those_of_a_run_and_of_the_scenario():
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


def test_an_estimator_that_is_named_twice_runs_once(tmp_path):
    twice = ("ship-swaying", "-e", "q-method", "-e", "q-method", "--duration", "1")
    status, out, err = call("campaign", *twice, "-n", "2", "--no-figure", "--out", tmp_path)
    assert (status, err) == (0, "insenv: note: -e q-method is given 2 times; it runs once\n")
    assert "compared with" not in out and (tmp_path / "campaign.json").is_file()

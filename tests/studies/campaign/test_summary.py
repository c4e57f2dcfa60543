"""The statistics of a campaign against NumPy: of the runs, and of drawn errors in place of the simulated ones."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import car, slow_ship, small_plan
from scipy.stats import chi2

from insenv import run
from insenv.base.remarks import Doubt
from insenv.estimators import get
from insenv.estimators.parts.finding import Finding
from insenv.scenario import load
from insenv.studies.campaign import Folder, make_plan, parse_variation, presentation, run_campaign, running
from insenv.studies.campaign import block as block_module
from insenv.studies.campaign import plan as plan_module
from insenv.studies.campaign.block import run_block


@pytest.fixture
def drawn(monkeypatch):
    """`run(plan)` gives the summary, and the arrays that stood in place of errors, squares, sigmas and NEES."""

    def run(plan):
        rng, kept, first = np.random.default_rng(2), [], block_module.run_block(plan, 0)

        def replaced(plan, number, stopped, part):
            arrays = {name: value.copy() for name, value in first.items()}
            arrays["seed"] = np.array([plan.first_seed + run for run in plan.blocks[number]], dtype=float)
            for name in ("error", "mean_square", "mean_variance", "nees"):
                if name in arrays:
                    size = rng.normal(size=arrays[name].shape)
                    arrays[name] = size if name == "error" else np.abs(size) + 0.1
            kept.append(arrays)
            return arrays

        monkeypatch.setattr(running, "run_block", replaced)
        found = run_campaign(plan)
        order = sorted(kept, key=lambda arrays: arrays["seed"][0])
        return found, {name: np.concatenate([arrays[name] for arrays in order]) for name in order[0]}

    return run


def test_navigation_over_the_runs(drawn):
    """The sum of NEES over the runs is chi-square distributed; the bounds of one run would hold whatever the filter does."""
    plan = make_plan(car(), "loosely-coupled", 24, first_seed=3, duration_s=4.0)
    found, arrays = drawn(replace(plan, block_samples=1))  # blocks of 8 runs
    assert found.from_s == 0.0 and len(found.seeds) == 24
    for place, name in enumerate(found.channels):
        course, error, square = found.courses[name], arrays["error"][:, :, place], arrays["mean_square"][:, :, place]
        assert np.allclose(course.mean, error.mean(axis=0)) and np.allclose(course.rms, np.sqrt(square.mean(axis=0)))
        assert np.allclose(course.percentiles, np.percentile(error, (2.5, 16.0, 50.0, 84.0, 97.5), axis=0))
        variance = arrays["mean_variance"][:, :, place]
        assert np.allclose(course.stated, np.sqrt(variance.mean(axis=0)))
        assert np.allclose(found.stated[:, place], np.sqrt(variance.mean(axis=1)))
        assert np.allclose(found.rms[:, place], np.sqrt(square.mean(axis=1)))
        assert found.figures()[name]["stated"] == pytest.approx(np.sqrt(variance.mean()))
    nees = found.nees
    assert nees.degrees == 9 and np.allclose(nees.mean, arrays["nees"].mean(axis=0))
    assert (nees.low, nees.high) == pytest.approx(tuple(chi2.ppf([0.025, 0.975], 9 * 24) / 24))
    means = np.random.default_rng(1).chisquare(9, (4000, 24)).mean(axis=1)
    assert np.mean((means > nees.low) & (means < nees.high)) == pytest.approx(0.95, abs=0.015)


def test_alignment_counts_the_last_quarter(drawn):
    found, arrays = drawn(small_plan(16))
    late = found.time >= 1.5 - 1e-9
    assert 0 < late.sum() < len(late)
    for place, (name, row) in enumerate(found.figures().items()):
        square = arrays["mean_square"][:, late, place]
        assert np.allclose(found.rms[:, place], np.sqrt(square.mean(axis=1)))
        assert row["rms"] == pytest.approx(np.sqrt(square.mean())), name
        assert row["percentiles"]["50"] == pytest.approx(np.median(arrays["error"][:, -1, place])), name


def test_a_record_holds_the_mean_square_since_the_one_before(monkeypatch):
    """The same runs recorded at every evaluation, and six times."""
    plan = make_plan(slow_ship(), "analytic", 3, first_seed=3, duration_s=3.0)
    each = run_block(plan, 0)
    monkeypatch.setattr(plan_module, "RECORDS", 6)
    assert plan.evaluation_samples == 1 and plan.evaluations == 10
    one, groups = run_block(plan, 0), each["error"].reshape(3, 6, 10, -1)
    assert np.allclose(one["mean_square"], np.mean(groups**2, axis=2), rtol=1e-9)
    assert np.array_equal(one["error"], groups[:, :, -1])


def test_diverged_runs_are_left_out_and_runs_far_from_the_median_listed(monkeypatch):
    """Ten times the median run, not ten times the worst: several runs may be far off."""
    plan, original = small_plan(24), block_module.run_block
    expected = run_campaign(plan)

    def spoilt(plan, number, stopped, part):
        arrays = {name: value.copy() for name, value in original(plan, number).items()}
        arrays["mean_square"] = np.ones_like(arrays["mean_square"])
        if number == 1:
            arrays["error"][2, 30:, 1] = np.nan
            arrays["mean_square"][4, 35:, 0] = np.inf
            for run, factor in ((1, 9.0), (3, 11.0), (5, 300.0)):
                arrays["mean_square"][run, :, 1] *= factor**2
        return arrays

    monkeypatch.setattr(running, "run_block", spoilt)
    found = run_campaign(plan)
    assert found.diverged == (3 + 8 + 2, 3 + 8 + 4) and found.far == (3 + 8 + 3, 3 + 8 + 5)
    kept = ~np.isin(found.seeds, found.diverged)
    assert kept.sum() == 22
    pitch, whole = found.courses["pitch_deg"], expected.courses["pitch_deg"]
    assert np.allclose(pitch.mean[:30], whole.mean[:30], rtol=1e-12)
    assert pitch.mean[-1] == pytest.approx(expected.final[kept, 1].mean())
    assert np.isfinite([row["rms"] for row in found.figures().values()]).all()
    assert found.as_json()["diverged"] == [13, 15]


def check_runs(found, scenario_of):
    """What is said of the runs, and their health, are those of `insenv.run`, without what needs outputs between records."""
    plan = found.plan
    for number, (seed, said) in enumerate(zip(found.seeds, found.said, strict=True)):
        (alone,) = run(scenario_of(number), plan.estimator, seed=int(seed), duration_s=plan.duration_s).results
        assert [one.remark for one in said] == [note for note in alone.notes if note.code != "heading-found"]
        if alone.health is not None:
            ours = found.health[number]
            assert (ours.verdict, ours.fixes) == (alone.health.verdict, alone.health.fixes)
            assert ours.nis.mean == pytest.approx(alone.health.nis.mean, rel=1e-9)


def test_what_runs_say_of_their_end_is_counted(tmp_path):
    """By the findings of `insenv.run`: 6 s at sea show the heading in some runs, not in all."""
    scenario = load("ship-at-sea").model_copy(update={"rate_hz": 10.0})
    plan = make_plan(scenario, "velocity-integration", 4, first_seed=3, duration_s=6.0)
    found = run_campaign(plan, store=Folder(tmp_path, plan))
    check_runs(found, lambda number: scenario)
    unknown = [int(seed) for seed, said in zip(found.seeds, found.said, strict=True) if said]
    assert 0 < len(unknown) < 4
    seeds = ", ".join(map(str, unknown))
    said = f"in {len(unknown)} of 4 runs (seed {seeds}): the heading is unknown at the end: turns"
    assert said in " ".join(found.notes) and said in " ".join(presentation.campaign_page(found).notes)
    (share,) = found.as_json()["of_runs"]
    assert (share["code"], share["share"], share["seeds"]) == ("heading-unknown", len(unknown) / 4, unknown)
    assert presentation.run_columns(found)["remarks"].tolist() == [
        "heading-unknown" if seed in unknown else "" for seed in range(3, 7)
    ]


SURE = {"estimator": {"loosely-coupled": {"accel_bias_sigma_ug": 0.01, "vrw_ug_sqrt_hz": 0.1}}}
OUTLIERS = (
    {},
    "gnss.outlier_probability=choice(0, 0.9)",
    "fixes-diverged motion-errors-as-noise too-sure",
    "(seed 6, 9), the largest with seed 9",
)
GRADES = (SURE, "imu.grade=choice(navigation, consumer)", "aid-misfit motion-errors-as-noise too-sure", "in 1 of 4")


@pytest.mark.parametrize(("estimator", "case"), [("loosely-coupled", GRADES), ("fusion", OUTLIERS)])
def test_what_runs_say_of_measurements_errors_and_parameters_is_counted(estimator, case):
    """What holds of the parameters holds of some of the varied values alone."""
    more, varied, codes, said = case
    variations, scenario = [parse_variation(varied)], car(duration_s=30.0, **more)
    plan = make_plan(scenario, estimator, 4, first_seed=6, duration_s=30.0, variations=variations)
    found = run_campaign(plan)
    check_runs(found, plan.values_of)
    assert " ".join(sorted(share["code"] for share in found.as_json()["of_runs"])) == codes and said in " ".join(found.notes)
    shares = found.as_json()["health"]
    assert shares["nis"] == pytest.approx(np.mean([one.nis.mean for one in found.health]))
    assert presentation.campaign_arrays(found)["runs/health/nis"].tolist() == [one.nis.mean for one in found.health]
    assert shares["diverged"] == np.mean([one.verdict == "diverged" for one in found.health])
    assert run_campaign(small_plan(2)).verdicts() is None


def test_a_run_that_is_doubted_is_not_called_consistent():
    doubt = Finding("position_sigma", Doubt("doubted", "a sigma is {ratio} nm"), 1e-9)
    doubting = replace(get("loosely-coupled"), findings=lambda parameters: (doubt,))
    found = run_campaign(make_plan(car(), doubting, 2, first_seed=6, duration_s=4.0))
    assert found.verdicts()["contradicted"] == 1.0 and found.verdicts()["consistent"] == 0.0
    assert any("100 % contradicted" in line for line in presentation.consistency_lines(found))


def test_runs_that_are_too_short_are_noted_and_fixes_are_not_missed_without_a_receiver():
    found = run_campaign(make_plan(slow_ship(), "q-method", 2, first_seed=3, duration_s=2.0))
    assert any(note.startswith("too short: 2 s of data, q-method needs 120 s") for note in found.as_json()["notes"])
    assert all(values[3] is None and values[2] is not None for _, values in presentation.campaign_rows(found))
    aided = run_campaign(make_plan(car(gnss=None, odometer={}), "fusion", 1, first_seed=3, duration_s=2.0))
    assert aided.verdicts() and not any("fix" in share.worst.remark.code for share in aided.shares)

"""A heading that is not known, and a field that shows it late: what measures motion waits."""

import numpy as np
import pytest
from changed_scenario import changed

import insenv
from insenv.estimators.fusion import awaited


def hover(heading_sigma_deg=180.0, tilt_sigma_deg=1.0, **magnetometer):
    return changed(
        "multirotor-hover",
        magnetometer=magnetometer,
        knowledge={"heading_sigma_deg": heading_sigma_deg, "tilt_sigma_deg": tilt_sigma_deg},
    )


@pytest.mark.parametrize(("magnetometer", "tilt_sigma_deg"), [
    ({"interval_s": 0.5}, 1.0), ({"interval_s": 2.0}, 5.0), ({"outages_s": [[0.0, 9.0]]}, 1.0),
])  # fmt: skip
def test_a_field_that_comes_after_the_first_fix_shows_a_heading_of_which_nothing_was_known(magnetometer, tilt_sigma_deg):
    """NEES of 9 states, 12 runs: hundreds to thousands where the fixes before it count."""
    summary = insenv.campaign(hover(tilt_sigma_deg=tilt_sigma_deg, **magnetometer), "fusion", 12, seed=961000, duration_s=30.0)
    late, heading = summary.time > 12.0, summary.courses["heading_deg"]
    assert 5.0 < np.mean(summary.nees.mean[late]) < 13.0
    assert np.sqrt(np.mean(heading.rms[late] ** 2) / np.mean(heading.stated[late] ** 2)) < 1.5
    assert [each.verdict for each in summary.health] == ["consistent"] * 12


def test_fixes_wait_for_the_first_field_and_no_longer():
    (result,) = insenv.run(hover(outages_s=[[0.0, 5.0]]), "fusion", seed=1, duration_s=8.0).results
    assert result.outputs["heading_awaited_time"][-1] == pytest.approx(5.05, abs=0.051)
    before = result.time < 5.0
    assert not result.outputs["fix_count"][before].any() and not result.outputs["barometer_count"][before].any()
    assert result.outputs["fix_count"][-1] > 10 and result.health.verdict == "consistent"
    assert any(note.startswith("the measurements of 5 s were not used") for note in result.notes)
    (known,) = insenv.run(hover(10.0, outages_s=[[0.0, 5.0]]), "fusion", seed=1, duration_s=3.0).results
    assert known.outputs["heading_awaited_time"][-1] == 0 and known.outputs["fix_count"][-1] > 5
    assert "heading-awaited" not in [note.code for note in known.notes]


def test_a_field_that_does_not_come_is_a_doubt():
    scenario = hover(outages_s=[[0.0, 100.0]])
    (result,) = insenv.run(scenario, "fusion", seed=1, duration_s=awaited.LONGEST + 5.0).results
    assert result.outputs["heading_awaited_time"][-1] == pytest.approx(awaited.LONGEST, abs=0.01)
    assert result.outputs["fix_count"][-1] > 10
    assert "field-not-come" in [note.code for note in result.notes] and result.health.verdict != "consistent"


@pytest.mark.parametrize("seed", [961101, 961102])
def test_a_smoother_begins_where_the_heading_was_found(seed):
    (result,) = insenv.run(hover(tilt_sigma_deg=3.0), "fusion-smoother", seed=seed, duration_s=30.0).results
    shown = result.time > 0.1
    for name in ("roll_deg", "pitch_deg", "heading_deg"):
        assert np.abs(result.errors[name] / result.sigma[name])[shown].max() < 4.5, name


@pytest.mark.parametrize("zero", ["soft_iron_sigma_percent", "coupling_sigma_percent"])
def test_iron_may_be_hard_alone(zero):
    (result,) = insenv.run(hover(10.0, **{zero: 0.0}), "fusion", seed=1, duration_s=2.0).results
    assert "hard_iron" in result.outputs and np.isfinite(result.errors["heading_deg"]).all()


def test_a_perfect_magnetometer_leaves_the_filter_honest():
    summary = insenv.campaign(hover(10.0, grade="perfect"), "fusion", 8, seed=961200, duration_s=20.0)
    assert np.mean(summary.nees.mean) < 14.0

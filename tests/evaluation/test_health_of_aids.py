"""Health of a filter by each of its aids: what is counted, and simulated drives whose instruments are wrong."""

import json

import numpy as np
import pytest
from command_line import call
from rich.console import Console
from written_logs import written_log

import insenv
from insenv import estimators
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation.health import Health, health
from insenv.evaluation.nis import Nis
from insenv.report.tables import comparison


def sums(id, ratios, refused=None):
    """The outputs of an aid with one component at a record per measurement, from test ratios and which are refused."""
    refused = np.zeros(len(ratios), bool) if refused is None else refused
    values = (
        np.ones(len(ratios)),
        refused,
        np.where(refused, 0.0, ratios**2),
        ~refused,
        np.where(refused, ratios**2, 0.0),
        refused,
    )
    shaped = [np.cumsum(value.astype(float)) for value in values]
    return dict(zip(aid_health(id), [*shaped[:2], *(one[:, None] for one in shaped[2:])], strict=True))


def test_the_worst_aid_gives_the_verdict():
    rng = np.random.default_rng(1)
    good, wide = sums("barometer", rng.normal(size=2000)), sums("odometer", 1.5 * rng.normal(size=2000))
    gone = sums("dvl", np.full(2000, 20.0), np.arange(2000) % 11 > 0)
    assert reported_aids([*good, *wide, *gone, "fix_refused_count"]) == ("barometer", "odometer", "dvl")
    assert health(good).verdict == "consistent" and health(good).factor == 1.0 and health(good).notes() == ()
    found = health({**good, **wide})
    assert found.verdict == "overconfident" and found.factor == pytest.approx(1.5, rel=0.05) and found.apart == ()
    found = health({**good, **wide, **gone})
    assert found.verdict == "diverged" and found.factor == pytest.approx(20.0) and found.apart == ("dvl",)
    of_dvl, of_odometer = found.notes(causes={"dvl": "the water"})
    assert of_dvl.startswith(
        "dvl does not fit the filter (diverged): its innovations are 20 times as large as stated, and 1818 "
    )
    assert of_dvl.endswith("Look at the water") and of_odometer.startswith("odometer does not fit the filter (overconfident)")
    assert found.fixes == 0 and np.isnan(found.nis.mean) and len(found.lines) == 4 and found.lines[0] == "diverged, factor 20"


def test_an_aid_that_measured_nothing_is_not_judged():
    empty = {name: np.zeros(5) if name.endswith("d_count") else np.zeros((5, 1)) for name in aid_health("dvl")}
    assert health({**empty, "dvl_count": np.zeros(5)}) is None


@pytest.mark.parametrize(
    ("verdict", "nis", "text"),
    [
        ("consistent", Nis(1.0, 0.9, 1.1), "consistent: 5 % of 20 fixes refused, NIS 1 (0.9 to 1.1)"),
        ("consistent", Nis(1.15, 0.9, 1.1), "consistent within 10 % of sigma: 5 % of 20 fixes refused, NIS 1.15 (0.9 to 1.1)"),
        ("overconfident", Nis(1.5, 0.9, 1.1), "overconfident, factor 1: 5 % of 20 fixes refused, NIS 1.5 (0.9 to 1.1)"),
        ("overconfident", Nis(0.5, 0.9, 1.1), "overconfident, factor 1: 5 % of 20 fixes refused, NIS 0.5 (0.9 to 1.1)"),
        (
            "consistent",
            Nis(0.5, 0.9, 1.1),
            "consistent, innovations smaller than stated: 5 % of 20 fixes refused, NIS 0.5 (0.9 to 1.1)",
        ),
        ("diverged", Nis(*3 * (float("nan"),)), "diverged, factor 1: 5 % of 20 fixes refused, none used"),
        ("untested", Nis(*3 * (float("nan"),)), "untested: none of 20 fixes was compared with an estimate"),
    ],
)
def test_the_verdict_of_a_filter_outside_the_bounds_says_so_itself(verdict, nis, text):
    found = Health(20, 1, nis, {}, verdict, 1.0, fix_verdict=verdict)
    assert found.summary == text


def test_the_outputs_of_fusion_are_rows_of_health():
    e = insenv.fusion(aids=["gnss", "odometer", "barometer"])
    assert e.health_rows.names[: len(FIX_HEALTH.names)] == FIX_HEALTH.names
    assert reported_aids(e.health_rows.names) == ("odometer", "barometer") and set(e.causes) == {"odometer", "barometer"}
    assert reported_aids(estimators.get("loosely-coupled").health_rows.names) == ("zero_velocity",)
    assert estimators.get("aqe-ekf").health_rows.names == FIX_HEALTH.names
    assert not insenv.fusion(aids=["odometer"]).reports_fixes and insenv.fusion(aids=["odometer"]).reports_health


@pytest.mark.slow
def test_a_log_with_right_instruments_is_consistent(tmp_path):
    (found,) = insenv.replay(written_log(tmp_path, odometer=1.0, barometer=0.0), "fusion").results
    assert found.health.verdict == "consistent" and set(found.health.aids) == {"odometer", "barometer", "zero_velocity"}
    assert found.notes == ()


@pytest.mark.slow
def test_a_wrong_odometer_of_a_log_is_named(tmp_path):
    """Its speeds are 30 % too large, 30 times what its grade says."""
    (found,) = insenv.replay(written_log(tmp_path, odometer=1.3, barometer=0.0), "fusion").results
    assert found.health.verdict == "overconfident" and found.health.fix_verdict == "consistent"
    assert found.health.aids["odometer"].factor > 1.5 and found.health.aids["odometer"].refused > 0
    of_scale, of_aid = found.notes
    assert of_scale.startswith("the estimate of odometer_scale is 30") and "odometer_scale_factor_sigma" in of_scale
    assert of_aid.startswith("odometer does not fit the filter (overconfident)") and "scale factor" in of_aid


def test_a_wrong_barometer_of_a_log_is_named(tmp_path):
    """Its heights are 300 m too large.  Its gate opens, and the estimated bias then explains every further height."""
    (found,) = insenv.replay(written_log(tmp_path, odometer=1.0, barometer=300.0), "fusion").results
    assert found.health.aids["barometer"].refused == 10
    assert found.notes[0].startswith("the estimate of barometer_bias is 4") and "barometer_bias_sigma" in found.notes[0]


def test_strict_names_the_aid(tmp_path):
    path = written_log(tmp_path, odometer=1.0, barometer=0.0)
    told = ("--set", "fusion.odometer_noise_mps=0.002")
    status, text, said = call("replay", str(path), "-e", "fusion", "--json", "--strict", *told)
    found = json.loads(text)["results"][0]["health"]
    assert status == 1 and found["aids"]["odometer"]["verdict"] == found["verdict"] == "diverged"
    assert said == "insenv: --strict: diverged: fusion from its fixes and odometer\n"


@pytest.mark.slow
def test_the_table_has_a_line_for_each_aid_and_a_campaign_the_shares():
    report = insenv.run("car-odometer", "fusion", duration_s=30)
    console = Console(record=True, width=200)
    with console.capture() as capture:
        console.print(*comparison(report))
    text = capture.get()
    assert "health: consistent" in text and "  odometer: consistent: 0 % of 300 measurements refused, NIS" in text
    document = insenv.campaign("car-odometer", "fusion", runs=2, duration_s=30).as_json()["health"]
    assert document["aids"]["odometer"]["consistent"] == 1.0 and document["aids"]["odometer"]["runs"] == 2


def test_a_filter_without_gnss_has_health():
    e = insenv.fusion(aids=["odometer", "zero_velocity"], id="wheels")
    found = insenv.run("car-odometer", e, duration_s=30).results[0]
    assert found.health.fixes == 0 and set(found.health.aids) == {"odometer", "zero_velocity"}
    assert not any("no fix came" in note for note in found.notes)

"""Health of filters with fixes and other aids: bounds on made-up ratios, and drives that are described truly and falsely."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import call
from scipy.signal import lfilter
from scipy.stats import chi2
from simulated_log import simulated_log
from written_logs import written_log

import insenv
from insenv import estimators, run
from insenv.base.errors import InputError
from insenv.core.tables import Table
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation.health import BLOCKS, counted_less, course, health
from insenv.runs.ensemble import ensemble

GNSS = {"file": "none", "time": 0, "latitude": 1, "longitude": 2, "height": 3, "position_unit": "rad", "wander_sigma_m": 1.5}


def of_fixes(ratios, refused=None, velocity=True):
    """Rows of `FIX_HEALTH` at a record per fix, from test ratios (fixes, 6) and what of them was refused (bool)."""
    refused = np.zeros(ratios.shape, bool) if refused is None else refused
    there = np.ones(ratios.shape, bool)
    there[:, 3:] = velocity

    def grouped(values):
        return np.cumsum(values.reshape(-1, 2, 3).sum(axis=2), axis=0)

    return {
        "fix_count": np.arange(1.0, len(ratios) + 1),
        "fix_refused_count": np.cumsum((refused & there).any(axis=1)).astype(float),
        "nis_used": grouped(np.where(there & ~refused, ratios**2, 0.0)),
        "nis_used_count": grouped((there & ~refused).astype(float)),
        "nis_refused": grouped(np.where(there & refused, ratios**2, 0.0)),
        "nis_refused_count": grouped((there & refused).astype(float)),
    }


def of_aid(id, ratios, refused=None):
    refused = np.zeros(len(ratios), bool) if refused is None else refused
    square, one = ratios**2, np.ones(len(ratios))
    values = one, refused, np.where(refused, 0.0, square), ~refused, np.where(refused, square, 0.0), refused
    shaped = [np.cumsum(value.astype(float)) for value in values]
    return dict(zip(aid_health(id), [*shaped[:2], *(each[:, None] for each in shaped[2:])], strict=True))


@pytest.mark.parametrize(("rho", "least"), [(0.0, 0.93), (0.9, 0.90)])
def test_the_bounds_hold_the_mean_as_often_as_they_say(rho, least):
    """Over 400 series of 600 fixes: 95 %, less for slow errors, whose correlation the blocks see only in part."""
    drawn = np.random.default_rng(5).normal(size=(400, 600, 6)) * np.sqrt(1 - rho**2)
    drawn[:, 0] /= np.sqrt(1 - rho**2)
    found = [health(of_fixes(ratios)).nis for ratios in lfilter([1.0], [1.0, -rho], drawn, axis=1)]
    assert np.mean([nis.low < nis.mean < nis.high for nis in found]) >= least
    # with rho 0.9 the variance of the mean is 9.5 times as large: bounds of independent innovations hold it 47 % of the time
    white = np.mean([abs(nis.mean - 1) < 1.96 * np.sqrt(2 / 3600) for nis in found])
    assert white < 0.55 or rho < 0.9
    # of independent ones they are as wide as for 3600 degrees of freedom, and by a scatter of blocks above that of chance more
    width = np.mean([nis.high - nis.low for nis in found]) / (2 * 1.96 * np.sqrt(2 / 3600))
    assert 1.0 <= width < 1.1 or rho > 0.0


def test_the_bounds_are_those_of_chi_square_with_the_freedom_that_the_blocks_leave():
    """Errors whose size changes from block to block: a sum of n independent squares of mean m has the variance 2 m^2 n."""
    ratios = np.random.default_rng(11).normal(size=(2000, 6)) * (1 + 0.3 * np.sin(np.arange(2000) / 300))[:, None]
    squares = ratios**2
    sums, mean = squares.reshape(BLOCKS, -1).sum(axis=1), squares.mean()
    excess = sums.var(ddof=1) / (2 * mean**2 * ratios.size / BLOCKS)
    degrees = ratios.size / excess
    assert excess > 5
    found = health(of_fixes(ratios)).nis
    expected = [mean, *(chi2.ppf([0.025, 0.975], degrees) / degrees)]
    assert [found.mean, found.low, found.high] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("fixes", "verdict"), [(2, "consistent"), (7, "consistent"), (8, "overconfident")])
def test_few_measurements_call_no_filter_overconfident(fixes, verdict):
    assert health(of_fixes(np.full((fixes, 6), 3.0))).verdict == verdict


@pytest.mark.parametrize("fixes", [1, 2 * BLOCKS - 1, 2 * BLOCKS, 10_000])
def test_health_of_few_and_many_fixes(fixes):
    found = health(of_fixes(np.ones((fixes, 6))))
    assert (found.fixes, found.refused, found.verdict, found.factor) == (fixes, 0, "consistent", 1.0)
    assert found.nis.mean == pytest.approx(1.0) and found.nis.low < 1 < found.nis.high
    assert json.loads(json.dumps(found.as_json()))["position"]["nis"] == pytest.approx(1.0)


def test_health_of_what_did_not_come():
    """No fix at all, an aid that measured nothing, fixes without velocities, and fixes that were compared with nothing."""
    assert health({row.name: np.zeros((5, *row.shape) if row.size > 1 else 5) for row in FIX_HEALTH}) is None
    assert health({name: np.zeros(5) if name.endswith("d_count") else np.zeros((5, 1)) for name in aid_health("dvl")}
                  | {"dvl_count": np.zeros(5)}) is None  # fmt: skip
    found = health(of_fixes(np.random.default_rng(1).normal(size=(500, 6)), velocity=False))
    assert found.verdict == "consistent" and found.groups["position"] == found.nis
    assert np.isnan(found.groups["velocity"].mean)
    found = health({**of_fixes(np.ones((9, 6))), **{name: np.zeros((9, 2)) for name in FIX_HEALTH.names[2:]}})
    assert (found.verdict, found.factor, found.fixes) == ("untested", 1.0, 9) and found.notes() == ()


@pytest.mark.parametrize(("size", "verdict"),
    [(1.0, "consistent"), (1.05, "consistent"), (1.3, "overconfident"), (8.0, "diverged")])  # fmt: skip
def test_a_verdict_follows_from_the_size_of_the_innovations(size, verdict):
    found = health(of_fixes(size * np.random.default_rng(2).normal(size=(2000, 6))))
    assert found.verdict == verdict and bool(found.notes()) == (verdict != "consistent")
    assert found.factor == (1.0 if verdict == "consistent" else pytest.approx(size, rel=0.05))


@pytest.mark.parametrize(("share", "verdict"),
    [(0.02, "consistent"), (0.2, "overconfident"), (0.82, "diverged"), (0.97, "diverged")])  # fmt: skip
def test_a_verdict_follows_from_the_fixes_refused(share, verdict):
    rng = np.random.default_rng(4)
    ratios, refused = rng.normal(size=(1000, 6)), np.zeros((1000, 6), bool)
    refused[:, 0] = rng.uniform(size=1000) < share
    ratios[refused] = 20.0
    found = health(of_fixes(ratios, refused))
    assert found.verdict == verdict and found.refused == refused.sum()
    assert found.nis.mean == pytest.approx(1.0, abs=0.1), "refused components are not in the NIS"
    assert verdict == "consistent" or found.factor > 2
    assert verdict != "diverged" or f"refused {refused.sum()} of 1000 fixes" in found.notes()[0]


def test_a_verdict_follows_from_each_group_and_from_the_end():
    rng = np.random.default_rng(3)
    ratios = rng.normal(size=(2000, 6)) * np.repeat([0.5, 1.3], 3)
    found, turned = health(of_fixes(ratios)), health(of_fixes(ratios[:, ::-1]))
    assert found.nis.mean < 1 and found.verdict == turned.verdict == "overconfident"
    assert found.factor == pytest.approx(1.3, rel=0.05)
    for part, verdict in ((slice(700, 1000), "diverged"), (slice(None, 100), "overconfident")):
        lost = rng.normal(size=(1000, 6))
        lost[part] *= 30  # a filter that parts from its fixes at the end has diverged, one that does at the start has not
        assert health(of_fixes(lost)).verdict == verdict
    small = health(of_fixes(0.5 * rng.normal(size=(2000, 6))))
    assert [note.code for note in small.notes()] == ["fixes-slow-errors"] and small.notes(models_slow_errors=True) == ()


def test_the_course_counts_every_fix():
    ratios = np.random.default_rng(8).normal(size=(100, 6))
    ratio, refused = course({name: value[4::5] for name, value in of_fixes(ratios).items()})
    assert np.isnan(ratio[0]) and not refused.any()
    assert ratio[1:] == pytest.approx(np.sqrt(np.mean(ratios[5:].reshape(19, -1) ** 2, axis=1)))


def test_the_worst_aid_gives_the_verdict():
    rng = np.random.default_rng(1)
    good, wide = of_aid("barometer", rng.normal(size=2000)), of_aid("odometer", 1.5 * rng.normal(size=2000))
    gone = of_aid("dvl", np.full(2000, 20.0), np.arange(2000) % 11 > 0)
    assert reported_aids([*good, *wide, *gone, "fix_refused_count"]) == ("barometer", "odometer", "dvl")
    assert health(good).verdict == "consistent" and health(good).factor == 1.0 and health(good).notes() == ()
    found = health({**good, **wide})
    assert found.verdict == "overconfident" and found.factor == pytest.approx(1.5, rel=0.05) and found.apart == ()
    found = health({**good, **wide, **gone})
    assert found.verdict == "diverged" and found.factor == pytest.approx(20.0) and found.apart == ("dvl",)
    of_dvl, of_odometer = found.notes(causes={"dvl": "the water"})
    assert "dvl does not fit" in of_dvl and "diverged" in of_dvl and " 1818 " in of_dvl and "the water" in of_dvl
    assert "odometer does not fit" in of_odometer and "overconfident" in of_odometer
    assert found.fixes == 0 and np.isnan(found.nis.mean)


def test_an_estimator_from_outside_has_health_by_its_outputs(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    base = estimators.get("loosely-coupled")

    def mine(rows):
        """loosely-coupled with these outputs in place of its rows of health."""
        kept = Table(tuple(row for row in base.model.outputs if row.name not in FIX_HEALTH)) + Table(tuple(rows))
        output = base.model.output
        of_kept = lambda p, x: {n: v for n, v in output(p, x).items() if n in kept}  # noqa: E731
        return replace(base, model=replace(base.model, id="mine", outputs=kept, output=of_kept))

    ours, without = (run("ship-underway", e, duration_s=10.0).results[0] for e in (base, mine(())))
    assert ours.health.fixes == 9
    assert without.health is None
    assert not any("fix" in note for note in without.notes)
    with pytest.raises(InputError, match=r"output 'nis_used' has the shape \(6,\): allowed is \(2,\)"):
        mine(replace(row, shape=(6,)) if row.name == "nis_used" else row for row in FIX_HEALTH)


@pytest.mark.parametrize("id", ["loosely-coupled", "aqe-ekf", "aqe-sukf", "aqe-sukf-printed", "fusion"])
def test_the_rows_are_the_sums_of_the_test_ratios(id, monkeypatch):
    """A record per sample shows every fix: the sums equal those of the output `test_ratio`."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    found = ensemble("car-city-drive", [id], [3], duration_s=5.0, records=1000).outputs[id]
    new = np.diff(found["fix_count"][0], prepend=0.0) > 0
    ratios = found["test_ratio"][0][new]
    assert new.sum() == found["fix_count"][0, -1] == 4
    total = found["nis_used"][0, -1] + found["nis_refused"][0, -1]
    assert total == pytest.approx(np.sum(ratios.reshape(-1, 2, 3) ** 2, axis=(0, 2)), rel=1e-12)
    assert (found["nis_used_count"][0, -1] + found["nis_refused_count"][0, -1]).tolist() == [12, 12]


def test_a_run_without_a_fix_says_so(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    result = run("car-city-drive", "loosely-coupled", duration_s=0.5).results[0]
    assert result.health is None and "no fix was received: the estimate is that of the inertial unit alone" in result.notes


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    return written_log(tmp_path_factory.mktemp("drive"), duration_s=240.0)


def test_a_log_that_is_described_truly_is_consistent(drive):
    result = insenv.replay(drive, "loosely-coupled").results[0]
    assert result.health.verdict == "consistent" and result.health.fixes == 239
    assert not any("innovations" in note or "contradict" in note for note in result.notes)


@pytest.mark.parametrize(("right", "wrong", "verdict"), [
    ("lever_arm_m = [-1.2, 0.3, -1.0]", "lever_arm_m = [1.2, 0.3, -1.0]", "overconfident"),
    ("lever_arm_m = [-1.2, 0.3, -1.0]", "lever_arm_m = [-1.2, -0.7, -1.0]", "overconfident"),
    ("time_offset_s = 0.0", "time_offset_s = 0.3", "overconfident"),
])  # fmt: skip
def test_a_log_that_is_described_falsely_is_not_passed_over(drive, right, wrong, verdict):
    """As on two recorded logs, of whose fixes 82 to 97 % were refused without a word."""
    text = drive.read_text("utf-8")
    assert right in text
    told = drive.with_name("told.toml")
    told.write_text(text.replace(right, wrong), encoding="utf-8")
    result = insenv.replay(told, "loosely-coupled").results[0]
    assert result.health.verdict == verdict and result.health.factor > 2
    (said,) = (note for note in result.notes if "innovations" in note)
    assert "lever arm" in said
    assert f"refused {result.health.refused} of 239 fixes" in said


@pytest.mark.slow
@pytest.mark.parametrize("stated", [{"unit": "industrial", "grade": "navigation"}, {"scale_of_sigma": 0.4}])
def test_a_log_of_a_worse_unit_or_receiver_than_stated_is_not_passed_over(tmp_path, stated):
    path = written_log(tmp_path, **stated)
    path.write_text(path.read_text("utf-8").replace("static_until_s", "heading_deg = 90.0\nstatic_until_s"), encoding="utf-8")
    health = insenv.replay(path, "loosely-coupled").results[0].health
    assert health.verdict == "overconfident" and health.factor > 2


def test_strict_fails_after_the_report_is_written(drive, tmp_path):
    arguments = ("-e", "loosely-coupled", "--out", tmp_path, "--no-figure")
    late = drive.with_name("late.toml")
    late.write_text(drive.read_text("utf-8").replace("time_offset_s = 0.0", "time_offset_s = 0.3"), encoding="utf-8")
    assert call("replay", drive, *arguments, "--strict")[0] == 0
    status, text, said = call("replay", late, *arguments, "--strict")
    contradicted = "contradicted: loosely-coupled by filter-restarted, fixes-contradict"
    assert status == 1 and said == f"insenv: --strict: overconfident: loosely-coupled about its fixes; {contradicted}\n"
    assert "health: overconfident" in text
    assert json.loads((tmp_path / "late.json").read_text())["results"][0]["health"]["verdict"] == "overconfident"


@pytest.mark.slow
def test_a_wrong_barometer_and_a_wrong_odometer_of_a_log_are_named(tmp_path, monkeypatch):
    """Heights 300 m too large are another datum, which the estimated bias takes up from the first one on."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    path = written_log(tmp_path, duration_s=40.0, odometer=1.0, barometer=300.0)
    told = ("--set", "fusion.odometer_noise_mps=0.002")
    status, text, said = call("replay", path, "-e", "fusion", "--json", "--strict", *told)
    report = json.loads(text)
    (found,) = report["results"]
    assert status == 1 and said.startswith("insenv: --strict: diverged: fusion from odometer")
    assert found["health"]["aids"]["odometer"]["verdict"] == found["health"]["verdict"] == "diverged"
    assert found["health"]["aids"]["barometer"]["refused"] == 0
    assert any("above the fixes at the start" in note for note in report["notes"])


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
@pytest.mark.parametrize(("worst", "said"), [(2.0, True), (1.21, True), (1.19, False)])
def test_the_component_that_is_worst_against_a_fix_is_named(order, worst, said):
    """Not the one with the largest sigma: down is often twice as uncertain, of estimate and fix."""
    stated, fix = np.array([1.5 * worst, 1.0, 5.0])[[*order]], np.array([1.5, 1.0, 5.0])[[*order]]
    assert counted_less(stated, fix) == {"said": said, "stated": 1.5 * worst, "fix": 1.5}


@pytest.mark.slow
def test_a_filter_that_states_more_than_one_fix_says_so():
    """Fixes of 2.1 m at 5 Hz without velocities, half of their variance slow: `fusion` estimates that half."""
    values = insenv.load("car-city-drive").model_dump(exclude_unset=True, mode="json") | {"rate_hz": 100.0}
    values["gnss"] |= {"interval_s": 0.2}
    told = {**GNSS, "position_sigma_m": [2.1, 2.1, 4.3], "lever_arm_m": [-1.2, 0.3, -1.0]}
    log = simulated_log(values, duration_s=60.0, grade="tactical", vehicle_kind="car", gnss=told)
    log = replace(log, gnss=replace(log.gnss, velocity_n=None, velocity_sigma=None))
    worse, better = insenv.replay(log, ["loosely-coupled", "fusion"], start="reference").results
    (said,) = (note for note in worse.notes if note.code == "fixes-count-less")
    assert "than that of one fix, 2.1 m" in said and "`fusion`" in said
    assert not [note for note in better.notes if note.code == "fixes-count-less"]


@pytest.mark.parametrize("id", ["q-method", "qakf", "qakf-improved", "inertial-fir", "gyrocompass"])
def test_an_alignment_that_is_too_short_says_so(id, monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    short = run("ship-swaying", id, duration_s=5.0)
    (said,) = (note for note in short.results[0].notes if note.startswith("too short"))
    assert said.startswith(f"too short: 5 s of data, {id} needs ") and not short.results[0].settled
    assert run(insenv.load("static-ecef").model_copy(update={"rate_hz": 2.0}), id, duration_s=600.0).results[0].settled

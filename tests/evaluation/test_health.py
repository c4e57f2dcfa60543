"""Health of filters with fixes: bounds on made-up ratios, and simulated drives that are described truly and falsely."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import call
from written_logs import written_log

from insenv import estimators, run
from insenv import replay as replayed
from insenv.core.model import Model
from insenv.core.tables import Table
from insenv.errors import InputError
from insenv.estimators.parts.rows import FIX_HEALTH
from insenv.evaluation.health import BLOCKS, course, health
from insenv.runs.ensemble import ensemble

REPORTING = [e.id for e in estimators.registered().values() if e.reports_health]


def sums(ratios, refused=None, velocity=True):
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


def correlated(rng, fixes, rho):
    """Normal ratios of variance 1 that follow one another with the correlation `rho`."""
    found = rng.normal(size=(fixes, 6))
    for before, after in itertools.pairwise(range(fixes)):
        found[after] = rho * found[before] + np.sqrt(1 - rho**2) * found[after]
    return found


@pytest.mark.parametrize(("rho", "least"), [(0.0, 0.93), (0.5, 0.92), (0.9, 0.90)])
def test_the_bounds_hold_the_mean_as_often_as_they_say(rho, least):
    """Over 400 series of 600 fixes: 95 %, less for slow errors, whose correlation the blocks see only in part."""
    rng, inside, white = np.random.default_rng(5), 0, 0
    for _ in range(400):
        nis = health(sums(correlated(rng, 600, rho))).nis
        inside += nis.low < nis.mean < nis.high
        white += abs(nis.mean - 1) < 1.96 * np.sqrt(2 / 3600)
    assert inside >= least * 400
    # with rho 0.9 the variance of the mean is 9.5 times as large: bounds of independent innovations hold it 47 % of the time
    assert white < 0.55 * 400 or rho < 0.9


@pytest.mark.parametrize("fixes", [1, 2 * BLOCKS - 1, 2 * BLOCKS, 10_000])
def test_health_of_few_and_many_fixes(fixes):
    found = health(sums(np.ones((fixes, 6))))
    assert found.fixes == fixes and found.refused == 0
    assert found.nis.mean == pytest.approx(1.0) and found.nis.low < 1 < found.nis.high
    assert found.verdict == "consistent" and found.factor == 1.0
    assert json.loads(json.dumps(found.as_json()))["position"]["nis"] == pytest.approx(1.0)


def test_health_without_fixes_and_without_velocities():
    rows = {
        name: np.zeros((5, *row.shape) if row.size > 1 else 5) for name, row in zip(FIX_HEALTH.names, FIX_HEALTH, strict=True)
    }
    assert health(rows) is None
    found = health(sums(np.random.default_rng(1).normal(size=(500, 6)), velocity=False))
    assert found.verdict == "consistent" and found.groups["position"] == found.nis
    assert np.isnan(found.groups["velocity"].mean)


def test_fixes_of_which_none_was_compared_show_nothing():
    found = health({**sums(np.ones((9, 6))), **{name: np.zeros((9, 2)) for name in FIX_HEALTH.names[2:]}})
    assert (found.verdict, found.factor, found.fixes) == ("untested", 1.0, 9) and found.notes() == ()
    assert found.summary == "untested: none of 9 fixes was compared with an estimate"


@pytest.mark.parametrize(
    ("size", "verdict"), [(1.0, "consistent"), (1.05, "consistent"), (1.3, "overconfident"), (8.0, "diverged")]
)
def test_a_verdict_follows_from_the_size_of_the_innovations(size, verdict):
    found = health(sums(size * np.random.default_rng(2).normal(size=(2000, 6))))
    assert found.verdict == verdict
    assert found.factor == (1.0 if verdict == "consistent" else pytest.approx(size, rel=0.05))
    assert bool(found.notes()) == (verdict != "consistent")


def test_one_group_is_enough():
    """Positions that scatter too little do not hide velocities that scatter too much, nor the other way round."""
    ratios = np.random.default_rng(3).normal(size=(2000, 6)) * np.repeat([0.5, 1.3], 3)
    assert health(sums(ratios)).nis.mean < 1
    assert health(sums(ratios)).verdict == health(sums(ratios[:, ::-1])).verdict == "overconfident"
    assert health(sums(ratios)).factor == pytest.approx(1.3, rel=0.05)


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.02, "consistent"), (0.2, "overconfident"), (0.82, "diverged"), (0.97, "diverged")]
)
def test_a_verdict_follows_from_the_fixes_refused(share, verdict):
    rng = np.random.default_rng(4)
    ratios, refused = rng.normal(size=(1000, 6)), np.zeros((1000, 6), bool)
    refused[:, 0] = rng.uniform(size=1000) < share
    ratios[refused] = 20.0
    found = health(sums(ratios, refused))
    assert found.verdict == verdict and found.refused == refused.sum()
    assert found.nis.mean == pytest.approx(1.0, abs=0.1), "refused components are not in the NIS"
    assert verdict == "consistent" or found.factor > 2
    assert verdict != "diverged" or f"refused {refused.sum()} of 1000 fixes" in found.notes()[0]


def test_a_filter_that_parts_from_its_fixes_at_the_end_has_diverged_and_one_at_the_start_not():
    ratios = np.random.default_rng(6).normal(size=(1000, 6))
    for part, verdict in ((slice(700, None), "diverged"), (slice(None, 100), "overconfident")):
        lost = ratios.copy()
        lost[part] *= 30
        assert health(sums(lost)).verdict == verdict


def test_positions_that_scatter_too_little_make_a_note():
    found = health(sums(0.6 * np.random.default_rng(7).normal(size=(1000, 6))))
    assert found.verdict == "consistent"
    (said,) = found.notes()
    assert said.startswith("positions scatter less than their sigmas say (mean NIS 0.3") and "slow" in said
    assert found.notes(models_slow_errors=True) == ()


def test_the_course_counts_every_fix():
    ratios = np.random.default_rng(8).normal(size=(100, 6))
    rows = {name: value[4::5] for name, value in sums(ratios).items()}
    ratio, refused = course(rows)
    assert np.isnan(ratio[0]) and not refused.any()
    assert ratio[1:] == pytest.approx(np.sqrt(np.mean(ratios[5:].reshape(19, -1) ** 2, axis=1)))


# --- the rows of the filters ---------------------------------------------------------------------------


def test_which_estimators_report_health():
    assert set(REPORTING) == {
        "loosely-coupled",
        "smoother",
        "aqe-ekf",
        "aqe-sukf",
        "aqe-sukf-printed",
        "fusion",
        "fusion-smoother",
    }


def mine(rows):
    """loosely-coupled under another name with these outputs in place of its rows of health."""
    model = estimators.get("loosely-coupled").model
    kept = Table(tuple(row for row in model.outputs if row.name not in FIX_HEALTH)) + Table(tuple(rows))

    def output(p, x):
        return {**{n: v for n, v in model.output(p, x).items() if n in kept}}

    shown: Model = replace(model, id="mine", outputs=kept, output=output)
    return replace(estimators.get("loosely-coupled"), model=shown)


def test_an_estimator_from_outside_has_health_by_its_outputs():
    ours, with_rows, without = (
        run("ship-underway", e, duration_s=60.0).results[0] for e in ("loosely-coupled", mine(FIX_HEALTH), mine(()))
    )
    assert with_rows.health == ours.health and ours.health.fixes == 59
    assert without.health is None and not any("fix" in note for note in without.notes)
    with pytest.raises(InputError, match=r"estimator 'mine': output 'nis_used' has the shape \(6,\): allowed is \(2,\)"):
        mine(replace(row, shape=(6,)) if row.name == "nis_used" else row for row in FIX_HEALTH)


@pytest.mark.parametrize("id", [id for id in REPORTING if not id.endswith("smoother")])  # its outputs are smoothed
def test_the_rows_are_the_sums_of_the_test_ratios(id):
    """A record per sample shows every fix: the sums equal those of the output `test_ratio`."""
    found = ensemble("car-city-drive", [id], [3], duration_s=12.0, records=2400).outputs[id]
    new = np.diff(found["fix_count"][0], prepend=0.0) > 0
    ratios = found["test_ratio"][0][new]
    assert new.sum() == found["fix_count"][0, -1] == 11
    total = found["nis_used"][0, -1] + found["nis_refused"][0, -1]
    assert total == pytest.approx(np.sum(ratios.reshape(-1, 2, 3) ** 2, axis=(0, 2)), rel=1e-12)
    assert (found["nis_used_count"][0, -1] + found["nis_refused_count"][0, -1]).tolist() == [33, 33]


def test_the_health_of_a_smoother_is_that_of_its_filter():
    filtered, smoothed = run("car-city-drive", ["loosely-coupled", "smoother"], duration_s=120.0).results
    assert smoothed.health.nis.mean == pytest.approx(filtered.health.nis.mean, rel=1e-3)  # intervals end at smoothed samples
    assert smoothed.health.fixes == filtered.health.fixes == 119
    assert smoothed.health.refused == filtered.health.refused > 0


def test_health_does_not_depend_on_the_records():
    """Sparse records: the same fixes, the same NIS; the bounds differ a little by the edges of the blocks."""
    dense, sparse = (
        ensemble("car-city-drive", ["loosely-coupled"], [1], records=n).outputs["loosely-coupled"] for n in (4500, 60)
    )
    of_dense, of_sparse = (health({n: found[n][0] for n in FIX_HEALTH.names}) for found in (dense, sparse))
    assert of_dense.fixes == of_sparse.fixes == 719 and of_dense.nis.mean == of_sparse.nis.mean
    assert of_dense.verdict == of_sparse.verdict == "consistent"


def test_a_run_without_a_fix_says_so():
    result = run("car-city-drive", "loosely-coupled", duration_s=0.5).results[0]
    assert result.health is None and "no fix came: the estimate is that of the inertial unit alone" in result.notes


# --- drives ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", ["loosely-coupled", "aqe-sukf"])
def test_a_log_that_is_described_truly_is_consistent(tmp_path, id):
    result = replayed(written_log(tmp_path), id).results[0]
    assert result.health.verdict == "consistent" and result.health.fixes == 239
    assert not any("fix" in note for note in result.notes)


@pytest.mark.parametrize(
    ("told", "verdict"),
    [
        ({"lever_arm_m": (1.2, 0.3, -1.0)}, "diverged"),
        ({"lever_arm_m": (-1.2, -0.7, -1.0)}, "overconfident"),
        ({"time_offset_s": 0.3}, "diverged"),
        ({"time_offset_s": -0.15}, "diverged"),
        ({"unit": "consumer", "grade": "navigation"}, "diverged"),
        ({"unit": "consumer", "grade": "navigation", "receiver": "spp"}, "diverged"),
        ({"unit": "consumer", "grade": "tactical", "receiver": "spp"}, "overconfident"),
        ({"scale_of_sigma": 0.4}, "overconfident"),
    ],
)
def test_a_log_that_is_described_falsely_is_not_passed_over(tmp_path, told, verdict):
    """As on two recorded logs, of whose fixes 82 to 97 % were refused without a word."""
    result = replayed(written_log(tmp_path, **told), "loosely-coupled").results[0]
    assert result.health.verdict == verdict and result.health.factor > 2
    (said,) = (note for note in result.notes if "innovations" in note)
    for word in ("grade", "lever arm", "time offset", f"refused {result.health.refused} of 239 fixes"):
        assert word in said


def test_strict_fails_after_the_report_is_written(tmp_path):
    (tmp_path / "log").mkdir()
    path, out = written_log(tmp_path / "log", time_offset_s=0.3), tmp_path / "out"
    arguments = ("replay", str(path), "-e", "loosely-coupled", "--out", str(out), "--no-figure")
    status, text, said = call(*arguments)
    assert status == 0 and "health: diverged" in text and not said
    status, text, said = call(*arguments, "--strict", "--json")
    assert status == 1 and said == "insenv: --strict: diverged: loosely-coupled from its fixes\n"
    assert json.loads(text)["results"][0]["health"]["verdict"] == "diverged" and (out / "log.json").exists()
    assert call("run", "car-city-drive", "--duration", "30", "--strict")[0] == 0


def test_strict_fails_for_whatever_states_too_little(tmp_path):
    path = written_log(tmp_path, scale_of_sigma=0.4)
    status, text, said = call("replay", str(path), "-e", "loosely-coupled", "--strict")
    assert status == 1 and "health: overconfident" in text
    assert said.startswith("insenv: --strict: overconfident: loosely-coupled about its fixes")
    status, _, said = call("run", "aircraft-inflight-alignment", "-e", "loosely-coupled", "--duration", "60", "--strict")
    both = "overconfident: loosely-coupled about its fixes; errors larger than stated: loosely-coupled"
    assert status == 1 and said == f"insenv: --strict: {both}\n"


# --- runs that are too short -----------------------------------------------------------------------------


@pytest.mark.parametrize("id", ["q-method", "qakf", "qakf-improved", "inertial-fir", "gyrocompass"])
def test_an_alignment_that_is_too_short_says_so(id):
    short = run("ship-swaying", id, duration_s=20.0)
    (said,) = (note for note in short.results[0].notes if note.startswith("too short"))
    assert said.startswith(f"too short: 20 s of data, {id} needs ") and not short.results[0].settled
    assert run("static-ecef", id, duration_s=600.0).results[0].settled


def test_the_time_that_an_alignment_needs_follows_its_parameters():
    e = estimators.get("q-method")
    assert e.too_short({"smoothing_time": 4.0}, 99.0) and not e.too_short({"smoothing_time": 4.0}, 100.0)
    assert not e.too_short({"smoothing_time": 0.0}, 0.01)
    assert estimators.get("loosely-coupled").too_short({}, 0.01) == ""
    with pytest.raises(InputError, match=r"estimator 'q-method', needs: -1\.0 s: allowed is a finite number"):
        replace(e, needs=lambda parameters: -1.0).too_short({}, 1.0)

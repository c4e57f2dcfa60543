"""Campaigns: varied keys, statistics, files and the command."""

import io
import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from campaigns import slow_ship, small_plan
from command_line import call
from navigation import FUNCTIONS, MODEL, error_state, random_state, with_error
from rich.console import Console

from insenv import geodesy, limit, run
from insenv.campaigns import Folder, cluster, make_plan, parse_variation, run_campaign, running
from insenv.campaigns import block as block_module
from insenv.campaigns.block import run_block
from insenv.campaigns.presentation import campaign_arrays, campaign_rows, campaign_tables
from insenv.core import symmetric
from insenv.core.numeric import vectorized
from insenv.errors import InputError
from insenv.estimators import get
from insenv.estimators.parts import quaternion_error
from insenv.estimators.parts.quaternion_error import Y
from insenv.evaluation.consistency import nees, normalised
from insenv.evaluation.errors import ATTITUDE
from insenv.scenario import limit_of, load

# --- varied keys --------------------------------------------------------------------------------------


def test_varied_keys_are_drawn_from_seed_and_key_alone():
    first, second = parse_variation("imu.gyro_bias_deg_h=-1.0:3.0"), parse_variation("start.latitude_deg=10.0:50.0")
    drawn = np.array([first.value(seed) for seed in range(4000)])
    assert drawn.min() >= -1 and drawn.max() <= 3
    assert drawn.mean() == pytest.approx(1.0, abs=5 * 4 / np.sqrt(12 * 4000))
    assert abs(np.corrcoef(drawn, [second.value(seed) for seed in range(4000)])[0, 1]) < 5 / np.sqrt(4000)

    alone = run_campaign(small_plan(12, variations=[first]))
    both = run_campaign(small_plan(12, variations=[second, first]))
    assert np.array_equal(alone.values[:, 0], both.values[:, 0]) and both.values.shape == (12, 2)
    assert np.array_equal(alone.values[:, 0], [first.value(int(seed)) for seed in alone.seeds])


def test_a_varied_run_is_the_scenario_with_that_value():
    variation = parse_variation("vehicle.sway.roll.0.amplitude_deg=1.0:10.0")
    plan = small_plan(9, variations=[variation, parse_variation("imu.gyro_bias_deg_h=0.0:5.0")])
    arrays = run_block(plan, 0)
    data = json.loads(json.dumps(dict(plan.scenario)))
    data["imu"]["gyro_bias_deg_h"] = plan.variations[0].value(5)
    data["vehicle"]["sway"]["roll"][0]["amplitude_deg"] = variation.value(5)
    other = make_plan(type(slow_ship()).model_validate(data), "analytic", 1, first_seed=5, duration_s=2.0)
    assert np.array_equal(arrays["error"][2], run_block(other, 0)["error"][0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("imu.gyro_bias_deg_h", "key=low:high"),
        ("imu.gyro_bias_deg_h=1", "key=low:high"),
        ("imu.gyro_bias_deg_h=2:1", "lower first"),
        ("imu.gyro_bias_deg_h=0:inf", "finite"),
        ("imu.gyro_bais_deg_h=0:1", "did you mean 'gyro_bias_deg_h'"),
        ("imu.foo=1:2", r"no key 'foo' \(allowed: ([a-z_]+, ){5}[a-z_]+ and [0-9]+ more; docs/scenarios.md shows all\)$"),
        ("start.latitude_deg.0=0:1", "a number has no key"),
        ("gnss.latency_s=0:1", r"no \[gnss\]"),
        ("start.latitude_deg=0:100", "latitude_deg = 100"),
        ("seed=0:100", "every run has a seed of its own, .*--seed"),
        ("duration_s=1:2", "all runs of a campaign share it .--duration"),
        ("title=0:1", "value is a number"),
        ("vehicle=0:1", "value is a number"),
        ("vehicle.sway.roll=0:1", "value is a number"),
        ("vehicle.sway.roll.3.amplitude_deg=0:1", "not an element of a list of 1"),
        ("estimator.q-method.arw=0:1", "unknown key"),
    ],
)
def test_keys_that_cannot_be_varied_are_refused(text, said):
    with pytest.raises(InputError, match=said):
        make_plan(slow_ship(), "q-method", 4, duration_s=2.0, variations=[parse_variation(text)])


def test_an_estimators_parameter_can_be_varied():
    variation = parse_variation("estimator.q-method.smoothing_time_s=0.01:0.3")
    plan = make_plan(slow_ship(), "q-method", 3, first_seed=3, duration_s=2.0, variations=[variation])
    plain = make_plan(slow_ship(), "q-method", 3, first_seed=3, duration_s=2.0)
    varied, fixed = run_campaign(plan), run_campaign(plain)
    assert (varied.final[:, 2] != fixed.final[:, 2]).all()
    assert ((varied.values > 0.01) & (varied.values < 0.3)).all()


def test_the_parts_of_the_plant_must_stay_the_same():
    from insenv.campaigns import plan as plan_module

    models = iter([1, 2, 3, 4])
    original = plan_module.build

    def changing(*arguments):
        return replace(original(*arguments), model=replace(original(*arguments).model, id=f"plant-{next(models)}"))

    with pytest.MonkeyPatch.context() as patch, pytest.raises(InputError, match="parts of 'ship-swaying' change"):
        patch.setattr(plan_module, "build", changing)
        small_plan(8, variations=[parse_variation("start.latitude_deg=0:1")])


# --- statistics ---------------------------------------------------------------------------------------


def test_summaries_are_those_of_the_runs(tmp_path):
    plan = small_plan(100)
    found = run_campaign(plan, store=Folder(tmp_path, plan))
    errors = np.concatenate([run_block(plan, k)["error"] for k in range(len(plan.blocks))])
    squares = np.concatenate([run_block(plan, k)["mean_square"] for k in range(len(plan.blocks))])
    late = found.time >= 1.5 - 1e-9
    for place, name in enumerate(ATTITUDE):
        course, row = found.courses[name], found.figures()[name]
        assert np.allclose(course.mean, errors[:, :, place].mean(axis=0))
        assert np.allclose(course.rms, np.sqrt(squares[:, :, place].mean(axis=0)))
        assert np.allclose(course.percentiles[4], np.percentile(errors[:, :, place], 97.5, axis=0))
        assert row["rms"] == pytest.approx(np.sqrt(squares[:, late, place].mean()))
        assert row["percentiles"]["50"] == pytest.approx(np.median(errors[:, -1, place]))
    assert found.diverged == () and found.from_s == 1.5


def test_diverged_runs_are_named_and_left_out(monkeypatch):
    plan, original = small_plan(24), block_module.run_block
    expected = run_campaign(plan)

    def spoilt(plan, number, stopped, part):
        arrays = {name: value.copy() for name, value in original(plan, number).items()}
        if number == 1:
            arrays["error"][2, 30:, 1] = np.nan
            arrays["mean_square"][4, 35:, 0] = np.inf
            arrays["mean_square"][6, :, 2] *= 1e6
        return arrays

    monkeypatch.setattr(running, "run_block", spoilt)
    found = run_campaign(plan)
    assert found.diverged == (3 + 8 + 2, 3 + 8 + 4) and found.far == (3 + 8 + 6,)
    kept = ~np.isin(found.seeds, found.diverged)
    assert kept.sum() == 22
    pitch, whole = found.courses["pitch_deg"], expected.courses["pitch_deg"]
    assert np.allclose(pitch.mean[:30], whole.mean[:30], rtol=1e-12)
    assert pitch.mean[-1] == pytest.approx(expected.final[kept, 1].mean())
    assert np.isfinite([row["rms"] for row in found.figures().values()]).all()
    assert found.as_json()["diverged"] == [13, 15]


def test_nees_is_the_squared_error_over_the_covariance():
    rng = np.random.default_rng(5)
    numeric = vectorized(normalised, 9, (9, 9))
    for _ in range(20):
        L, e = rng.normal(size=(9, 9)), rng.normal(size=9)
        assert numeric(e, L @ L.T) == pytest.approx(e @ np.linalg.solve(L @ L.T, e), rel=1e-8)


def nees_of(id, estimate, truth_rows):
    """NEES as computed by the campaign's model, from a state vector and the rows of the truth."""
    model = get(id).model
    x = model.state.symbols(ca.SX(ca.DM(estimate)))
    truth = type(x)(**{name: ca.SX(ca.DM(np.atleast_1d(value))) for name, value in truth_rows.items()})
    value, degrees = nees(get(id), x, type(x)(), truth)
    return float(ca.evalf(value)), degrees


def truth_of(state):
    """Rows of the truth from the state of a navigation filter."""
    outputs = MODEL.outputs.unpack(np.array(MODEL.kernels["output"].function(MODEL.parameters.start_vector(), state)).ravel())
    return {name: outputs[name] for name in ("q_nb", "velocity_n", "latitude", "longitude", "height")}


def test_nees_of_the_15_state_filter_is_that_of_its_own_error_state():
    rng = np.random.default_rng(6)
    for _ in range(5):
        true = random_state(rng)
        scale = 1e-2 * np.repeat([30.0, 0.5, 1e-3, 1e-5, 1e-3], 3)
        L = rng.normal(size=(15, 15)) * scale[:, None]
        estimate = MODEL.state.pack({"covariance": (L @ L.T).T[np.tril_indices(15)]}, with_error(true, L @ rng.normal(size=15)))
        P = symmetric.full_array(MODEL.state.unpack(estimate)["covariance"], 15)[:9, :9]
        error = error_state(estimate, true)[:9]
        found, degrees = nees_of("loosely-coupled", estimate, truth_of(true))
        assert degrees == 9 and found == pytest.approx(error @ np.linalg.solve(P, error), rel=1e-4)  # equal to first order


def test_nees_of_a_quaternion_error_counts_rotation_velocity_and_position():
    """Small correlated errors, added to the truth and described by the covariance."""
    rng = np.random.default_rng(7)
    model, place = get("aqe-ekf").model, quaternion_error
    for _ in range(5):
        base = MODEL.state.unpack(random_state(rng))
        shared = {n: base[n] for n in ("q_wb", "velocity_w", "q_ew", "height")}
        L = rng.normal(size=(9, 9)) * np.repeat([1e-4, 0.2, 2.0], 3)[:, None]
        e = L @ rng.normal(size=9)  # rotation, velocity, position, in w
        into = np.zeros((place.N, 9))
        into[place.DQ, 0:3] = 0.5 * np.array(ca.DM(ca.evalf(Y(ca.SX(ca.DM(base["q_wb"]))))))
        into[place.VELOCITY, 3:6], into[place.POSITION, 6:9] = np.eye(3), np.eye(3)
        P = into @ (L @ L.T) @ into.T
        estimate = model.state.pack({**shared, "covariance": P.T[np.tril_indices(place.N)]})
        # the filter's own function removes errors: psi is minus the rotation, without that of the computed frame
        state = MODEL.state.pack(shared, random_state(rng))
        theta = frame_turn(state, e[6:9])
        back = np.concatenate([e[6:9], e[3:6], -e[0:3] - theta, np.zeros(6)])
        true = np.array(FUNCTIONS["corrected"](state, back)).ravel()
        found, degrees = nees_of("aqe-ekf", estimate, truth_of(true))
        assert degrees == 9 and found == pytest.approx(e @ np.linalg.solve(L @ L.T, e), rel=2e-2)


def frame_turn(state, dr):
    """Rotation of the computed frame (3, rad) due to a position error (3, m, w)."""
    rows = MODEL.state.unpack(state)
    return geodesy.numeric.transport_rate_w(dr, rows["q_ew"], rows["height"])


@pytest.mark.slow  # compiles for half a minute
def test_nees_of_the_alignment_filter_lies_within_its_bounds():
    """Drawn biases and initial errors, as in `insenv.reproduce`: three states, consistent after convergence."""
    from insenv.reproduce.ecef import laboratory

    found = run_campaign(make_plan(laboratory(5.0), "ecef-kf", 16, first_seed=0, duration_s=160.0))
    assert found.nees is not None and found.nees.degrees == 3
    assert found.as_json()["nees"]["share_inside"] > 0.9


# --- output -------------------------------------------------------------------------------------------


def printed(found):
    console = Console(width=80, file=io.StringIO(), markup=False, highlight=False)
    for part in campaign_tables(found):
        console.print(part)
    return " ".join(console.file.getvalue().split())


def test_health_of_every_run_and_its_shares():
    """A run's health is that of `insenv run` with its seed; a gate of half a sigma refuses fixes until it opens."""
    scenario = load("ship-underway").model_copy(update={"rate_hz": 10.0})
    plan = make_plan(scenario, "loosely-coupled", 3, first_seed=4, duration_s=60.0)
    found = run_campaign(plan)
    alone = run(scenario, "loosely-coupled", seed=5, duration_s=60.0).results[0].health
    assert found.health[1].fixes == alone.fixes == 59
    assert found.health[1].nis.mean == pytest.approx(alone.nis.mean, rel=1e-9)
    shares = found.as_json()["health"]
    assert shares["runs"] == 3 and shares["consistent"] == 1.0 and shares["overconfident"] == shares["diverged"] == 0.0
    assert shares["nis"] == pytest.approx(np.mean([one.nis.mean for one in found.health]))
    assert campaign_arrays(found)["runs/health/nis"].tolist() == [one.nis.mean for one in found.health]
    assert printed(found).count("health of 3 runs: 100 % consistent, 0 % overconfident, 0 % diverged") == 1

    single = printed(run_campaign(make_plan(scenario, "loosely-coupled", 1, first_seed=4, duration_s=60.0)))
    assert "health of 1 run:" in single and "1 run of 60 s, seed 4," in single

    wrong = {"loosely-coupled": {"innovation_gate": 0.5}}
    lost = run_campaign(make_plan(load({**scenario.model_dump(exclude_unset=True), "estimator": wrong}), "loosely-coupled", 2,
                                  first_seed=4, duration_s=60.0))  # fmt: skip
    assert lost.verdicts()["consistent"] == 0.0 and lost.verdicts()["refused"] > 0.1
    assert run_campaign(small_plan(2)).verdicts() is None and run_campaign(small_plan(2)).as_json()["health"] is None


def test_what_runs_say_of_their_end_is_counted(tmp_path):
    """By the findings of `insenv run`: 6 s at sea show the heading in some runs, not in all."""
    scenario = load("ship-at-sea").model_copy(update={"rate_hz": 10.0})
    plan = make_plan(scenario, "velocity-integration", 4, first_seed=3, duration_s=6.0)
    found = run_campaign(plan, store=Folder(tmp_path, plan))
    for seed, held in zip(found.seeds, found.held, strict=True):
        result = run(scenario, "velocity-integration", seed=int(seed), duration_s=6.0).results[0]
        assert list(held) == [note for note in result.notes if "heading" in note and "heading found" not in note]
    unknown = [int(seed) for seed, held in zip(found.seeds, found.held, strict=True) if held]
    assert 0 < len(unknown) < 4
    seeds = ", ".join(map(str, unknown))
    assert f"note: in {len(unknown)} of 4 runs (seed {seeds}): the heading is unknown at the end: turns" in printed(found)


def test_runs_to_which_no_fix_came_are_counted():
    values = load("ship-underway").model_dump(exclude_unset=True)
    scenario = load({**values, "rate_hz": 10.0, "gnss": {**values["gnss"], "outages_s": [(0.0, 60.0)]}})
    found = run_campaign(make_plan(scenario, "loosely-coupled", 2, first_seed=4, duration_s=20.0))
    (note,) = (note for note in run(scenario, "loosely-coupled", duration_s=20.0).results[0].notes if "no fix came" in note)
    assert f"in 2 of 2 runs: {note}" in found.notes


def test_the_largest_ratio_of_a_finding_is_told():
    sentence = "the estimate of dvl_scale is {ratio} times its sigma"
    found = replace(run_campaign(small_plan(3)), held=({sentence: 5.25}, {}, {sentence: 70.1}))
    assert found.notes == ("in 2 of 3 runs (seed 3, 5): the estimate of dvl_scale is up to 70.1 times its sigma",)


def test_runs_that_are_too_short_have_no_ratio():
    plan = make_plan(slow_ship(), "q-method", 2, first_seed=3, duration_s=2.0)
    found = run_campaign(plan)
    assert any(note.startswith("too short: 2 s of data, q-method needs 100 s") for note in found.as_json()["notes"])
    assert all(values[3] is None and values[2] is not None for _, values in campaign_rows(found))


def test_files_hold_every_run_and_the_figure(tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    plan = small_plan(12, variations=[parse_variation("imu.gyro_bias_deg_h=0:1")])
    found = run_campaign(plan)
    written = found.save(tmp_path)
    assert [p.name for p in written.paths] == ["campaign.npz", "campaign.json", "campaign.html", "campaign.png", "campaign.svg"]
    with np.load(tmp_path / "campaign.npz", allow_pickle=False) as arrays:
        assert arrays["runs/seed"].tolist() == list(range(3, 15))
        assert arrays["runs/heading_deg/final"].shape == arrays["runs/imu.gyro_bias_deg_h"].shape == (12,)
        assert arrays["heading_deg/percentiles"].shape == (5, len(arrays["time"]))
        assert json.loads(arrays["meta"].item())["runs"] == 12
    assert json.loads((tmp_path / "campaign.json").read_text())["errors"].keys() == set(ATTITUDE)
    assert (tmp_path / "campaign.png").stat().st_size > 10_000
    assert len(repr(found).splitlines()) == 2 and "12 runs of 2 s, seeds 3 to 14" in repr(found)
    html = found._repr_html_()
    assert "heading [deg]" in html and 'src="data:image/png;base64,' in html


def test_dataframe_of_the_courses():
    pytest.importorskip("pandas")
    found = run_campaign(small_plan(8))
    frame = found.to_dataframe()
    assert frame.index.name == "time" and np.array_equal(frame.index, found.time)
    course = found.courses["heading_deg"]
    assert np.array_equal(frame["rms_heading_deg"], course.rms)
    assert np.array_equal(frame["p97.5_heading_deg"], course.percentiles[-1])
    assert np.array_equal(frame["limit_heading_deg"], course.limit)


def test_the_command(tmp_path):
    arguments = ("campaign", "ship-swaying", "-e", "analytic", "-n", "6", "--duration", "1", "--seed", "5")
    status, out, err = call(*arguments, "--vary", "start.latitude_deg=10:40", "--out", tmp_path, "--no-figure")
    assert (status, err) == (0, "") and "6 runs of 1 s, seeds 5 to 10" in out and "drawn from 10 to 40" in out
    assert max(map(len, out.splitlines()[:-1])) <= 80
    status, out, _ = call(
        *arguments, "--vary", "start.latitude_deg=10:40", "--out", tmp_path, "--resume", "--no-figure", "--json"
    )
    found = json.loads(out)
    assert status == 0 and found["runs"] == 6 and found["imu_samples"] == 1200 and found["nees"] is None
    assert found["varied"] == [
        {"key": "start.latitude_deg", "distribution": "uniform", "parameters": [10.0, 40.0], "low": 10.0, "high": 40.0}
    ]
    assert set(found["errors"]["heading_deg"]) == {
        "mean", "rms", "percentiles", "limit", "stated", "rms_95", "percentiles_95"
    }  # fmt: skip
    status, _, err = call(*arguments, "--out", tmp_path)
    assert status == 2 and "another campaign: it differs in variations" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("ship-swaying", "-e", "q-methd", "-n", "4"), "did you mean 'q-method'"),
        (("ship-swaying", "-e", "q-method", "-n", "0"), "runs = 0"),
        (("ship-swaying", "-e", "loosely-coupled", "-n", "4"), "needs GNSS"),
        (("car-city-drive", "-e", "q-method", "-n", "4"), "moves"),
        (("aircraft-survey", "-e", "smoother", "-n", "4"), "insenv run"),
        (("ship-swaying", "-e", "q-method", "-n", "4", "--resume"), "--out"),
        (("ship-swaying", "-e", "q-method", "-n", "4", "--workers", "0"), "workers = 0"),
        (("ship-swaying", "-e", "q-method", "-n", "4", "--workers", "2", "--scheduler", "tcp://h:1"), "one of them"),
        (("ship-swaying", "-e", "q-method", "-n", "4", "--seed", "-1"), "seed = -1"),
        (("ship-swaying", "-e", "q-method", "-n", "4", "--seed", str(2**53 - 1)), "seed ="),
        (("ship-swaying", "-e", "q-method", "-n", "4", "--vary", "x"), "key=low:high"),
    ],
)
def test_wrong_calls_end_with_one_line(arguments, said):
    status, out, err = call("campaign", *arguments)
    assert status == 2 and out == "" and said in err and len(err.splitlines()) == 1


def test_ctrl_c_says_what_is_kept(monkeypatch, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "_finished", interrupted)
    arguments = ("campaign", "ship-swaying", "-e", "analytic", "-n", "6", "--duration", "1")
    assert call(*arguments)[0] == 130 and "nothing written" in call(*arguments)[2]
    assert "nothing is kept" in call(*arguments, "--out", tmp_path / "out")[2]  # no block was finished
    assert not (tmp_path / "out").exists()


def test_the_limit_follows_what_is_varied(monkeypatch):
    """Each run has the limit of its own scenario; of many runs, some have, and this is said."""
    monkeypatch.setattr("insenv.campaigns.limits.VARIED_RUNS", 3)
    variations = [parse_variation("start.latitude_deg=20:85"), parse_variation("imu.gyro_arw_deg_sqrt_h=0.001:0.01")]
    plan = make_plan(slow_ship(), "analytic", 3, first_seed=1, duration_s=60.0, variations=variations)
    found = run_campaign(plan)
    assert found.limit_note == "" and len(set(found.limit[:, 2])) == 3
    late = found.time >= found.from_s - 1e-9
    assert found.figures()["heading_deg"]["limit"] == pytest.approx(np.sqrt(np.mean(found.limit[:, 2] ** 2)))
    for place in range(3):
        own = limit_of(plan.plant_of(place)).at(found.time[late])["heading_deg"]
        assert found.limit[place, 2] == pytest.approx(np.sqrt(np.mean(own**2)), rel=0.02)

    many = run_campaign(make_plan(slow_ship(), "analytic", 9, first_seed=1, duration_s=1.0, variations=variations))
    assert np.isfinite(many.limit[:, 2]).nonzero()[0].tolist() == [0, 4, 8]
    assert many.as_json()["notes"][-1] == "limit: the root mean square over 3 of the 9 runs, evenly spaced"


def test_equal_campaigns_in_two_folders_have_equal_files(tmp_path):
    given = ("campaign", "ship-swaying", "-e", "analytic", "-n", "8", "--duration", "2", "--no-figure", "--json", "--out")
    for name in ("one", "two"):
        status, out, _ = call(*given, tmp_path / name)
        assert status == 0
        assert json.loads(out)["files"] == [str(tmp_path / name / file) for file in ("campaign.npz", "campaign.json")]
    first, second = ((tmp_path / name / "campaign.json").read_bytes() for name in ("one", "two"))
    assert first == second
    assert json.loads(first)["files"] == ["campaign.npz", "campaign.json"]


def test_the_last_seed_of_a_campaign_has_an_end_that_is_said_in_terms_of_the_first():
    with pytest.raises(InputError, match=r"first seed = 9007199254740990 of 4 runs.* up to 9007199254740989"):
        make_plan(slow_ship(), "analytic", 4, first_seed=2**53 - 2, duration_s=2.0)
    assert make_plan(slow_ship(), "analytic", 4, first_seed=2**53 - 3, duration_s=2.0).runs == 4


def test_the_limit_follows_the_latitude():
    """Beside each run stands the limit of a ship at its own latitude."""
    scenario = slow_ship()
    plan = make_plan(
        scenario, "analytic", 3, first_seed=1, duration_s=60.0, variations=[parse_variation("start.latitude_deg=0:75")]
    )
    found = run_campaign(plan)
    assert found.limit[np.argmax(found.values[:, 0]), 2] > 1.2 * found.limit[np.argmin(found.values[:, 0]), 2]
    late = found.time >= found.from_s - 1e-9
    for latitude, beside in zip(found.values[:, 0], found.limit[:, 2], strict=True):
        data = {**dict(plan.scenario), "start": {**plan.scenario["start"], "latitude_deg": float(latitude)}}
        own = limit(type(scenario).model_validate(data), duration_s=60.0)
        assert beside == pytest.approx(np.sqrt(np.mean(own.at(found.time[late])["heading_deg"] ** 2)), rel=0.02)


def test_lost_samples_are_noted():
    plan = make_plan(slow_ship(drop_probability=0.1), "analytic", 8, first_seed=1, duration_s=2.0)
    found = run_campaign(plan)
    assert "last one received" in " ".join(found.as_json()["notes"]) and found.diverged == ()
    assert small_plan(8).notes == ()


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    pytest.importorskip("distributed", reason="Dask is not installed")
    monkeypatch.setattr("insenv.campaigns.executors.CONNECT_S", 0.3)
    with pytest.raises(InputError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:9'"):
        run_campaign(small_plan(8), workers=cluster("tcp://127.0.0.1:9"))

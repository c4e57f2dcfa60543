"""Error budgets: against closed forms, sums of Gaussian sources, single runs, and what is declared of the sensors."""

import base64
import itertools
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from changed_scenario import changed
from command_line import call, strict
from interpreted import interpreted  # noqa: F401

import insenv
from insenv.core.runner import make_runner
from insenv.report.page import page_json
from insenv.report.tables import number
from insenv.scenario import build, load
from insenv.sensors import IMU, registry
from insenv.studies import budget as budget_module
from insenv.studies.budget import packed, sensors_of, switch_off, switchable
from insenv.studies.budget_result import budget_page, budget_table

PERFECT = {"grade": "perfect", "gyro_bias_deg_h": 0.0, "accel_bias_ug": 0.0}
TRUE_START = {"draw_errors": False, **dict.fromkeys(("roll_error_deg", "pitch_error_deg", "heading_error_deg"), 0.0)}


@pytest.fixture(scope="module")
def small():
    """Four runs of a swaying ship, 2 s at 20 Hz."""
    return insenv.budget(changed("ship-swaying", rate_hz=20.0), "q-method", 4, duration_s=2.0)


def test_sources_of_a_ship_are_those_of_closed_forms_and_sum_in_variance_to_the_whole(monkeypatch):
    """64 runs of 120 s.  Tilt by accelerometer biases: b / g; heading by gyro biases: b / (Omega cos L).

    All sources of this ship are drawn with mean 0: the root sum of squares is the whole, but for chance.  Contributions of
    one run multiply by chance; over n runs 2 sum_{i<j} c_i c_j / sum c^2 has the variance 4 sum_{i<j} s_i s_j / n, s being
    shares, each counted as one draw a run.
    """
    monkeypatch.delenv("INSENV_BACKEND")
    ship = insenv.budget(changed("ship-swaying", rate_hz=20.0), "q-method", 64, duration_s=120.0)
    shares = ship.shares()
    pairs = (1.0 - np.sum(shares**2, axis=0)) / 2.0
    ratio = (ship.rms(ship.whole) / ship.rms(ship.sum)) ** 2 - 1.0
    assert np.all(np.abs(ratio) < 3.0 * np.sqrt(4.0 * pairs / ship.runs) + 1e-3), ratio
    assert np.all(pairs > 0.02)  # there is something to add up
    # a linear method: run by run nothing is left, and a source left out leaves the rest
    assert np.all(ship.rms(ship.interaction) < 2e-3 * ship.rms(ship.whole))
    for k, name in enumerate(ship.sources):
        assert np.allclose(ship.rms(ship.without[k]), ship.rms(ship.sum - ship.alone[k]), rtol=0.25), name

    rows = build(load("ship-swaying")).parameters
    low, high = ship.as_json()["rms_ratio_95"]  # the scatter of 64 draws
    alone = dict(zip(ship.sources, ship.rms(ship.alone), strict=True))
    tilt = np.degrees(np.max(rows["accel_bias_sigma"]) / 9.79)
    heading = np.degrees(np.max(rows["gyro_bias_sigma"]) / (7.292115e-5 * np.cos(np.radians(30.0))))
    # 120 s see the east bias in part only: the heading of a level platform is a matter of the last third
    assert low < alone["accel turn-on bias"][0] / tilt < high
    assert low < alone["accel turn-on bias"][1] / tilt < high
    assert low < alone["gyro turn-on bias"][2] / heading < high


def test_a_fixed_bias_falls_freely():
    """An accelerometer bias of 100 ug down, alone: g b t^2 / 2 of height in 20 s, and nothing else moves."""
    imu = {**PERFECT, "accel_bias_ug": [0.0, 0.0, 100.0]}
    scenario = changed("static-ecef", imu=imu, start={"heading_deg": 0.0}, knowledge=TRUE_START, rate_hz=50.0)
    found = insenv.budget(scenario, "wander-sins", 2, duration_s=20.0)
    assert found.sources == ("accel turn-on bias",)
    down = found.channels.index("down_m")
    fall = 100e-6 * 9.80665 * found.time**2 / 2.0
    assert np.allclose(np.sqrt(found.alone[0, :, down]), fall, rtol=1e-3)
    assert np.sqrt(found.alone[0, -1, found.channels.index("heading_deg")]) < 1e-6
    assert np.sqrt(found.without[0, -1, down]) < 1e-4  # without it, the method alone
    assert np.array_equal(found.without[0], found.none)


@pytest.mark.slow
def test_all_sources_are_the_runs_of_the_seeds():
    scenario = changed("car-city-drive", rate_hz=100.0)
    found = insenv.budget(scenario, "loosely-coupled", 2, seed=7, duration_s=1.5)
    results = [insenv.run(scenario, "loosely-coupled", seed=seed, duration_s=1.5).results[0] for seed in (7, 8)]
    at = np.searchsorted(results[0].time, found.time - 1e-9)
    for place, name in enumerate(found.channels):
        rms = np.sqrt(np.mean([result.errors[name][at] ** 2 for result in results], axis=0))
        assert np.allclose(np.sqrt(found.whole[:, place]), rms, rtol=1e-9, atol=1e-12), name
    assert {"GNSS outliers", "GNSS outages"} <= set(found.sources)


def test_the_receiver_states_the_same_whatever_is_switched_off():
    """Or the filter would be another one: with noise switched off the receiver would say that it is perfect."""
    plant = build(load("car-city-drive"), duration_s=20.0)
    model = switchable(plant.model, sensors_of(plant.scenario))
    assert model is switchable(plant.model, sensors_of(plant.scenario))
    sources = budget_module.sources_of(plant, range(3))
    quiet = [source for source in sources if source.name.startswith("GNSS")]
    whole = packed(model, plant.parameters)
    shown = {
        name: model.outputs.unpack(make_runner(model, vector).run(1000))
        for name, vector in (("whole", whole), ("quiet", switch_off(model, whole, quiet)))
    }
    before = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(1000))
    for name, values in before.items():
        assert np.array_equal(values, shown["whole"][name]), name
    for name in ("gnss_position_sigma", "gnss_velocity_sigma"):
        late = slice(400, None)
        assert np.array_equal(shown["whole"][name][late], shown["quiet"][name][late])
        assert np.all(shown["quiet"][name][late] > 0.01)
    assert not np.array_equal(shown["whole"]["gnss_latitude"], shown["quiet"]["gnss_latitude"])


def test_every_error_row_of_every_sensor_is_in_one_source():
    """What is no error: times, correlation times, lever arms and mountings that are told, the temperature's course."""
    no_error = (
        "_time", "_interval", "_latency", "q_bs", "_lever_arm_b", "_mounting", "imu_temperature", "gnss_has_velocity",
        "_outlier_size", "dvl_water_track", "magnetic_field_n", "magnetic_field_gradient", "heading_baseline_b",
        "heading_length_tolerance",
    )  # fmt: skip
    plain = [section.sensor for section in registry.registered().values()]
    for sensor in (IMU, *plain):
        table = sensor.part(lambda p, x: None).parameters
        rows = [row for source in sensor.errors for row in source.rows]
        assert len(rows) == len(set(rows)), sensor.id
        off = switch_off(SimpleNamespace(parameters=table), np.full(table.size, np.pi), sensor.errors)
        for source in sensor.errors:
            for name in source.rows:
                table[name].check(np.full(table[name].size, source.off))
                assert np.all(off[table.slice(name)] == source.off), name
        left = [name for name in table.names if name not in rows and not any(part in name for part in no_error)]
        assert left == [], sensor.id


@pytest.mark.slow
def test_a_sensor_of_another_package_is_part_of_the_method(monkeypatch):
    real = budget_module.sensors_of
    unknown = {sensor.id: replace(sensor, errors=None, stated=None) for sensor in real(load("car-city-drive"))}
    patched = lambda scenario: tuple(unknown["gnss"] if s.id == "gnss" else s for s in real(scenario))  # noqa: E731
    monkeypatch.setattr(budget_module, "sensors_of", patched)
    settings = {"loosely-coupled": {"rotation_error": 0.0}}
    found = insenv.budget(changed("car-city-drive", rate_hz=100.0), "loosely-coupled", 2, duration_s=3.0, settings=settings)
    assert any(note.startswith("rotation_error = 0 mrad is set") for note in found.notes)
    assert not any(name.startswith("GNSS") for name in found.sources)
    assert any("the errors of gnss are not known" in note for note in found.notes)
    assert found.rms(found.none)[found.channels.index("north_m")] > 0.1


def test_heading_errors_on_both_sides_of_180_deg_are_near_each_other(small, monkeypatch):
    """A whole turn in the error with all sources, or with one of them, is none in what is made of differences."""
    real = budget_module._errors

    def turned(case, progress):
        found, heading = real(case, progress), case.measured.channels.index("heading_deg")
        found[0, 0, :, heading] += 360.0
        found[1, 2, :, heading] -= 360.0
        return found

    monkeypatch.setattr(budget_module, "_errors", turned)
    found = insenv.budget(changed("ship-swaying", rate_hz=20.0), "q-method", 4, duration_s=2.0)
    assert found.alone == pytest.approx(small.alone, rel=1e-6, abs=1e-9)
    assert found.interaction == pytest.approx(small.interaction, rel=1e-6, abs=1e-9)


def test_runs_that_diverge_are_left_out_and_said(small, monkeypatch):
    real = budget_module._errors

    def damaged(case, progress):
        found = real(case, progress)
        found[1, 0, -1] = np.nan  # seed 2 diverges with all sources
        found[1:, 2, -1] = np.nan  # the first source alone diverges in most runs
        return found

    monkeypatch.setattr(budget_module, "_errors", damaged)
    found = insenv.budget(changed("ship-swaying", rate_hz=20.0), "q-method", 4, duration_s=2.0)
    assert found.diverged == (2,)
    assert np.isnan(found.alone[0]).all()
    assert np.isfinite(found.without).all() and np.isfinite(found.alone[1:]).all()
    assert any(f"{found.sources[0]} alone" in note and "interaction" in note for note in found.notes)
    assert np.isfinite(found.whole).all() and not np.array_equal(found.whole, small.whole)
    document = strict(json.dumps(found.document().as_json()))
    assert document["sources"][0]["alone"]["roll_deg"] is None


@pytest.mark.slow
def test_the_command_prints_writes_and_is_json(tmp_path):
    given = ("budget", "ship-swaying", "-e", "q-method", "-n", "2", "--duration", "1")
    status, text, _ = call(*given, "--out", tmp_path / "found")
    assert status == 0 and "root sum of squares" in text
    names = {path.name for path in (tmp_path / "found").iterdir()}
    assert names == {"budget.html", "budget.json", "budget.npz", "budget.png", "budget.svg"}
    document = strict((tmp_path / "found" / "budget.json").read_text("utf-8"))
    assert strict(call(*given, "--json")[1])["sources"] == document["sources"]
    assert 0.0 < sum(source["share"]["heading_deg"] for source in document["sources"]) <= 1.0
    with np.load(tmp_path / "found" / "budget.npz") as arrays:
        assert arrays["alone"].shape == (len(document["sources"]), len(arrays["time"]), 3)
        assert np.allclose(arrays["root_sum_square"] ** 2, arrays["method"] ** 2 + (arrays["alone"] ** 2).sum(axis=0))


def test_the_page_stacks_what_the_budget_holds(small):
    """Bands end at the root of the sums of squares, the highest at that of all; shares add up to 100 %."""
    document = page_json(budget_page(small))
    arrays = [np.frombuffer(base64.b64decode(text), dtype="<f4") for text in document["arrays"]]
    stacks, shares = document["sections"]
    heading = stacks["panels"][2]
    bands = [curve for curve in heading["curves"] if curve["kind"] == "between"]
    assert np.all(arrays[bands[0]["low"]] == 0.0)
    assert all(one["high"] == other["low"] for one, other in itertools.pairwise(bands))
    np.testing.assert_allclose(arrays[bands[-1]["high"]], np.sqrt(small.sum[:, 2]), rtol=1e-6)
    assert np.allclose(arrays[shares["panels"][2]["curves"][-1]["high"]], 100.0)
    largest = small.sources[int(np.argmax(small.shares()[:-1].max(axis=1)))]
    assert document["legend"][bands[0]["group"]]["name"] == largest
    (table,) = document["tables"]
    row = next(row for row in table["rows"] if row[0] == "all sources")
    assert row[1::2] == [number(value) for value in small.rms(small.whole)]
    rising = replace(small, alone=np.ones_like(small.alone) * np.arange(1.0, 1.0 + len(small.sources))[:, None, None] ** 4)
    assert [row[0] for row in budget_table(rising, "", [0, 2]).rows[:2]] == [*small.sources[:-3:-1]]  # the largest first

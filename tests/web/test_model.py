"""The WebAssembly of pages, in wasmtime, gives the numbers of `insenv run` to the bit."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insenv
from insenv.bench.page_machine import PageMachine
from insenv.report.page.html import worker_script
from insenv.scenario import load, names
from insenv.web.controls import setting_of, with_values
from insenv.web.live import Live, live, live_document

wasmtime = pytest.importorskip("wasmtime")
pytest.importorskip("ziglang")


@cache
def page_of(scenario: str, *estimators: str, duration_s: float) -> Live:
    """One page for several tests: its controls are looked for once."""
    return live(scenario, estimators, duration_s=duration_s)


FAST = [("ship-swaying", ("q-method", "qakf")), ("car-city-drive", ("loosely-coupled",))]


def runs(scenario: str, estimators: tuple[str, ...], duration_s: float, seed: int | None = None) -> None:
    """A page's numbers equal those of `insenv.run`: each output of the truth and of the estimators."""
    made = page_of(scenario, *estimators, duration_s=duration_s)
    machine = PageMachine(made)
    assert not wasmtime.Module(wasmtime.Engine(), made.wasm).imports
    if seed is not None:
        machine.begin(seed)
    report = insenv.run(scenario, estimators, duration_s=duration_s, seed=seed)
    shown = machine.named(machine.run(made.plant.samples // made.every * made.every, made.every))
    assert shown["time"].tobytes() == report.truth.time.tobytes()
    for row in ("q_nb", "velocity_n", "latitude", "longitude", "height"):
        assert shown[row].tobytes() == getattr(report.truth, row).tobytes(), row
    for member, result in zip(made.page.members, report.results, strict=True):
        assert member.estimator.id == result.estimator
        for row, values in result.outputs.items():
            assert np.ascontiguousarray(shown[member.prefix + row]).tobytes() == values.tobytes(), (member.estimator.id, row)
        for place, channel in enumerate(member.channels):
            error = shown[f"{member.prefix}error"][:, place]
            np.testing.assert_allclose(error, result.errors[channel], rtol=0, atol=1e-9)
        for place, channel in enumerate(member.stated):
            np.testing.assert_allclose(shown[f"{member.prefix}sigma"][:, place], result.sigma[channel], rtol=1e-12)


@pytest.mark.parametrize(("scenario", "estimators"), FAST)
def test_equals_run(scenario: str, estimators: tuple[str, ...]) -> None:
    runs(scenario, estimators, 60.0 if scenario.startswith("car") else 10.0)


def test_another_seed_starts_as_run_does() -> None:
    runs("car-city-drive", ("loosely-coupled",), 60.0, seed=77)


def cases() -> list[tuple[str, str]]:
    """Every estimator on every scenario that it runs on."""
    found = []
    for name in names():
        plant = insenv.scenario.build(load(name))
        for estimator in insenv.estimators.registry.registered():
            try:
                adapted = plant.adapted(estimator, whole=False)
                plant.parameters_of(adapted, whole=False)
            except insenv.InputError:
                continue
            found.append((name, estimator))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("scenario", names())
def test_every_scenario_and_estimator(scenario: str) -> None:
    own = [estimator for name, estimator in cases() if name == scenario]
    assert own
    for estimator in own:
        runs(scenario, (estimator,), 20.0, seed=5)
        page_of.cache_clear()


CHANGED = {
    "start.latitude_deg": -41.3,
    "start.heading_deg": 123.4,
    "vehicle.sway.roll.0.amplitude_deg": 7.7,
    "vehicle.sway.roll.0.period_s": 9.1,
    "vehicle.sway.pitch.0.phase_deg": 33.3,
    "imu.grade": "tactical",
    "knowledge.heading_error_deg": -1.7,
    "knowledge.tilt_sigma_deg": 0.3,
}


def test_controls_give_the_numbers_of_run() -> None:
    made = page_of("ship-swaying", "q-method", duration_s=10.0)
    by_key = {control.key: control for control in made.controls}
    p, known = np.array(made.parameters), np.array(made.known)
    for key, value in CHANGED.items():
        by_key[key].apply(value, p, known)
    machine = PageMachine(made)
    machine.begin(3, p, known)
    shown = machine.named(machine.run(made.plant.samples, made.every))
    report = insenv.run(with_values(made.values, setting_of(made.controls, CHANGED)), seed=3)
    assert shown["q_nb"].tobytes() == report.truth.q_nb.tobytes()
    assert np.ascontiguousarray(shown["e0_q_nb"]).tobytes() == report.results[0].outputs["q_nb"].tobytes()


NODE = """
const { Session } = require("./worker.cjs"), fs = require("fs");
const [live, messages] = JSON.parse(fs.readFileSync("given.json")), records = [], clouds = [];
let ended;
const end = new Promise((resolve) => { ended = resolve; });
const session = new Session((message) => {
  if (message.got === "error") { console.error(message.message); process.exit(1); }
  if (message.got === "reset") records.length = 0;
  if (message.records) records.push(Buffer.from(message.records.buffer));
  if (message.got === "cloud") clouds.push({ ...message, errors: message.errors.map((one) => [...one]) });
  if (message.got === "toml") fs.writeFileSync("scenario.toml", message.text);
  if (message.got === "end") ended();
});
(async () => {
  await session.receive({ do: "load", live });
  for (const message of messages) {
    await session.receive(message);
    while (session.cloud) await new Promise((resume) => setTimeout(resume, 5));
  }
  await session.receive({ do: "run", speed: null });
  await end;
  await session.receive({ do: "toml" });
  fs.writeFileSync("clouds.json", JSON.stringify(clouds));
  fs.writeFileSync("records.bin", Buffer.concat(records));
  process.exit(0);
})();
"""


def by_worker(made: Live, messages: list[dict[str, Any]], folder: Path) -> dict[str, Any]:
    """Outputs by row name of web/worker.js in Node, which takes the messages and then runs to the end."""
    if shutil.which("node") is None:
        pytest.skip("Node is not installed")
    (folder / "given.json").write_text(json.dumps([live_document(made), messages]))
    (folder / "go.cjs").write_text(NODE)
    (folder / "worker.cjs").write_text(worker_script())
    done = subprocess.run(["node", "go.cjs"], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    model = made.page.model
    return model.outputs.unpack(np.fromfile(folder / "records.bin").reshape(-1, model.outputs.size))


def equal_to_run_of_its_scenario(shown: dict[str, Any], folder: Path, row: str) -> None:
    """`insenv run` of the scenario that the page gives has the numbers of the page."""
    report = insenv.run(folder / "scenario.toml")
    assert shown["q_nb"].tobytes() == report.truth.q_nb.tobytes()
    assert np.ascontiguousarray(shown[f"e0_{row}"]).tobytes() == report.results[0].outputs[row].tobytes()


def test_worker_gives_a_scenario_with_its_numbers(tmp_path: Path) -> None:
    made = page_of("ship-swaying", "q-method", duration_s=10.0)
    messages = [{"do": "reset", "seed": 9, "values": CHANGED}, {"do": "step", "samples": 17}]
    equal_to_run_of_its_scenario(by_worker(made, messages, tmp_path), tmp_path, "q_nb")


def test_worker_cuts_gnss_off_as_the_scenario_says(tmp_path: Path) -> None:
    made = page_of("car-city-drive", "loosely-coupled", duration_s=60.0)
    cut = [{"do": "cut", "sensor": "gnss", "on": on} for on in (True, False, True)]
    messages = [{"do": "step", "samples": 801}, cut[0], {"do": "step", "samples": 1200}, cut[1], {"do": "step", "samples": 900}]
    shown = by_worker(made, [*messages, cut[2]], tmp_path)
    fixes = shown["time"][np.flatnonzero(np.diff(shown["e0_fix_count"], prepend=0.0))]
    assert np.all((fixes < 4.2) | (fixes > 10.0) & (fixes < 14.7)) and len(fixes) == 8
    equal_to_run_of_its_scenario(shown, tmp_path, "fix_count")


def test_a_driven_run_is_run_again_from_its_scenario(tmp_path: Path) -> None:
    """Steer right and brake, then release: `insenv run` of the scenario file follows, and so does a page of it."""
    made = page_of("car-city-drive", "loosely-coupled", duration_s=60.0)
    steer = [
        {"do": "input", "values": values} for values in ({"speed": 9.5, "yaw_rate": 0.2}, {"yaw_rate": -0.1}, {"speed": 0.0})
    ]
    messages = [
        {"do": "step", "samples": 7001},
        steer[0],
        {"do": "step", "samples": 900},
        steer[1],
        {"do": "step", "samples": 333},
    ]
    shown = by_worker(made, [*messages, steer[2]], tmp_path)
    equal_to_run_of_its_scenario(shown, tmp_path, "q_nb")
    other = tmp_path / "other"
    other.mkdir()
    course = by_worker(made, [], other)
    assert np.max(np.abs(shown["offset_n"] - course["offset_n"])) > 10.0
    again = by_worker(live(tmp_path / "scenario.toml"), [], other)
    assert again["q_nb"].tobytes() == shown["q_nb"].tobytes()
    with pytest.raises(insenv.InputError, match="has commands: `insenv run` and `insenv page` follow them, nothing else does"):
        insenv.campaign(tmp_path / "scenario.toml", "loosely-coupled", runs=2)


def test_a_cloud_has_the_errors_of_run(tmp_path: Path) -> None:
    made = page_of("ship-swaying", "q-method", "qakf", duration_s=10.0)
    values = {"start.heading_deg": 77.0}
    by_worker(made, [{"do": "reset", "seed": 1022, "values": values}, {"do": "cloud", "units": 3}], tmp_path)
    clouds = json.loads((tmp_path / "clouds.json").read_text())
    assert [cloud["seed"] for cloud in clouds] == [1021, 1022, 1023]  # the page offers no seed after these
    assert [cloud["done"] for cloud in clouds] == [1, 2, 3]
    scenario = with_values(made.values, values)
    for cloud in clouds:
        report = insenv.run(scenario, seed=cloud["seed"])
        every = round(cloud["interval_s"] / report.truth.time[0])
        for errors, result in zip(cloud["errors"], report.results, strict=True):
            expected = np.stack([result.errors[channel][every - 1 :: every] for channel in result.errors], axis=-1)
            np.testing.assert_allclose(np.reshape(errors, expected.shape), expected, rtol=0, atol=1e-9)


def test_a_cloud_follows_the_commands(tmp_path: Path) -> None:
    made = page_of("ship-swaying", "q-method", duration_s=10.0)
    messages = [{"do": "step", "samples": 401}, {"do": "input", "values": {"sea": 2.0}}, {"do": "step", "samples": 100}]
    by_worker(made, [*messages, {"do": "cloud", "units": 2}], tmp_path)
    for cloud in json.loads((tmp_path / "clouds.json").read_text()):
        (result,) = insenv.run(tmp_path / "scenario.toml", seed=cloud["seed"]).results
        ends = [errors[-1] for errors in result.errors.values()]
        np.testing.assert_allclose(cloud["errors"][0][-3:], ends, rtol=0, atol=1e-9)


def test_the_sea_of_a_moored_ship_is_steered(tmp_path: Path) -> None:
    """A rising sea and a passing wave: `insenv run` of the scenario file follows."""
    made = page_of("ship-swaying", "q-method", duration_s=10.0)
    assert "command_sea" in made.page.model.inputs
    messages = [
        {"do": "step", "samples": 401},
        {"do": "input", "values": {"sea": 2.0}},
        {"do": "step", "samples": 400},
        {"do": "input", "values": {"wave": 1.5}},
    ]
    shown = by_worker(made, messages, tmp_path)
    still = PageMachine(made).run(made.plant.samples, made.every)
    lifted = shown["offset_n"] - made.page.model.outputs.unpack(still)["offset_n"]
    assert np.all(lifted[shown["time"] <= 2.0] == 0.0) and lifted[-1, 2] < -0.5
    equal_to_run_of_its_scenario(shown, tmp_path, "q_nb")


def test_worker_refuses_in_a_sentence(tmp_path: Path) -> None:
    made = page_of("ship-swaying", "q-method", duration_s=10.0)
    for values, sentence in (
        ({"start.latitude_deg": 91}, "start.latitude_deg = 91 deg: allowed is -80 to 80 deg"),
        ({"imu.grade": "golden"}, 'imu.grade = "golden": allowed is'),
        ({"imu.colour": 1}, "imu.colour: this page has no control of that name"),
    ):
        with pytest.raises(AssertionError, match=re.escape(sentence)):
            by_worker(made, [{"do": "reset", "seed": 9, "values": values}], tmp_path)
    count = next(len(control.options) for control in made.controls if control.key == "imu.grade")
    with pytest.raises(AssertionError, match=rf'"tactcal": allowed is one of {count} names, the nearest: tactical, ') as wrong:
        by_worker(made, [{"do": "reset", "seed": 9, "values": {"imu.grade": "tactcal"}}], tmp_path)
    assert len(next(line for line in str(wrong.value).splitlines() if "tactcal" in line)) < 300
    with pytest.raises(AssertionError, match="seed = 5000: allowed is 0 to 1023"):
        by_worker(made, [{"do": "reset", "seed": 5000, "values": {}}], tmp_path)


def test_a_smoother_has_no_page() -> None:
    with pytest.raises(insenv.InputError, match="smooths a whole run"):
        live("car-city-drive", ("smoother",))

"""The WebAssembly of pages, in wasmtime and in the worker in Node, gives the numbers of `insenv run` to the bit."""

import json
from pathlib import Path

import numpy as np
import pytest
import wasmtime
from interpreted import interpreted  # noqa: F401
from live_pages import CAR, SHIP, answers, in_node, live_page

import insenv
from insenv.base.keys import FORMS
from insenv.bench.page_machine import PageMachine
from insenv.report.page import worker_script
from insenv.web.controls import with_values
from insenv.web.live import live_document
from insenv.web.start import not_computed


@pytest.mark.parametrize(("page", "seed"), [(SHIP, None), pytest.param(CAR, 77, marks=pytest.mark.slow)])
def test_equals_run(page, seed):
    """tests/core/test_bits.py compares the outputs of every estimator; here the truth, the errors and the sigmas."""
    made = live_page(*page)
    machine = PageMachine(made)
    assert not wasmtime.Module(wasmtime.Engine(), made.wasm).imports
    if seed is not None:
        machine.begin(seed)
    ids, duration = [member.estimator.id for member in made.page.members], made.plant.duration_s
    report = insenv.run(made.plant.scenario, ids, duration_s=duration, seed=seed)
    shown = machine.named(machine.run(made.plant.samples // made.every * made.every, made.every))
    for row in ("time", "q_nb", "velocity_n", "latitude", "longitude", "height"):
        assert shown[row].tobytes() == getattr(report.truth, row).tobytes(), row
    for member, result in zip(made.page.members, report.results, strict=True):
        for place, channel in enumerate(member.channels):
            error = shown[f"{member.prefix}error"][:, place]
            np.testing.assert_allclose(error, result.errors[channel], rtol=0, atol=1e-9)
        for place, channel in enumerate(member.stated):
            np.testing.assert_allclose(shown[f"{member.prefix}sigma"][:, place], result.sigma[channel], rtol=1e-12)


WORKER = Path(__file__).with_name("host.cjs").read_text("utf-8")
CHANGED = {
    "start.latitude_deg": -41.3, "start.heading_deg": 123.4, "vehicle.sway.roll.0.amplitude_deg": 7.7,
    "vehicle.sway.roll.0.period_s": 9.1, "vehicle.sway.pitch.0.phase_deg": 33.3, "imu.grade": "tactical",
    "knowledge.heading_error_deg": -1.7, "knowledge.tilt_sigma_deg": 0.3,
}  # fmt: skip


def reset(seed, **values):
    return {"do": "reset", "seed": seed, "values": values}


def step(samples):
    return {"do": "step", "samples": samples}


def give(**values):
    return {"do": "input", "values": values}


def by_worker(made, messages, folder):
    """Outputs by row name of web/worker.js in Node, which takes the messages and then runs to the end; clouds and errors."""
    (folder / "worker.cjs").write_text(worker_script())
    told = json.loads(in_node(WORKER, [live_document(made), messages], folder))
    model = made.page.model
    return model.outputs.unpack(np.fromfile(folder / "records.bin").reshape(-1, model.outputs.size)), told


def equal_to_run_of_its_scenario(shown, folder, row):
    """`insenv run` of the scenario that the page gives has the numbers of the page."""
    report = insenv.run(folder / "scenario.toml")
    assert shown["q_nb"].tobytes() == report.truth.q_nb.tobytes()
    assert np.ascontiguousarray(shown[f"e0_{row}"]).tobytes() == report.results[0].outputs[row].tobytes()


@pytest.mark.slow
def test_worker_gives_a_scenario_with_its_numbers_and_refuses_in_a_sentence(tmp_path):
    made = live_page(*SHIP)
    wrong = reset(9, **{"start.latitude_deg": 91}), reset(5000)
    shown, told = by_worker(made, [*wrong, reset(9, **CHANGED), step(17)], tmp_path)
    latitude, seed = told["errors"]
    assert "start.latitude_deg = 91 deg: allowed is -80 to 80 deg" in latitude
    assert "seed = 5000: allowed is 0 to 1023" in seed
    equal_to_run_of_its_scenario(shown, tmp_path, "q_nb")


def test_the_module_computes_the_normals_of_most_start_errors_and_the_page_holds_the_others(tmp_path):
    made = live_page(*SHIP)
    code = "module_machine.Machine.load(given).then((machine) => [...machine.drawn])"
    drawn = answers("machine.js", code, live_document(made), tmp_path)
    assert np.array(drawn).tobytes() == made.normals.tobytes()
    assert len(not_computed(made.normals, made.seeds)[0]) < 0.16 * made.normals.size  # 0.15: the tails


def test_a_control_converts_as_its_key_and_a_cloud_has_the_rms_of_its_units(tmp_path):
    scale, value, forms = 3600.0, 100.1, ("product", "quotient", "degrees", "inverse")
    code = """given.forms.map((form) => {
      const machine = Object.create(module_machine.Machine.prototype), p = [0];
      const targets = [{ into: "p", form, scale: given.scale, at: [0], stated: [] }];
      machine.live = { outages: [] };
      machine.controls = new Map([["key", { minimum: 0, maximum: 1e9, targets }]]);
      machine.set("key", given.value, p, []);
      return p[0];
    })"""
    found = answers("machine.js", code, {"forms": forms, "scale": scale, "value": value}, tmp_path)
    assert found == [float(FORMS[form](value, scale)) for form in forms]
    live = {"channels": {"a": {"label": "a [m]"}}, "estimators": [{"id": "x", "channels": ["a"]}]}
    code = "module_cloud.figures(given.live, given.ends, 0, (end) => [end], false).rows"
    assert answers("cloud.js", code, {"live": live, "ends": [3.0, -4.0]}, tmp_path) == [["a [m]", "3.54", "4.00"]]


def test_a_grade_goes_before_the_numbers_that_replace_its_own(tmp_path):
    """In whatever order a link names them."""
    controls = {"imu.bias_deg_h": {}, "imu.grade": {"options": {}}, "gnss.grade": {"options": {}}, "gnss.noise_m": {}}
    code = """given[1].map((order) => {
        const set = [], values = Object.fromEntries(order.map((key) => [key, 1]));
        const machine = { controls: new Map(Object.entries(given[0])), set: (key) => set.push(key) };
        module_machine.Machine.prototype.apply.call(machine, values);
        return set;
    })"""
    orders = [list(controls), list(controls)[::-1], ["imu.bias_deg_h", "gnss.noise_m", "imu.grade", "gnss.grade"]]
    for order, found in zip(orders, answers("machine.js", code, [controls, orders], tmp_path), strict=True):
        assert sorted(found) == sorted(order) and {key.split(".")[1] for key in found[:2]} == {"grade"}


@pytest.mark.slow
def test_worker_cuts_gnss_off_and_drives_as_the_scenario_says(tmp_path):
    made = live_page(*CAR)
    cut, on = ({"do": "cut", "sensor": "gnss", "on": off} for off in (True, False))
    messages = [step(801), cut, step(1200), on, step(900), cut, step(4100), give(speed=9.5, yaw_rate=0.2), step(900),
                give(yaw_rate=-0.1), step(333), give(speed=0.0)]  # fmt: skip
    shown, _ = by_worker(made, messages, tmp_path)
    fixes = shown["time"][np.flatnonzero(np.diff(shown["e0_fix_count"], prepend=0.0))]
    assert np.all((fixes < 4.2) | (fixes > 10.0) & (fixes < 14.7)) and len(fixes) == 8
    equal_to_run_of_its_scenario(shown, tmp_path, "fix_count")
    equal_to_run_of_its_scenario(shown, tmp_path, "latitude")
    course = PageMachine(made).run(made.plant.samples, made.every)
    assert np.max(np.abs(shown["offset_n"] - made.page.model.outputs.unpack(course)["offset_n"])) > 10.0


@pytest.mark.slow
def test_a_cloud_has_the_errors_of_run_and_follows_the_commands(tmp_path):
    made, values = live_page(*SHIP), {"start.heading_deg": 77.0}
    sea = [step(401), give(sea=2.0), step(100)]
    _, told = by_worker(made, [reset(1022, **values), {"do": "cloud", "units": 3}, *sea, {"do": "cloud", "units": 2}], tmp_path)
    clouds, driven = told["clouds"][:3], told["clouds"][3:]
    assert [cloud["seed"] for cloud in clouds] == [1021, 1022, 1023]  # the page offers no seed after these
    assert [cloud["done"] for cloud in clouds] == [1, 2, 3] and len(driven) == 2
    for cloud in clouds:
        report = insenv.run(with_values(made.values, values), seed=cloud["seed"])
        every = round(cloud["interval_s"] / report.truth.time[0])
        for errors, result in zip(cloud["errors"], report.results, strict=True):
            expected = np.stack([result.errors[channel][every - 1 :: every] for channel in result.errors], axis=-1)
            np.testing.assert_allclose(np.reshape(errors, expected.shape), expected, rtol=0, atol=1e-9)
    for cloud in driven:
        (result,) = insenv.run(tmp_path / "scenario.toml", seed=cloud["seed"]).results
        ends = [errors[-1] for errors in result.errors.values()]
        np.testing.assert_allclose(cloud["errors"][0][-3:], ends, rtol=0, atol=1e-9)

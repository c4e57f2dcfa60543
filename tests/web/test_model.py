"""The WebAssembly of pages, in wasmtime and in the worker in Node, gives the numbers of `insenv run` to the bit."""

import json
from pathlib import Path

import numpy as np
import pytest
import wasmtime
from interpreted import interpreted  # noqa: F401
from live_pages import CAR, SHIP, answers, in_node, live_page, panel_answers

import insenv
from insenv.base.units import FORMS
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


def test_a_cloud_is_drawn_at_the_ends_of_its_intervals_with_the_limit_of_then(tmp_path):
    interval, curves = 2.5, [[0.1, -0.2, 0.3, -0.4], [0.5, 0.6, 0.7, 0.8]]
    limit = {"time_s": [1, 4, 6, 12], "sigma": {"a": [9, 3, 2, 1]}, "floor": {"a": 0}}
    channels = {name: {"title": name, "label": f"{name} [m]", "unit": "m"} for name in "ab"}
    live = {"channels": channels, "estimators": [{"id": "x", "channels": ["b", "a"]}], "limit": limit}
    units = [np.column_stack([np.full(4, 7.0), values]).ravel().tolist() for values in curves]
    code = """const panel = module_cloud.cloudPanel(given.live, () => {}), [, channel] = panel.element.all("select");
    given.units.forEach((one, k) => panel.take({ errors: [one], interval_s: given.interval, done: k + 1, units: 2 }));
    channel.value = "a";
    channel.tell("change");
    return uPlot.plots.at(-1);"""
    x, *drawn, upper, lower = panel_answers("cloud.js", code, {"live": live, "units": units, "interval": interval}, tmp_path)
    assert x == [2.5, 5.0, 7.5, 10.0] and drawn == curves
    expected = np.interp(x, limit["time_s"], limit["sigma"]["a"])
    np.testing.assert_allclose([upper, lower], [expected, -expected], rtol=1e-12)


@pytest.mark.parametrize("order", [("grade", "bias"), ("bias", "grade")])
def test_a_figure_replaces_that_of_a_grade_in_either_order(tmp_path, order):
    code = """(() => {
      const machine = Object.create(module_machine.Machine.prototype), p = [1, 1];
      const target = (at) => ({ into: "p", form: "product", scale: 1, at: [at], stated: [] });
      const grade = { options: [{ value: "good", p: [[0, 5], [1, 6]] }] };
      machine.live = { outages: [] };
      machine.controls = new Map([["grade", grade], ["bias", { minimum: 0, maximum: 9, targets: [target(0)] }]]);
      machine.apply(Object.fromEntries(given), p, []);
      return p;
    })()"""
    given = [(key, {"grade": "good", "bias": 7}[key]) for key in order]
    assert answers("machine.js", code, given, tmp_path) == [7, 6]


def test_an_outage_begins_and_ends_between_the_sample_that_was_measured_and_the_next(tmp_path):
    """By the windows that the page gives to a scenario; here the sensor measures at whole samples."""
    code = """given.map((moments) => {
      const session = Object.create(module.exports.Session.prototype);
      session.live = { rate_hz: 8, outages: [{ sensor: "gnss", key: "gnss.outages_s" }], values: { gnss: {} } };
      Object.assign(session, { values: {}, machine: { setOutages: () => {} }, post: () => {}, unit: { commands: [] } });
      moments.forEach((sample, place) => {
        session.unit.sample = sample;
        session.do_cut({ sensor: "gnss", on: place % 2 === 0 });
      });
      return session.values["gnss.outages_s"];
    })"""
    moments = [[40], [40, 56], [40, 40], [0, 8, 16]]
    found = answers("worker.js", code, moments, tmp_path)
    inside = [[[sample for sample in range(100) if begin <= sample / 8 < end] for begin, end in windows] for windows in found]
    assert inside == [[[*range(41, 100)]], [[*range(41, 57)]], [], [[*range(1, 9)], [*range(17, 100)]]]


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

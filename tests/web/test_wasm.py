"""The WebAssembly of pages, in wasmtime, gives the numbers of `insenv run` to the bit."""

from __future__ import annotations

import json
import shutil
import subprocess
import textwrap

import numpy as np
import pytest
from page_machine import PageMachine

import insenv
from insenv.files.resources import web_folder
from insenv.scenario import load, names
from insenv.web.live import live, live_document

pytest.importorskip("wasmtime")
pytest.importorskip("ziglang")

FAST = [("ship-swaying", ("q-method", "qakf")), ("car-city-drive", ("loosely-coupled",))]


def runs(scenario: str, estimators: tuple[str, ...], duration_s: float | None, seed: int | None = None) -> None:
    """A page's numbers equal those of `insenv.run`: each output of the truth and of the estimators."""
    made = live(scenario, estimators, duration_s=duration_s)
    machine = PageMachine(made)
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
    runs(scenario, estimators, 30.0)


def test_another_seed_starts_as_run_does() -> None:
    runs("car-city-drive", ("loosely-coupled",), 20.0, seed=77)


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


@pytest.mark.skipif(shutil.which("node") is None, reason="Node is not installed")
def test_worker_in_node(tmp_path) -> None:
    """web/worker.js itself, run in slices of its own clock, gives the records of `insenv run`."""
    made = live("ship-swaying", ("q-method",), duration_s=20.0)
    (tmp_path / "live.json").write_text(json.dumps(live_document(made)))
    script = textwrap.dedent("""
        const { Session } = require(process.argv[2]), fs = require("fs");
        const live = JSON.parse(fs.readFileSync("live.json")), records = [];
        const session = new Session((message) => {
          if (message.got === "error") { console.error(message.message); process.exit(1); }
          if (message.records) records.push(Buffer.from(message.records.buffer));
          if (message.got === "end") { fs.writeFileSync("records.bin", Buffer.concat(records)); process.exit(0); }
        });
        (async () => {
          await session.receive({ do: "load", live });
          await session.receive({ do: "step", samples: 17 });
          await session.receive({ do: "run", speed: null });
        })();
    """)
    (tmp_path / "go.cjs").write_text(script)
    worker = str(web_folder() / "worker.js")
    done = subprocess.run(["node", "go.cjs", worker], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    model = made.page.model
    shown = model.outputs.unpack(np.fromfile(tmp_path / "records.bin").reshape(-1, model.outputs.size))
    report = insenv.run("ship-swaying", ("q-method",), duration_s=20.0)
    assert np.ascontiguousarray(shown["e0_q_nb"]).tobytes() == report.results[0].outputs["q_nb"].tobytes()


def test_a_smoother_has_no_page() -> None:
    with pytest.raises(insenv.InputError, match="smooths a whole run"):
        live("car-city-drive", ("smoother",))

"""`lssvm`: its inputs against closed forms, its file, and its training data."""

import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from driven import columns_of, fed, fed_outputs
from resting import samples

from insenv import attitude, geodesy
from insenv.base.errors import InputError, InsenvError
from insenv.estimators import get, lssvm
from insenv.estimators.lssvm import TrainedMachine
from insenv.estimators.settings import tuning
from insenv.reproduce import large_misalignment
from insenv.scenario import build, load
from insenv.studies.learning.training import digest

MODEL = lssvm.MODEL
EMPTY = {row.name: np.zeros(row.shape) for row in lssvm.MACHINE}


def driven(seconds, seed=3, **tuned):
    """Parameters and columns of a run of `large-misalignment`."""
    plant = build(load("large-misalignment"), seed=seed, duration_s=seconds)
    return {**get("lssvm").parameters(plant.knowledge), **tuned}, columns_of(plant)


@pytest.mark.parametrize(("raw", "seconds"), [(1.0, 60.0), (2.0, 1.0)])
def test_raw_inputs_are_the_differences_of_velocity_and_position(raw, seconds):
    """From (20, 20, 60) deg: (R - I) times specific force at rest, integrated once and twice."""
    parameters, columns = driven(60.0, **EMPTY | {"raw_inputs": raw})
    shown = fed_outputs(MODEL, columns, parameters)
    assert shown["ready"][-1] == 1.0
    start, true = (attitude.numeric.to_dcm(q[-1]) for q in (shown["q_nb"], columns["q_nb"]))
    up = np.array([0.0, 0.0, -float(geodesy.numeric.normal_gravity(np.sin(np.radians(32.0)), 0.0))])
    force = (start @ true.T - np.eye(3)) @ up
    velocity, position = shown["features"][-1].reshape(2, 3)
    noise = 0.01 * np.linalg.norm(force) * seconds + 0.1  # the Earth's rotation, and the receiver's
    assert np.abs(velocity - force * seconds).max() < noise
    assert np.abs(position - force * seconds**2 / 2).max() < noise * max(seconds, 1.0)


def test_machine_is_the_sum_over_its_support_vectors():
    rng = np.random.default_rng(0)
    rows = {"support": rng.normal(size=(lssvm.SUPPORT, 6)), "coefficients": rng.normal(size=(lssvm.SUPPORT, 3))}
    rows |= {"offset": rng.normal(size=3), "scale": rng.uniform(0.2, 1, 6), "machine_sigma": np.zeros(3)}
    p, x = ca.SX.sym("p", MODEL.parameters.size), ca.SX.sym("x", 6)
    function = ca.Function("f", [p, x], [lssvm.machine(MODEL.parameters.symbols(p), x)])
    point = rng.normal(size=6)
    square = ((point * rows["scale"] - rows["support"]) ** 2).sum(axis=1)
    expected = np.exp(-square) @ rows["coefficients"] + rows["offset"]
    assert np.allclose(function(MODEL.parameters.pack(rows), point).full().ravel(), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("phi_deg", [(0.0, 0.0, 0.0), (0.5, -0.3, 2.0), (20.0, 10.0, -60.0), (50.0, -40.0, 140.0)])
def test_inputs_against_closed_form(phi_deg):
    """Perfect sensors at rest: acceleration difference (R - I)(-down), its rate (R - I) east, for any R."""
    numeric, latitude, dt, arm = attitude.numeric, 0.56, 0.02, np.array([0.5, 0.2, -1.0])
    q_nb = numeric.from_euler(0.02, -0.03, 0.7)
    columns = samples(q_nb, latitude, 300.0, dt)
    n = len(columns["dt"])
    antenna = geodesy.numeric.geodetic_from_ned_offset(numeric.rotate(q_nb, arm), latitude, 0.3, 10.0)
    places = dict(zip(("latitude", "longitude", "height"), antenna, strict=True))
    columns |= {f"gnss_{name}": np.full(n, value) for name, value in places.items()}
    columns |= {"gnss_valid": (np.arange(1, n + 1) % 50 == 0).astype(float), "gnss_velocity_valid": np.ones(n)}
    columns |= {f"gnss_{name}_sigma": np.full((n, 3), 1e-6) for name in ("position", "velocity")}
    given = numeric.to_euler(numeric.multiply(numeric.from_rotation_vector(np.radians(phi_deg)), q_nb))
    known = {"latitude": latitude, "longitude": 0.3, "height": 10.0, "antenna_lever_arm": arm}
    known |= dict(zip(("start_roll", "start_pitch", "start_heading"), given, strict=True))
    shown = fed(MODEL, columns, known | EMPTY).outputs()
    R, features = numeric.to_dcm(numeric.multiply(shown["q_nb"], numeric.conjugate(q_nb))), shown["features"]
    # the chain takes the rate as constant: its own change, of the Earth's turn squared, is left out where R is large
    size = np.linalg.norm(R - np.eye(3))
    assert np.allclose(features[:3], (R - np.eye(3)) @ [0, 0, -1], atol=1e-5 + 3e-5 * size)
    assert np.allclose(features[3:5], ((R - np.eye(3)) @ [0, 1, 0])[:2], atol=1e-3 + 5e-3 * size)
    assert abs(features[5]) < 0.1  # no sway, no heading by it


def test_sway_shows_the_heading():
    """With a large stated gyro bias the share of the sway grows, and the share of the rate falls as much."""
    parameters, columns = driven(150.0, gyro_bias_sigma=1e-5, **EMPTY)
    y = fed(MODEL, columns, parameters).outputs()
    numeric = attitude.numeric
    R = numeric.to_dcm(numeric.multiply(y["q_nb"], numeric.conjugate(columns["q_nb"][-1])))
    by_sway = y["features"][5]
    heading = np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
    assert abs(by_sway - np.sin(heading)) < 0.06 and abs(y["features"][3]) < 0.05


def test_training_and_evaluation_have_other_scenarios_and_seeds():
    judged, seeds = {*large_misalignment.STARTS.values()}, {*range(1, large_misalignment.SEEDS + 1)}
    plain = {name: load(name).model_dump() for name in [*lssvm.shipped().seeds, *judged]}
    for ours, used in lssvm.shipped().seeds.items():
        assert used and not used & seeds
        for theirs in judged:  # other runs, not the same under another name
            differs = {key for key, value in plain[ours].items() if value != plain[theirs][key]}
            assert {"start", "vehicle", "imu", "knowledge"} <= differs


@pytest.mark.parametrize("name", ["lssvm", "lssvm-printed", "lssvm-printed-reset", "lssvm-printed-validated"])
def test_the_shipped_machines_belong_to_the_present_scenario(name):
    assert lssvm.shipped(name).raw_inputs == {"lssvm": 0, "lssvm-printed-reset": 2}.get(name, 1)
    for each in lssvm.shipped(name).training["runs"]:
        assert each["digest"] == digest(load(each["scenario"]))


def machine(count=5):
    rng = np.random.default_rng(1)
    training = {"runs": [{"scenario": "x", "seeds": [1, 2], "digest": "0", "duration_s": 1.0}]}
    return TrainedMachine(
        rng.normal(size=(count, 6)), rng.normal(size=(count, 3)) * 1e5, rng.normal(size=3), np.full(6, 1 / 3), np.ones(3),
        training, "0.1.0",
    )  # fmt: skip


def test_file_keeps_every_bit(tmp_path):
    one = machine()
    one.save(tmp_path / "m.json")
    other = lssvm.load(tmp_path / "m.json")
    for name in ("support", "coefficients", "offset", "scale", "machine_sigma"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    assert other.training == one.training and other.insenv == "0.1.0" and other.seeds == {"x": {1, 2}}
    assert [p.name for p in tmp_path.iterdir()] == ["m.json"]
    rows = tuning("lssvm", {"file": str(tmp_path / "m.json")})
    assert np.array_equal(rows["support"][:5], one.support) and not rows["coefficients"][5:].any()
    replace(one, raw_inputs=2).save(tmp_path / "m.json")
    assert tuning("lssvm", {"file": str(tmp_path / "m.json")})["raw_inputs"] == 2.0
    with pytest.raises(InputError, match="97 support vectors: allowed is up to 96"):
        machine(97).rows(lssvm.SUPPORT)
    with pytest.raises(InsenvError, match="cannot write"):
        one.save(tmp_path / "none" / "m.json")


@pytest.mark.parametrize(("place", "value", "words"), [
    ("machine.raw_inputs", 3, "machine.raw_inputs is 3"),
    ("format", "other", "its format is not 'insenv-lssvm'"),
    ("version", 2, "version 2: .* version 1; use a newer"),
    ("machine", None, "lacks its machine"),
    ("machine.support", [[1.0, 2.0]], r"machine.support has shape \(1, 2\)"),
    ("machine.scale", [1e999] * 6, "machine.scale .* not finite"),
    ("machine.coefficients", [[1.0, 2.0, 3.0]], "5 support vectors, 1 coefficients"),
])  # fmt: skip
def test_wrong_files_are_errors(tmp_path, place, value, words):
    machine().save(tmp_path / "m.json")
    content = json.loads((tmp_path / "m.json").read_text())
    part, _, name = place.rpartition(".")
    (content[part] if part else content)[name] = value
    (tmp_path / "m.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=words):
        lssvm.load(tmp_path / "m.json")


@pytest.mark.parametrize("data", [b"\xff\xfe\x00", b"[1]", b'{"format":'])
def test_files_of_another_kind(tmp_path, data):
    (tmp_path / "m.json").write_bytes(data)
    with pytest.raises(InputError, match=r"estimator\.lssvm\.file: .*m\.json.* not (JSON|a trained machine)"):
        tuning("lssvm", {"file": str(tmp_path / "m.json")})

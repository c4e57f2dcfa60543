"""Training of the LS-SVM: its linear system, scikit-learn's contract, de-noising, and training from runs to a file."""

import importlib.util
import json

import numpy as np
import pytest
from command_line import call, refused, strict
from sklearn.utils.estimator_checks import estimator_checks_generator

from insenv import attitude
from insenv.base.resources import scenario_folder
from insenv.estimators import lssvm
from insenv.estimators.lssvm import kernel
from insenv.runs.ensemble import ensemble
from insenv.scenario import load
from insenv.studies.learning import training
from insenv.studies.learning.regressor import LSSVMRegressor, pivots, rbf
from insenv.studies.learning.training import EMPTY, Choice, collect, denoised, digest, sine_vector, smooth_misalignment, train

TRAINING = "large-misalignment-training"


def problem_truth(X):
    return np.stack([np.sin(2 * X[:, 0]) + X[:, 1] ** 2, X[:, 2] * X[:, 0], np.full(len(X), 2.0)], axis=1)


def problem(n=60, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1, 1, (n, 3))
    return X, problem_truth(X) + 0.01 * rng.normal(size=(n, 3)) * [1, 1, 0]


def test_kernel_is_the_exponential():
    r = np.concatenate([np.linspace(0, 14, 2001), [39.0, 41.0, 1e6]])
    value = kernel(r)
    assert np.allclose(value[:2001], np.exp(-r[:2001]), rtol=1e-7, atol=0)
    assert (value[2001:] < 1e-16).all() and (value > 0).all() and kernel(0.0) == 1.0


def test_fit_solves_the_printed_linear_system():
    X, y = problem()
    m = LSSVMRegressor(gamma=20.0, sigma=0.7).fit(X, y)
    n = len(X)
    K = np.exp(-((X[:, None] - X[None]) ** 2).sum(-1) / 0.7**2)
    A = np.block([[np.zeros((1, 1)), np.ones((1, n))], [np.ones((n, 1)), K + np.eye(n) / 20.0]])
    solution = np.linalg.solve(A, np.vstack([np.zeros(3), y]))
    assert np.allclose(m.intercept_, solution[0], atol=1e-6)
    assert np.allclose(m.dual_coef_, solution[1:], atol=1e-5)
    assert np.abs(m.dual_coef_.sum(axis=0)).max() < 1e-9  # sum of a = 0
    assert np.allclose(m.dual_coef_ / 20.0, y - m.predict(X), atol=1e-6)  # a = gamma e


def test_fixed_size_with_all_samples_is_the_whole_problem():
    """The fixed-size formulas with all samples as support vectors, except one of weight 0."""
    X, y = problem(40)
    more, weights = np.vstack([X, [[5.0, 5.0, 5.0]]]), np.r_[np.ones(40), 1e-12]
    whole = LSSVMRegressor(gamma=10.0, sigma=0.6).fit(X, y)
    fixed = LSSVMRegressor(gamma=10.0, sigma=0.6, support=40).fit(more, np.vstack([y, [0, 0, 0]]), weights)
    there = np.random.default_rng(3).uniform(-1, 1, (50, 3))
    assert len(fixed.support_) == 40
    assert np.sqrt(np.mean((fixed.predict(there) - whole.predict(there)) ** 2)) < 0.01
    few = LSSVMRegressor(gamma=1e3, sigma=1.5, support=25).fit(X, y)
    assert np.sqrt(np.mean((few.predict(there) - problem_truth(there)) ** 2)) < 0.05


def test_pivots_are_those_of_the_kernel_matrix():
    X, _ = problem(50)
    chosen = pivots(X, 0.8, 20)
    assert len(set(chosen.tolist())) == 20
    K = rbf(X, X, 0.8)
    for count in (5, 20):  # each pivot is where the previous ones leave the largest remainder
        before = chosen[: count - 1]
        part = K[:, before]
        rest = np.diag(K) - np.einsum("ij,ij->i", part @ np.linalg.inv(K[np.ix_(before, before)]), part)
        assert rest[chosen[count - 1]] > rest.max() * (1 - 1e-6)
    assert len(pivots(np.zeros((5, 2)), 1.0, 3)) == 1  # identical samples give one support vector


@pytest.mark.parametrize(("support", "sigma"), [pytest.param(None, 1.0, marks=pytest.mark.slow), (50, 10.0)])
def test_scikit_learn_contract(support, sigma):
    left_out = {"check_array_api_input"}  # for libraries other than NumPy; needs a setting before SciPy is imported
    if support is not None:  # repeated samples have other pivots than weighted ones
        left_out |= {"check_sample_weight_equivalence_on_dense_data", "check_sample_weight_equivalence_on_sparse_data"}
    count = 0
    for estimator, check in estimator_checks_generator(LSSVMRegressor(sigma=sigma, support=support)):
        if getattr(check, "func", check).__name__ not in left_out:
            check(estimator)
            count += 1
    assert count > 30


@pytest.mark.parametrize("parameters", [{"gamma": 0.0}, {"sigma": -1.0}, {"support": 0}])
def test_wrong_parameters_are_refused(parameters):
    with pytest.raises(ValueError, match=next(iter(parameters))):
        LSSVMRegressor(**parameters).fit(*problem())


def test_denoised_misalignment_of_any_size():
    rng = np.random.default_rng(1)
    numeric = attitude.numeric
    constant = numeric.from_rotation_vector(np.array([1.0, -0.5, 2.4]))
    noise = numeric.from_rotation_vector(rng.normal(size=(400, 3)) * 1e-3)
    sins = numeric.from_rotation_vector(rng.normal(size=(400, 3)))
    filter = numeric.multiply(numeric.conjugate(numeric.multiply(noise, constant)), sins)
    found = smooth_misalignment(sins, filter)
    away = numeric.to_rotation_vector(numeric.multiply(found, numeric.conjugate(constant)))
    assert np.abs(away[50:-50]).max() < 2e-3 and np.sqrt(np.mean(away**2)) < 0.7e-3
    q = numeric.from_rotation_vector(np.array([[0.0, 0.3, 0.4], [0.0, 0.0, 3.0]]))
    assert np.array_equal(denoised(noise[:5]), noise[:5])  # too short for a wavelet level
    assert np.allclose(sine_vector(q), [[0, 0.6 * np.sin(0.5), 0.8 * np.sin(0.5)], [0, 0, np.sin(3.0)]])


CHOICE = Choice(gammas=(1e4, 1e5), sigmas=(2.0,), support=48)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A small machine from ten runs of three minutes."""
    told = []
    machine = train([TRAINING], range(500, 510), duration_s=180.0, choice=CHOICE, progress=lambda *news: told.append(news))
    path = tmp_path_factory.mktemp("machine") / "tiny.json"
    machine.save(path)
    return machine, path, told


@pytest.mark.slow
def test_a_trained_machine_aligns_what_it_has_not_seen(trained):
    """From initial errors of any size; without the machine the SINS keeps its initial error."""
    _, path, _ = trained
    scenario = load("large-misalignment-extreme")
    seeds = range(3)

    def last_errors(tuning):
        found = ensemble(scenario, ["lssvm"], seeds, duration_s=150.0, records=15, tuning={"lssvm": tuning})
        return np.abs(found.attitude_errors_deg("lssvm")[:, -1])

    aligned = last_errors(lssvm.read_file(str(path)))
    assert aligned[:, 2].max() < 2.0
    assert aligned[:, :2].max() < 0.2
    assert last_errors(EMPTY)[:, 2].max() > 90.0


@pytest.mark.slow
def test_conditions_are_kept_and_training_is_repeatable(trained):
    machine, path, told = trained
    loaded = lssvm.load(path)
    assert loaded.seeds == {TRAINING: set(range(500, 510))}
    run = loaded.training["runs"][0]
    assert run["duration_s"] == 180.0 and run["digest"] == digest(load(TRAINING))
    assert loaded.training["parameters"]["gamma"] in CHOICE.gammas and loaded.training["parameters"]["support"] == 48
    assert loaded.training["samples"] == 24 * loaded.training["runs_used"] == 240
    assert loaded.training["scores"]["relative_error"] < 0.5
    again = train([TRAINING], range(500, 510), duration_s=180.0, choice=CHOICE)
    for one in (loaded, again):
        assert np.array_equal(one.support, machine.support) and np.array_equal(one.coefficients, machine.coefficients)
    assert told[0] == ("simulating", 1, 5) and told[-1] == ("learning", 8, 8)


@pytest.mark.slow
def test_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training, "GAMMAS", (1e4,))
    arguments = ("train", "lssvm", TRAINING, "--seeds", "20-24", "--duration", "120", "--support", "20", "-o", "m.json")
    code, out, err = call(*arguments, "--json")
    assert code == 0, err
    answer = strict(out)
    assert answer["file"] == "m.json" and answer["runs"][0]["seeds"] == [20, 21, 22, 23, 24]
    assert answer["parameters"]["support"] == 20 == len(json.loads((tmp_path / "m.json").read_text())["machine"]["support"])
    text = (scenario_folder() / "large-misalignment.toml").read_text("utf-8").replace("600.0", "60.0")
    scenario = text + '\n[estimator.lssvm]\nfile = "m.json"\n'
    (tmp_path / "own.toml").write_text(scenario)
    code, out, err = call("run", "own.toml", "-e", "lssvm", "--json")
    assert code == 0, err
    (tmp_path / "own.toml").write_text(scenario.replace("m.json", "n.json"))
    refused(call("run", "own.toml", "-e", "lssvm"), "lssvm", "file", "n.json")


@pytest.mark.slow
def test_the_printed_machine(tmp_path, monkeypatch):
    """c = 15 and delta^2 = 0.2, inputs over their standard deviation, the angles as outputs, no weights."""
    monkeypatch.chdir(tmp_path)
    call("train", "lssvm", TRAINING, "--seeds", "20-24", "--duration", "120", "--as-printed", "-o", "m.json")
    machine = lssvm.load("m.json")
    assert machine.raw_inputs == 1
    assert machine.training["parameters"] == {"gamma": 30.0, "sigma": np.sqrt(0.2), "support": 96}
    samples = collect([load(TRAINING)], range(20, 25), 120.0, None, 1)
    size = samples.inputs.std(axis=0)
    plain = LSSVMRegressor(30.0, np.sqrt(0.2), 96).fit(samples.inputs / size, samples.outputs)
    here = samples.inputs[::7]
    square = ((here[:, None] * machine.scale - machine.support) ** 2).sum(axis=-1)
    found = np.exp(-square) @ machine.coefficients + machine.offset
    assert np.allclose(found, plain.predict(here / size), rtol=1e-6, atol=1e-7)
    assert np.abs(samples.inputs[:, 3:]).max() > 1e4  # m: the SINS runs free


def test_missing_packages_are_named(monkeypatch):
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "pywt" else real(name, *rest))
    refused(call("train", "lssvm", TRAINING, "--seeds", "1-9"), "PyWavelets", "pip install")

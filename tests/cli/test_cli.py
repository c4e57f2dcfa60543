"""The command line: output, exit statuses, failed work."""

import warnings

import pytest
from command_line import SHORT, call, strict

from insenv import run
from insenv.base import errors
from insenv.cli import main
from insenv.evaluation.errors import ATTITUDE


def test_run_prints_a_table_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(*SHORT)
    assert (status, err) == (0, "") and not list(tmp_path.iterdir())
    assert "heading [deg]" in out and "rms/limit" in out and "--out" in out
    assert max(map(len, out.splitlines())) <= 80


def test_run_json_is_one_document_with_the_documented_keys_repeatable_by_seed():
    status, out, err = call(*SHORT, "--json", "--seed", 5, "-e", "q-method")
    found = strict(out)
    assert (status, err) == (0, "")
    assert (found["scenario"], found["seed"], found["duration_s"], found["imu_samples"]) == ("ship-swaying", 5, 10.0, 2000)
    (result,) = found["results"]
    assert result["estimator"] == "q-method" and result["us_per_sample"] > 0 and "files" not in found
    assert all(set(result[kind]) == set(ATTITUDE) for kind in ("final", "rms", "max", "limit"))
    again, other = (strict(call(*SHORT, "--json", "--seed", seed)[1])["results"][0] for seed in (5, 2))
    assert result["rms"] == again["rms"] != other["rms"]


def test_bench_and_schema(monkeypatch):
    monkeypatch.setattr("insenv.bench.speed.NUMERIC_REPETITIONS", 1)
    status, out, err = call("bench", "--only", "numeric.one", "--json")
    found = strict(out)
    assert (status, err) == (0, "") and set(found) == {"machine", "figures"}
    assert {"name", "value", "unit", "floor", "n"} <= set(found["figures"][0])
    status, out, _ = call("schema")
    assert status == 0 and {"vehicle", "imu", "duration_s"} <= set(strict(out)["properties"])


def test_an_error_is_a_json_document_too():
    for arguments in (["run", "nonesuch"], ["run", "x", "--nonesuch"], ["reproduce", "quaternions"]):
        status, out, err = call(*arguments, "--json")
        found = strict(out)["error"]
        assert status == 2 and found["type"] == "InputError" and found["message"] in err
    assert "did you mean 'quaternion'" in err


@pytest.mark.parametrize(("fault", "status", "word"), [
    (errors.InsenvError("it diverged"), 1, "it diverged"),
    (errors.InputError("a = 2 m: allowed is 1 m"), 2, "allowed is 1 m"),
    (OSError(28, "No space left on device"), 1, "No space left"),
    (MemoryError(), 1, "out of memory"),
    (ZeroDivisionError("division by zero"), 1, "internal error: ZeroDivisionError"),
    (KeyboardInterrupt(), 130, "interrupted, nothing written"),
])  # fmt: skip
def test_faults_become_one_line(monkeypatch, fault, status, word):

    def fail(*_, **__):
        raise fault

    monkeypatch.setattr("insenv.runs.simulated.run", fail)
    code, out, err = call(*SHORT)
    assert (code, out) == (status, "") and word in err and err.count("\n") == 1
    assert strict(call(*SHORT, "--json")[1])["error"]["message"] in err
    monkeypatch.setenv("INSENV_DEBUG", "1")
    with pytest.raises(type(fault)):  # and a traceback on request
        main(list(SHORT))


def test_warnings_are_one_line(monkeypatch):
    def warning(*arguments, **options):
        for _ in range(2):
            warnings.warn("no C compiler found", RuntimeWarning, stacklevel=1)
        return run(*arguments, **options)

    monkeypatch.setattr("insenv.runs.simulated.run", warning)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert call(*SHORT)[2] == "insenv: warning: no C compiler found\n"

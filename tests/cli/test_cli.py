"""The command line: output, files, exit statuses, failed and interrupted work."""

import os
import re
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from command_line import SHORT, call, log_file, refused, strict

from insenv import errors, run
from insenv.cli import main
from insenv.cli.interruptions import Interruptions
from insenv.cli.output import print_parts
from insenv.evaluation.errors import ATTITUDE
from insenv.report.tables import table_of

# as installed, but with Ctrl-C enabled even if the parent ignores it, as shells do for background jobs
PROGRAM = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from insenv.cli import main; main()"


def start(*arguments, program=PROGRAM, **options):
    """Start the command line in a process of its own."""
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


# --- commands ----------------------------------------------------------------------------------------


def test_list():
    status, out, err = call("list")
    assert (status, err) == (0, "") and max(map(len, out.splitlines())) <= 80
    status, listed, err = call("list", "--json")
    listed = strict(listed)
    assert {"scenarios", "estimators", "imu_grades", "gnss_grades", "environments"} <= set(listed) and (status, err) == (0, "")
    names = [row["name"] for row in listed["scenarios"] if "paper" not in row["title"]]
    names += [
        row["name"] for key in ("imu_grades", "gnss_grades") for row in listed[key] if not row["name"].startswith("paper-")
    ]
    names += [row["id"] for row in listed["estimators"] if not row["id"].endswith("-printed")]
    names += [row["kind"] for row in listed["vehicles"]] + [row["id"] for row in listed["sensors"]]
    assert {"ship-swaying", "q-method", "marine", "aircraft", "gnss"} <= set(names) and all(name in out for name in names)


def test_run_prints_a_table_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(*SHORT)
    assert (status, err) == (0, "") and not list(tmp_path.iterdir())
    assert "heading [deg]" in out and "rms/limit" in out and "--out" in out
    assert max(map(len, out.splitlines())) <= 80
    assert not [line for line in (*out.splitlines(), *call("list")[1].splitlines()) if line.endswith(" ")]


def test_run_json_is_one_document_with_the_documented_keys():
    status, out, err = call(*SHORT, "--json", "--seed", 5, "-e", "q-method", "-e", "q-method")
    found = strict(out)
    assert (status, err) == (0, "")
    assert (found["scenario"], found["seed"], found["duration_s"], found["imu_samples"]) == ("ship-swaying", 5, 10.0, 2000)
    (result,) = found["results"]
    assert result["estimator"] == "q-method" and result["us_per_sample"] > 0 and "files" not in found
    assert all(set(result[kind]) == set(ATTITUDE) for kind in ("final", "rms", "max", "limit"))


def test_run_writes_files(tmp_path):
    status, out, err = call(*SHORT, "--out", tmp_path / "new" / "out", "--json")
    files = [Path(path) for path in strict(out)["files"]]
    kinds = ("npz", "json", "html", "png", "svg")
    assert (status, err) == (0, "") and {p.name for p in files} == {f"ship-swaying.{kind}" for kind in kinds}
    assert sorted(files) == sorted((tmp_path / "new" / "out").iterdir())
    with np.load(files[0]) as arrays:
        assert arrays["truth/q_nb"].shape == (len(arrays["truth/time"]), 4)
    status, out, _ = call(*SHORT, "--out", tmp_path / "other", "--no-figure")
    assert status == 0 and "ship-swaying.npz" in out and len(list((tmp_path / "other").iterdir())) == 2


def test_run_is_repeatable_and_the_seed_matters():
    first, again, other = (strict(call(*SHORT, "--json", "--seed", seed)[1])["results"][0] for seed in (1, 1, 2))
    assert first["rms"] == again["rms"] != other["rms"]


def test_schema_describes_the_scenarios():
    status, out, _ = call("schema")
    assert status == 0 and {"vehicle", "imu", "duration_s"} <= set(strict(out)["properties"])


def test_bench():
    status, out, err = call("bench", "--only", "import", "--json")
    found = strict(out)
    assert (status, err) == (0, "") and set(found) == {"machine", "figures"}
    assert {"name", "value", "unit", "floor", "n"} <= set(found["figures"][0])
    status, out, _ = call("bench", "--only", "import")
    assert status == 0 and "import.insenv" in out and max(map(len, out.splitlines())) <= 80
    assert call("bench", "--only", "nonesuch")[0] == 2


def test_version_and_help():
    assert call("--version")[1].startswith("insenv 0.")
    for arguments in (["--help"], ["run", "-h"], ["replay", "--help"]):
        status, out, err = call(*arguments)
        assert (status, err) == (0, "") and "Usage" in out
    status, out, _ = call()
    assert status == 2 and "Usage" in out
    assert re.search(r"\bstream\b", out)


@pytest.mark.parametrize("command", ["run", "replay"])
def test_help_names_the_table_of_the_settings(command):
    """Square brackets are markup to the help: the table's name was missing in it."""
    shown = " ".join(call(command, "--help")[1].replace("│", " ").split())
    assert "table estimator.ID;" in shown


def test_an_unknown_paper_is_named():
    status, _, err = call("reproduce", "quaternions")
    assert status == 2 and "did you mean 'quaternion'" in err


def standing(fixes):
    """The fixes of a CSV file, all at the place of the first."""
    header, *rows = fixes.splitlines()
    place = rows[0].split(",")[1:]
    return "\n".join([header, *(",".join([row.split(",")[0], *place]) for row in rows)]) + "\n"


def test_replay(tmp_path):
    log = log_file(tmp_path, gnss=standing)
    status, out, err = call("replay", log, "-e", "q-method", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    kinds = {path.suffix for path in (tmp_path / "out").iterdir()}
    assert "heading" in out and kinds == {".npz", ".json", ".html", ".png", ".svg"}
    found = strict(call("replay", log, "-e", "q-method", "--json")[1])
    assert found["seed"] is None and found["results"][0]["rms"] == {}
    refused(call("replay", log_file(tmp_path), "-e", "q-method"), "aligns a vehicle in place", "9.86 m/s", "moves")


def test_unwritable_folder_is_reported_before_the_work(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("insenv.runs.simulated.run", lambda *_, **__: pytest.fail("the work was begun"))
    refused(call(*SHORT, "--out", tmp_path / "file" / "out"), "file/out", "is not a folder")


def test_an_error_is_a_json_document_too():
    for arguments, kind in ((["run", "nonesuch"], "InputError"), (["run", "x", "--nonesuch"], "InputError")):
        status, out, err = call(*arguments, "--json")
        found = strict(out)["error"]
        assert status == 2 and found["type"] == kind and found["message"] in err


# --- work that fails ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "status", "word"),
    [
        ("InsenvError('it diverged')", 1, "it diverged"),
        ("InputError('a = 2 m: allowed is 1 m')", 2, "allowed is 1 m"),
        ("OSError(28, 'No space left on device')", 1, "No space left"),
        ("MemoryError()", 1, "out of memory"),
        ("ZeroDivisionError('division by zero')", 1, "internal error: ZeroDivisionError"),
        ("KeyboardInterrupt()", 130, "interrupted, nothing written"),
    ],
)
def test_faults_become_one_line(monkeypatch, fault, status, word):
    def fail(*_, **__):
        raise eval(fault, vars(errors))

    monkeypatch.setattr("insenv.runs.simulated.run", fail)
    code, out, err = call(*SHORT)
    assert (code, out) == (status, "") and word in err and err.count("\n") == 1
    assert strict(call(*SHORT, "--json")[1])["error"]["message"] in err


def test_debug_shows_the_traceback(monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setenv("INSENV_DEBUG", "1")
    monkeypatch.setattr("insenv.runs.simulated.run", fail)
    with pytest.raises(ZeroDivisionError):
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


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_in_a_long_run_leaves_nothing(tmp_path):
    begun = tmp_path / "begun"
    tell = f"import pathlib, insenv.core.runner as r; f = r.InterpreterRunner.run; p = pathlib.Path({str(begun)!r}); "
    tell += "r.InterpreterRunner.run = lambda *a, **k: (p.touch(), f(*a, **k))[1]; "
    process = start(
        "run",
        "ship-swaying",
        "--duration",
        "80000",
        "--out",
        tmp_path / "out",
        program=tell + PROGRAM,
        env={**os.environ, "INSENV_BACKEND": "interpreter"},
    )
    try:
        for _ in range(600):
            if begun.exists():
                break
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (130, "", "insenv: interrupted, nothing written\n")
    assert list(tmp_path.iterdir()) == [begun]


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_that_casadi_would_discard_is_raised_after_it():
    scope = {}
    exec(compile("def converted(act):\n try: act()\n except BaseException: pass", "casadi/casadi.py", "exec"), scope)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with Interruptions(), pytest.raises(KeyboardInterrupt):
            scope["converted"](lambda: os.kill(os.getpid(), signal.SIGINT))
            time.sleep(10.0)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_while_the_call_is_parsed_is_reported(monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("insenv.cli.options.partial", interrupted)
    assert call("list") == (130, "", "insenv: interrupted, nothing written\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_full_disk_on_stdout():
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-c", PROGRAM, "list"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1 and "No space left" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_closed_pipe_is_not_an_error():
    process = start("schema")
    process.stdout.close()
    assert (process.stderr.read(), process.wait(30)) == ("", 141)
    process.stderr.close()


@pytest.mark.parametrize(
    "command",
    [("budget", "ship-swaying"), ("tune", "car-city-drive"), ("fmu", "export", "ship-swaying", "-o", "x.fmu"),
     ("fmu", "ssp", "ship-swaying", "-o", "x.ssp"), ("stream", "ship-swaying", "--to", "udpout:127.0.0.1:14999")],
)  # fmt: skip
def test_a_command_that_runs_one_estimator_refuses_two(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(*command, "-e", "q-method", "-e", "analytic")
    assert (status, out) == (2, "") and "-e q-method -e analytic: allowed is one estimator" in err
    assert not list(tmp_path.iterdir())


def test_a_table_wider_than_the_screen_is_not_cut(capsys):
    cell = "walk 25.2 [19.4, 31.5] deg/h/sqrt(h), " * 4
    table = table_of("first", "second")
    table.add_row("a b", cell)
    print_parts([table])
    assert cell.strip() in capsys.readouterr().out

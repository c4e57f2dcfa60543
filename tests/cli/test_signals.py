"""How signals end the command, at any time; standard streams that are closed or full, and a reader that leaves."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import SHORT
from places import ROOT

from insenv.base import starting
from insenv.cli.signals import Interruptions, ignore_from_now_on

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals and pipes of POSIX")

COMMAND = [sys.executable, "-m", "insenv"]
HEARING = (
    "import os, signal, sys\n"
    "for name in ('SIGINT', 'SIGTERM', 'SIGHUP'): signal.signal(getattr(signal, name), signal.SIG_DFL)\n"
    "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])\n"
)
"""Starts Python with every signal at its default, also where the tests run with some ignored."""
ENDS = [
    ("SIGINT", 130, "insenv: interrupted, nothing written\n"),
    ("SIGTERM", 143, "insenv: ended by SIGTERM, nothing written\n"),
    ("SIGHUP", 129, "insenv: ended by SIGHUP, nothing written\n"),
]


def environment(**more):
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


def ended(arguments, name, begun, **options):
    """Start Python with arguments, send the signal once the file `begun` exists; give status, stdout and stderr."""
    command = [sys.executable, "-c", HEARING, *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)
    try:
        for _ in range(1200):
            if begun.exists() or process.poll() is not None:
                break
            time.sleep(0.05)
        process.send_signal(getattr(signal, name))
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    return process.returncode, out, err


@pytest.fixture
def slow_import(tmp_path):
    """Environment of a process in which the first import of the command or of a script never ends; the file that it makes."""
    begun = tmp_path / "begun"
    (tmp_path / "path").mkdir()
    code = f"import pathlib, time\npathlib.Path({str(begun)!r}).touch()\ntime.sleep(60)\n"
    for module in ("typer", "gymnasium"):
        (tmp_path / "path" / f"{module}.py").write_text(code)
    return environment(PYTHONPATH=f"{tmp_path / 'path'}{os.pathsep}{ROOT}"), begun


@pytest.mark.parametrize(("name", "status", "line"), ENDS)
def test_a_signal_while_the_modules_load_ends_in_one_line_and_a_json_document(slow_import, name, status, line):
    env, begun = slow_import
    found, out, err = ended(["-m", "insenv", *SHORT, "--json"], name, begun, env=env)
    assert (found, err) == (status, line) and json.loads(out)["error"]["message"] in line


def test_a_script_that_imports_insenv_keeps_its_signals(slow_import):
    env, begun = slow_import
    status, _, err = ended(["-c", "import insenv"], "SIGINT", begun, env=env)
    assert status == -signal.SIGINT and "KeyboardInterrupt" in err


def test_a_signal_in_a_long_run_leaves_nothing(tmp_path):
    begun = tmp_path / "begun"
    program = (
        "import pathlib, insenv.core.runner as r; from insenv.cli import main; f = r.InterpreterRunner.run; "
        f"r.InterpreterRunner.run = lambda *a, **k: (pathlib.Path({str(begun)!r}).touch(), f(*a, **k))[1]; main()"
    )
    arguments = ["-c", program, "run", "ship-swaying", "--duration", "80000", "--out", tmp_path / "out"]
    answer = ended(arguments, "SIGTERM", begun, env=environment(INSENV_BACKEND="interpreter"))
    assert answer == (143, "", "insenv: ended by SIGTERM, nothing written\n")
    assert list(tmp_path.iterdir()) == [begun]


@pytest.mark.parametrize(("argv", "orig", "is_it"), [
    (["/usr/bin/insenv", "list"], ["python", "/usr/bin/insenv", "list"], True),
    (["-m", "list"], ["python", "-W", "error", "-m", "insenv", "list"], True),
    (["-m", "list"], ["python", "-m", "insenv.bench", "list"], False),
    (["my_insenv.py"], ["python", "my_insenv.py"], False),
    ([], ["python"], False),
])  # fmt: skip
def test_the_command_is_told_from_a_script(argv, orig, is_it):
    assert starting.is_command(argv, orig) is is_it


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


def test_signals_that_are_ignored_stay_ignored(monkeypatch):
    """As SIGHUP below nohup, and SIGINT in the background jobs of a script."""
    monkeypatch.setattr(starting, "is_command", lambda *_: True)
    before = {number: signal.getsignal(number) for number in starting.SIGNALS}
    try:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        starting.prepare()
        with Interruptions():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            os.kill(os.getpid(), signal.SIGHUP)  # nothing happens
        assert signal.getsignal(signal.SIGINT) is signal.getsignal(signal.SIGTERM) is starting.end
        ignore_from_now_on()
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.slow
def test_a_campaign_in_processes_is_ended_by_sigterm(tmp_path):
    """Its workers, which no terminal tells, end too."""
    folder = tmp_path / "campaign"
    arguments = ["campaign", "ship-swaying", "-e", "q-method", "-n", "100000", "--workers", "2", "--out", folder]
    status, out, err = ended(["-m", "insenv", *arguments], "SIGTERM", folder, env=environment())
    assert (status, out) == (143, "") and err.splitlines()[-1].startswith("insenv: ") and "Traceback" not in err


PYTHON = f"'{sys.executable}' -m insenv"


def shell(line):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(["bash", "-c", line], env=environment, capture_output=True, text=True, timeout=120)
    assert "Traceback" not in done.stderr and "internal error" not in done.stderr
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("command", ["schema", pytest.param("list", marks=pytest.mark.slow)])
def test_a_reader_that_has_gone_ends_a_command_with_141(command):
    """The output of `schema` is larger than a pipe holds; that of others stays in buffers until the end."""
    assert shell(f"(sleep 0.01; {PYTHON} {command}; echo $? >&2) | true") == (0, "", "141\n")


def test_a_closed_stdout_is_named_after_the_work_and_without_stderr_the_status_tells(tmp_path):
    status, _, err = shell(f"{PYTHON} run ship-swaying -e analytic --duration 1 --no-figure --out '{tmp_path}' >&-")
    assert status == 1 and err.endswith("insenv: standard output is closed\n")
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".json", ".npz"]
    assert shell(f"{PYTHON} run nonesuch >&- 2>&-")[0] == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_full_disk_on_stdout():
    status, _, err = shell(f"{PYTHON} list >/dev/full")
    assert status == 1 and "No space left" in err

"""Calls of the command line for the tests of it."""

import io
import json
import os
from contextlib import redirect_stderr, redirect_stdout
from unittest import mock

import pytest
from places import ROOT

from insenv.cli import main

SHORT = ("run", "ship-swaying", "--duration", "10")


def call(*arguments):
    """Run a command line in this process; give its exit status, stdout and stderr without the line that says it compiles."""
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.dict(os.environ, INSENV_DEBUG="0"),
        redirect_stdout(out),
        redirect_stderr(err),
        pytest.raises(SystemExit) as ended,
    ):
        main([str(argument) for argument in arguments])
    return ended.value.code, out.getvalue(), err.getvalue().replace("insenv: compiling, once\n", "")


def log_file(folder, **changes):
    """Write a log of a turning car, its files changed by functions of their text (imu, gnss, toml); give the description."""
    for kind, name in (("imu", "plain-imu.csv"), ("gnss", "plain-gnss.csv"), ("toml", "plain.toml")):
        text = (ROOT / "tests" / "logs" / "data" / name).read_text("utf-8")
        (folder / name).write_text(changes.get(kind, str)(text), encoding="utf-8")
    return folder / "plain.toml"


def strict(text):
    """Parsed JSON; fails on NaN and Infinity."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


def refused(answer, *words, status=2):
    """One clear line on stderr with all `words`, nothing on stdout."""
    code, out, err = answer
    assert (code, out) == (status, ""), err
    assert "Traceback" not in err and "internal error" not in err
    assert err.startswith("insenv: ") and err.count("\n") <= 6
    missing = [word for word in words if word not in err]
    assert not missing, f"{missing} not in {err!r}"

"""Shared fixtures: a small model that exercises everything a model can do."""

import gc
import os
import sys

import casadi as ca
import pytest
from _pytest.mark.expression import Expression
from hypothesis import settings

from insenv.core.cache import usable_folder
from insenv.core.compile import LIBRARY
from insenv.core.elementary import normal_pair, sin_cos
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.tables import Row, Table

# without it each of some hundred processes, and each worker of pytest-xdist, would compile all modules anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# models are compiled at the lowest level, which takes half the time: the bits are the same (tests/core/test_bits.py)
os.environ.setdefault("INSENV_OPTIMIZATION", "0")

# the same examples on every machine: a run that passes here passes there
settings.register_profile("same", derandomize=True)
settings.load_profile("same")


COMPILED = pytest.StashKey[set[str]]()


def cached_models() -> set[str]:
    folder = usable_folder()
    return set() if folder is None else {path.name for path in folder.iterdir() if (path / LIBRARY).exists()}


def pytest_configure(config: pytest.Config) -> None:
    config.stash[COMPILED] = cached_models()
    for path in (argument.partition("::")[0] for argument in config.args):  # workers of pytest-xdist would not say it
        if not (config.invocation_params.dir / path).exists():
            raise pytest.UsageError(f"{path}: no such file or folder")
    for flag, name in (("-k", "keyword"), ("-m", "markexpr")):
        try:
            Expression.compile(config.getoption(name) or "a")
        except Exception as error:  # ParseError, since pytest 9 SyntaxError
            said = str(error).partition(" (<")[0]
            raise pytest.UsageError(f"{flag} {config.getoption(name)!r}: {said}; allowed is such as 'A and not B'") from None


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, exitstatus: pytest.ExitCode, config: pytest.Config
) -> None:
    if exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED:
        chosen = [f"{flag} {value!r}" for flag in ("-k", "-m") if (value := config.getoption(flag))]
        terminalreporter.write_line(f"no test matches {' '.join([*config.args, *chosen])}", red=True)
    found = cached_models()
    new = len(found - config.stash[COMPILED])
    terminalreporter.write_line(f"{new} models compiled, {len(found)} in the cache")


def pytest_collection_finish() -> None:
    """What is there when the first test begins stays to the end: no garbage collection need look at it."""
    gc.collect()
    gc.freeze()


def _sample(p, x, u, r):
    s, c = sin_cos(x.position[0])
    first, second = normal_pair(r[0], r[1])
    noise = ca.vertcat(first, second, r[2] - 0.5)
    step = x.step + 1
    return {
        "step": step,
        "position": x.position + p.gain * u.push + noise,
        "matrix": x.matrix + ca.horzcat(ca.vertcat(s, c), ca.vertcat(c, -s)),
        "rare_due": step - p.period * ca.floor(step / p.period) == 0,
    }


TOY = Model(
    id="toy", title="noise, a rare step by state, one by input, a matrix",
    parameters=Table((SEED, Row("gain", "Gain of push", start=2.0), Row("period", "Advances from one to the next", start=3.0))),
    state=Table((
        STEP, Row("position", "Where it is", "m", (3,), lower=-1e9, upper=1e9), Row("rare_due", "1 when the rare step is due"),
        Row("rare", "Rare steps so far"), Row("untouched", "No step changes it", start=7.0),
        Row("matrix", "A matrix, not symmetric", shape=(2, 2), start=((1.0, 2.0), (3.0, 4.0))), Row("kicks", "Kicks so far"),
    )),
    inputs=Table((Row("push", "Push", "m", (3,)), Row("kick", "1 to kick"))),
    outputs=Table((Row("place", "Where it is", "m", (3,)), Row("sum", "Rare, kicks, untouched"), Row("corner", "Upper right"))),
    steps={
        "sample": Step(_sample, uniforms=3),
        "rare": Step(lambda p, x, u, r: {"rare": x.rare + 1, "position": x.position * r[0]}, when="rare_due", uniforms=1),
        "kick": Step(lambda p, x, u: {"kicks": x.kicks + 1}, when="kick"),
    },
    output=lambda p, x: {"place": x.position, "sum": x.rare + x.kicks + x.untouched, "corner": x.matrix[0, 1]},
    start=lambda p, r: {"position": ca.vertcat(r[0], r[1], p.gain)}, start_uniforms=2,
)  # fmt: skip


@pytest.fixture(scope="session")
def toy() -> Model:
    return TOY

"""A model as portable C: the same bits whatever the compiler may do, and a status for every wrong value."""

import ctypes
import math
import re
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest
from peers import program

from insenv.base.errors import InputError
from insenv.core.compile import find_compiler
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.portable import Portable, c_files
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table

OK, NOT_FINITE, OUT_OF_RANGE, NOT_WHOLE, WRONG_DT, DIVERGED = range(6)
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
DEVIATIONS = {"2.3", "8.9", "15.5", "21.15"}
"""Rules of MISRA C:2012 that the C does not keep; docs/microcontroller.md gives the reasons."""
N = 40  # rows that one step changes: a loop, and more than one piece


def toy():
    """A filter of nothing: three steps, of which two have a condition, one on an input and one on the state."""

    def predict(p, x, u):
        ring = {"a": x.b * u.dt + 1e-3 * u.fix_speed, "b": x.c + u.rate[1], "c": x.a * p.gain}
        return {**ring, "count": x.count + 1.0, "due": x.count > 1.0}

    def update(p, x, u):
        return {"many": ca.sqrt(ca.fabs(x.many * 0.9 + u.fix_place * x.a)) - x.b / 3.0, "a": x.a + ca.sum1(x.many) / 7.0}

    def halve(p, x, u):
        return {"b": x.b * 0.5}

    place, speed = Row("fix_place", "place", "m", start=2.0, lower=-5.0, upper=5.0), Row("fix_speed", "speed")
    rate, dt = Row("rate", "rate", "rad/s", (3,), "b"), Row("dt", "length", "s", start=0.01, lower=1e-6, upper=10.0)
    inputs = rate, dt, flag("fix_valid"), place, flag("fix_speed_valid"), speed
    parameters = Row("gain", "gain", "1/s", start=0.7, lower=0.0), Row("orders", "orders", start=2.0, whole=True)
    many = Row("many", "many", shape=(N,), start=1.0)
    state = *(Row(name, name) for name in ("a", "b", "c", "count", "due")), many
    steps = {"predict": Step(predict), "update": Step(update, when="fix_valid"), "halve": Step(halve, when="due")}
    tables = map(Table, (parameters, state, inputs, (Row("a", "a"), many)))
    output, start = lambda p, x: {"a": x.a + p.gain, "many": x.many * 3.0}, lambda p: {"b": p.gain * 2.0}
    return Model("toy", "toy", *tables, steps, output, start)


def flag(name):
    return Row(name, "whether there is one", lower=0, upper=1, flag=True)


def write(folder, model, single=()):
    start = model.parameters.start_vector()
    elements = [row.name in single for row in model.state for _ in range(row.size)]
    texts = c_files(model, Portable("toy", start, (0.005, 0.02), "Those of the test.", elements if single else ()))
    for name, text in texts.items():
        (folder / name).write_text(text)


class Filter:
    """A filter of the C of a model, through ctypes."""

    def __init__(self, model, folder, *flags, single=()):
        write(folder, model, single)
        command = [*find_compiler().command, "-std=c99", *flags, "-shared", "-fPIC", "toy.c", "-o", "toy.so", "-lm"]
        self.compiled = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        self.model, self.memory = model, ctypes.create_string_buffer(100_000)
        if not self.compiled.returncode:
            self.library = ctypes.CDLL(str(folder / "toy.so"))

    def init(self, **parameters):
        values = {**self.model.parameters.unpack(self.model.parameters.start_vector()), **parameters}
        return self._call(self.library.toy_init, np.array([values[name] for name in self.model.parameters.names], dtype=float))

    def sample(self, row):
        return self._call(self.library.toy_sample, np.array(row))

    def output(self):
        values = np.zeros(self.model.outputs.size)
        return self._call(self.library.toy_output, values), values

    def _call(self, function, values):
        return function(self.memory, ctypes.c_void_p(values.ctypes.data))

    @property
    def wrong(self):
        return ctypes.cast(self.memory, ctypes.POINTER(ctypes.c_int))[0]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    return Filter(toy(), tmp_path_factory.mktemp("portable"), "-O1", *WARNINGS)


def rows(count):
    drawn = np.random.default_rng(5)
    inputs = np.tile(toy().inputs.start_vector(), (count, 1))
    inputs[:, :3] = drawn.normal(size=(count, 3))
    inputs[:, 4], inputs[:, 5] = drawn.random(count) < 0.3, drawn.normal(size=count)
    return inputs


@pytest.mark.parametrize("flags", [("-O0",), ("-O2", "-march=native", "-ffp-contract=fast")])
def test_every_sample_has_the_bits_of_a_runner_even_if_the_compiler_is_told_to_fuse(tmp_path, flags):
    here, runner, inputs = Filter(toy(), tmp_path, *flags), make_runner(toy(), backend="interpreter"), rows(60)
    assert here.init() == OK
    assert here.output()[1].tobytes() == runner.output().tobytes()
    for row, expected in zip(inputs, runner.run(60, inputs), strict=True):
        assert here.sample(row) == OK
        status, values = here.output()
        assert status == OK
        assert values.tobytes() == expected.tobytes()


def test_rows_in_single_precision_are_updated_in_it_and_read_in_double(tmp_path):
    """The bits of NumPy, operation by operation."""
    here, inputs, f = Filter(toy(), tmp_path, "-O2", *WARNINGS, single=["many"]), rows(8), np.float32
    assert here.init() == OK
    inputs[:, 4], inputs[:, 7], many, b, gain = 1.0, 1234.5, np.ones(N, f), 1.4, 0.7
    a = c = 0.0
    for k, row in enumerate(inputs):
        a, b, c = b * row[3] + 1e-3 * row[7], c + row[1], a * gain
        a, many = a + sum(map(float, many)) / 7.0, np.sqrt(np.abs(many * f(0.9) + f(row[5] * a))) - f(b / 3.0)
        assert here.sample(row) == OK
        status, values = here.output()
        b *= 0.5 if k > 1 else 1.0
        assert (status, values[0]) == (OK, a + gain)
        assert values[1:].tobytes() == (many.astype(float) * 3.0).tobytes()


def test_a_constant_beyond_single_precision_is_refused():
    table = Table((Row("a", "a"),))
    for constant in (1e-60, 1e60):
        steps = {"go": Step(lambda p, x, u, constant=constant: {"a": x.a * constant})}
        model = Model("m", "m", table, table, table, table, steps, lambda p, x: vars(x))
        with pytest.raises(InputError, match=rf"a constant of the model is {re.escape(repr(constant))}: allowed in single"):
            c_files(model, Portable("m", np.zeros(1), (0.0, 1.0), "", [True]))


WRONG = [
    (1, math.nan, NOT_FINITE), (2, math.inf, NOT_FINITE), (3, 0.0, OUT_OF_RANGE), (3, 0.0049, WRONG_DT), (3, 0.0201, WRONG_DT),
    (4, 0.5, NOT_WHOLE), (4, 2.0, OUT_OF_RANGE), (5, 5.1, OUT_OF_RANGE), (5, -5.1, OUT_OF_RANGE), (7, math.nan, NOT_FINITE),
]  # fmt: skip


@pytest.mark.parametrize(("place", "value", "status"), WRONG)
def test_a_wrong_input_has_a_status_and_a_place_and_the_sample_does_not_count(compiled, place, value, status):
    row = np.array([0.0, 0.0, 0.0, 0.01, 1.0, 1.0, 1.0, 1.0])
    wrong = row.copy()
    wrong[place] = value
    compiled.init()
    before = compiled.output()[1]
    assert (compiled.sample(wrong), compiled.wrong) == (status, place)
    assert compiled.output()[1].tobytes() == before.tobytes()
    assert compiled.sample(row) == OK


@pytest.mark.parametrize("flags", [(0.0, 1.0), (1.0, 0.0)])
def test_what_a_flag_switches_off_may_hold_anything(compiled, flags):
    """Also through the flag of its flag: a speed counts only in a fix that is valid."""
    compiled.init()
    valid, speed_valid = flags
    assert compiled.sample([0.0, 0.0, 0.0, 0.01, valid, 9.0 if not valid else 1.0, speed_valid, math.nan]) == OK
    assert compiled.output()[0] == OK


def test_a_wrong_parameter_and_a_filter_that_diverges_have_a_status(compiled):
    assert (compiled.init(gain=-1.0), compiled.wrong) == (OUT_OF_RANGE, 0)
    assert (compiled.init(orders=1.5), compiled.wrong) == (NOT_WHOLE, 1)
    assert compiled.init(gain=1e200) == OK
    for _ in range(4):
        compiled.sample([0.0, 0.0, 0.0, 0.01, 1.0, 1.0, 0.0, 0.0])
    assert (compiled.output()[0], compiled.wrong) == (DIVERGED, 0)


def test_options_that_change_results_are_refused_at_compile_time(tmp_path):
    assert "-ffast-math changes the results" in Filter(toy(), tmp_path, "-ffast-math").compiled.stderr


@pytest.mark.parametrize(("method", "refused"), [(0, False), (1, False), (2, True), (16, False), (64, False), (-1, True)])
def test_double_is_evaluated_as_itself(tmp_path, method, refused):
    """C11, 5.2.4.2.2, and ISO/IEC TS 18661-3: GCC says 16 of processors that have arithmetic of half precision."""
    made = Filter(toy(), tmp_path, "-U__FLT_EVAL_METHOD__", f"-D__FLT_EVAL_METHOD__={method}")
    assert ("double is evaluated with more digits" in made.compiled.stderr) == refused


def test_a_random_model_and_a_row_that_is_a_keyword_are_refused():
    none = Table((Row("seed2", "one"),))
    random = Model(
        "r", "r", Table((SEED,)), Table((STEP,)), none, none, {"s": Step(lambda p, x, u, r: {}, uniforms=1)}, lambda p, x: {}
    )
    with pytest.raises(InputError, match="'r' is random"):
        c_files(random, Portable("r", np.zeros(1), (0.0, 1.0), ""))
    keyword = Table((Row("register", "one"),))
    model = Model("k", "k", keyword, none, none, none, {}, lambda p, x: {"seed2": x.seed2})
    with pytest.raises(InputError, match="row 'register' of model 'k'"):
        c_files(model, Portable("k", np.zeros(1), (0.0, 1.0), ""))


def test_it_is_c_plus_plus_too(tmp_path):
    write(tmp_path, toy())
    compiler = shutil.which("g++") or pytest.skip("no g++ on the path")
    subprocess.run([compiler, "-x", "c++", "-std=c++11", *WARNINGS, "-c", "toy.c"], cwd=tmp_path, check=True)


@pytest.mark.slow
def test_cppcheck_finds_nothing_but_the_stated_deviations_from_misra(tmp_path):
    write(tmp_path, toy())
    checks = ["--addon=misra", "--enable=warning,style,performance,portability", "--std=c99", "--quiet"]
    known = ["-D__GNUC__=12", "-DDBL_MANT_DIG=53", "-DDBL_MAX_EXP=1024"]
    command = [program("cppcheck", how="apt-get install cppcheck"), *checks, *known, "toy.c"]
    told = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stderr
    assert set(re.findall(r"\[(.+)\]$", told, re.MULTILINE)) == {f"misra-c2012-{rule}" for rule in DEVIATIONS}, told

"""Models that may share kept equations have one identity: all that decides the equations is in it."""

import functools
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from insenv.core import identity as identities
from insenv.core.identity import identity
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import get, registered

STATE = Table((Row("a", "A number", "m", start=1.0),))
STEP = """
def made(held, more=0):
    def step(p, x, u, k=2, *, last=5):
        return {'a': x.a + len(str(held)) + more}
    return step
"""


def made(held, text=STEP, module="insenv.made"):
    """A step that holds a value, of a module of insenv."""
    space = {"__name__": module}
    exec(text, space)
    return space["made"](held)


def model(step, **changes):
    tables = {"parameters": Table(), "state": STATE, "inputs": Table(), "outputs": STATE, **changes}
    return Model(id="m", title="", **tables, steps={"go": Step(step)}, output=made(0))


X = ca.SX.sym("x")
HELD = {
    "number": lambda: 1.0,
    "whole number": lambda: 1,
    "flag": lambda: True,
    "text": lambda: "1.0",
    "nothing": lambda: None,
    "tuple": lambda: (1.0,),
    "list": lambda: [1.0],
    "dict": lambda: {"a": 1.0},
    "dict of another key": lambda: {"b": 1.0},
    "set": lambda: {1.0, 2.0, 3.0},
    "array": lambda: np.array([1.0, 2.0]),
    "array of one other number": lambda: np.array([1.0, 2.5]),
    "array of another shape": lambda: np.array([[1.0, 2.0]]),
    "array of another type": lambda: np.array([1.0, 2.0], dtype=np.float32),
    "number of NumPy": lambda: np.float64(1.0),
    "table": lambda: STATE,
    "row of another meaning": lambda: Row("a", "Another number", "m", start=1.0),
    "row of another unit": lambda: Row("a", "A number", "km", start=1.0),
    "equations": lambda: ca.Function("f", [X], [2 * X]),
    "other equations": lambda: ca.Function("f", [X], [3 * X]),
    "function": lambda: made(2.0),
    "function with another value": lambda: made(3.0),
    "partial": lambda: functools.partial(made(2.0), 1),
    "partial of another value": lambda: functools.partial(made(2.0), 2),
    "namespace": lambda: SimpleNamespace(a=1.0),
    "method": lambda: STATE.slice,
    "class": lambda: Row,
    "builtin": lambda: len,
    "values": lambda: {"a": 1.5}.values(),
}


def test_what_a_step_holds_is_told_apart_by_its_value():
    found = {name: identity(model(made(make()))) for name, make in HELD.items()}
    assert None not in found.values() and len(set(found.values())) == len(HELD)
    assert {name: identity(model(made(make()))) for name, make in HELD.items()} == found  # made again


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("x.a +", "x.a -"),
        ("x.a + len", "2 * x.a + len"),
        ("more=0", "more=1"),
        ("k=2", "k=3"),
        ("last=5", "last=6"),
        ("'a': x", "'b': x"),
        ("def made", "\ndef made"),
    ],
)
def test_another_code_is_another_identity(old, new):
    assert old in STEP
    assert identity(model(made(0))) != identity(model(made(0, STEP.replace(old, new)))) is not None


def test_tables_and_steps_are_in_it(monkeypatch):
    base = model(made(0))
    others = [
        replace(base, state=STATE + Table((Row("b", "b"),))),
        replace(base, state=Table((replace(STATE["a"], start=2.0),))),
        replace(base, outputs=Table((replace(STATE["a"], upper=5.0),))),
        replace(base, steps={"go": Step(made(0), when="a")}),
        replace(base, steps={"on": Step(made(0))}),
        replace(base, start=made(0)),
        replace(base, output=made(1)),
    ]
    found = [identity(one) for one in (base, *others)]
    monkeypatch.setattr(identities, "_environment", lambda: "other sources, or another version of CasADi")
    found.append(identity(base))
    assert None not in found and len(set(found)) == len(found)


def outside(p, x, u):
    return {"a": x.a}


FACTOR = 2.0


@functools.wraps(made(0))
def wrapping(p, x, u):
    """Named as the function of insenv that it wraps."""
    return {"a": FACTOR * x.a}


class Unknown:
    pass


@pytest.mark.parametrize(
    "step",
    [outside, wrapping, made(outside), made([outside]), made(Unknown()), made(Unknown), made(np.array([None])), made(X),
     made(functools.cache(made(0)))],
)  # fmt: skip
def test_what_may_depend_on_anything_has_no_identity(step):
    assert identity(model(step)) is None


def test_a_thing_may_hold_itself():
    held = [1.0]
    held.append(held)
    assert identity(model(made(held))) == identity(model(made(held))) is not None


def test_every_estimator_has_one_of_its_own():
    found = [identity(get(id).model) for id in registered()]
    assert None not in found and len(set(found)) == len(found)

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
from insenv.scenario import build, load

STATE = Table((Row("a", "A number", "m", start=1.0),))
STEP = """
def made(held, more=0):
    def step(p, x, u, k=2, *, last=5):
        return {'a': x.a + len(str(held)) + more}
    return step
"""


def made(held, text=STEP):
    """A step that holds a value, of a module of insenv."""
    space = {"__name__": "insenv.made"}
    exec(text, space)
    return space["made"](held)


def model(step):
    return Model(id="m", title="", parameters=Table(), state=STATE, inputs=Table(), outputs=STATE,
                 steps={"go": Step(step)}, output=made(0))  # fmt: skip


X = ca.SX.sym("x")


def held():
    """Values of which each is another one than the others."""
    plain = [1.0, 1, True, "1.0", None, (1.0,), [1.0], {"a": 1.0}, {"b": 1.0}, {1.0, 2.0, 3.0}, {"a": 1.5}.values()]
    arrays = [np.array([1.0, 2.0]), np.array([1.0, 2.5]), np.array([[1.0, 2.0]]), np.array([1.0, 2.0], dtype=np.float32)]
    rows = [STATE, Row("a", "Another number", "m", start=1.0), Row("a", "A number", "km", start=1.0)]
    equations = [ca.Function("f", [X], [2 * X]), ca.Function("f", [X], [3 * X])]
    functions = [made(2.0), made(3.0), functools.partial(made(2.0), 1), functools.partial(made(2.0), 2), STATE.slice, Row, len]
    return [*plain, *arrays, np.float64(1.0), *rows, *equations, *functions, SimpleNamespace(a=1.0)]


def test_what_a_step_holds_is_told_apart_by_its_value():
    found = [identity(model(made(value))) for value in held()]
    assert None not in found and len(set(found)) == len(found)
    assert [identity(model(made(value))) for value in held()] == found
    itself = [1.0]
    itself.append(itself)
    assert identity(model(made(itself))) == identity(model(made(itself))) is not None


def test_tables_steps_and_code_are_in_it(monkeypatch):
    base = model(made(0))
    others = [
        replace(base, state=STATE + Table((Row("b", "b"),))), replace(base, state=Table((replace(STATE["a"], start=2.0),))),
        replace(base, outputs=Table((replace(STATE["a"], upper=5.0),))), replace(base, steps={"go": Step(made(0), when="a")}),
        replace(base, steps={"on": Step(made(0))}), replace(base, start=made(0)), replace(base, output=made(1)),
    ]  # fmt: skip
    texts = {"x.a +": "x.a -", "x.a + len": "2 * x.a + len", "more=0": "more=1", "k=2": "k=3", "last=5": "last=6",
             "'a': x": "'b': x", "def made": "\ndef made"}  # fmt: skip
    others += [model(made(0, STEP.replace(old, new))) for old, new in texts.items()]
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


def using(value):
    """A step that uses a value by a global name."""
    space = {"__name__": "insenv.made", "value": value}
    exec("def step(p, x, u):\n    return {'a': value(x.a)}", space)
    return space["step"]


class Unknown:
    pass


@pytest.mark.parametrize(
    "step",
    [outside, wrapping, made([outside]), made(Unknown()), made(Unknown), made(np.array([None])), made(X),
     made(functools.cache(made(0))), using(outside)],
)  # fmt: skip
def test_what_may_depend_on_anything_has_no_identity(step):
    assert identity(model(step)) is None


@pytest.mark.parametrize("scenario", ["car-odometer", "multirotor-hover", "ship-dvl"])
def test_plants_and_filters_with_instruments_have_one(scenario):
    plant = build(load(scenario))
    assert None not in [identity(one) for one in (plant.model, plant.adapted(get("fusion"), None, offline=False).model)]


def test_every_estimator_has_one_of_its_own():
    found = [identity(get(id).model) for id in registered()]
    assert None not in found and len(set(found)) == len(found)


@pytest.mark.parametrize(("place", "value"), [
    ("insenv.estimators.analytic.TURN", 3.0), ("insenv.estimators.analytic._line", made(0)),
    ("insenv.estimators.ecef_kf.AXIS_E", ca.SX([0, 0, 7e-5])), ("insenv.geodesy.q_ew_from_geodetic", made(0)),
    ("insenv.geodesy.E2", 0.0067), ("insenv.core.elementary._SIN", [1.0, -0.1]),
    ("insenv.core.tables.Table.slice", made(0)),
])  # fmt: skip
def test_what_a_script_replaces_is_seen(place, value, monkeypatch):
    before = identity(get("ecef-kf").model), identity(get("analytic").model)
    monkeypatch.setattr(place, value)
    after = identity(get("ecef-kf").model), identity(get("analytic").model)
    assert after != before and None not in after

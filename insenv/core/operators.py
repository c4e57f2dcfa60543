"""CasADi's operators without the search for their overload, while equations are traced.

`x * y` of two SX takes 20 us in Python, of which the node takes 2: CasADi tries to convert both to numbers, arrays and sparse
matrices before it takes them for what they are.  A model has some ten thousand such operations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import casadi as ca

_FORWARD = {
    "__add__": ca.OP_ADD,
    "__sub__": ca.OP_SUB,
    "__mul__": ca.OP_MUL,
    "__truediv__": ca.OP_DIV,
    "__lt__": ca.OP_LT,
    "__le__": ca.OP_LE,
    "__eq__": ca.OP_EQ,
    "__ne__": ca.OP_NE,
}
_REVERSED = {
    "__radd__": ca.OP_ADD,
    "__rsub__": ca.OP_SUB,
    "__rmul__": ca.OP_MUL,
    "__rtruediv__": ca.OP_DIV,
    "__gt__": ca.OP_LT,
    "__ge__": ca.OP_LE,
}
_PLAIN = frozenset((ca.SX, float, int))


@contextmanager
def quick_operators() -> Iterator[None]:
    """Operators of SX with SX or plain numbers make the same node at once; all others are CasADi's, as all are afterwards."""
    for name, quick in _QUICK.items():
        setattr(ca.SX, name, quick)
    try:
        yield
    finally:
        for name, usual in _USUAL.items():
            setattr(ca.SX, name, usual)


def _quick(name: str) -> Callable[[Any, Any], Any]:
    usual, make = _USUAL[name], ca.SX.binary
    if name in _REVERSED:
        operation = _REVERSED[name]
        return lambda x, y: make(operation, y, x) if type(y) in _PLAIN else usual(x, y)
    operation = _FORWARD[name]
    return lambda x, y: make(operation, x, y) if type(y) in _PLAIN else usual(x, y)


_USUAL = {name: getattr(ca.SX, name) for name in (*_FORWARD, *_REVERSED)}
_QUICK = {name: _quick(name) for name in _USUAL}

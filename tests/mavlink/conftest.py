"""Fixtures of the MAVLink tests."""

import socket
from contextlib import ExitStack

import pytest
from interpreted import interpreted  # noqa: F401

from insenv.mavlink.wire import open_link


@pytest.fixture
def opened():
    with ExitStack() as stack:
        yield lambda *a, **k: stack.enter_context(open_link(*a, **k))


@pytest.fixture
def sockets():
    """Plain sockets that are closed at the end: bound to loopback, or connected to a port of it."""
    with ExitStack() as stack:

        def make(kind=socket.SOCK_DGRAM, bound=False, to=None):
            made = stack.enter_context(socket.socket(socket.AF_INET, kind))
            made.settimeout(5)
            if bound:
                made.bind(("127.0.0.1", 0))
            if to is not None:
                made.connect(("127.0.0.1", to))
            return made

        yield make

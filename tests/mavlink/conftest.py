"""Fixtures of the MAVLink tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from insenv.mavlink.wire import Link, open_link


@pytest.fixture
def opened() -> Iterator[Callable[..., Link]]:
    """Open links that are closed at the end."""
    with ExitStack() as stack:
        yield lambda *a, **k: stack.enter_context(open_link(*a, **k))

"""Fixtures of the tests of environments."""

import pytest


@pytest.fixture(autouse=True, scope="module")
def interpreted():
    """These episodes are short: compiling would take longer than running them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("INSENV_BACKEND", "interpreter")
        yield

"""Fixtures of the command line's tests."""

import pytest


@pytest.fixture(autouse=True, scope="module")
def interpreted():
    """No model is compiled here: the runs are short."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("INSENV_BACKEND", "interpreter")
        yield

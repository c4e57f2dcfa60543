"""Short drives on the interpreter: their scenarios are compiled nowhere else."""

import pytest


@pytest.fixture(autouse=True, scope="module")
def interpreted():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("INSENV_BACKEND", "interpreter")
        yield

"""`import insenv` stays cheap: heavy packages load inside the functions that need them."""

import subprocess
import sys

import pytest

import insenv
from insenv.estimators.parts.rows import FIX_HEALTH

ROWS = FIX_HEALTH.names
SIZES = [row.shape for row in FIX_HEALTH.rows]
HEAVY = ("matplotlib", "sklearn", "fmpy", "pymavlink", "dask", "scipy.signal", "pandas", "torch")


def loaded_by(statement: str) -> set[str]:
    """Names of the modules that a fresh interpreter holds after `statement`."""
    script = f"{statement}\nimport sys\nprint(*sys.modules, sep='\\n')"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize("statement", ["import insenv", "import insenv.cli"])
def test_import_loads_nothing_heavy(statement):
    assert loaded_by(statement).isdisjoint(HEAVY)


def test_import_of_the_package_alone_registers_the_environments_and_loads_none():
    loaded = loaded_by("import insenv")
    assert "gymnasium" in loaded and loaded.isdisjoint({"casadi", "scipy", "insenv.envs", "insenv.core"})


def test_the_health_of_a_running_filter_loads_no_more_than_its_quantiles_need():
    started = "from insenv.evaluation.live_health import LiveHealth; LiveHealth()"
    loaded = loaded_by(started)
    assert "scipy.special" in loaded and "scipy.stats" not in loaded
    judged = f"import numpy as np; {started}.take(0.0, dict(zip({ROWS}, map(np.ones, {SIZES}))), None)"
    assert {name for name in loaded_by(judged) - loaded if name.startswith("scipy")} == set()


def test_submodules_load_on_first_use():
    assert "insenv.core" in loaded_by("import insenv; insenv.core")
    assert {"core", "errors", "vehicles"} <= set(dir(insenv))


def test_unknown_attribute_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nonesuch'"):
        insenv.nonesuch  # noqa: B018

"""`import insenv` stays cheap: heavy packages load inside the functions that need them."""

import ast
import subprocess
import sys
from pathlib import Path

import insenv
from insenv.estimators.parts.rows import FIX_HEALTH

HEAVY = {"matplotlib", "sklearn", "fmpy", "pymavlink", "dask", "scipy.signal", "pandas", "torch"}
PRINT = "print(*sys.modules)"


def loaded_by(*statements: str) -> list[set[str]]:
    script = "\n".join(["import sys", *(f"{statement}\n{PRINT}" for statement in statements)])
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return [set(line.split()) for line in done.stdout.splitlines()]


def test_the_package_registers_the_environments_and_loads_none_and_submodules_on_first_use():
    alone, core, command = loaded_by("import insenv", "insenv.core", "import insenv.cli")
    assert "gymnasium" in alone and alone.isdisjoint({"casadi", "scipy", "insenv.envs", "insenv.core", *HEAVY})
    assert "insenv.core" in core and command.isdisjoint(HEAVY)


def test_type_checkers_find_the_public_names_where_they_are_loaded_from():
    tree = ast.parse(Path(insenv.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    assert {alias.asname: node.module for node in block.body for alias in node.names} == insenv._HOME


def test_a_process_that_is_the_command_registers_the_environments_when_it_needs_them():
    command = "sys.argv = sys.orig_argv = ['insenv']; import insenv"
    asked = "import insenv.envs, gymnasium; assert 'insenv/ShipAlignment-v0' in gymnasium.registry"
    alone, _ = loaded_by(command, asked)
    assert "gymnasium" not in alone


def test_the_health_of_a_running_filter_loads_no_scipy():
    rows = f"dict(zip({FIX_HEALTH.names}, map(np.ones, {[row.shape for row in FIX_HEALTH.rows]})))"
    begun = "import numpy as np; from insenv.evaluation.live_health import LiveHealth; health = LiveHealth()"
    started, judged = loaded_by(begun, f"health.take(0.0, {rows}, None)")
    assert not {name for name in started | judged if name.startswith("scipy")}

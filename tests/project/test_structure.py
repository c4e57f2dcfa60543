"""The structure of the package, imports inside functions and for types included: no circle, few arrows, few floors.

The order of the layers is a contract of import-linter (pyproject.toml).
"""

from functools import cache
from graphlib import TopologicalSorter

import grimp
import pytest
from places import ROOT

FLOORS, ARROWS, SHORTEST, LONGEST = 12, 190, 45, 500
"""Most folders in a chain of imports, arrows between top-level folders and files; lines of a file."""


@pytest.fixture(scope="module")
def imports():
    """By module, the modules that it imports."""
    graph = grimp.build_graph("insenv", cache_dir=None)
    return {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}


def folder(module):
    """The folder or file at the top that a module is in; the package itself is the public face above all."""
    return (module.split(".") + ["insenv"])[1]


def arrows(imports):
    """By folder, the other folders that it imports."""
    found = {folder(name): set() for name in imports}
    for name, others in imports.items():
        found[folder(name)] |= {folder(other) for other in others} - {folder(name)}
    return found


def test_nothing_imports_in_a_circle(imports):
    """`prepare` raises `CycleError` with the circle."""
    TopologicalSorter(imports).prepare()
    TopologicalSorter(arrows(imports)).prepare()


def test_arrows_and_floors_between_folders(imports):
    drawn = arrows(imports)
    assert sum(map(len, drawn.values())) <= ARROWS

    @cache
    def floors(name):
        return 1 + max(map(floors, drawn[name]), default=0)

    folders = [name for name in drawn if (ROOT / "insenv" / name).is_dir()]
    assert max(map(floors, folders)) <= FLOORS


def test_a_file_holds_one_idea_neither_less_nor_more():
    """Public faces, which only name what others define, may be short."""
    lines = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in (ROOT / "insenv").rglob("*.py")
        if path.name not in ("__init__.py", "__main__.py")
    }
    assert {path: count for path, count in lines.items() if not SHORTEST <= count <= LONGEST} == {}

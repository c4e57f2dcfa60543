"""The commands that messages advise for optional packages."""

import re
import sys

import pytest
from command_line import call, refused
from places import ROOT

from insenv.base import installing
from insenv.base.installing import install_extra, install_package
from insenv.export import FORMATS

DECLARED = (ROOT / "pyproject.toml").read_text("utf-8")
CODE = "".join(path.read_text("utf-8") for path in (ROOT / "insenv").rglob("*.py"))


def test_from_a_wheel_the_packages_of_the_extra_in_the_version_asked_for(tmp_path, monkeypatch):
    """Beside a stray pyproject.toml of another package."""
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "other"\n')
    required = ["numpy>=2.0", 'tomli>=2; python_version < "3.11"', "matplotlib>=3.8; extra == 'plot'",
                "scikit-learn; extra == 'ml'", 'PyWavelets ; extra == "ml"',
                "onavdata==0.2.5; (platform_machine in 'x86_64') and extra == 'test'"]  # fmt: skip
    monkeypatch.setattr(installing, "requires", lambda name: required)
    assert install_extra("plot", tmp_path) == "pip install 'matplotlib>=3.8'"
    assert install_extra("ml", tmp_path) == "pip install scikit-learn PyWavelets"
    assert install_package("onavdata") == "pip install onavdata==0.2.5"


def test_every_extra_that_is_advised_is_declared_and_has_the_package():
    """What is imported and what is installed can have other names: rerun comes with rerun-sdk."""
    advised = set(re.findall(r"(?:install_extra\(|\badvice\(.\w+., |\bneed\([^)]*\bextra=)['\"](\w+)", CODE))
    assert {"plot", "native", "workbench", "web"} <= advised
    extras = dict(re.findall(r"^(\w+) = \[(.*?)\]", DECLARED, re.MULTILINE | re.DOTALL))
    assert advised <= set(extras)
    calls = re.findall(r'\bneed\([^\n]*?, "(\w+)",(?: package="([^"]+)",)? extra="(\w+)"', CODE)
    calls += [(each.module, each.package, each.extra) for each in FORMATS.values() if each.module]
    assert len(calls) > 12
    for module, package, extra in calls:
        names = [name.lower() for name in re.findall(r'"([\w-]+)', extras[extra])]
        assert (package or module).lower() in names, (module, package, extra)


def test_the_extra_docs_holds_what_the_tutorials_import():
    text = "".join(path.read_text("utf-8") for path in (ROOT / "docs" / "tutorials").glob("*.md"))
    cells = "".join(re.findall(r"^```\{code-cell\} python$(.*?)^```$", text, re.MULTILINE | re.DOTALL))
    imported = set(re.findall(r"^\s*(?:import|from) (\w+)", cells, re.MULTILINE)) - {*sys.stdlib_module_names, "insenv"}
    lists = "".join(re.findall(r"^(?:dependencies|docs) = \[(.*?)^\]", DECLARED, re.MULTILINE | re.DOTALL))
    assert {"matplotlib"} <= imported | {"allantools"} <= set(re.findall(r'^ +"([\w-]+)', lists, re.MULTILINE))


SHIP = ("ship-swaying", "--duration", "5")
NEEDING = {  # a command of each way to import
    "gpxpy": ("run", *SHIP, "--out", "out", "--gpx"),
    "pyarrow": ("campaign", *SHIP, "-e", "q-method", "-n", "2", "--out", "out", "--table", "parquet"),
    "ziglang": ("page", *SHIP, "-o", "x.html"),
    "serial": ("stream", "ship-swaying", "--to", "serial:/dev/ttyUSB0:57600"),
    "pyulog": ("replay", ROOT / "examples" / "logs" / "px4-takeoff.ulg.gz", "-e", "loosely-coupled"),
}


@pytest.mark.parametrize("module", NEEDING)
def test_a_missing_package_is_a_wrong_call_of_every_command(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    refused(call(*NEEDING[module]), " needs ", ", which is not installed: pip install ")
    assert not list(tmp_path.iterdir())

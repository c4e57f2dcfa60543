"""The commands that messages advise for optional packages."""

import re
import sys
from pathlib import Path

import pytest
from command_line import call, refused
from places import ROOT

from insenv import installing
from insenv.export.formats import FORMATS
from insenv.installing import advice, install_extra, install_package

REQUIREMENTS = [
    "numpy>=2.0",
    'tomli>=2; python_version < "3.11"',
    "matplotlib>=3.8; extra == 'plot'",
    "scikit-learn; extra == 'ml'",
    'PyWavelets ; extra == "ml"',
    "onavdata==0.2.5; (platform_machine in 'x86_64') and extra == 'test'",
]


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """A folder as that of a wheel, with a stray pyproject.toml of another package."""
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "other"\n')
    monkeypatch.setattr(installing, "requires", lambda name: REQUIREMENTS)
    return tmp_path


def test_from_a_checkout_the_extra_of_its_folder(tmp_path, monkeypatch):
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "insenv"\n')
    assert install_extra("plot", tmp_path) == f"pip install -e '{tmp_path}[plot]'"
    monkeypatch.chdir(tmp_path)
    assert install_extra("plot", Path.cwd()) == "pip install -e '.[plot]'"


def test_from_a_wheel_the_packages_of_the_extra(wheel):
    assert install_extra("plot", wheel) == "pip install 'matplotlib>=3.8'"
    assert install_extra("ml", wheel) == "pip install scikit-learn PyWavelets"


def test_a_package_in_the_version_asked_for(wheel):
    assert install_package("onavdata") == "pip install onavdata==0.2.5"
    assert install_package("pywavelets") == "pip install PyWavelets"
    assert install_package("no_such_package") == "pip install no_such_package"


def test_one_missing_package_is_named_with_its_extra(wheel, monkeypatch):
    monkeypatch.setattr(installing, "_is_checkout", lambda root: False)
    assert advice("pywavelets", "ml") == (
        "pip install PyWavelets (or all of the extra 'ml': pip install -e '.[ml]' in a checkout of insenv)"
    )


def test_every_extra_that_is_advised_is_declared():
    root = Path(installing.__file__).parents[1]
    declared = (root / "pyproject.toml").read_text("utf-8")
    code = "".join(path.read_text("utf-8") for path in (root / "insenv").rglob("*.py"))
    advised = set(re.findall(r"(?:install_extra\(|\badvice\(.\w+., |\bneed\([^)]*\bextra=)['\"](\w+)", code))
    assert {"plot", "native", "workbench", "web"} <= advised
    assert all(re.search(rf"^{extra} = \[", declared, re.MULTILINE) for extra in advised)


def test_the_package_that_is_advised_is_one_of_its_extra():
    """What is imported and what is installed can have other names: rerun comes with rerun-sdk."""
    declared = (ROOT / "pyproject.toml").read_text("utf-8")
    code = "".join(path.read_text("utf-8") for path in (ROOT / "insenv").rglob("*.py"))
    calls = re.findall(r'\bneed\([^\n]*?, "(\w+)",(?: package="([^"]+)",)? extra="(\w+)"', code)
    calls += [(each.module, each.package, each.extra) for each in FORMATS.values() if each.module]
    assert len(calls) > 12
    for module, package, extra in calls:
        packages = re.search(rf"^{extra} = \[(.*?)\]", declared, re.MULTILINE | re.DOTALL)[1]
        names = [name.lower() for name in re.findall(r'"([\w-]+)', packages)]
        assert (package or module).lower() in names, (module, package, extra)


LOG = ROOT / "examples" / "logs" / "plain.toml"
SHIP = ("ship-swaying", "--duration", "5")
NEEDING = {
    "allantools": ("allan", LOG),
    "cma": ("tune", "ship-swaying", "-e", "q-method"),
    "gpxpy": ("run", *SHIP, "--out", "out", "--gpx"),
    "rosbags": ("replay", LOG, "-e", "loosely-coupled", "--out", "out", "--bag"),
    "pyarrow": ("campaign", *SHIP, "-e", "q-method", "-n", "2", "--out", "out", "--table", "parquet"),
    "distributed": ("campaign", *SHIP, "-e", "q-method", "-n", "2", "--scheduler", "tcp://127.0.0.1:8786"),
    "sklearn": ("train", "lssvm", "ship-swaying"),
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

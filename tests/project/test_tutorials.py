"""The cells of each tutorial run from top to bottom, as a program of their own in an empty folder.

`make docs` runs them too, in a notebook, and shows what they print; this test needs neither Sphinx nor Jupyter.
"""

import os
import re
import subprocess
import sys

import pytest
from places import ROOT

FOLDER = ROOT / "docs" / "tutorials"
CELL = re.compile(r"^```\{code-cell\} python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TUTORIALS = sorted(path for path in FOLDER.glob("*.md") if path.name != "index.md")


@pytest.mark.slow
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_runs(path, tmp_path):
    cells = CELL.findall(path.read_text("utf-8"))
    assert len(cells) > 2
    (tmp_path / "cells.py").write_text("\n\n".join(cells), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "cells.py"],
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_every_tutorial_is_listed():
    listed = re.findall(r"^\| \[[^\]]+\]\(([\w-]+\.md)\)", (FOLDER / "index.md").read_text("utf-8"), re.MULTILINE)
    assert sorted(listed) == [path.name for path in TUTORIALS]

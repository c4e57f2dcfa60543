"""What README.md, CONTRIBUTING.md and docs/*.md tell a reader to type, typed.

Taken from fenced blocks: in ``console`` and ``sh`` the lines that begin with ``$ insenv``,
``$ python -m insenv`` or ``$ python examples/`` are run, those with ``$ make`` must name a target of the
Makefile; a ``python`` block is run whole (as a doctest if it begins with ``>>>``).  Each block runs in its
own folder, empty but for links to the repository's examples and scenarios.  ``<!-- not run: reason -->`` on
the line before a block leaves it out; pytest lists those as skipped, with the reason.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from places import ROOT

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "generated" not in path.parts),
]
FENCE = re.compile(
    r"^(?:<!-- not run: (?P<reason>.*?) -->\n)?^```(?P<language>console|sh|python)[^\n]*\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
PYTHON = shlex.quote(sys.executable)
START = r"(?P<start>^(?:\w+=\S+ +)*|[|;&] *)"  # where a command may begin, after variables that it is given


class Block(NamedTuple):
    """A fenced block: the page and line it stands at, its language, its text, why it is not run."""

    place: str
    language: str
    text: str
    reason: str | None


def blocks_of(name: str, page: str) -> list[Block]:
    """All blocks of the text `page`."""
    return [
        Block(f"{name}:{page.count(chr(10), 0, m.start('text'))}", m["language"], m["text"], m["reason"])
        for m in FENCE.finditer(page)
    ]


def commands_of(text: str) -> list[str]:
    """The lines after ``$ `` of a console block, continued lines joined."""
    return re.findall(r"^\$ (.*)$", text.replace("\\\n", " "), re.MULTILINE)


def runnable(command: str) -> str | None:
    """The command with this interpreter's insenv in it, or None if it is neither insenv nor an example."""
    command = re.sub(START + r"(?:\.venv/bin/)?insenv\b(?!=)", rf"\g<start>{PYTHON} -m insenv", command)
    command = re.sub(START + r"(?:\.venv/bin/)?python3? (?=examples/|-m insenv)", rf"\g<start>{PYTHON} ", command)
    return command if PYTHON in command else None


def run(command: str | list[str], folder: Path) -> None:
    """Run in `folder`; fail with all that it said."""
    done = subprocess.run(
        command,
        shell=isinstance(command, str),
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, f"{command}\nended with {done.returncode}\n{done.stdout}\n{done.stderr}"


@pytest.fixture
def folder(tmp_path):
    """An empty folder that sees the repository's examples and scenarios."""
    for name in ("examples", "scenarios"):
        if (ROOT / name).is_dir():
            (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


ALL = [b for page in PAGES for b in blocks_of(page.relative_to(ROOT).as_posix(), page.read_text("utf-8"))]


@pytest.mark.parametrize("block", ALL, ids=lambda block: block.place)
def test_block(block, folder):
    if block.reason is not None:
        pytest.skip(f"{block.place}: {block.reason}")
    if block.language == "python":
        (folder / "block.txt").write_text(block.text, encoding="utf-8")
        doctest = ["-m", "doctest"] if block.text.startswith(">>>") else []
        run([sys.executable, *doctest, "block.txt"], folder)
        return
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    for command in commands_of(block.text):
        if command.startswith("make "):
            named = {word for word in shlex.split(command, comments=True)[1:] if "=" not in word}
            assert named <= targets, f"{block.place}: no such target in the Makefile: {named - targets}"
        elif ready := runnable(command):
            run(ready, folder)


def test_the_blocks_are_found():
    page = "text\n<!-- not run: no radio -->\n```sh\n$ insenv list\n```\n```python\nx = 1\n```\n```c\nx;\n```\n"
    assert blocks_of("p.md", page) == [
        Block("p.md:3", "sh", "$ insenv list\n", "no radio"),
        Block("p.md:6", "python", "x = 1\n", None),
    ]
    assert commands_of("$ insenv run \\\n  ship\nout\n$ make demo\n") == ["insenv run    ship", "make demo"]
    assert runnable("A=1 insenv list | insenv run") == f"A=1 {PYTHON} -m insenv list | {PYTHON} -m insenv run"
    assert runnable("pip install insenv") is None


@pytest.mark.parametrize("page", ["README.md", "docs/cli.md"])
def test_the_table_shown_is_the_table_printed(page):
    done = subprocess.run(
        [sys.executable, "-m", "insenv", "run", "ship-swaying", "-e", "q-method"], capture_output=True, text=True
    )
    rows = re.findall(r"^(?:roll|pitch|heading) \[deg\] .*$", (ROOT / page).read_text("utf-8"), re.MULTILINE)
    assert len(rows) == 3 and set(rows) <= set(done.stdout.splitlines())

"""What README.md, CONTRIBUTING.md and docs/*.md tell a reader to type, typed.

What stands below a command must be printed by it, in this order; ``...`` stands for any lines.  Each block runs in a folder of
its own with links to examples and scenarios.  ``<!-- not run: reason -->`` on the line before a block leaves it out.
At the end: the links of README.md.
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
from readme_links import ReadmeLinks, absolute

AS_INSTALLED = ("README.md", "docs/cli.md")  # with the packages that README.md installs alone
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "generated" not in path.parts),
]
FENCE = re.compile(
    r"^(?:<!-- not run: (?P<reason>[^\n]*) -->\n)?"
    r"^```(?P<language>console|sh|python)[^\n]*\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
PYTHON = shlex.quote(sys.executable)
START = r"(?P<start>^(?:\w+=\S+ +)*|[|;&] *)"  # where a command may begin, after variables that it is given


class Block(NamedTuple):
    page: str
    line: int
    language: str
    text: str
    reason: str | None

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks_of(name: str, page: str) -> list[Block]:
    found = [(page.count("\n", 0, m.start("text")), m) for m in FENCE.finditer(page)]
    return [Block(name, line, m["language"], m["text"], m["reason"]) for line, m in found]


TIMES = re.compile(r"(?:, \S+ us a sample|, \S+ us per step|simulated in \S+ s|lateness .*|\d+ messages to .*)")


def timeless(text: str) -> list[str]:
    return [TIMES.sub("", line).rstrip() for line in text.splitlines()]


def missing(shown: list[str], printed: str) -> list[str]:
    """The first of the lines shown that is not printed after those before it; empty if all are."""
    lines = iter(timeless(printed))
    for line in timeless("\n".join(shown)):
        if line not in ("", "...") and line not in lines:  # `in` an iterator goes on from where it is
            return [line]
    return []


def runnable(command: str) -> str | None:
    """The command with this interpreter's insenv in it, or None if it is neither insenv nor an example."""
    command = re.sub(START + r"(?:\.venv/bin/)?insenv\b(?!=)", rf"\g<start>{PYTHON} -m insenv", command)
    command = re.sub(START + r"(?:\.venv/bin/)?python3? (?=examples/|-m insenv)", rf"\g<start>{PYTHON} ", command)
    return command if PYTHON in command else None


NOT_INSTALLED = (
    "dask distributed hypothesis onavdata pandas pyins pythonfmu pywt serial sklearn stable_baselines3 torch ziglang"
)
HIDING = f"""
import sys

class Hiding:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {NOT_INSTALLED.split()!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Hiding())
"""


def path_of(page: str, folder: Path) -> str:
    """PYTHONPATH of what runs a page: it finds insenv, for some pages with only what README.md installs with it."""
    if page not in AS_INSTALLED:
        return str(ROOT)
    place = folder / ".hiding"
    place.mkdir()
    (place / "sitecustomize.py").write_text(HIDING)
    return f"{place}{os.pathsep}{ROOT}"


def run(command: str | list[str], folder: Path, path: str = str(ROOT)) -> str:
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONIOENCODING": "utf-8", "PYTHONPATH": path}
    given = {"cwd": folder, "env": environment, "capture_output": True, "encoding": "utf-8", "timeout": 600}
    done = subprocess.run(command, shell=isinstance(command, str), **given)
    assert done.returncode == 0, f"{command}\nended with {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def linked(folder: Path) -> Path:
    for name in ("examples", "scenarios"):
        if (ROOT / name).is_dir():
            (folder / name).symlink_to(ROOT / name)
    return folder


ALL = [b for page in PAGES for b in blocks_of(page.relative_to(ROOT).as_posix(), page.read_text("utf-8"))]


def marked(things: list, is_fast) -> list:
    return [pytest.param(x, id=str(x), marks=[] if is_fast(x) else pytest.mark.slow) for x in things]


COMMANDS = [b for b in ALL if b.language in ("console", "sh") or b.reason]
FIRST_RUN = next(b for b in COMMANDS if "insenv run" in b.text)


@pytest.mark.parametrize("block", marked(COMMANDS, FIRST_RUN.__eq__))
def test_commands(block, tmp_path):
    if block.reason is not None:
        pytest.skip(f"{block}: {block.reason}")
    folder = tmp_path if "$ insenv examples" in block.text else linked(tmp_path)
    path = path_of(block.page, folder)
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    parts = re.split(r"^\$ ", block.text.replace("\\\n", " "), flags=re.MULTILINE)[1:]
    for command, *shown in map(str.splitlines, parts):
        if re.fullmatch(r"python examples/\w+\.py", command) and not shown:
            continue  # test_examples.py runs them, and looks at what they print
        if command.startswith("make "):
            named = {word for word in shlex.split(command, comments=True)[1:] if "=" not in word}
            assert named <= targets, f"{block}: no such target in the Makefile: {named - targets}"
        elif ready := runnable(command):
            printed = run(ready, folder, path)
            gone = missing(shown, printed)
            assert not gone, f"{block}: {command} does not print, or not in this order: {gone[0]}\n{printed}"


WITH_PYTHON = dict.fromkeys(b.page for b in ALL if b.language == "python" and not b.reason)
"""The cells of a tutorial are run when the site is built, one after the other (docs/conf.py)."""
EACH = """
import os, runpy, sys
for name in sys.argv[1:]:
    os.chdir(os.path.dirname(name))
    runpy.run_path(name, run_name="__main__")
"""


@pytest.mark.parametrize("page", marked(WITH_PYTHON, "README.md".__eq__))
def test_python(page, tmp_path):
    """Each block alone; a traceback names the line of the page."""
    texts = {b.line: b.text for b in ALL if b.page == page and b.language == "python" and not b.reason}
    files = []
    for line, text in texts.items():
        folder = tmp_path / f"line-{line}"
        folder.mkdir()
        files.append(linked(folder) / "block.py")
        files[-1].write_text("\n" * line + text, encoding="utf-8")
    run([sys.executable, "-c", EACH, *map(str, files)], tmp_path, path_of(page, tmp_path))


def test_what_is_not_printed_is_found():
    printed = "q-method, 0.2 us a sample\nroll   1.0   \npitch 3\nheading 2\n"
    assert missing(["q-method, 9 us a sample", "roll   1.0", "...", "heading 2"], printed) == []
    assert missing(["heading 2", "roll   1.0"], printed) == ["roll   1.0"]


SOURCE = "https://example.org/someone/insenv"
TARGET = re.compile(r"\]\(([^)\s]+)\)")
README = (ROOT / "README.md").read_text("utf-8")


def test_what_the_readme_links_to_exists():
    local = [target.partition("#")[0] for target in TARGET.findall(README) if not target.startswith("http")]
    assert local and [target for target in local if not (ROOT / target).exists()] == []


def test_links_and_images_become_absolute_where_an_address_is_declared():
    text = "![a ship](docs/ship.png) [page](docs/a.md#part) [there](https://x.org) [here](#part)"
    raw, blob = f"{SOURCE}/raw/v1.0", f"{SOURCE}/blob/v1.0"
    expected = f"![a ship]({raw}/docs/ship.png) [page]({blob}/docs/a.md#part) [there](https://x.org) [here](#part)"
    assert absolute(text, SOURCE + "/", "v1.0") == expected
    metadata = {"version": "1.2.3", "urls": {"Source": SOURCE}}
    ReadmeLinks(str(ROOT), {}).update(metadata)
    shown = metadata["readme"]["text"]
    assert all(target.startswith(("https://", "http://", "#")) for target in TARGET.findall(shown))
    assert f"]({SOURCE}/raw/v1.2.3/docs/figures/ship-swaying.png)" in shown

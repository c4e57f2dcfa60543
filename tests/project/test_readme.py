"""What README.md, CONTRIBUTING.md and docs/*.md tell a reader to type, typed.

Taken from fenced blocks: in ``console`` and ``sh`` the lines that begin with ``$ insenv``,
``$ python -m insenv`` or ``$ python examples/`` are run, those with ``$ make`` must name a target of the
Makefile; a ``python`` block is run whole (as a doctest if it begins with ``>>>``).  The lines below a command
that is run must be printed by it, in this order; ``...`` stands for any lines, and times of the machine may
differ.  Each block runs in its own folder, empty but for links to the repository's examples and scenarios; a
block with ``insenv examples`` gets them from there.  ``<!-- not run: reason -->`` on the line before a block
leaves it out; pytest lists those as skipped, with the reason.

The blocks of README.md are run by interpreters that start anew, so that what these import is seen; those of the other pages,
where the system can fork, by processes that have insenv imported (`warm.py`).  Both README.md and docs/cli.md do with the
packages that README.md installs.
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
from warm import Warm

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


def shown_below(text: str) -> list[tuple[str, list[str]]]:
    """The commands of a console block, each with the lines that stand below it."""
    joined = text.replace("\\\n", " ")
    parts = re.split(r"^\$ ", joined, flags=re.MULTILINE)[1:]
    return [(part.splitlines()[0], part.splitlines()[1:]) for part in parts]


TIMES = re.compile(r"(?:, \S+ us a sample|, \S+ us per step|simulated in \S+ s|lateness .*|\d+ messages to .*)")
"""What differs from run to run: times of the machine, and what depends on them."""


def timeless(text: str) -> list[str]:
    """The lines without what differs from run to run, and without trailing blanks."""
    return [TIMES.sub("", line).rstrip() for line in text.splitlines()]


def missing(shown: list[str], printed: str) -> list[str]:
    """The first of the lines shown that is not printed after those before it; empty if all are."""
    lines = iter(timeless(printed))
    for line in timeless("\n".join(shown)):
        if line not in ("", "...") and line not in lines:  # `in` an iterator goes on from where it is
            return [line]
    return []


def runnable(command: str, python: str = PYTHON) -> str | None:
    """The command with this interpreter's insenv in it, or None if it is neither insenv nor an example."""
    command = re.sub(START + r"(?:\.venv/bin/)?insenv\b(?!=)", rf"\g<start>{python} -m insenv", command)
    command = re.sub(START + r"(?:\.venv/bin/)?python3? (?=examples/|-m insenv)", rf"\g<start>{python} ", command)
    return command if python in command else None


SCRIPTS_RUN_ELSEWHERE = {f"python examples/{name}.py" for name in ("compare_estimators", "env_loop", "own_estimator")}
"""Commands that `test_examples.py` runs too, with warnings as errors, and looks at what they print."""

NOT_INSTALLED = (
    "dask distributed hypothesis onavdata pandas pyins pythonfmu pywt serial sklearn stable_baselines3 torch ziglang"
)
"""Packages that `pip install '.[plot]'` does not install, by the names that they are imported by."""
HIDING = f"""
import sys

class Hiding:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {NOT_INSTALLED.split()!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Hiding())
"""


def as_installed(folder: Path) -> str:
    """PYTHONPATH of a Python that finds insenv and what README.md installs with it, and no further package."""
    place = folder / ".hiding"
    place.mkdir()
    (place / "sitecustomize.py").write_text(HIDING)
    return f"{place}{os.pathsep}{ROOT}"


def environment(path: str = str(ROOT)) -> dict[str, str]:
    """The environment of a block, with this PYTHONPATH."""
    return {**os.environ, "MPLBACKEND": "Agg", "PYTHONIOENCODING": "utf-8", "PYTHONPATH": path}


def run(command: str | list[str], folder: Path, path: str = str(ROOT)) -> str:
    """Run in `folder` with this PYTHONPATH; fail with all that it said, or give what it printed."""
    done = subprocess.run(
        command,
        shell=isinstance(command, str),
        cwd=folder,
        env=environment(path),
        capture_output=True,
        encoding="utf-8",
        timeout=300,
    )
    assert done.returncode == 0, f"{command}\nended with {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def forked():
    """The words of an interpreter that has insenv imported; of a usual one where the system cannot fork."""
    if sys.platform != "linux":
        yield [sys.executable]
        return
    with Warm(environment()) as warm:
        yield warm.python


@pytest.fixture(scope="module")
def forked_as_installed(tmp_path_factory):
    """The same, without the packages that README.md does not install."""
    if sys.platform != "linux":
        yield [sys.executable]
        return
    with Warm(environment(as_installed(tmp_path_factory.mktemp("bare")))) as warm:
        yield warm.python


PYTHONS = {"README.md": None, "docs/cli.md": "forked_as_installed"}
"""The fixtures of the interpreters by page, if it is not `forked`; None: one that starts anew."""


@pytest.fixture
def folder(block, tmp_path):
    """A folder for the block: empty, or with links to the repository's examples and scenarios."""
    if "$ insenv examples" in block.text:
        return tmp_path
    for name in ("examples", "scenarios"):
        if (ROOT / name).is_dir():
            (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


ALL = [b for page in PAGES for b in blocks_of(page.relative_to(ROOT).as_posix(), page.read_text("utf-8"))]


@pytest.mark.parametrize("block", ALL, ids=lambda block: block.place)
def test_block(block, folder, request):
    if block.reason is not None:
        pytest.skip(f"{block.place}: {block.reason}")
    page = block.place.partition(":")[0]
    interpreter = PYTHONS.get(page, "forked")
    path = as_installed(folder) if page in PYTHONS else str(ROOT)
    python = [sys.executable] if interpreter is None else request.getfixturevalue(interpreter)
    if block.language == "python":
        (folder / "block.txt").write_text(block.text, encoding="utf-8")
        doctest = ["-m", "doctest"] if block.text.startswith(">>>") else []
        run([*python, *doctest, "block.txt"], folder, path)
        return
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    for command, shown in shown_below(block.text):
        if command in SCRIPTS_RUN_ELSEWHERE and not shown:
            continue
        if command.startswith("make "):
            named = {word for word in shlex.split(command, comments=True)[1:] if "=" not in word}
            assert named <= targets, f"{block.place}: no such target in the Makefile: {named - targets}"
        elif ready := runnable(command, shlex.join(python)):
            printed = run(ready, folder, path)
            gone = missing(shown, printed)
            assert not gone, f"{block.place}: {command} does not print, or not in this order: {gone[0]}\n{printed}"


def test_scripts_run_elsewhere_are_run_there_and_named_on_a_page():
    text = Path(__file__).with_name("test_examples.py").read_text("utf-8")
    commands = {command for b in ALL if b.reason is None for command in commands_of(b.text)}
    assert commands >= SCRIPTS_RUN_ELSEWHERE
    said = re.search(r"^SAID = \{.*?^\}", text, re.MULTILINE | re.DOTALL)[0]
    slow = re.search(r"^COMPILES_LONG = .*$", text, re.MULTILINE)[0]
    for script in (Path(command.split()[1]) for command in SCRIPTS_RUN_ELSEWHERE):
        assert f'"{script.name}": (' in said and script.name not in slow


def test_the_blocks_are_found():
    page = "text\n<!-- not run: no radio -->\n```sh\n$ insenv list\n```\n```python\nx = 1\n```\n```c\nx;\n```\n"
    assert blocks_of("p.md", page) == [
        Block("p.md:3", "sh", "$ insenv list\n", "no radio"),
        Block("p.md:6", "python", "x = 1\n", None),
    ]
    assert commands_of("$ insenv run \\\n  ship\nout\n$ make demo\n") == ["insenv run    ship", "make demo"]
    assert runnable("A=1 insenv list | insenv run") == f"A=1 {PYTHON} -m insenv list | {PYTHON} -m insenv run"
    assert runnable("pip install insenv") is None


def test_packages_that_the_page_does_not_install_are_hidden(tmp_path):
    path = as_installed(tmp_path)
    tried = "import importlib\ntry: importlib.import_module('{}')\nexcept ModuleNotFoundError: print('hidden')"
    for name in NOT_INSTALLED.split():
        assert run([sys.executable, "-c", tried.format(name)], tmp_path, path) == "hidden\n"
    assert run([sys.executable, "-c", tried.format("matplotlib")], tmp_path, path) == ""


SCRIPTS = {
    "import os, sys; print(sys.argv, os.getcwd(), os.environ['A'], sys.stdin.read(), __name__, sys.path[0])": 0,
    "import atexit; atexit.register(print, 'at the end'); raise SystemExit": 0,
    "import sys, threading; threading.Timer(0.1, print, ['at last']).start(); sys.exit(7)": 7,
    "raise SystemExit('no such file')": 1,
    "import numpy; numpy.nothing": 1,
    "import os, signal; os.kill(os.getpid(), signal.SIGKILL)": 137,
}


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_forked_process_does_what_an_interpreter_does(script, forked, tmp_path):
    """Output, status and messages, by way of a shell."""
    (tmp_path / "script.py").write_text(script)
    given = {"shell": True, "input": "read", "capture_output": True, "encoding": "utf-8", "env": environment(), "cwd": tmp_path}
    new, old = (subprocess.run(f"A=b {shlex.join(python)} script.py c", **given) for python in (forked, [sys.executable]))
    assert (new.returncode, new.stdout) == (old.returncode, old.stdout)
    assert new.returncode == SCRIPTS[script]
    assert new.stderr.splitlines()[-1:] == old.stderr.replace("Killed\n", "").splitlines()[-1:]  # the shell's word


def test_a_wrong_command_fails_in_a_forked_process(forked, tmp_path):
    with pytest.raises(AssertionError, match=r"ended with 2\n\s*insenv: no scenario 'nowhere'"):
        run([*forked, "-m", "insenv", "run", "nowhere"], tmp_path)


def test_lines_below_a_command_must_be_printed_in_order():
    block = "$ insenv run ship\nroll   1.0\n...\nheading 2\n$ insenv list \\\n  grades\n"
    assert shown_below(block) == [("insenv run ship", ["roll   1.0", "...", "heading 2"]), ("insenv list    grades", [])]
    printed = "q-method, 0.2 us a sample\nroll   1.0   \npitch 3\nheading 2\n"
    assert missing(["q-method, 9 us a sample", "roll   1.0", "...", "heading 2"], printed) == []
    assert missing(["heading 2", "roll   1.0"], printed) == ["roll   1.0"]
    assert missing(["roll   1.1"], printed) == ["roll   1.1"]


def test_the_pages_show_tables_that_are_compared():
    """The table of README and that of the page of the command line are among the lines that `test_block` compares."""
    for page in ("README.md", "docs/cli.md", "docs/benchmarks.md"):
        text = (ROOT / page).read_text("utf-8")
        lines = [line for b in blocks_of(page, text) if b.reason is None for _, shown in shown_below(b.text) for line in shown]
        for row in ("roll [deg]", "pitch [deg]", "heading [deg]"):
            assert any(line.startswith(row) for line in lines), (page, row)
        for fence in re.findall(r"^```text\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
            assert "[deg]" not in fence, f"{page}: a table outside of a console block is not compared"

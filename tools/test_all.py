"""Run every check that there is, each even if one before it failed, and print one table at the end; `make test-all`.

Outcomes are kept in `.test-all/`: ``--again`` runs only the targets that did not pass on the present state of the tree, and
says which these are; after any change of the tree it runs all of them, because each may depend on any file.  A peer that is
missing, such as a browser, is installed if this process may; a test that lacks one fails (tests/helpers/peers.py).
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / ".test-all"
SITE = "build/docs/html"
BIN = Path(sys.executable).parent
PYTHON = sys.executable
SIDE_BY_SIDE = ("-n", "2", "--dist", "worksteal")
NAMED = ("tests/fmu", "tests/web", "tests/mavlink", "tests/project", "tests/studies/learning", "tests/envs/test_sb3.py")
"""Tests whose slow part is a target of its own."""
SITE_TESTS = "tests/project/test_site.py"
"""They need a site that has been built: the target `site`."""


@dataclass(frozen=True)
class Target:
    """What is run under one name: command lines, one after the other.  pytest: arguments of pytest, if it is tests."""

    name: str
    what: str
    commands: tuple[tuple[str, ...], ...] = ()
    pytest: tuple[str, ...] = ()


TARGETS = (
    Target(
        "static",
        "ruff, import-linter, mypy",
        (
            (str(BIN / "ruff"), "check", "--output-format", "concise", "."),
            (str(BIN / "ruff"), "format", "--check", "."),
            (str(BIN / "lint-imports"),),
            (str(BIN / "mypy"),),
        ),
    ),
    Target("fast", "the tests of `make test`", pytest=(*SIDE_BY_SIDE, "-m", "not slow")),
    Target(
        "slow",
        "statistics, all interfaces on all models",
        pytest=(*SIDE_BY_SIDE, "-m", "slow", *(f"--ignore={path}" for path in NAMED)),
    ),
    Target("fmu", "FMUs: all models, platforms", pytest=(*SIDE_BY_SIDE, "-m", "slow", "tests/fmu")),
    Target("mavlink", "streams: MAVProxy, tshark, floods", pytest=(*SIDE_BY_SIDE, "-m", "slow", "tests/mavlink")),
    Target("web", "pages in Chromium and Node, TypeScript", pytest=(*SIDE_BY_SIDE, "-m", "slow", "tests/web")),
    Target(
        "pages",
        "every command of the pages, examples, the wheel",
        pytest=(*SIDE_BY_SIDE, "-m", "slow", "tests/project", f"--ignore={SITE_TESTS}"),
    ),
    Target("learning", "training", pytest=(*SIDE_BY_SIDE, "-m", "slow", "tests/studies/learning", "tests/envs/test_sb3.py")),
    Target(
        "site",
        "the documentation site, opened page by page",
        (
            (
                PYTHON,
                "-m",
                "sphinx",
                "-b",
                "html",
                "-q",
                "-W",
                "--keep-going",
                "-d",
                "build/docs/doctrees",
                "docs",
                "build/docs/html",
            ),
        ),
        ("--noconftest", SITE_TESTS),
    ),
    Target("mutants", "faults that the tests find", ((PYTHON, "tools/mutants.py"),)),
)

PACKAGES = {
    "chromium": "chromium",
    "chromedriver": "chromium-driver",
    "tshark": "tshark",
    "node": "nodejs",
    "qemu-aarch64": "qemu-user",
    "aarch64-linux-gnu-gcc": "gcc-aarch64-linux-gnu",
    "wine": "wine64",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
    "cppcheck": "cppcheck",
    "clang-tidy": "clang-tidy",
}
"""Programs that tests run, and the packages of Debian that bring them."""


@dataclass
class Outcome:
    """What a target gave: numbers of tests, of faults or, without either, of commands.  skips: reasons, with theirs."""

    name: str
    passed: int = 0
    failed: int = 0
    skips: dict[str, int] = field(default_factory=dict)
    status: int = 0
    minutes: float = 0.0
    state: str = ""

    @property
    def good(self) -> bool:
        return self.status == 0 and self.failed == 0


def state_of_tree() -> str:
    """The commit, and a hash of what differs from it and of files that are not in it: an outcome is of one state."""

    def git(*arguments: str) -> bytes:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, check=False).stdout

    digest = hashlib.sha256(git("diff", "HEAD"))
    for name in git("ls-files", "--others", "--exclude-standard", "-z").split(b"\0"):
        if name:
            digest.update(name + (ROOT / os.fsdecode(name)).read_bytes())
    return f"{git('rev-parse', 'HEAD').decode().strip()}-{digest.hexdigest()[:12]}"


def install_peers() -> None:
    """Install the programs that are missing, where this process may; print what stays missing."""
    missing = {program: package for program, package in PACKAGES.items() if shutil.which(program) is None}
    if missing and shutil.which("apt-get") and hasattr(os, "geteuid") and os.geteuid() == 0:
        environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
        for command in (["apt-get", "update", "-qq"], ["apt-get", "install", "-y", "-qq", *" ".join(missing.values()).split()]):
            subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=False)
    if shutil.which("tsc") is None and shutil.which("npm"):
        subprocess.run(["npm", "install", "--silent", "-g", "typescript"], stdout=subprocess.DEVNULL, check=False)
        missing["tsc"] = "typescript (npm)"
    for program, package in missing.items():
        if shutil.which(program) is None:
            print(f"missing: {program} ({package}); the tests that run it fail", file=sys.stderr)


def environment() -> dict[str, str]:
    """What the tests of all targets see."""
    mavproxy = ROOT / ".venv" / "mavproxy" / "bin" / "python"
    peers = {"INSENV_MAVPROXY": str(mavproxy)} if mavproxy.exists() else {}
    return {**os.environ, "INSENV_TEST_ALL": "1", "INSENV_SITE": SITE, **peers}


def done(target: Target) -> Outcome:
    """Run a target; its output goes to a file, and the end of it to the terminal if it failed."""
    outcome, begun = Outcome(target.name), time.monotonic()
    log, report = KEPT / f"{target.name}.txt", KEPT / f"{target.name}.xml"
    report.unlink(missing_ok=True)
    commands = list(target.commands)
    if target.pytest:
        commands.append((PYTHON, "-m", "pytest", f"--junitxml={report}", *target.pytest))
    with log.open("w", encoding="utf-8") as stream:
        for command in commands:
            stream.flush()
            ran = subprocess.run(command, cwd=ROOT, env=environment(), stdout=stream, stderr=subprocess.STDOUT, check=False)
            outcome.status = outcome.status or ran.returncode
            outcome.passed += ran.returncode == 0
            outcome.failed += ran.returncode != 0
    if target.pytest:
        count(report, outcome)
    elif found := re.findall(r"^(\d+) of (\d+) killed", log.read_text(encoding="utf-8"), re.MULTILINE):
        outcome.passed, outcome.failed = int(found[-1][0]), 0
        outcome.skips = {"survived": int(found[-1][1]) - int(found[-1][0])}
    outcome.minutes = (time.monotonic() - begun) / 60.0
    if not outcome.good:
        print("\n".join(log.read_text(encoding="utf-8", errors="replace").splitlines()[-40:]))
        print(f"{target.name}: the whole output is in {log.relative_to(ROOT)}", flush=True)
    return outcome


def count(report: Path, outcome: Outcome) -> None:
    """The numbers of an outcome are those of pytest's report."""
    outcome.passed = outcome.failed = 0
    if not report.exists():
        return
    reasons: Counter[str] = Counter()
    for case in ElementTree.parse(report).iter("testcase"):
        skipped = case.find("skipped")
        if skipped is not None:
            reasons[skipped.get("message", "")] += 1
        elif case.find("failure") is not None or case.find("error") is not None:
            outcome.failed += 1
        else:
            outcome.passed += 1
    outcome.skips = dict(reasons)


def table(outcomes: Sequence[Outcome]) -> str:
    """The summary: a line per target, then the reasons of skips."""
    lines = [f"{'target':<10}{'passed':>8}{'failed':>8}{'skipped':>9}{'minutes':>9}"]
    for one in outcomes:
        end = "" if one.good else f"  FAILED (status {one.status})"
        skipped = sum(one.skips.values())
        lines.append(f"{one.name:<10}{one.passed:>8}{one.failed:>8}{skipped:>9}{one.minutes:>9.1f}{end}")
    lines.append(
        f"{'together':<10}{sum(one.passed for one in outcomes):>8}{sum(one.failed for one in outcomes):>8}"
        f"{sum(sum(one.skips.values()) for one in outcomes):>9}{sum(one.minutes for one in outcomes):>9.1f}"
    )
    for one in outcomes:
        lines += [f"{one.name}: {number} skipped: {reason}" for reason, number in one.skips.items()]
    return "\n".join(lines)


def kept_outcomes() -> dict[str, Outcome]:
    """What earlier calls kept, by target."""
    found = {}
    for target in TARGETS:
        with contextlib.suppress(OSError, ValueError, TypeError):
            found[target.name] = Outcome(**json.loads((KEPT / f"{target.name}.json").read_text(encoding="utf-8")))
    return found


def reason(outcome: Outcome | None, state: str) -> str:
    """Why a target of that earlier outcome is run again on this state of the tree; empty: it is not."""
    if outcome is None:
        return "not run before"
    if outcome.state != state:
        return "the tree has changed since"
    return "" if outcome.good else "failed before"


def plan(reasons: dict[str, str]) -> str:
    """One line: which targets are run again and why, by the reason of each; then those that are not."""
    groups: dict[str, list[str]] = {}
    for name, why in reasons.items():
        groups.setdefault(why, []).append(name)
    passed = groups.pop("", [])
    runs = "; ".join(f"{', '.join(names)} ({why})" for why, names in groups.items())
    return f"again: {runs or 'nothing'}" + (f"; not again: {', '.join(passed)} (passed)" if passed else "")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the targets; 1 if one failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("targets", nargs="*", help=f"only these of {', '.join(target.name for target in TARGETS)}")
    parser.add_argument("--again", action="store_true", help="only targets that have not passed on this state of the tree")
    given = parser.parse_args(arguments)
    known = {target.name for target in TARGETS}
    if unknown := set(given.targets) - known:
        parser.error(f"no target {sorted(unknown)[0]!r} (allowed: {', '.join(target.name for target in TARGETS)})")
    KEPT.mkdir(exist_ok=True)
    install_peers()
    state = state_of_tree()
    targets = [target for target in TARGETS if not given.targets or target.name in given.targets]
    before = kept_outcomes() if given.again else {}
    reasons = {target.name: reason(before.get(target.name), state) for target in targets}
    if given.again:
        print(plan(reasons), flush=True)
    outcomes = []
    for target in targets:
        if not reasons[target.name]:
            outcomes.append(before[target.name])
            continue
        print(f"{target.name}: {target.what}", flush=True)
        outcome = done(target)
        outcome.state = state
        (KEPT / f"{target.name}.json").write_text(json.dumps(asdict(outcome)), encoding="utf-8")
        outcomes.append(outcome)
        print(f"{target.name}: {'passed' if outcome.good else 'FAILED'} in {outcome.minutes:.1f} min", flush=True)
    print(table(outcomes))
    return 0 if all(one.good for one in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())

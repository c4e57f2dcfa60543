"""Inject single-place faults into the physics and report which of them the tests find; `make mutants`.

The faults are listed in `tools/mutants.toml`: for each file the tests that concern it and pairs of an exact text and what
replaces it. Nothing is changed in the checkout: every worker has a copy of the tree in a temporary folder, in which one
fault at a time is made and the tests run until the first fails. A text that does not stand exactly once in its file is an
error, and so is a test that fails, or finds nothing to run, without a fault.  With `--resume FILE` the outcomes go to a file
too, and the faults that it says were killed are not tried again.

A fault is tried with the tests of `make test` first; if it survives them, with those marked slow.  Outcomes: `killed` (a test
of `make test` failed), `slow` (one marked slow failed), `survived`, `timeout` and `broken` (the tests could not be collected:
the fault is no program). The first two count.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
LIST = Path(__file__).with_suffix(".toml")
FOUND_BY = Path(__file__).with_name("mutants-found.json")
"""Which test found each fault in an earlier run (``--keep``)."""
FOLDERS = ("insenv", "scenarios", "fmu", "web", "tests", "tools", "examples", "recordings", "docs")
TRAVELS = (*FOLDERS, "pyproject.toml", "README.md")
REQUIRED, REQUIRED_FAST = 0.98, 0.95
"""Least share of the faults that all tests find, and that those of `make test` find."""
LIMIT_S = 300.0
"""Time limit of the tests of one fault, s."""
NOTHING_COLLECTED = 5
"""Status of pytest if no test is selected."""
FOUND = ("killed", "slow")
_SECONDS = itertools.count(1_000_000_000)


@dataclass(frozen=True)
class Mutant:
    """One fault.

    file: path in the repository. text, becomes: what is replaced, and by what. tests: arguments of pytest.
    """

    file: str
    text: str
    becomes: str
    tests: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.file}: {' '.join(self.text.split())}  ->  {' '.join(self.becomes.split()) or '(nothing)'}"


@dataclass(frozen=True)
class Outcome:
    """What the tests said of a fault, the test that found it, and how long they ran (s)."""

    mutant: Mutant
    said: str
    found_by: str
    seconds: float


def listed(chosen: Iterable[str] = ()) -> list[Mutant]:
    """The faults of the list, of all files or of those whose path contains one of `chosen`.

    Raises `SystemExit` naming each text that does not stand exactly once in its file, and a fault listed twice.
    """
    wanted, found, wrong = tuple(chosen), [], []
    for entry in tomllib.loads(LIST.read_text(encoding="utf-8"))["file"]:
        source = (ROOT / entry["path"]).read_text(encoding="utf-8")
        for text, becomes in entry["mutants"]:
            mutant = Mutant(entry["path"], text, becomes, tuple(entry["tests"]))
            count = source.count(text)
            if count != 1:
                wrong.append(f"{mutant}: the text stands {count} times in the file")
            if text == becomes or mutant in found:
                wrong.append(f"{mutant}: no fault, or listed twice")
            found.append(mutant)
    if wrong:
        raise SystemExit("\n".join(wrong))
    return [mutant for mutant in found if not wanted or any(part in mutant.file for part in wanted)]


def copied(folder: Path) -> Path:
    """A copy of the tree in a new folder inside `folder`."""
    copy = Path(tempfile.mkdtemp(dir=folder))
    for name in TRAVELS:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
        else:
            shutil.copy2(source, copy / name)
    return copy


def tested(tree: Path, tests: tuple[str, ...], limit_s: float, marked: str = "not slow", workers: int = 0) -> tuple[str, str]:
    """Run tests in a copy of the tree until the first fails: (outcome, test that failed and why, or the end of the output).

    marked: expression of the marks of the tests that run.  workers: processes side by side, if not one.
    """
    arguments = [
        "-x",
        "-q",
        "-m",
        marked,
        "-p",
        "no:cacheprovider",
        "-p",
        "no:randomly",
        "--no-header",
        "--tb=no",
        "-rfE",
        *(("-n", str(workers), "--dist", "worksteal") if workers else ()),
        *tests,
    ]
    environment = {
        **os.environ,
        "COLUMNS": "1000",
        "PYTHONPATH": str(tree),
        "INSENV_BACKEND": "interpreter",  # most faults would have to be compiled
        "INSENV_CACHE_DIR": str(tree.parent / "cache"),  # the user's would fill with equations of faults
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "pytest", *arguments]
    try:
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, timeout=limit_s, check=False)
    except subprocess.TimeoutExpired:
        return "timeout", ""
    failed = [line.removeprefix("FAILED ") for line in done.stdout.splitlines() if line.startswith("FAILED ")]
    if done.returncode in (0, NOTHING_COLLECTED):
        return "survived", ""
    if done.returncode == 1 and failed:
        return "killed", failed[0]
    return "broken", (done.stdout + done.stderr)[-2000:]


def tried(mutant: Mutant, tree: Path, limit_s: float, likely: str = "") -> Outcome:
    """Make one fault in a copy of the tree, run its tests, and restore the file.

    likely: the test that found it in an earlier run, which is run first.
    """
    path, begun = tree / mutant.file, time.monotonic()
    source, times = path.read_text(encoding="utf-8"), path.stat()
    path.write_text(source.replace(mutant.text, mutant.becomes), encoding="utf-8")
    # Python trusts compiled code if size and second of its source agree: no two faults share a second, and none the source's
    stamp = next(_SECONDS)
    os.utime(path, (stamp, stamp))
    try:
        said, found_by = tested(tree, (likely,), limit_s) if likely else ("survived", "")
        if said != "killed":  # it may have another name now
            said, found_by = tested(tree, mutant.tests, limit_s)
        if said == "survived":
            said, found_by = tested(tree, mutant.tests, limit_s, "slow")
            said = "slow" if said == "killed" else said
    finally:
        path.write_text(source, encoding="utf-8")
        os.utime(path, (times.st_atime, times.st_mtime))
    return Outcome(mutant, said, found_by.split(" - ")[0] if said in FOUND else found_by, time.monotonic() - begun)


def sound(mutants: list[Mutant], tree: Path, workers: int) -> None:
    """Raise `SystemExit` if a test that is to find faults fails without one."""
    tests = tuple(dict.fromkeys(test for mutant in mutants for test in mutant.tests))
    begun = time.monotonic()
    said, text = tested(tree, tests, 3600.0, workers=workers)
    if said != "survived":
        raise SystemExit(f"the tests fail without a fault: {said} {text}")
    print(f"without a fault the tests pass in {time.monotonic() - begun:.0f} s", flush=True)


def killed_before(mutants: list[Mutant], file: Path | None) -> list[Outcome]:
    """The outcomes of those faults that the file of an earlier run says were killed.  A changed fault is another fault."""
    if file is None or not file.exists():
        return []
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    killed = {row["mutant"]: row for row in rows if row["said"] in FOUND}
    return [
        Outcome(mutant, killed[str(mutant)]["said"], killed[str(mutant)]["found_by"], killed[str(mutant)]["seconds"])
        for mutant in mutants
        if str(mutant) in killed
    ]


def all_tried(mutants: list[Mutant], workers: int, limit_s: float, file: Path | None = None) -> list[Outcome]:
    """Try every fault, some at a time; prints each outcome as it comes, and adds it to `file`."""
    outcomes = killed_before(mutants, file)
    known = {outcome.mutant for outcome in outcomes}
    likely = _likely()
    left = [mutant for mutant in mutants if mutant not in known]
    if not left:
        return outcomes
    with tempfile.TemporaryDirectory(prefix="insenv-mutants-") as name:
        trees: Queue[Path] = Queue()
        for _ in range(workers):
            trees.put(copied(Path(name)))
        tree = trees.get()
        sound(left, tree, workers)
        trees.put(tree)

        def one(mutant: Mutant) -> Outcome:
            tree = trees.get()
            try:
                return tried(mutant, tree, limit_s, likely.get(str(mutant), ""))
            finally:
                trees.put(tree)

        with ThreadPoolExecutor(workers) as pool:
            for number, future in enumerate(as_completed([pool.submit(one, mutant) for mutant in left]), 1):
                outcome = future.result()
                outcomes.append(outcome)
                if file is not None:
                    row = {"mutant": str(outcome.mutant), "said": outcome.said, "found_by": outcome.found_by}
                    with file.open("a", encoding="utf-8") as stream:
                        stream.write(json.dumps({**row, "seconds": round(outcome.seconds)}) + "\n")
                by = f"  by {outcome.found_by}" if outcome.said in FOUND else ""
                print(f"{number:4}/{len(left)} {outcome.said:8} {outcome.seconds:5.0f} s  {outcome.mutant}{by}", flush=True)
        by_slow = tuple(dict.fromkeys(outcome.found_by for outcome in outcomes if outcome.said == "slow"))
        if by_slow and tested(tree, by_slow, 3600.0, "slow")[0] != "survived":
            raise SystemExit(f"a test marked slow fails without a fault: {' '.join(by_slow)}")
    return outcomes


def _likely() -> dict[str, str]:
    """The test that found each fault before, by the fault."""
    found: dict[str, str] = json.loads(FOUND_BY.read_text(encoding="utf-8")) if FOUND_BY.exists() else {}
    return found


def main(arguments: list[str] | None = None) -> int:
    """Run the command; 1 if fewer than `REQUIRED` of the faults are found, or `REQUIRED_FAST` by the tests of `make test`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("files", nargs="*", help="only the faults of files whose path contains one of these")
    parser.add_argument("-j", "--workers", type=int, default=2, help="faults tried at a time")
    parser.add_argument("--limit", type=float, default=LIMIT_S, help="time limit of one fault, s")
    parser.add_argument("--resume", type=Path, help="file of outcomes: what it says was killed is not tried again")
    parser.add_argument("--list", action="store_true", help="check the list and print it")
    parser.add_argument(
        "--keep", action="store_true", help=f"write which test found each of these faults to {FOUND_BY.name}: it runs first"
    )
    given = parser.parse_args(arguments)
    mutants = listed(given.files)
    if given.list and mutants:
        print("\n".join(str(mutant) for mutant in mutants))
        print(f"{len(mutants)} faults in {len({mutant.file for mutant in mutants})} files")
        return 0
    if not mutants:
        raise SystemExit(f"{', '.join(given.files)}: no file with faults has this in its path; --list shows all that have some")
    begun = time.monotonic()
    outcomes = all_tried(mutants, given.workers, given.limit, given.resume)
    if given.keep:
        listed_now = {str(mutant) for mutant in listed([])}
        found_by = {fault: test for fault, test in _likely().items() if fault in listed_now}
        found_by |= {str(each.mutant): each.found_by for each in outcomes if each.said == "killed"}
        FOUND_BY.write_text(json.dumps(dict(sorted(found_by.items())), indent=0) + "\n", encoding="utf-8")
    left = [outcome for outcome in outcomes if outcome.said not in FOUND]
    fast = sum(outcome.said == "killed" for outcome in outcomes)
    total = len(outcomes)
    for outcome in left:
        print(f"{outcome.said}: {outcome.mutant}  ({' '.join(outcome.mutant.tests)}) {outcome.found_by}")
    print(
        f"{total - len(left)} of {total} killed ({100 - 100 * len(left) / total:.1f} %), {fast} by the tests of make test "
        f"({100 * fast / total:.1f} %), in {time.monotonic() - begun:.0f} s"
    )
    return 0 if total - len(left) >= REQUIRED * total and fast >= REQUIRED_FAST * total else 1


if __name__ == "__main__":
    sys.exit(main())

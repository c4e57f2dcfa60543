"""Storage of finished blocks: in memory, or in a folder from which an interrupted campaign resumes.

A folder holds `manifest.json`, the plan with its digest, and `blocks/NNNNNN.npz`, the summaries of the runs of each
block.  Files are written under a temporary name and renamed, so that a file with its final name is complete.  A damaged
block counts as not done.  One campaign at a time holds the lock of a folder, and every block that is read must have the
digest of the plan.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError, InsenvError
from insenv.base.output import LockedError, atomic, exclusive
from insenv.studies.campaign.block import Arrays
from insenv.studies.campaign.plan import Plan

FORMAT, VERSION = "insenv-campaign", 1
MANIFEST, BLOCKS, LOCK = "manifest.json", "blocks", ".lock"
OF_ESTIMATOR = ("estimator", "equations", "parameters")
"""What the plans of a comparison do not share (`Plan.as_json`)."""
_DAMAGE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


def check_compared(folder: Path, plans: Sequence[Plan]) -> None:
    """Raise `InputError` for a folder that holds a comparison, unless `plans` are several on the same runs.

    The campaigns of a comparison lie in folders named by their estimators (`insenv.studies.campaign.running.stores_of`).
    """
    compared: dict[str, Mapping[str, Any]] = {}
    for manifest in sorted(folder.glob(f"*/{MANIFEST}")):
        with suppress(*_DAMAGE, TypeError):
            theirs = json.loads(manifest.read_text(encoding="utf-8"))["plan"]
            if theirs["estimator"] == manifest.parent.name:
                compared[manifest.parent.name] = theirs
    if compared and len(plans) == 1:
        names = ", ".join(compared)
        raise InputError(f"{str(folder)!r} holds the comparison of {names}: choose another folder for one estimator")
    for plan in plans:
        compared.pop(plan.estimator, None)  # is compared whole by its own `Folder`
    ours = {name: value for name, value in plans[0].as_json().items() if name not in OF_ESTIMATOR} if compared else {}
    for id, theirs in compared.items():
        other = [name for name, value in ours.items() if json.dumps(value) != json.dumps(theirs.get(name))]
        if other:
            raise InputError(
                f"{str(folder)!r} holds another comparison: its campaign of {id} differs in {', '.join(other)}; {OTHER_FOLDER}"
            )


class Memory:
    """Blocks kept in memory."""

    def __init__(self) -> None:
        self._blocks: dict[int, Arrays] = {}

    def has(self, number: int) -> bool:
        """Whether the block is stored."""
        return number in self._blocks

    def put(self, number: int, arrays: Arrays) -> None:
        """Store a finished block."""
        self._blocks[number] = arrays

    def part(self, number: int) -> Arrays | None:
        """What an interruption left of a block: memory keeps nothing."""
        return None

    def column(self, number: int, name: str) -> np.ndarray:
        """One array of a finished block."""
        return self._blocks[number][name]

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold the store for one campaign; memory belongs to this process."""
        yield


OTHER_FOLDER = "name another folder with --out, or repeat that campaign's options with --resume"


def _differences(theirs: Mapping[str, Any], plan: Plan) -> str:
    """The options in which another campaign differs, with its values and those of the plan."""
    ours = plan.as_json()
    pairs = {name: (theirs.get(name), ours[name]) for name in ours if _text(theirs.get(name)) != _text(ours[name])}
    if isinstance((pairs.get("scenario") or (None,))[0], dict):
        there, here = pairs.pop("scenario")
        pairs = {**{f"scenario.{key}": each for key, each in _leaves(there, here)}, **pairs}
    stated = {name: each for name, each in pairs.items() if name not in ("equations", "parameters")}
    shown = [f"{name} ({_text(there)[:40]} there, {_text(here)[:40]} here)" for name, (there, here) in stated.items()]
    more = [f"and {len(shown) - 4} more"] if len(shown) > 4 else []
    return ", ".join([*shown[:4], *more] or pairs)


def _leaves(there: Any, here: Any, key: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """The values in which two tables differ, by dotted key."""
    if not (isinstance(there, dict) and isinstance(here, dict)):
        if _text(there) != _text(here):
            yield key, (there, here)
        return
    for name in dict.fromkeys([*there, *here]):
        yield from _leaves(there.get(name), here.get(name), f"{key}.{name}" if key else name)


def _text(value: Any) -> str:
    return json.dumps(value)


class Folder:
    """Blocks kept in a folder.

    plan: plan of the campaign.
    resume: whether to resume the campaign in the folder; if False, the folder must hold none.
    Raises `InputError` for a folder that holds another campaign or that cannot be used.
    """

    def __init__(self, path: str | Path, plan: Plan, resume: bool = False) -> None:
        self.path, self.plan = Path(path), plan
        self._digest, self._resume, self._wrote = plan.digest, resume, False
        self._check_folder(resume)

    def _check_folder(self, resume: bool) -> None:
        manifest = self.path / MANIFEST
        if manifest.exists():
            self._check(manifest, resume)
        elif self.path.exists() and not self.path.is_dir():
            raise InputError(f"cannot write to the output folder {str(self.path)!r}: it is not a folder")
        elif (self.path / BLOCKS).exists():
            raise InputError(f"{str(self.path)!r} holds blocks of a campaign, but no {MANIFEST} to identify it")

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold the folder for one campaign during the block: lock it, and check again what it holds.

        Raises `InputError` if another process runs a campaign there, or has finished one since this object was made.
        """
        made = [path for path in (self.path, *self.path.parents) if not path.exists()]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InsenvError(f"cannot write to {str(self.path)!r}: {error.strerror or error}") from error
        try:
            with ExitStack() as lock:
                self._lock(lock)
                self._check_folder(self._resume or self._wrote)
                yield
        finally:
            for path in made:  # what is still empty was made for the lock only
                with suppress(OSError):
                    path.rmdir()

    def _lock(self, stack: ExitStack) -> None:
        try:
            stack.enter_context(exclusive(self.path / LOCK))
        except LockedError:
            raise InputError(f"{str(self.path)!r} is in use: another campaign runs there; choose another folder") from None
        except OSError as error:
            raise InsenvError(f"cannot lock {str(self.path / LOCK)!r}: {error.strerror or error}") from error

    def has(self, number: int) -> bool:
        """Whether the block is stored and undamaged."""
        whole = self._stored(self._file(number))
        expected = [self.plan.seed_of(run) for run in self.plan.blocks[number]]
        return whole is not None and np.array_equal(whole.get("seed", ()), expected)

    def put(self, number: int, arrays: Arrays) -> None:
        """Write a finished block.  Raises `InputError` beside another's."""
        self._write(self._file(number), arrays)
        with suppress(OSError):  # a finished block counts, whatever lies beside it
            self._begun(number).unlink(missing_ok=True)

    def put_part(self, number: int, arrays: Arrays) -> None:
        """Write what an interruption left of a block."""
        self._write(self._begun(number), arrays)

    def _write(self, path: Path, arrays: Arrays) -> None:
        """Write arrays, preceded by the manifest if they are the first."""
        try:
            self._identified()
            with atomic(path) as stream:
                np.savez(stream, allow_pickle=False, plan=np.array(self._digest), **arrays)
            self._wrote = True
        except OSError as error:
            raise InsenvError(f"cannot write to {str(self.path)!r}: {error.strerror or error}") from error

    def part(self, number: int) -> Arrays | None:
        """What an interruption left of a block; None if there is nothing that can be read."""
        return self._stored(self._begun(number))

    def _stored(self, path: Path) -> Arrays | None:
        """The arrays of a file of this campaign; None for another's, and if not all can be read."""
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
                whole = {name: arrays[name] for name in arrays.files}  # reading checks every checksum
        except _DAMAGE:
            return None
        return whole if str(whole.pop("plan", "")) == self._digest else None

    def column(self, number: int, name: str) -> np.ndarray:
        """One array of a finished block.  Raises `InsenvError` if it is damaged or a block of another campaign."""
        try:
            with self._file(number).open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
                if str(arrays["plan"]) != self._digest:
                    raise InsenvError(f"{self._file(number)}: a block of another campaign: its digest differs from the plan's")
                return arrays[name]
        except _DAMAGE as error:
            raise InsenvError(f"{self._file(number)}: can no longer be read: {error}") from None

    def _identified(self) -> None:
        """Make the folder of the blocks, and the manifest if there is none.  Raises `InputError` beside another's."""
        (self.path / BLOCKS).mkdir(parents=True, exist_ok=True)
        if (self.path / MANIFEST).exists():
            self._check(self.path / MANIFEST, True)
        else:
            text = json.dumps(self._manifest(), indent=1) + "\n"
            with atomic(self.path / MANIFEST) as stream:
                stream.write(text.encode())

    def _file(self, number: int) -> Path:
        return self.path / BLOCKS / f"{number:06d}.npz"

    def _begun(self, number: int) -> Path:
        return self.path / BLOCKS / f"{number:06d}.begun.npz"

    def _manifest(self) -> dict[str, Any]:
        return {"format": FORMAT, "version": VERSION, "digest": self._digest, "plan": self.plan.as_json()}

    def _check(self, manifest: Path, resume: bool) -> None:
        """Raise `InputError` unless the folder holds this campaign and it is to be resumed."""
        try:
            stored = json.loads(manifest.read_text(encoding="utf-8"))
            digest, plan = stored["digest"], stored["plan"]
        except (*_DAMAGE, TypeError):
            raise InputError(f"{str(manifest)!r} is not the manifest of a campaign: choose another folder") from None
        if digest != self._digest:
            raise InputError(
                f"{str(self.path)!r} holds another campaign: it differs in {_differences(plan, self.plan)}; {OTHER_FOLDER}"
            )
        if not resume:
            raise InputError(f"{str(self.path)!r} holds this campaign already: --resume continues it")

"""Storage of finished blocks: in memory, or in a folder from which an interrupted campaign resumes.

A folder holds `manifest.json`, the plan with its digest, and `blocks/NNNNNN.npz`, the summaries of the runs of each
block.  Files are written under a temporary name and renamed, so that a file with its final name is complete.  A damaged
block counts as not done.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from insenv.campaigns.block import Arrays
from insenv.campaigns.plan import Plan
from insenv.errors import InputError, InsenvError
from insenv.files.output import atomic

FORMAT, VERSION = "insenv-campaign", 1
MANIFEST, BLOCKS = "manifest.json", "blocks"
_DAMAGE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


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

    def column(self, number: int, name: str) -> np.ndarray:
        """One array of a finished block."""
        return self._blocks[number][name]


class Folder:
    """Blocks kept in a folder.

    plan: plan of the campaign.
    resume: whether to resume the campaign in the folder; if False, the folder must hold none.
    Raises `InputError` for a folder that holds another campaign or that cannot be used.
    """

    def __init__(self, path: str | Path, plan: Plan, resume: bool = False) -> None:
        self.path, self.plan = Path(path), plan
        self._digest = plan.digest
        manifest = self.path / MANIFEST
        if manifest.exists():
            self._check(manifest, resume)
        elif self.path.exists() and not self.path.is_dir():
            raise InputError(f"cannot write to the output folder {str(path)!r}: it is not a folder")
        elif (self.path / BLOCKS).exists():
            raise InputError(f"{str(self.path)!r} holds blocks of a campaign, but no {MANIFEST} to identify it")

    def has(self, number: int) -> bool:
        """Whether the block is stored and undamaged."""
        try:
            with self._file(number).open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
                whole = {name: arrays[name] for name in arrays.files}  # reading checks every checksum
        except _DAMAGE:
            return False
        runs = self.plan.blocks[number]
        expected = [self.plan.first_seed + run for run in runs]
        return str(whole.get("plan", "")) == self._digest and np.array_equal(whole.get("seed", ()), expected)

    def put(self, number: int, arrays: Arrays) -> None:
        """Write a finished block, preceded by the manifest if it is the first."""
        try:
            (self.path / BLOCKS).mkdir(parents=True, exist_ok=True)
            if not (self.path / MANIFEST).exists():
                text = json.dumps(self._manifest(), indent=1) + "\n"
                with atomic(self.path / MANIFEST) as stream:
                    stream.write(text.encode())
            with atomic(self._file(number)) as stream:
                np.savez(stream, allow_pickle=False, plan=np.array(self._digest), **arrays)
        except OSError as error:
            raise InsenvError(f"cannot write to {str(self.path)!r}: {error.strerror or error}") from error

    def column(self, number: int, name: str) -> np.ndarray:
        """One array of a finished block."""
        try:
            with self._file(number).open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
                return arrays[name]
        except _DAMAGE as error:
            raise InsenvError(f"{self._file(number)}: can no longer be read: {error}") from None

    def _file(self, number: int) -> Path:
        return self.path / BLOCKS / f"{number:06d}.npz"

    def _manifest(self) -> dict[str, Any]:
        return {"format": FORMAT, "version": VERSION, "digest": self._digest, "plan": self.plan.as_json()}

    def _check(self, manifest: Path, resume: bool) -> None:
        """Raise `InputError` unless the folder holds this campaign and it is to be resumed."""
        try:
            found = json.loads(manifest.read_text(encoding="utf-8"))
            digest, plan = found["digest"], found["plan"]
        except (*_DAMAGE, TypeError):
            raise InputError(f"{str(manifest)!r} is not the manifest of a campaign: choose another folder") from None
        if digest != self._digest:
            ours = self.plan.as_json()
            other = [name for name in ours if json.dumps(ours[name]) != json.dumps(plan.get(name))]
            raise InputError(f"{str(self.path)!r} holds another campaign: it differs in {', '.join(other)}")
        if not resume:
            raise InputError(f"{str(self.path)!r} holds this campaign already: --resume continues it")

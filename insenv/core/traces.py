"""Traced equations in the cache folder: reading them takes a tenth of the time of tracing.

A file holds the kernels of one model, named by the model's identity: a hash of all that follows, a line of JSON, then each
kernel as CasADi writes it, compressed.  A file that is damaged, or that another user could have written, is not read.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any

from insenv.base.output import atomic
from insenv.core.cache import is_private, usable_folder
from insenv.core.tables import Spans as Spans

FOLDER = "equations"
MAX_FILES = 400
"""Largest number of files; the oldest are removed.  insenv has some fifty models, and a changed source makes new ones."""


@dataclass(frozen=True)
class Kernel:
    """One function of a model in the form in which it is compiled.

    function: a `casadi.Function` of flat columns; its single result holds only the rows that it sets.
    spans: the slices of the state (or output) vector to which the pieces of the result belong, in order.
    """

    function: Any
    spans: Spans

    @property
    def pieces(self) -> list[tuple[slice, slice]]:
        """Each of the spans, with its slice of the result."""
        ends = list(accumulate((span.stop - span.start for span in self.spans), initial=0))
        return [(span, slice(*ends[k : k + 2])) for k, span in enumerate(self.spans)]

    @cached_property
    def text(self) -> str:
        """The function as CasADi writes it."""
        return str(self.function.serialize())


@dataclass(frozen=True, eq=False)
class Traced(Mapping[str, Kernel]):
    """The kernels of a model by name; those from the cache are read on first access.

    fingerprint: hash of the tables and equations.  spans: of each kernel.
    """

    fingerprint: str
    spans: Mapping[str, Spans]
    _kernels: dict[str, Kernel]
    _texts: Mapping[str, bytes]

    def __getitem__(self, name: str) -> Kernel:
        if name not in self._kernels:
            import casadi as ca

            text = zlib.decompress(self._texts[name]).decode()
            self._kernels[name] = Kernel(ca.Function.deserialize(text), self.spans[name])
        return self._kernels[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.spans)

    def __len__(self) -> int:
        return len(self.spans)


def traced(kernels: Mapping[str, Kernel], tables: str) -> Traced:
    """Kernels that were just traced.  tables: a text of the model's tables, for the fingerprint."""
    text = "".join(f"{name}{kernel.spans}{kernel.text}" for name, kernel in kernels.items())
    fingerprint = hashlib.sha256(f"{tables}{text}".encode()).hexdigest()
    return Traced(fingerprint, {name: kernel.spans for name, kernel in kernels.items()}, dict(kernels), {})


def read(identity: str) -> Traced | None:
    """The kernels of the model with this identity; None if they are not in the cache."""
    path = _path(identity)
    if path is None:
        return None
    try:
        if not is_private(path):
            return None
        digest, _, rest = path.read_bytes().partition(b"\n")
        if hashlib.sha256(rest).hexdigest().encode() != digest:
            return None
        head, _, body = rest.partition(b"\n")
        known = json.loads(head)
        spans, texts, done = {}, {}, 0
        for name, pieces, length in known["kernels"]:
            spans[name] = tuple(slice(start, stop) for start, stop in pieces)
            texts[name] = body[done : done + length]
            done += length
        return Traced(known["fingerprint"], spans, {}, texts)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def keep(identity: str, traced: Traced) -> None:
    """Write the kernels of a model to the cache, if its folder can be used."""
    path = _path(identity)
    if path is None:
        return
    texts = {name: zlib.compress(traced[name].text.encode(), 1) for name in traced}
    body = b"".join(texts.values())
    kernels = [(name, [(span.start, span.stop) for span in traced.spans[name]], len(texts[name])) for name in texts]
    content = json.dumps({"fingerprint": traced.fingerprint, "kernels": kernels}).encode() + b"\n" + body
    with contextlib.suppress(OSError):
        path.parent.mkdir(mode=0o700, exist_ok=True)
        with atomic(path, private=True) as stream:
            stream.write(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
        _limit(path.parent)


def _path(identity: str) -> Path | None:
    folder = usable_folder()
    return None if folder is None else folder / FOLDER / identity[:32]


def _limit(folder: Path) -> None:
    """Remove the oldest files beyond `MAX_FILES`."""
    files = []
    with os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):  # another process may have removed it
                files.append((entry.stat().st_mtime, entry.path))
    for _, path in sorted(files)[:-MAX_FILES]:
        with contextlib.suppress(OSError):
            os.unlink(path)

"""The files of a `Document`: arrays, JSON, page, figure.

All of them are written, or none: an interruption leaves the files of an earlier run as they were.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insenv.base.errors import InputError, InsenvError
from insenv.base.installing import advice, is_installed
from insenv.base.output import as_path, cannot_write, staged, to_json
from insenv.base.style import save
from insenv.report.document import Document
from insenv.report.figures import draw
from insenv.report.page import html


def no_matplotlib() -> str:
    """The note of results without a figure because matplotlib is not installed; empty if it is."""
    return "" if is_installed("matplotlib") else f"no figure: matplotlib is not installed: {advice('matplotlib', 'plot')}"


@dataclass(frozen=True)
class FilesWritten:
    """paths: the files written: npz, json, html, png, svg, then further ones. note: what was omitted and why, or empty."""

    paths: tuple[Path, ...]
    note: str = ""


class OutputFolder:
    """An output folder, checked before the long work. Raises `InputError` if it cannot be written to.

    The first file creates it: work that fails leaves no empty folder.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = as_path("folder", path)
        try:
            present = next(p for p in (self.path.absolute(), *self.path.absolute().parents) if p.exists())
            if not present.is_dir():
                raise InputError(f"cannot write to the output folder {str(path)!r}: {str(present)!r} is not a folder")
            with tempfile.TemporaryFile(dir=present):
                pass
        except OSError as error:
            raise cannot_write(self.path, error) from None

    @contextmanager
    def staged(self) -> Iterator[Callable[[str], Path]]:
        """Write all files of the block or none; see `insenv.base.output.staged`. Raises `InsenvError` if writing fails.

        A name may have folders in it, which are made.
        """
        made = [path for path in (self.path, *self.path.parents) if not path.exists()]
        try:
            with ExitStack() as stack:
                parts: dict[Path, Callable[[str], Path]] = {}

                def part(name: str) -> Path:
                    inner = Path(name).parent
                    if inner not in parts:
                        (self.path / inner).mkdir(parents=True, exist_ok=True)
                        parts[inner] = stack.enter_context(staged(self.path / inner))
                    return parts[inner](Path(name).name)

                self.path.mkdir(parents=True, exist_ok=True)
                yield part
        except OSError as error:
            raise InsenvError(f"cannot write to {str(self.path)!r}: {error.strerror or error}") from error
        finally:
            for path in made:  # of work that fails
                with suppress(OSError):
                    path.rmdir()


def write_document(
    document: Document, folder: OutputFolder, figure: bool = True, more: Mapping[str, str | bytes] | None = None
) -> FilesWritten:
    """Write the files of a document: its texts, NAME.npz, NAME.json; if `figure`, its page and, with matplotlib, its figure.

    more: contents of further files by name, which come last.  Raises `InsenvError` if that fails; then none of them is written.
    """
    note = ""
    if figure:
        note = document.undrawn or (no_matplotlib() if document.figure else "")
    page, picture = (document.page, None if note else document.figure) if figure else (None, None)
    present = {"npz": document.arrays, "json": True, "html": page, "png": picture, "svg": picture}
    listed: dict[str, Sequence[str]] = {"texts": list(document.texts), "further": list(document.further)}
    listed |= {kind: [f"{document.name}.{kind}"] for kind, there in present.items() if there}
    names = [*(name for part in document.order for name in listed.get(part, ())), *(more or {})]
    paths = tuple(folder.path / name for name in names)
    with folder.staged() as part:
        write_contents(document.texts, part)
        if document.arrays is not None:
            with part(f"{document.name}.npz").open("wb") as stream:
                np.savez_compressed(stream, allow_pickle=False, **document.arrays())
        text = to_json(document.as_json([str(path) for path in paths] if document.located else names)) + "\n"
        part(f"{document.name}.json").write_text(text, encoding="ascii")
        for name, write in document.further.items():
            write(part(name))
        if page is not None:
            part(f"{document.name}.html").write_text(html(page()), encoding="utf-8", newline="\n")
        if picture is not None:
            save(draw(picture()), {kind: part(f"{document.name}.{kind}") for kind in ("png", "svg")})
        write_contents(more or {}, part)
    return FilesWritten(paths, note)


def write_contents(contents: Mapping[str, str | bytes], part: Callable[[str], Path]) -> None:
    """Write texts and bytes by name through `part`, the function that `OutputFolder.staged` gives."""
    for name, content in contents.items():
        part(name).write_bytes(content.encode() if isinstance(content, str) else content)


def file_name(scenario: str) -> str:
    """The scenario's name (of a file: without folder and suffix) as a file name that is valid on every system."""
    name = Path(scenario).stem if scenario.endswith(".toml") else scenario
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "run"

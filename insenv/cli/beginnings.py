"""The commands `insenv examples` and `insenv new`: files to start from."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from insenv.base.errors import InputError
from insenv.cli.options import Json, deferred, given_path


class Kind(str, Enum):
    """What `insenv new` writes."""

    scenario = "scenario"
    log = "log"


@deferred
def examples(
    folder: Annotated[
        Path, typer.Argument(parser=given_path, metavar="[DIR]", help="Folder to write to; made if it does not exist.")
    ] = Path("examples"),
    as_json: Json = False,
) -> None:
    """Copy the examples to a folder: scripts, a scenario, recorded logs."""
    from insenv.base.resources import examples_folder

    source = examples_folder()
    texts = {
        path.relative_to(source).as_posix(): path.read_bytes()
        for path in sorted(source.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }
    count, new_ones = len(texts), len(_write(folder, texts))
    shown = folder.as_posix()
    told = f"{count} files written to {shown}" if new_ones == count else f"{count} files in {shown}, {new_ones} of them new"
    _tell(
        folder,
        list(texts),
        as_json,
        f"{told}; to try them:",
        f"  insenv run {shown}/own_scenario.toml",
        f"  insenv replay {shown}/logs/plain.toml -e loosely-coupled",
        f"  python {shown}/env_loop.py",
    )


@deferred
def new(
    kind: Annotated[Kind, typer.Argument(metavar="scenario|log", help="A scenario to simulate, or a recorded log.")],
    file: Annotated[Path, typer.Argument(parser=given_path, metavar="FILE", help="The .toml file to write.")],
    as_json: Json = False,
) -> None:
    """Write a commented file to start from, which runs as it is: a scenario, or a description of a log with its CSV files."""
    from insenv.base.resources import examples_folder

    if file.suffix != ".toml":
        raise InputError(f"FILE = {str(file)!r}: allowed is a name that ends in .toml")
    if not file.parent.is_dir():
        raise InputError(f"cannot write {str(file)!r}: there is no folder {str(file.parent)!r}")
    source = examples_folder()
    if kind is Kind.scenario:
        texts = {file.name: _renamed(source / "own_scenario.toml", {"examples/own_scenario.toml": file.as_posix()})}
        command = f"insenv run {file.as_posix()}"
    else:
        # the samples stand beside the description, under its name
        samples = {
            path.name: f"{file.stem}{path.name.removeprefix('plain')}" for path in sorted((source / "logs").glob("plain-*"))
        }
        texts = {file.name: _renamed(source / "logs" / "plain.toml", {"examples/logs/plain.toml": file.as_posix(), **samples})}
        texts |= {name: (source / "logs" / of).read_bytes() for of, name in samples.items()}
        command = f"insenv replay {file.as_posix()} -e loosely-coupled"
    new_ones = _write(file.parent, texts)
    told = f"written: {', '.join(new_ones)}"
    if not new_ones:
        told = f"nothing written: {', '.join(texts)} {'exists' if len(texts) == 1 else 'exist'} already"
    _tell(file.parent, list(texts), as_json, f"{told}; to try it:", f"  {command}")


def _renamed(path: Path, names: dict[str, str]) -> bytes:
    """The text of a file with other names in it."""
    text = path.read_text(encoding="utf-8")
    for old, new_name in names.items():
        text = text.replace(old, new_name)
    return text.encode()


def _write(folder: Path, texts: dict[str, bytes]) -> list[str]:
    """Write files below a folder, all or none, and return their names; one that is there with this content stays.

    Raises `InputError` if one exists with another content or the folder cannot be written to.
    """
    from insenv.base.output import staged

    try:
        equal = [name for name, text in texts.items() if (folder / name).is_file() and (folder / name).read_bytes() == text]
    except OSError as error:
        raise InputError(f"cannot read {str(error.filename or folder)!r}: {error.strerror or error}") from None
    texts = {name: text for name, text in texts.items() if name not in equal}
    there = [name for name in texts if (folder / name).exists()]
    if there:
        named = str(folder / there[0])
        what = f"{named!r} exists" if len(there) == 1 else f"{named!r} and {len(there) - 1} more files exist"
        raise InputError(f"{what} with another content: no file is overwritten")
    try:
        folders = sorted({(folder / name).parent for name in texts})
        for place in folders:
            place.mkdir(parents=True, exist_ok=True)
        for place in folders:
            with staged(place) as part:
                for name, text in texts.items():
                    if (folder / name).parent == place:
                        part(Path(name).name).write_bytes(text)
    except OSError as error:
        raise InputError(f"cannot write {str(error.filename or folder)!r}: {error.strerror or error}") from None
    return list(texts)


def _tell(folder: Path, names: list[str], as_json: bool, *lines: str) -> None:
    from insenv.cli.output import print_json, print_line

    if as_json:
        print_json({"files": [str(folder / name) for name in names]})
        return
    for line in lines:
        print_line(line)

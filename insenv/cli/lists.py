"""Names, keys and files to start from: the commands `insenv list`, `insenv schema`, `insenv examples`, `insenv new`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, Optional, get_args

import typer

from insenv.base.errors import InputError
from insenv.cli.options import Json, command, nonempty_path

Rows = list[dict[str, Any]]


What = Literal["scenarios", "estimators", "states", "aids", "vehicles", "sensors", "grades", "environments"]
"""What `insenv list` lists."""


@command
def list_all(
    what: Annotated[
        Optional[What],  # noqa: UP045
        typer.Argument(
            metavar="[WHAT]",
            help=f"What to list with titles: {', '.join(get_args(What))}; without it only names, of all of them.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """List scenarios, estimators, states and aids of fusion filters, vehicles, sensors, grades and environments."""
    from insenv.cli.output import print_json, print_line

    if as_json:
        chosen = get_args(What) if what is None else (what,)
        print_json({key: rows for one in chosen for key, rows in _known(one).items()})
    elif what is None:
        _print_names()
    else:
        for place, (key, rows) in enumerate(_known(what).items()):
            if place:
                print_line()
            _print_titles(key, rows)


def _known(what: What) -> dict[str, Rows]:
    """What there is, by the key of the JSON document."""
    from insenv import estimators, scenario, sensors, vehicles
    from insenv.base.shipped import titles
    from insenv.base.toml import summary
    from insenv.estimators.fusion.available import all_aids, all_states
    from insenv.sensors import registry

    if what == "scenarios":
        return {"scenarios": scenario.summaries()}
    if what == "estimators":
        known = estimators.registered().values()
        return {
            "estimators": [
                {"id": e.id, "title": e.title, "kind": e.kind, "aided": e.aided, "sensors": list(e.sensors)} for e in known
            ]
        }
    if what == "states":
        meanings = {name: state.value.meaning.removeprefix("Estimated ") for name, state in all_states().items()}
        return {"states": _titled("name", meanings)}
    if what == "aids":
        return {
            "aids": _titled("name", {id: f"{aid.title.removeprefix('the ')}: {aid.what}" for id, aid in all_aids().items()})
        }
    if what == "vehicles":
        kinds = vehicles.registry.registered()
        return {"vehicles": _titled("kind", {kind: summary(section) for kind, section in kinds.items()})}
    if what == "sensors":
        return {"sensors": _titled("id", {id: summary(section) for id, section in registry.registered().items()})}
    if what == "environments":
        return {"environments": _titled("id", titles())}
    grades = {"imu_grades": {**sensors.IMU_GRADES, **_folder_grades()}, "gnss_grades": sensors.GNSS_GRADES}
    lists = {key: _titled("name", {name: known[name].title for name in real_first(known)}) for key, known in grades.items()}
    lists["instrument_grades"] = [
        {"sensor": id, "name": grade.name, "title": grade.title}
        for id, each in registry.instruments().items()
        for grade in each.grades.values()
    ]
    return lists


def _titled(key: str, titles: Mapping[str, str]) -> Rows:
    """Rows of names, under `key`, with their titles."""
    return [{key: name, "title": title} for name, title in titles.items()]


def _folder_grades() -> dict[str, Any]:
    """The grades of inertial units in files of the working folder; files that hold none are named on stderr."""
    if not any(_may_be_grade(path) for path in Path.cwd().glob("*.toml")):  # without the import of all sensors
        return {}
    from insenv.cli.output import print_line
    from insenv.sensors.grade_file import in_folder

    grades, faults = in_folder(Path.cwd())
    for fault in faults:
        print_line(f"insenv: not a grade: {fault}", stderr=True)
    return dict(grades)


def _may_be_grade(path: Path) -> bool:
    """Whether a file names a figure of an inertial unit anywhere."""
    try:
        content = path.read_bytes()
    except OSError:
        return False
    return b"gyro_" in content or b"accel_" in content


def real_first(grades: Iterable[str]) -> list[str]:
    """The names of grades: those of real units and of files, then the one without errors, then those that papers simulate."""
    return sorted(grades, key=lambda name: 2 if name.startswith("paper-") else int(name == "perfect"))


def _names() -> Iterator[tuple[str, list[str]]]:
    """All names but those of papers' simulations and printed forms, by what they name; what insenv ships is not imported."""
    from insenv.base.resources import scenario_titles
    from insenv.base.shipped import ESTIMATORS, GNSS_GRADES, IDS, IMU_GRADES, SENSORS, VEHICLES

    yield "scenarios", [name for name, title in scenario_titles().items() if "paper" not in title.lower()]
    yield "estimators", [id for id in _with_installed("estimators", ESTIMATORS) if not id.endswith("-printed")]
    yield "vehicles", _with_installed("vehicles", VEHICLES)
    yield "sensors", _with_installed("sensors", SENSORS)
    yield "IMU grades", real_first([*IMU_GRADES, *_folder_grades()])
    yield "GNSS grades", real_first(GNSS_GRADES)
    yield "environments", list(IDS)


def _with_installed(group: str, shipped: Iterable[str]) -> list[str]:
    """The names of what insenv ships, and of what installed packages add, which are imported only if there are any."""
    from importlib.metadata import entry_points  # which imports much of the standard library

    if not entry_points(group=f"insenv.{group}"):
        return list(shipped)
    return list(import_module(f"insenv.{group}.registry").names())


def _print_names() -> None:
    from insenv.cli.output import print_line, print_table

    rows = [(what, ", ".join(names)) for what, names in _names()]
    print_table(("what", "names"), rows, head=False)
    print_line("titles, states, aids, grades, scenarios of papers: insenv list WHAT")


_HEADS = {
    "vehicles": "kind of vehicle",
    "imu_grades": "IMU grade",
    "gnss_grades": "GNSS grade",
    "instrument_grades": "instrument grade",
}
"""Heads of the columns of names that are not the key of the JSON document without its s."""


def _print_titles(key: str, rows: Rows) -> None:
    from insenv.cli.output import print_table
    from insenv.estimators.contract import shown_name

    def takes(row: dict[str, Any]) -> str:
        return ", ".join(["IMU", *map(shown_name, row["sensors"])])

    name = next(name for name in ("sensor", "name", "id", "kind") if name in rows[0])
    columns: dict[str, Callable[[dict[str, Any]], str]] = {_HEADS.get(key, key.removesuffix("s")): lambda row: row[name]}
    if key == "scenarios":
        columns["duration"] = lambda row: f"{row['duration_s']:g} s"
    if key == "estimators":
        columns |= {"kind": lambda row: row["kind"], "takes": takes}
    if key == "instrument_grades":
        columns = {"sensor": lambda row: row["sensor"], "grade": lambda row: row["name"]}
    columns["title"] = lambda row: row["title"]
    print_table(list(columns), [[text(row) for text in columns.values()] for row in rows])


@command
def schema(as_json: Annotated[bool, typer.Option("--json", help="No effect: the schema is JSON.")] = False) -> None:
    """Print the JSON schema of a scenario file, for editors."""
    from insenv.cli.output import print_json
    from insenv.scenario import json_schema

    print_json(json_schema())


# The commands `insenv examples` and `insenv new`: files to start from.


Kind = Literal["scenario", "log"]
"""What `insenv new` writes."""


@command
def examples(
    folder: Annotated[
        Path, typer.Argument(parser=nonempty_path, metavar="[DIR]", help="Folder to write to; made if it does not exist.")
    ] = Path("examples"),
    as_json: Json = False,
) -> None:
    """Copy the examples to a folder: scripts, a scenario, recorded logs, a package of plug-ins."""
    from insenv.base.resources import examples_folder
    from insenv.cli.output import print_answer

    source = examples_folder()
    texts = {
        path.relative_to(source).as_posix(): path.read_bytes()
        for path in sorted(source.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }
    count, added, to = len(texts), len(_write(folder, texts)), folder.as_posix()
    done = f"{count} files written to {to}" if added == count else f"{count} files in {to}, {added} of them new"
    print_answer(
        as_json,
        {"files": [str(folder / name) for name in texts]},
        [
            f"{done}; to try them:",
            f"  insenv run {to}/own_scenario.toml",
            f"  insenv replay {to}/logs/plain.toml -e loosely-coupled",
            f"  python {to}/env_loop.py",
        ],
    )


@command
def new(
    kind: Annotated[Kind, typer.Argument(metavar="scenario|log", help="A scenario to simulate, or a recorded log.")],
    file: Annotated[Path, typer.Argument(parser=nonempty_path, metavar="FILE", help="The .toml file to write.")],
    as_json: Json = False,
) -> None:
    """Write a commented file to start from, which runs as it is: a scenario, or a description of a log with its CSV files."""
    from insenv.base.output import check_output_file
    from insenv.base.resources import examples_folder
    from insenv.cli.output import print_answer

    check_output_file(file, ".toml")
    source = examples_folder()
    if kind == "scenario":
        texts = {file.name: _renamed(source / "own_scenario.toml", {"examples/own_scenario.toml": file.as_posix()})}
        trial = f"insenv run {file.as_posix()}"
    else:
        # the samples stand beside the description, under its name
        samples = {
            path.name: f"{file.stem}{path.name.removeprefix('plain')}" for path in sorted((source / "logs").glob("plain-*"))
        }
        texts = {file.name: _renamed(source / "logs" / "plain.toml", {"examples/logs/plain.toml": file.as_posix(), **samples})}
        texts |= {name: (source / "logs" / of).read_bytes() for of, name in samples.items()}
        trial = f"insenv replay {file.as_posix()} -e loosely-coupled"
    added = _write(file.parent, texts)
    done = f"written: {', '.join(added)}"
    if not added:
        done = f"nothing written: {', '.join(texts)} {'exists' if len(texts) == 1 else 'exist'} already"
    files = [str(file.parent / name) for name in texts]
    print_answer(as_json, {"files": files}, [f"{done}; to try it:", f"  {trial}"])


def _renamed(path: Path, names: dict[str, str]) -> bytes:
    """The text of a file with other names in it."""
    text = path.read_text(encoding="utf-8")
    for old, new_name in names.items():
        text = text.replace(old, new_name)
    return text.encode()


def _write(folder: Path, texts: dict[str, bytes]) -> list[str]:
    """Write files below a folder, all or none, and return their names; a file that exists with this content is left.

    Raises `InputError` if one exists with another content or the folder cannot be written to.
    """
    from insenv.base.output import cannot_write, staged

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
    except FileExistsError:
        raise InputError(f"cannot write to the folder {str(folder)!r}: it is a file") from None
    except OSError as error:
        raise cannot_write(Path(error.filename or folder), error) from None
    return list(texts)

"""The commands `insenv list` and `insenv schema`: the names and keys that commands and scenario files accept."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from enum import Enum
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.options import Json, deferred, given_path

if TYPE_CHECKING:
    from insenv.estimators.fusion import ErrorState


Rows = list[dict[str, Any]]


class What(str, Enum):
    """What `insenv list` lists."""

    scenarios = "scenarios"
    estimators = "estimators"
    states = "states"
    aids = "aids"
    vehicles = "vehicles"
    sensors = "sensors"
    grades = "grades"
    environments = "environments"


@deferred
def list_all(
    what: Annotated[
        Optional[What],  # noqa: UP045
        typer.Argument(metavar="[WHAT]", help=f"{', '.join(What)}: these, with their titles; without it the names of all."),
    ] = None,
    as_json: Json = False,
) -> None:
    """List scenarios, estimators, states and aids of fusion filters, vehicles, sensors, grades and environments."""
    from insenv.cli.output import print_json, print_line

    if as_json:
        chosen = What if what is None else (what,)
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
    from insenv import estimators
    from insenv.base.registration import titles
    from insenv.base.toml import summary
    from insenv.estimators.fusion.available import all_aids, all_states
    from insenv.scenario import summaries
    from insenv.sensors import GNSS_GRADES, IMU_GRADES
    from insenv.sensors import registry as sensors
    from insenv.sensors.figures import FiguresSection
    from insenv.vehicles import registry as vehicles

    if what is What.scenarios:
        return {"scenarios": summaries()}
    if what is What.estimators:
        known = estimators.registered().values()
        return {
            "estimators": [
                {"id": e.id, "title": e.title, "kind": e.kind, "aided": e.aided, "sensors": list(e.sensors)} for e in known
            ]
        }
    if what is What.states:
        return {"states": [{"name": name, "title": _what(state)} for name, state in all_states().items()]}
    if what is What.aids:
        return {
            "aids": [{"name": id, "title": f"{aid.title.removeprefix('the ')}: {aid.what}"} for id, aid in all_aids().items()]
        }
    if what is What.vehicles:
        return {"vehicles": [{"kind": kind, "title": summary(section)} for kind, section in vehicles.registered().items()]}
    if what is What.sensors:
        return {"sensors": [{"id": id, "title": summary(section)} for id, section in sensors.registered().items()]}
    if what is What.grades:
        grades: dict[str, Any] = {"imu_grades": {**IMU_GRADES, **_own_grades()}, "gnss_grades": GNSS_GRADES}
        found: dict[str, Rows] = {
            key: [{"name": name, "title": known[name].title} for name in real_first(known)] for key, known in grades.items()
        }
        found["instrument_grades"] = [
            {"sensor": id, "name": grade.name, "title": grade.title}
            for id, section in sensors.registered().items()
            if issubclass(section, FiguresSection)
            for grade in section.grades.values()
        ]
        return found
    return {"environments": [{"id": id, "title": title} for id, title in titles().items()]}


def _own_grades() -> dict[str, Any]:
    """The grades of inertial units in files of the working folder; files that are none are told on stderr."""
    if not any(Path.cwd().glob("*.toml")):
        return {}
    from insenv.cli.output import print_line
    from insenv.sensors.grade_file import in_folder

    own, faults = in_folder(Path.cwd())
    for fault in faults:
        print_line(f"insenv: not a grade: {fault}", stderr=True)
    return dict(own)


def _what(state: ErrorState) -> str:
    """What an error state is, without "Estimated"."""
    return state.value.meaning.removeprefix("Estimated ")


def real_first(grades: Iterable[str]) -> list[str]:
    """The names of grades: those of real units and of files, then the one without errors, then those that papers simulate."""
    return sorted(grades, key=lambda name: 2 if name.startswith("paper-") else int(name == "perfect"))


_HEADS = {
    "vehicles": "kind of vehicle",
    "imu_grades": "IMU grade",
    "gnss_grades": "GNSS grade",
    "instrument_grades": "instrument grade",
}


_WITH_SENSOR = ("instrument_grades",)
"""Lists of grades whose names are those of one sensor."""
_TITLES_ONLY = ("states", *_WITH_SENSOR)
"""Lists too long for the screen that shows all names; grades, scenarios and forms of papers are left out there too."""


def _names() -> Iterator[tuple[str, list[str]]]:
    """All names but those of papers' simulations and printed forms, by what they name; what insenv ships is not imported."""
    from insenv.base.registration import IDS
    from insenv.base.resources import scenario_titles
    from insenv.base.shipped import ESTIMATORS, SENSORS, VEHICLES
    from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES

    yield "scenarios", [name for name, title in scenario_titles().items() if "paper" not in title.lower()]
    yield "estimators", [id for id in _with_installed("estimators", ESTIMATORS) if not id.endswith("-printed")]
    yield "vehicles", _with_installed("vehicles", VEHICLES)
    yield "sensors", _with_installed("sensors", SENSORS)
    for head, known in (("IMU grades", {**IMU_GRADES, **_own_grades()}), ("GNSS grades", GNSS_GRADES)):
        yield head, [name for name in real_first(known) if not name.startswith("paper-")]
    yield "environments", list(IDS)


def _with_installed(group: str, shipped: Iterable[str]) -> list[str]:
    """The names of what insenv ships, and of what installed packages add, which are asked only if there are any."""
    if not entry_points(group=f"insenv.{group}"):
        return list(shipped)
    return list(import_module(f"insenv.{group}.registry").names())


def _head(key: str) -> str:
    return _HEADS.get(key, key.removesuffix("s"))


def _name(row: dict[str, Any]) -> str:
    return str(next(row[key] for key in ("name", "id", "kind") if key in row))


def _print_names() -> None:
    from insenv.cli.output import print_line, print_table

    rows = [(what, ", ".join(names)) for what, names in _names()]
    print_table(("what", "names"), rows, head=False)
    print_line("titles, states, aids, instruments, what papers simulate: insenv list WHAT")


def _print_titles(key: str, rows: Rows) -> None:
    from insenv.cli.output import print_table
    from insenv.estimators.contract import shown_name

    columns: Sequence[str] = (_head(key), "title")
    shown: list[Sequence[str]]
    if key == "scenarios":
        columns = (_head(key), "duration", "title")
        shown = [(row["name"], f"{row['duration_s']:g} s", row["title"]) for row in rows]
    elif key == "estimators":
        columns = (_head(key), "kind", "takes", "title")
        shown = [(row["id"], row["kind"], ", ".join(["IMU", *map(shown_name, row["sensors"])]), row["title"]) for row in rows]
    elif key in _WITH_SENSOR:
        columns = ("sensor", "grade", "title")
        shown = [(row["sensor"], row["name"], row["title"]) for row in rows]
    else:
        shown = [(_name(row), row["title"]) for row in rows]
    print_table(columns, shown)


@deferred
def schema(as_json: Annotated[bool, typer.Option("--json", help="No effect: the schema is JSON.")] = False) -> None:
    """Print the JSON schema of a scenario file, for editors."""
    from insenv.cli.output import print_json
    from insenv.scenario import json_schema

    print_json(json_schema())


# The commands `insenv examples` and `insenv new`: files to start from.


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

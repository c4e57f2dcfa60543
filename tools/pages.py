"""Generate parts of the pages in docs/ (tables of keys, of rows, of grades, names; code), pictures and scenarios/schema.json.

``python tools/pages.py`` in the repository rewrites them; tests/project/test_pages.py compares. A generated part of a page
stands between ``<!-- begin NAME (python tools/pages.py) -->`` and ``<!-- end NAME -->``.
"""

from __future__ import annotations

import importlib
import inspect
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

import benchmarks
import estimator_pages
import pictures
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

import insenv
from insenv import estimators
from insenv.base.remarks import TEXTS
from insenv.base.shipped import VEHICLES
from insenv.base.toml import plain, sections_in
from insenv.core.tables import Row, Table
from insenv.estimators.contract import shown_name
from insenv.logs.description import EvaluationSection, InitialSection, LogDescription, PublishedSection
from insenv.logs.description import GnssSection as LogGnssSection
from insenv.logs.description import ImuSection as LogImuSection
from insenv.logs.description import ReferenceSection as LogReferenceSection
from insenv.logs.flight_log import FlightDescription
from insenv.logs.instruments import section_of
from insenv.report.console import as_text
from insenv.scenario import description, json_schema
from insenv.scenario.description import GravitySection
from insenv.scenario.tracks.fmu_section import Outputs
from insenv.scenario.tracks.readers import Columns
from insenv.scenario.tracks.waypoints import Waypoint
from insenv.sensors import GnssSection, ImuSection
from insenv.sensors.catalogue import IMU_GRADES
from insenv.sensors.gnss import FIGURES, GNSS_GRADES, GNSS_PARAMETERS, GNSS_STATE, GNSS_STATED
from insenv.sensors.grades import ImuGrade
from insenv.sensors.imu_tables import IMU_PARAMETERS, IMU_STATE
from insenv.sensors.registry import instruments, registered
from insenv.sensors.sampled import Sampled
from insenv.studies.proof import public_logs
from insenv.studies.proof_result import Proof
from insenv.vehicles import registry as vehicles
from insenv.vehicles import section as legs
from insenv.vehicles.ship import AngleWave, HullSection, LengthWave, SeaSection, SwaySection

ROOT = Path(__file__).resolve().parents[1]
Sections = Iterable[tuple[str, type[BaseModel]]]


def markdown(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


# --- keys of TOML files ------------------------------------------------------------------------------

PARTS: dict[type[BaseModel], str] = {
    SwaySection: "[vehicle.sway]",
    AngleWave: "a sinusoid of roll, pitch or yaw",
    LengthWave: "a sinusoid of north, east or down",
    SeaSection: "[vehicle.sea]",
    HullSection: "[vehicle.sea.hull]",
    legs.EngineWave: "a frequency of an engine",
    Columns: "[vehicle.columns]",
    Waypoint: "a waypoint",
    Outputs: "[vehicle.outputs]",
}
"""Titles of the sections within those of vehicles that are no legs."""


def vehicle_sections() -> Sections:
    """The section of each kind of vehicle with its title, then those within it that no kind before has."""
    listed: dict[type[BaseModel], str] = {}
    for kind in VEHICLES:
        section = vehicles.get(kind)
        article = "an" if kind[0] in "aeiou" else "a"
        listed[section] = f'[vehicle], kind = "{kind}"'
        for part in _within(section):
            listed.setdefault(part, PARTS.get(part, f"a leg of {article} {kind}"))
    return [(title, section) for section, title in listed.items()]


def _within(section: type[BaseModel]) -> list[type[BaseModel]]:
    parts = [part for field in section.model_fields.values() for part in sections_in(field.annotation)]
    return [each for part in parts for each in (part, *_within(part))]


SCENARIO_SECTIONS: Sections = (
    ("top level", description.scenario_class()),
    ("[start]", legs.StartSection),
    *vehicle_sections(),
    ("[imu]", ImuSection),
    ("[gnss]", GnssSection),
    *((f"[{id}]", section) for id, section in registered().items() if id in instruments()),
    ("[gravity]", GravitySection),
    ("[knowledge]", description.KnowledgeSection),
    ("[[story]]", description.CaptionSection),
)
LOG_SECTIONS: Sections = (
    ("top level", LogDescription),
    ("[imu]", LogImuSection),
    ("[gnss]", LogGnssSection),
    *((f"[{id}]", section) for id, section in ((id, section_of(each)) for id, each in instruments().items())),
    ("[reference]", LogReferenceSection),
    ("[initial]", InitialSection),
    ("[evaluation]", EvaluationSection),
    ("[[evaluation.published]]", PublishedSection),
)
FLIGHT_SECTIONS: Sections = (("top level", FlightDescription),)

SCENARIO_TYPES = {"outages_s": "list of pairs"}
"""Types by key, for keys whose annotation does not show the type that a user writes."""
LOG_TYPES = {
    "axes": "text or 3x3",
    "accel_axes": "text or 3x3",
    "file": "text or list",
}


def key_tables(sections: Sections, types: dict[str, str] | None = None) -> str:
    """For each section a heading, the first line of its docstring and a table of its keys.

    Keys that a section shares with an earlier one through a common base class are listed only there, unless their default
    is another one.
    """
    parts: list[str] = []
    owners: dict[type, tuple[str, type[BaseModel]]] = {}
    for title, model in sections:
        bases = [base for base in model.__mro__[1:] if base.__module__ == model.__module__]
        shared = next((base for base in bases if base in owners), None)
        inherited = getattr(shared, "model_fields", {})
        parts.append(f"### {title}\n\n{(model.__doc__ or '').strip().partition(chr(10))[0]}\n")
        same: set[str] = set()
        if shared is not None:
            first, *_, last = inherited
            owner, listed = owners[shared]
            same = {name for name in inherited if model.model_fields[name].default == listed.model_fields[name].default}
            other = [f"`{name}`" for name in inherited if name not in same]
            changed = f", of which {', '.join(other)} {'has' if len(other) == 1 else 'have'} another default" if other else ""
            parts.append(f"In addition to the keys `{first}` to `{last}` of {owner}{changed}:\n")
        parts.append(key_table(model, same, types) + "\n")
        owners = {**dict.fromkeys(bases, (title, model)), **owners}
    return "\n".join(parts).rstrip()


def key_table(model: type[BaseModel], without: Iterable[str] = (), types: dict[str, str] | None = None) -> str:
    """The table of the keys of one section."""
    fields = ((name, field) for name, field in model.model_fields.items() if name not in without)
    head = ("key", "value", "unit", "allowed", "default", "meaning")
    return markdown(head, (_key_cells(name, field, types or {}) for name, field in fields))


def _key_cells(name: str, field: Any, types: dict[str, str]) -> list[str]:
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    default = field.default
    if default is PydanticUndefined:
        text = "must be given"
    elif default is None or default == () or default == {} or default == "" or isinstance(default, BaseModel):
        text = "-"
    else:
        text = f"`{default}`"
    value = types.get(name) or _takes(field.metadata) or _type(field.annotation)
    allowed = _limits(field.metadata, field.annotation)
    return [f"`{name}`", value, str(extra.get("unit", "")) or "-", allowed or "-", text, str(field.description)]


_SIGNS = {"gt": "above {}", "ge": "from {}", "lt": "below {}", "le": "to {}"}


def _limits(metadata: Any, annotation: Any = None) -> str:
    """The values that a key allows: from its numeric limits and from validators whose function has the attribute `limits`."""
    parts = [
        text.format(plain(getattr(item, name))) for name, text in _SIGNS.items() for item in metadata if hasattr(item, name)
    ]
    parts += [item.func.limits for item in metadata if hasattr(getattr(item, "func", None), "limits")]
    inner = [_limits(getattr(part, "__metadata__", ()), part) for part in get_args(annotation)]
    return " ".join(parts) or next((text for text in inner if text), "")


def _takes(metadata: Any) -> str:
    """The values that a validator takes instead of those of the type, if its function has the attribute `takes`; else empty."""
    return next((item.func.takes for item in metadata if hasattr(getattr(item, "func", None), "takes")), "")


def _type(annotation: Any) -> str:
    """A reader's name for the type of a key."""
    origin = get_origin(annotation)
    if origin is Literal:
        return ", ".join(f"`{v}`" for v in get_args(annotation))
    inner = [a for a in get_args(annotation) if a is not type(None)]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "section"
    if origin is dict:
        return "table"
    if origin is tuple and Ellipsis not in inner:
        of = "columns" if "str | int" in str(inner[0]) else "names" if set(inner) == {str} else "numbers"
        return f"{len(inner)} {of}"
    if origin is tuple:
        return "sections" if sections_in(inner[0]) else f"list of {_type(inner[0])}"
    if takes := _takes(getattr(annotation, "__metadata__", ())):
        return takes
    if inner and hasattr(annotation, "__metadata__"):
        return _type(inner[0])
    if set(inner) == {str, int}:
        return "column"
    if origin is Union and len(inner) > 1 and sections_in(annotation):
        return "section"
    if inner:
        return _type(inner[0])
    return {float: "number", int: "whole number", bool: "true, false", str: "text"}.get(annotation, "value")


# --- sensors -----------------------------------------------------------------------------------------


def rows_table(table: Table) -> str:
    """The rows of a table of the model."""
    head = ("row", "shape", "unit", "frame", "start", "meaning")
    return markdown(head, ([f"`{r.name}`", _shape(r), r.unit, r.frame, _start(r), r.meaning] for r in table))


def instrument_tables(part: Literal["measurement", "stated_errors"]) -> str:
    """The measurement rows of every instrument, or its stated errors."""
    tables = [(f"{each.title} (`{id}`)", getattr(each, part)) for id, each in instruments().items()]
    tables += [("GNSS receiver (`gnss`)", GNSS_STATED)] if part == "stated_errors" else []
    return "\n\n".join(f"### {title}\n\n{rows_table(table)}" for title, table in tables)


def instrument_grades() -> str:
    """The catalogue of each instrument: its grades, their figures and the source of each."""
    parts = []
    for id, each in instruments().items():
        parts.append(f"### {each.title} (`[{id}]`)\n")
        for grade in each.grades.values():
            rows = ([f"`{name}`", _figure(value), grade.source(name)] for name, value in grade.figures.items())
            table = f"\n\n{markdown(['figure', 'value', 'source'], rows)}" if grade.figures else ""
            parts.append(f"`{grade.name}`: {grade.title}{table}\n")
    return "\n".join(parts).rstrip()


def instrument_parameters() -> str:
    """The parameter rows of each instrument."""
    tables = ((each.title, Sampled(each).all_parameters) for each in instruments().values())
    return "\n\n".join(f"### {title}\n\n{rows_table(table)}" for title, table in tables)


def imu_grades() -> str:
    """The IMU catalogue: each grade, its figures and the source of each."""
    return "\n".join(_imu_grade(grade) for grade in IMU_GRADES.values()).rstrip()


def gnss_grades() -> str:
    """The GNSS catalogue."""
    rows = (
        [
            f"`{grade.name}`",
            grade.title,
            *(_figure(grade.figures[key]) if key in grade.figures else "" for key in FIGURES),
            grade.source(""),
        ]
        for grade in GNSS_GRADES.values()
    )
    return markdown(("grade", "what", *(f"`{key}`" for key in FIGURES), "source"), rows)


def _imu_grade(grade: ImuGrade) -> str:
    head, figures = f"### `{grade.name}`: {grade.title}\n", imu_figures(grade)
    return f"{head}\n{figures}\n" if figures else head


def imu_figures(grade: ImuGrade) -> str:
    """The figures of a grade with their sources; empty if it has none."""
    rows = [[f"`{name}`", _figure(value), grade.source(name)] for name, value in grade.figures().items()]
    return markdown(["figure", "value", "source"], rows) if rows else ""


def _shape(row: Row) -> str:
    return " x ".join(map(str, row.shape))


def _start(row: Row) -> str:
    values = [f"{value:g}" for value in row.flat_start()]
    return values[0] if len(set(values)) == 1 else ", ".join(values)


def _figure(value: Any) -> str:
    if not isinstance(value, tuple):
        return f"{value:.5g}"
    return f"{value[0]:.3g}" if len(set(value)) == 1 else ", ".join(f"{v:.3g}" for v in value)


# --- files and public names ----------------------------------------------------------------------------


def code_of(path: str, language: str = "python") -> Callable[[], str]:
    """A file of the repository as a code block, which the tests of the pages do not run."""
    text = (ROOT / path).read_text(encoding="utf-8").rstrip()
    return lambda: f"<!-- not run: tests/outside runs it -->\n```{language}\n{text}\n```"


def public_names() -> str:
    """The public names of insenv: each with its home and the first line of its docstring."""
    rows = []
    for name in insenv.__all__:
        thing = getattr(insenv, name)
        home = thing.__name__ if inspect.ismodule(thing) else thing.__module__
        summary = (inspect.getdoc(thing) or "").partition("\n")[0]
        rows.append([f"`insenv.{name}`", f"`{home}`", summary])
    return markdown(("name", "defined in", "what it is"), rows)


def estimators_table() -> str:
    """The estimators, each with the page that names it in its first heading."""
    titles = {
        path.name: path.read_text(encoding="utf-8").partition("\n")[0] for path in (ROOT / "docs" / "estimators").glob("*.md")
    }
    rows = []
    for id, estimator in estimators.registered().items():
        page = next(name for name, title in sorted(titles.items()) if f"`{id}`" in title)
        needs = ", ".join(["IMU", *map(shown_name, estimator.sensors)])
        rows.append([f"[`{id}`]({page})", estimator.kind, needs, estimator.title])
    return markdown(("estimator", "kind", "takes", "what it is"), rows)


def proof_text() -> str:
    """What `insenv prove` prints of the recorded results, tests/studies/proof.json."""
    values = json.loads((ROOT / "tests" / "studies" / "proof.json").read_text(encoding="utf-8"))
    return f"```text\n{as_text(Proof.of_json(values).document().blocks())}\n```"


def public_logs_table() -> str:
    """The public logs: what they were used for, the unit's grade, the outages, how to get them."""
    rows = [
        [f"`{log.name}`", log.description["title"], log.used, log.grade or "none", f"`{log.outages}`", f"`{log.get}`"]
        for log in public_logs().values()
    ]
    return markdown(("log", "what it is", "used", "grade", "fixes withheld", "how to get it"), rows)


def remarks_table() -> str:
    """The codes of remarks with their texts, of all modules that declare some."""
    for path in (ROOT / "insenv").rglob("*.py"):
        if "insenv.base.remarks import" in path.read_text(encoding="utf-8"):
            importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    return markdown(("code", "text"), [[f"`{code}`", text] for code, text in sorted(TEXTS.items())])


# --- pages -------------------------------------------------------------------------------------------

PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "docs/scenario-keys.md": {"keys": lambda: key_tables(SCENARIO_SECTIONS, SCENARIO_TYPES)},
    "docs/log-keys.md": {"keys": lambda: key_tables(LOG_SECTIONS, LOG_TYPES)},
    "docs/flight-logs.md": {"keys": lambda: key_tables(FLIGHT_SECTIONS)},
    "docs/accuracy.md": {"logs": public_logs_table, "results": proof_text},
    "docs/api.md": {"names": public_names},
    "docs/json.md": {"remarks": remarks_table},
    "docs/estimators/index.md": {"table": estimators_table},
    "docs/write-your-own.md": {
        name: code_of(f"examples/insenv-rail/{path}", language)
        for name, path, language in (
            ("pyproject", "pyproject.toml", "toml"),
            ("estimator", "insenv_rail/ahrs.py", "python"),
            ("instrument", "insenv_rail/compass.py", "python"),
            ("vehicle", "insenv_rail/trolley.py", "python"),
            ("scenario", "rail.toml", "toml"),
        )
    },
    "docs/sensors.md": {
        "imu-parameters": lambda: rows_table(IMU_PARAMETERS),
        "imu-state": lambda: rows_table(IMU_STATE),
        "gnss-parameters": lambda: rows_table(GNSS_PARAMETERS),
        "gnss-state": lambda: rows_table(GNSS_STATE),
        "imu-grades": imu_grades,
        "gnss-grades": gnss_grades,
    },
    **estimator_pages.pages(markdown),
    "docs/instruments.md": {
        "measurements": lambda: instrument_tables("measurement"),
        "stated": lambda: instrument_tables("stated_errors"),
        "parameters": instrument_parameters,
        "grades": instrument_grades,
    },
    **benchmarks.pages(markdown),
}
"""By page, its generated parts by name."""
SCHEMA = "scenarios/schema.json"
PICTURES = {
    "docs/figures/architecture.svg": pictures.architecture,
    "docs/figures/frames.svg": pictures.frames,
    "docs/figures/sample-path.svg": pictures.sample_path,
}


def current() -> dict[str, str]:
    """What each generated file should hold, by its path in the repository. Raises ValueError if a page lacks a marker."""
    found = {}
    for page, parts in PAGES.items():
        text = (ROOT / page).read_text(encoding="utf-8")
        for name, part in parts.items():
            begin, end = f"<!-- begin {name} (python tools/pages.py) -->\n", f"<!-- end {name} -->"
            if text.count(begin) != 1 or text.count(end) != 1:
                raise ValueError(f"{page} must have one part {name!r} between {begin.strip()} and {end}")
            before, rest = text.split(begin)
            text = f"{before}{begin}\n{part()}\n\n{end}{rest.split(end)[1]}"
        found[page] = text
    found[SCHEMA] = json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"
    found |= {path: draw() for path, draw in PICTURES.items()}
    return found


if __name__ == "__main__":
    if ROOT not in Path(insenv.__file__).resolve().parents:
        raise SystemExit(f"insenv is that of {Path(insenv.__file__).parent}: allowed is that of {ROOT} (pip install -e .)")
    for path, text in current().items():
        (ROOT / path).write_text(text, encoding="utf-8")

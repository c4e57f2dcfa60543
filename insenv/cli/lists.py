"""The commands `insenv list` and `insenv schema`: the names and keys that commands and scenario files accept."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from insenv.cli.options import Json, deferred


@deferred
def list_all(as_json: Json = False) -> None:
    """List the scenarios, estimators, kinds of vehicle, sensors, sensor grades and environments."""
    from insenv import estimators
    from insenv.cli.output import print_json, print_line, print_table
    from insenv.estimators.contract import shown_name
    from insenv.files.toml import summary
    from insenv.registration import titles
    from insenv.scenario import summaries
    from insenv.sensors import GNSS_GRADES, IMU_GRADES
    from insenv.sensors import registry as sensors
    from insenv.sensors.figures import FiguresSection
    from insenv.vehicles import registry as vehicles

    scenarios = summaries()
    known: list[dict[str, Any]] = [
        {"id": e.id, "title": e.title, "kind": e.kind, "aided": e.aided, "sensors": e.sensors}
        for e in estimators.registered().values()
    ]
    kinds = [{"kind": kind, "title": summary(section)} for kind, section in vehicles.registered().items()]
    sensed = [{"id": id, "title": summary(section)} for id, section in sensors.registered().items()]
    grades: dict[str, list[dict[str, str]]] = {
        "imu_grades": [{"name": name, "title": grade.title} for name, grade in IMU_GRADES.items()],
        "gnss_grades": [{"name": name, "title": grade.title} for name, grade in GNSS_GRADES.items()],
    }
    instrument_grades = [
        {"sensor": id, "name": grade.name, "title": grade.title}
        for id, section in sensors.registered().items()
        if issubclass(section, FiguresSection)
        for grade in section.grades.values()
    ]
    if as_json:
        environments = [{"id": id, "title": title} for id, title in titles().items()]
        own = {"vehicles": kinds, "sensors": sensed}
        found = {**grades, "instrument_grades": instrument_grades}
        print_json({"scenarios": scenarios, "estimators": known, **own, **found, "environments": environments})
        return
    print_table(("scenario", "duration", "title"), [(s["name"], f"{s['duration_s']:g} s", s["title"]) for s in scenarios])
    print_line()
    shown = [(e["id"], e["kind"], ", ".join(["IMU", *map(shown_name, e["sensors"])]), e["title"]) for e in known]
    print_table(("estimator", "kind", "takes", "title"), shown)
    print_line()
    print_table(("kind of vehicle", "title"), [(v["kind"], v["title"]) for v in kinds])
    print_line()
    print_table(("sensor", "title"), [(s["id"], s["title"]) for s in sensed])
    for key, name in (("imu_grades", "IMU grade"), ("gnss_grades", "GNSS grade")):
        print_line()
        print_table((name, "title"), [(g["name"], g["title"]) for g in grades[key]])
    print_line()
    print_table(("sensor", "grade", "title"), [(g["sensor"], g["name"], g["title"]) for g in instrument_grades])
    print_line()
    print_table(("environment", "title"), list(titles().items()))


@deferred
def schema(as_json: Annotated[bool, typer.Option("--json", help="No effect: the schema is JSON.")] = False) -> None:
    """Print the JSON schema of a scenario file, for editors."""
    from insenv.cli.output import print_json
    from insenv.scenario import json_schema

    print_json(json_schema())

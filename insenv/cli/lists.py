"""The commands `insenv list` and `insenv schema`: the names and keys that commands and scenario files accept."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from insenv.cli.options import Json, deferred


@deferred
def list_all(as_json: Json = False) -> None:
    """List the scenarios, estimators, sensor grades and environments."""
    from insenv import estimators
    from insenv.cli.output import print_json, print_line, print_table
    from insenv.registration import titles
    from insenv.scenario import summaries
    from insenv.sensors import GNSS_GRADES, IMU_GRADES

    scenarios = summaries()
    known: list[dict[str, Any]] = [
        {"id": e.id, "title": e.model.title, "kind": e.kind, "aided": e.aided} for e in estimators.registered().values()
    ]
    grades: dict[str, list[dict[str, str]]] = {
        "imu_grades": [{"name": name, "title": grade.title} for name, grade in IMU_GRADES.items()],
        "gnss_grades": [{"name": name, "title": grade.title} for name, grade in GNSS_GRADES.items()],
    }
    if as_json:
        environments = [{"id": id, "title": title} for id, title in titles().items()]
        print_json({"scenarios": scenarios, "estimators": known, **grades, "environments": environments})
        return
    print_table(("scenario", "duration", "title"), [(s["name"], f"{s['duration_s']:g} s", s["title"]) for s in scenarios])
    print_line()
    takes = {True: "IMU, GNSS", False: "IMU"}
    print_table(("estimator", "kind", "takes", "title"), [(e["id"], e["kind"], takes[e["aided"]], e["title"]) for e in known])
    for key, name in (("imu_grades", "IMU grade"), ("gnss_grades", "GNSS grade")):
        print_line()
        print_table((name, "title"), [(g["name"], g["title"]) for g in grades[key]])
    print_line()
    print_table(("environment", "title"), list(titles().items()))


@deferred
def schema(as_json: Annotated[bool, typer.Option("--json", help="No effect: the schema is JSON.")] = False) -> None:
    """Print the JSON schema of a scenario file, for editors."""
    from insenv.cli.output import print_json
    from insenv.scenario import json_schema

    print_json(json_schema())

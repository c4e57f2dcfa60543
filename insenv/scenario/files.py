"""Scenario files: loading by name or path, the list of those in insenv, and the JSON schema for editors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from insenv.base.changes import Changes, changed, sentence
from insenv.base.errors import LISTED, InputError, nearest
from insenv.base.resources import scenario_folder
from insenv.base.resources import scenario_names as names
from insenv.base.toml import is_log, is_scenario, read_toml, shown, validated
from insenv.estimators import Estimator, registered, registry
from insenv.estimators.settings import Settings, setting_rows
from insenv.scenario.build import plant_of
from insenv.scenario.description import Scenario, scenario_class
from insenv.sensors import imu_grade
from insenv.sensors.figures import FiguresSection
from insenv.sensors.grade_file import beside, refuse_grade
from insenv.sensors.registry import registered as registered_sensors

ScenarioLike = str | Path | Scenario | Mapping[str, Any]
"""A name that ``insenv list`` shows, the path of a ``.toml`` file, a `Scenario`, or the values of such a file."""


USUAL = {"alignment": "ship-swaying", "navigation": "car-city-drive"}
"""Scenario from which the parameters of an estimator come that is exported without one, by its kind."""


def load(scenario: ScenarioLike) -> Scenario:
    """Load and check a scenario.

    Raises `InputError` for an unknown name, an unreadable file, a wrong key or value, or values that conflict.
    """
    if isinstance(scenario, Scenario):
        return scenario
    if isinstance(scenario, Mapping):
        return parse(dict(scenario), name="scenario")
    if not isinstance(scenario, (str, Path)):
        raise InputError(f"scenario = {shown(scenario)}: allowed is a name, the path of a .toml file, a Scenario or its values")
    text = str(scenario)
    if isinstance(scenario, str) and not text.endswith(".toml"):
        known = names()
        if text not in known and Path(text).is_file():
            raise InputError(
                f"{text}: not a scenario: allowed is a name or the path of a .toml file; `insenv replay {text} -e ID` takes a "
                "recorded log"
            )
        if text not in known and Path(text).exists():
            raise InputError(
                f"scenario {text!r} is not a .toml file: allowed is the path of one, or a name that `insenv list` shows"
            )
        if text not in known:
            raise InputError(f"no scenario {text!r}{nearest(text, known, LISTED)}; or give the path of a .toml file")
        path = scenario_folder() / f"{text}.toml"
    else:
        path = Path(scenario)
    data = read_toml(path)
    if is_log(data) and not is_scenario(data):
        raise InputError(
            f"{path}: the description of a recorded log, not a scenario: `insenv replay {path} -e ID` runs estimators on it"
        )
    refuse_grade(data, path, "a scenario")
    return parse(beside(beside(data, path.parent, "imu"), path.parent, "vehicle", key="file"), str(path), path.stem)


def with_settings(scenario: ScenarioLike, settings: Settings | None, estimators: Sequence[str | Estimator]) -> Scenario:
    """The scenario with parameters by estimator id, as of `insenv.run`, in its tables [estimator.ID].

    Raises `InputError` as `load`, and for settings that are wrong or of an estimator that is not among `estimators`.
    """
    loaded = load(scenario)
    setting_rows(settings, registry.get_all(estimators))
    if not settings:
        return loaded
    values = loaded.stated()
    for id, table in settings.items():
        values["estimator"][id] = {**values["estimator"].get(id, {}), **table}
    return parse(values, loaded.name or "scenario", loaded.name)


def with_changes(scenario: ScenarioLike, changes: Changes) -> Scenario:
    """The scenario with other values of single keys, by their dotted names, as in ``{"imu.grade": "tactical"}``.

    Raises `InputError` as `load`, and for keys and values that a scenario may not have.
    """
    loaded = load(scenario)
    if not changes:
        return loaded
    made = parse(changed(loaded.stated(), changes), "--set", loaded.name)
    made._changes = sentence(changes)
    return made


def parse(data: dict[str, Any], label: str = "scenario", name: str = "") -> Scenario:
    """The scenario of TOML values; every line of an error begins with `label`.  Raises `InputError`."""
    scenario = validated(scenario_class(), data, label)
    scenario._name = name
    try:
        plant_of(scenario)
        places = {f"estimators[{number}]": id for number, id in enumerate(scenario.estimators)}
        for where, id in [*places.items(), *(("estimator", id) for id in scenario.estimator)]:
            try:
                registry.get(id)
            except InputError as error:
                raise InputError(f"{where}: {error}") from None
        scenario.tunings  # noqa: B018 (checked here, used later)
    except InputError as error:
        raise InputError(f"{label}: {error}") from None
    return scenario


def summaries() -> list[dict[str, Any]]:
    """Name, title, vehicle, duration_s, rate_hz, gnss and estimators of each scenario in insenv."""
    return [
        {
            "name": scenario.name,
            "title": scenario.title,
            "vehicle": scenario.vehicle.kind,
            "duration_s": scenario.duration_s,
            "rate_hz": scenario.rate_hz,
            "gnss": scenario.gnss is not None,
            "estimators": list(scenario.estimators),
        }
        for scenario in map(load, names())
    ]


def json_schema() -> dict[str, Any]:
    """JSON schema of a scenario file, for editors (``scenarios/schema.json``)."""
    schema = _plain(scenario_class().model_json_schema())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "insenv scenario", **schema}


def _plain(schema: Any) -> Any:
    """The schema without pydantic's titles, and without null, which TOML does not have."""
    if isinstance(schema, list):
        return [_plain(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    plain = {
        name: _plain(value)
        for name, value in schema.items()
        if (name, value) not in (("default", None), ("unit", "")) and not (name == "title" and isinstance(value, str))
    }
    choices = [choice for choice in plain.get("anyOf", []) if choice != {"type": "null"}]
    if len(choices) == 1:
        plain = {**choices[0], **{name: value for name, value in plain.items() if name != "anyOf"}}
    elif choices:
        plain["anyOf"] = choices
    return plain


# The estimators that a scenario names, and those that can run on it.


def accepted(scenario: Scenario) -> list[str]:
    """Ids of the estimators that can run on the scenario."""
    return [id for id, estimator in registered().items() if not estimator.refusal(scenario.drive())]


def named_estimators(scenario: Scenario) -> tuple[str, ...]:
    """Ids of the estimators that the scenario names.  Raises `InputError` if it names none."""
    if scenario.estimators:
        return tuple(scenario.estimators)
    where = f"scenario {scenario.name!r}" if scenario.name else "the scenario"
    allowed = accepted(scenario)
    example = allowed[0] if allowed else "ID"
    raise InputError(
        f"{where} names no estimator: name one with -e ID (in Python: estimators={example!r}), or write estimators = "
        f'["{example}"] into the file; allowed here: {", ".join(allowed) or "none"}'
    )


# What a grade of the catalogue gives for a key that a scenario leaves to it.


def grade_value(section: str, grade: str, key: str) -> Any:
    """The value in the unit of the key, one number or three; None if the section has no such figure.

    Raises `InputError` for an unknown grade.
    """
    if section == "imu":
        return getattr(imu_grade(grade), key, None)
    kind = registered_sensors().get(section)
    if kind is None or not issubclass(kind, FiguresSection) or key not in kind.figures or not kind.figures[key].vector:
        return None
    if grade not in kind.grades:
        raise InputError(f"{section}.grade = {grade!r}: unknown grade")
    return kind.grades[grade].figures.get(key, 0.0)

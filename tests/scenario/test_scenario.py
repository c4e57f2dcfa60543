"""Scenarios: those of insenv, wrong files, the schema and the examples of the page."""

import copy
import datetime
import json
import math
from itertools import chain

import numpy as np
import pytest
from driven import columns_of
from hypothesis import given, settings
from hypothesis import strategies as st
from peers import package
from places import ROOT

from insenv.base.errors import InputError
from insenv.base.keys import SetsRow
from insenv.base.resources import scenario_folder
from insenv.base.toml import read_toml
from insenv.core.runner import make_runner
from insenv.estimators import registry
from insenv.scenario import build, json_schema, load, names, parse
from insenv.scenario.description import GravitySection, KnowledgeSection
from insenv.sensors import ImuSection
from insenv.sensors import registry as instruments
from insenv.sensors.grades import WAYS
from insenv.testing import check_keys
from insenv.vehicles import registry as vehicles

IN_PLACE = {
    "ship-swaying", "ship-irregular-sea", "car-parked", "aircraft-parked", "static-ecef", "turntable-quaternion",
    "large-misalignment", "large-misalignment-extreme", "large-misalignment-training", "ship-moored-paper", "car-parked-paper",
    "turntable-calibration", "turntable-indexing", "ship-slow-surge",
}  # fmt: skip


def text_of(name):
    return (scenario_folder() / f"{name}.toml").read_text(encoding="utf-8")


def data_of(name):
    return read_toml(scenario_folder() / f"{name}.toml")


@pytest.mark.parametrize("name", names())
def test_each_scenario_builds_and_runs(name):
    scenario = load(name)
    plant = build(scenario, duration_s=0.5)
    outputs = columns_of(plant)
    assert all(np.isfinite(values).all() for values in outputs.values())
    assert outputs["time"][-1] == pytest.approx(0.5)
    assert plant.samples == round(0.5 * scenario.rate_hz) and plant.sample_interval == 1.0 / scenario.rate_hz
    assert scenario.name == name and text_of(name).startswith("#:schema ./schema.json\n")
    assert plant.in_place == (name in IN_PLACE) and ("gnss" in plant.sensors) == (scenario.gnss is not None)
    assert scenario.estimators
    for id in scenario.estimators:
        estimator = plant.adapted(registry.get(id))
        estimator.model.parameters.pack(plant.parameters_of(estimator))
        assert set(estimator.sensors) <= set(plant.sensors)


CAR, SHIP, PLANE = "car-city-drive", "ship-swaying", "aircraft-survey"


@pytest.mark.parametrize(("name", "old", "new", "said"), [
    (CAR, "innovation_gate = 5.0", "gate = 5.0", "estimator.loosely-coupled.gate: unknown key"),
    (SHIP, "deg = 10.0, period_s = 8.0", "deg = 10.0", "vehicle.sway.roll[0]: needs either period_s [s] or frequency_hz"),
    (PLANE, "survey_lines = 15", "survey_lines = 30", "segments: allowed are at most 64"),
])  # fmt: skip
def test_wrong_scenarios(tmp_path, name, old, new, said):
    text = text_of(name)
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(path)
    assert said in str(caught.value) and str(caught.value).startswith(f"{path}: ")


def test_a_folder_is_no_scenario(tmp_path):
    with pytest.raises(InputError, match="a folder"):
        load(tmp_path)


def _leaves(value, path=()):
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path] * bool(path) + [leaf for name, inner in items for leaf in _leaves(inner, (*path, name))]


PLACES = [(name, path) for name in (CAR, SHIP, PLANE, "ship-underway") for path in _leaves(data_of(name))]
JUNK = st.one_of(
    st.booleans(), st.text(max_size=5), st.integers(), st.floats(), st.just(10**400), st.just([]), st.just({}),
    st.lists(st.floats(), max_size=4), st.just(datetime.date(2020, 1, 1)),
    st.dictionaries(st.text(max_size=3), st.floats(), max_size=2),
)  # fmt: skip


@settings(max_examples=50, deadline=None)
@given(st.sampled_from(PLACES), JUNK)
def test_any_value_is_an_error_or_runs(place, junk):
    name, path = place
    data = copy.deepcopy(data_of(name))
    inner = data
    for part in path[:-1]:
        inner = inner[part]
    inner[path[-1]] = junk
    try:
        scenario = parse(data, "mine.toml")
    except InputError as error:
        assert all(line.startswith(("mine.toml: ", "and ")) for line in str(error).splitlines())
    else:
        plant = build(scenario)
        assert np.isfinite(make_runner(plant.model, plant.parameters).run(3)).all()


@pytest.mark.parametrize("section", [GravitySection, KnowledgeSection, ImuSection])
def test_sections_that_are_no_sensor_keep_what_is_promised_of_them(section):
    check_keys(section)


ENDINGS = {
    "deg": "_deg", "m": "_m", "s": "_s", "m/s": ("_mps", "_m_s"), "Hz": "_hz", "m/s2": "_mps2", "%": "_percent", "ug": "_ug",
    "deg/h": "_deg_h", "deg C": "_degc", "ppm": "_ppm", "urad": "_urad", "arcsec": "_arcsec", "g": "_g",
}  # fmt: skip


def test_every_key_shows_its_unit():
    for section in [json_schema(), *json_schema()["$defs"].values()]:
        for name, schema in section["properties"].items():
            assert schema["description"]
            if schema.get("unit") in ENDINGS:
                assert name.endswith(ENDINGS[schema["unit"]]), name
            if schema.get("type") == "number":
                assert "unit" in schema or name in ("roll_damping", "enhancement") or "probability" in name, name


def test_a_key_with_the_name_of_a_row_sets_it_and_no_other_key_does():
    sections = {"imu": ImuSection, **instruments.registered(), **vehicles.registered()}
    for name, section in sections.items():
        set_by = [(key, each.row) for key, field in section.model_fields.items() for each in field.metadata
                  if isinstance(each, SetsRow)]  # fmt: skip
        rows = [row for key, row in set_by if key not in chain(*WAYS)]
        assert len(set(rows)) == len(rows), name
        wrong = [(key, row) for key, row in set_by if key.rpartition("_")[0] in {*rows} - {row}]
        assert wrong == [], name


def test_the_schema_accepts_the_scenarios_of_insenv():
    jsonschema = package("jsonschema")
    schema = json.loads((ROOT / "scenarios/schema.json").read_text(encoding="utf-8"))
    of_schema = jsonschema.validators.validator_for(schema)
    of_schema.check_schema(schema)
    for name in names():
        of_schema(schema).validate(data_of(name))
    with pytest.raises(jsonschema.ValidationError):
        of_schema(schema).validate({**data_of(SHIP), "sed": 1})


def test_the_first_file_of_the_page(tmp_path):
    page = (ROOT / "docs/scenarios.md").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(page.split("```toml\n")[1].split("```")[0])
    plant = build(load(tmp_path / "mine.toml"), duration_s=1.0)
    assert np.isfinite(make_runner(plant.model, plant.parameters).run(plant.samples)).all()


@pytest.mark.parametrize("bad", [{"seed": 1.5}, {"seed": 2**54}, {"duration_s": math.nan}])
def test_wrong_calls(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        build(load("static-ecef"), **bad)

"""The files that describe an FMU."""

import math
import subprocess
import sys
from xml.etree import ElementTree as ET
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.model_description import read_build_description
from fmpy.validation import validate_fmu
from lxml import etree

from insenv import estimators
from insenv.core.runner import make_runner
from insenv.fmu.description import start_dependencies
from insenv.fmu.exporter import FOLDER
from insenv.fmu.reading import element_names
from insenv.fmu.subject import subject
from insenv.fmu.variables import UNITS
from insenv.scenario import names

EXTRA = {"time", "sample_interval", "parameters.step_is_one_increment", "sample_number"}  # not rows of the tables
QUICK = {"loosely-coupled": 3, "qakf-improved": 2, "ship-swaying": 2}
ALL = [
    pytest.param(id, fmi, marks=() if QUICK.get(id) == fmi else pytest.mark.slow)
    for id in (*estimators.registered(), *names())
    for fmi in (2, 3)
]


def read(path, name="modelDescription.xml"):
    with ZipFile(path) as archive:
        return ET.fromstring(archive.read(name))


def expected(id):
    """By variable name: row, causality and start values (None for outputs), from the tables."""
    what = subject(id, {})
    model = what.model
    found = {}
    for row in model.parameters:
        found[f"parameters.{row.name}"] = (row, "parameter", what.parameters[model.parameters.slice(row.name)])
    for row in model.inputs:
        found[row.name] = (row, "input", [what.sample_interval] if row.name == "dt" else row.flat_start())
    found |= {row.name: (row, "output", None) for row in model.outputs}
    return {name: each for name, each in found.items() if each[0].name not in EXTRA}


def check(variable, types, row):
    """Unit and bounds of one variable (FMI 3) or of one element (FMI 2); a flag is a Boolean."""
    declared = types.get(variable.get("declaredType"))
    unit, low, high = (variable.get(key) or (None if declared is None else declared.get(key)) for key in ("unit", "min", "max"))
    assert (variable.tag == "Boolean") == row.flag
    if row.flag:
        assert (row.lower, row.upper, row.unit, row.shape) == (0, 1, "1", ())
        return
    mixed = [part.strip() for part in row.unit.split(",")]
    if row.unit in ("1", "SI"):  # dimensionless, and a matrix whose elements have different units
        assert unit in (None, "1")
    elif len(mixed) > 1:  # elements with different units: each has its unit, their array has none
        assert unit is None if variable.find("Dimension") is not None else unit in mixed
    else:
        assert unit == row.unit
    assert (-math.inf if low is None else float(low), math.inf if high is None else float(high)) == (row.lower, row.upper)


@pytest.mark.parametrize(("id", "fmi"), ALL)
def test_the_description_is_valid_and_every_variable_is_a_row(bare, id, fmi):
    path = bare(id, fmi)
    assert validate_fmu(str(path)) == []
    assert read_build_description(str(path))[0].sourceFileSets[0].sourceFiles == [f"fmi{fmi}.c"]
    root = read(path)
    assert root.find("CoSimulation").get("needsExecutionTool") == "false"
    types = {t.get("name"): t[0] if fmi == 2 else t for t in root.find("TypeDefinitions")}
    units = {unit.get("name") for unit in root.findall("UnitDefinitions/Unit")}
    assert all(t.get("unit") in units and t.get("nominal") for t in types.values())
    with ZipFile(path) as archive:  # an estimator takes one sample a step
        assert (b"ONE_SAMPLE_A_STEP 1" in archive.read("sources/config.h")) == (id in estimators.registered())
    assert all(v.get("description") for v in root.findall("ModelVariables/*"))
    listed = {v.get("name"): v for v in root.find("ModelVariables") if v.get("name") not in EXTRA}
    rows = expected(id)
    elements = {name: element_names(name, row.shape if fmi == 2 else ()) for name, (row, _, _) in rows.items()}
    assert list(listed) == [element for name in rows for element in elements[name]]
    for name, (row, causality, start) in rows.items():
        for place, element in enumerate(elements[name]):
            variable = listed[element]
            typed = variable[0] if fmi == 2 else variable
            assert variable.get("causality") == causality
            assert variable.get("description").startswith(row.meaning)
            check(typed, types, row)
            if start is None:
                assert typed.get("start") is None
            elif row.flag:
                assert typed.get("start") == ("true" if start[0] else "false")
            else:
                given = [float(text) for text in typed.get("start").split()]
                np.testing.assert_array_equal(given, start[place : place + 1] if fmi == 2 else start)
        if fmi == 3:
            assert tuple(int(d.get("start")) for d in listed[name].iterfind("Dimension")) == row.shape


def test_elements_and_units(bare):
    root = read(bare("loosely-coupled"))
    by_name = {v.get("name"): v for v in root.findall("ModelVariables/*")}
    assert by_name["velocity_n[2]"].get("description") == "Velocity over the Earth: east"
    assert by_name["delta_angle[1]"].get("variability") == "continuous"
    units = {unit.get("name"): unit for unit in root.findall("UnitDefinitions/Unit")}
    assert units["rad/s"].find("BaseUnit").attrib == {"rad": "1", "s": "-1"}
    assert units["m/s^2"].find("BaseUnit").attrib == {"m": "1", "s": "-2"}
    assert units["rad/s^0.5"].find("BaseUnit") is None
    shown = {d.get("name"): float(d.get("factor")) for unit in units.values() for d in unit.findall("DisplayUnit")}
    deg, ug = 180 / np.pi, 1e6 / 9.80665
    wanted = {"deg": deg, "deg/h": deg * 3600, "ug": ug, "deg/sqrt(h)": deg * 60, "ug/sqrt(Hz)": ug}
    assert {name: shown[name] for name in wanted} == pytest.approx(wanted, rel=1e-15)


SIZES = {"deg": np.pi / 180, "h": 3600.0, "g": 9.80665, "ug": 9.80665e-6, "nT": 1e-9, "km": 1e3, "degC": 1.0, "sqrt": np.sqrt}
SIZES |= dict.fromkeys(("rad", "m", "s", "K", "Hz"), 1.0)
"""In SI."""


@pytest.mark.parametrize("unit", [unit for unit in UNITS.values() if unit.displays], ids=lambda unit: unit.name)
def test_a_display_unit_has_the_size_that_its_name_says(unit):
    for display in unit.displays:
        size = eval(display.name.replace("^", "**"), SIZES.copy())
        assert display.factor == pytest.approx(1.0 / size, rel=1e-14), display.name
        assert display.offset == (-273.15 if display.name == "degC" else 0.0)


@pytest.mark.parametrize("id", QUICK)
def test_the_dependencies_at_the_start_are_exact(id):
    """Every initial output that a parameter changes is listed, and every listed dependency is in the equations."""
    what = subject(id, {})
    needs = start_dependencies(what.model)
    before, changing = make_runner(what.model, what.parameters).output(), np.zeros_like(needs)
    for place in range(what.parameters.size):
        for change in (1e-3, 0.5):
            moved = what.parameters.copy()
            moved[place] += change
            changing[:, place] |= make_runner(what.model, moved).output() != before
    assert changing.any() and not (changing & ~needs).any()


@pytest.mark.parametrize(("fmi", "arrays"), ((2, False), (3, True), (3, False)))
def test_files_and_terminals(bare, fmi, arrays):
    with ZipFile(bare("loosely-coupled", fmi, arrays=arrays)) as archive:
        names = set(archive.namelist())
        assert {"documentation/index.html", "documentation/licenses/license.txt"} <= names
        assert not any(name.startswith("sources/fmi") and name.endswith(".h") for name in names)  # the importer has its own
        manifest = etree.fromstring(archive.read(f"{FOLDER}fmi-ls-manifest.xml"))
        assert {related.get("source") for related in manifest} == {"in.csv", "ref.csv", "experiments.xml"}
        heading, *rows = archive.read(f"{FOLDER}in.csv").decode().splitlines()
        fixes = heading.split('","').index("gnss_valid")
        assert sum(row.split(",")[fixes] == "1" for row in rows) == 1  # a fix arrives in the reference signals
        if fmi == 2:  # no importer reads terminals there, and FMI Library calls them an error
            assert "model.png" in names and not any(name.startswith("terminalsAndIcons") for name in names)
            return
        assert "terminalsAndIcons/icon.png" in names
        schema = etree.XMLSchema(file=f"{next(iter(fmpy.__path__))}/schema/fmi3/fmi3TerminalsAndIcons.xsd")
        root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        schema.assertValid(root)
        members = {m.get("variableName") for m in root.iter("TerminalMemberVariable")}
        known = {v.get("name") for v in ET.fromstring(archive.read("modelDescription.xml")).find("ModelVariables")}
        assert members <= known and {"gnss_latitude", "q_nb" if arrays else "q_nb[4]"} <= members


@pytest.mark.slow
@pytest.mark.parametrize("fmi", (2, 3))
def test_another_tool_finds_it_compliant(bare, fmi):
    script = "from fmu_manipulation_toolbox.cli.fmutool import fmutool; fmutool()"
    command = [sys.executable, "-c", script, "-input", str(bare("loosely-coupled", fmi)), "-check"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    said = done.stdout + done.stderr
    assert f"seems to be compliant with FMI-{fmi}.0" in said and "No semantic error" in said
    assert "ERROR" not in said and "WARNING" not in said

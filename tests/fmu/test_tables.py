"""Every variable of every FMU is a row of the model's tables: name, unit, meaning, bounds, start value and shape."""

import math
from xml.etree import ElementTree as ET
from zipfile import ZipFile

import numpy as np
import pytest
from fmu_tools import thorough

from insenv import estimators
from insenv.core.tables import Row
from insenv.fmu import export_fmu
from insenv.fmu.reading import element_names
from insenv.fmu.subject import subject
from insenv.scenario import names

EXTRA = {"time", "sample_interval", "parameters.step_is_one_increment"}  # not rows of the tables
NO_UNIT = {"1", "SI"}  # dimensionless, and a matrix whose elements have different units


def expected(id):
    """By variable name: row, causality and start values (None for outputs), from the tables."""
    what = subject(id, {})
    found = {}
    for table, causality, prefix in (
        (what.model.parameters, "parameter", "parameters."),
        (what.model.inputs, "input", ""),
        (what.model.outputs, "output", ""),
    ):
        for row in table:
            if row.name not in EXTRA:
                start = {
                    "parameter": lambda row: what.parameters[what.model.parameters.slice(row.name)],
                    "input": lambda row: [what.sample_interval] if row.name == "dt" else row.flat_start(),
                    "output": lambda row: None,
                }[causality](row)
                found[prefix + row.name] = (row, causality, start)
    return found


def inherited(variable, types, name):
    """An attribute of a variable, or of its declared type if it has one."""
    declared = types.get(variable.get("declaredType"))
    return variable.get(name) or (None if declared is None else declared.get(name))


def check(variable, types, row: Row):
    """Unit and bounds of one variable (FMI 3) or of one element (FMI 2); a flag is a Boolean."""
    assert (variable.tag == "Boolean") == row.flag
    if row.flag:
        assert (row.lower, row.upper, row.unit, row.shape) == (0, 1, "1", ())
        return
    unit = inherited(variable, types, "unit")
    mixed = [part.strip() for part in row.unit.split(",")]
    if row.unit in NO_UNIT:
        assert unit in (None, "1")
    elif len(mixed) > 1:  # elements with different units: each has its unit, their array has none
        assert unit is None if variable.find("Dimension") is not None else unit in mixed
    else:
        assert unit == row.unit
    low, high = (inherited(variable, types, bound) for bound in ("min", "max"))
    assert (-math.inf if low is None else float(low)) == row.lower
    assert (math.inf if high is None else float(high)) == row.upper


QUICK = ("loosely-coupled", "qakf-improved", "ship-swaying")
ALL = [pytest.param(id, marks=() if id in QUICK else thorough) for id in (*estimators.registered(), *names())]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("id", ALL)
def test_every_variable_is_a_row(monkeypatch, tmp_path, id, fmi):
    monkeypatch.setattr("insenv.fmu.exporter.build", lambda *arguments: {})  # no binary is needed
    with ZipFile(export_fmu(id, tmp_path / "x.fmu", fmi=fmi)) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    listed = {v.get("name"): v for v in root.find("ModelVariables") if v.get("name") not in EXTRA}
    definitions = root.find("TypeDefinitions")
    types = {t.get("name"): t[0] if fmi == 2 else t for t in definitions}
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
            elif fmi == 2:
                assert float(typed.get("start")) == start[place]
            else:
                np.testing.assert_array_equal([float(text) for text in typed.get("start").split()], start)
        if fmi == 3:
            assert tuple(int(d.get("start")) for d in listed[name].iterfind("Dimension")) == row.shape

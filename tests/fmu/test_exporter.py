"""The exported file: description, sources, documents, bytes."""

import functools
import json
import re
import shutil
import struct
import subprocess
import sys
from xml.etree import ElementTree as ET
from zipfile import ZipFile

import numpy as np
import pytest
from command_line import call, refused, strict

from insenv import estimators, scenario
from insenv.core.runner import make_runner
from insenv.errors import InputError, InsenvError
from insenv.fmu import export_fmu, platforms
from insenv.fmu.description import start_dependencies
from insenv.fmu.subject import subject
from insenv.fmu.variables import Kind, variables

PLANTS = ("ship-swaying", "ship-underway", "car-city-drive", "aircraft-survey")
SUBJECTS = (*estimators.registered(), *PLANTS)


@pytest.fixture
def uncompiled(monkeypatch):
    """Export without binaries."""
    monkeypatch.setattr("insenv.fmu.exporter.build", lambda *arguments: {})


def description(path):
    with ZipFile(path) as archive:
        return ET.fromstring(archive.read("modelDescription.xml"))


@functools.cache
def parser(lark, grammar, start):
    """FMPy's parser of names, constructed once."""
    return lark(grammar, start=start)


@functools.cache
def parsed(lark, grammar, start, name):
    """A name in FMPy's grammar."""
    return parser(lark, grammar, start).parse(name)


@pytest.fixture
def names_once(monkeypatch):
    """FMPy's check of names; names that differ only in their numbers are parsed once."""
    import lark

    class Once:
        def __init__(self, grammar, start):
            self.parse = lambda name: parsed(original, grammar, start, re.sub(r"\d+", "1", name))

    original = lark.Lark
    monkeypatch.setattr(lark, "Lark", Once)


@pytest.mark.parametrize("fmi", (2, 3))
@pytest.mark.parametrize("id", SUBJECTS)
def test_every_fmu_is_valid(uncompiled, names_once, tmp_path, id, fmi):
    from fmpy.model_description import read_build_description
    from fmpy.validation import validate_fmu

    path = export_fmu(id, tmp_path / "x.fmu", fmi=fmi)
    assert validate_fmu(str(path)) == []
    assert read_build_description(str(path))[0].sourceFileSets[0].sourceFiles == [f"fmi{fmi}.c"]
    root = description(path)
    assert all(v.get("description") for v in root.findall("ModelVariables/*"))
    assert root.find("CoSimulation").get("needsExecutionTool") == "false"
    units = {unit.get("name") for unit in root.findall("UnitDefinitions/Unit")}
    types = {t.get("name"): t if fmi == 3 else t[0] for t in root.find("TypeDefinitions")}
    assert all(t.get("unit") in units and t.get("nominal") for t in types.values())


@pytest.mark.parametrize("fmi", (2, 3))
def test_another_tool_finds_it_compliant(uncompiled, tmp_path, fmi):
    pytest.importorskip("fmu_manipulation_toolbox", reason="fmu-manipulation-toolbox is not installed")
    path = export_fmu("loosely-coupled", tmp_path / "x.fmu", fmi=fmi)
    script = "from fmu_manipulation_toolbox.cli.fmutool import fmutool; fmutool()"
    command = [sys.executable, "-c", script, "-input", str(path), "-check"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    said = done.stdout + done.stderr
    assert f"seems to be compliant with FMI-{fmi}.0" in said and "No semantic error" in said
    assert "ERROR" not in said and "WARNING" not in said


def icons(path):
    """The icons of an FMU."""
    with ZipFile(path) as archive:
        return [archive.read(name) for name in archive.namelist() if name in ("model.png", "terminalsAndIcons/icon.png")]


@pytest.mark.parametrize(
    ("what", "estimator", "icon"),
    [
        ("q-method", None, "estimator"),
        ("ship-swaying", None, "ship"),
        ("ship-swaying", "q-method", "ship"),
        ("large-misalignment", None, "ship"),
        ("car-parked", None, "car"),
        ("aircraft-parked", None, "aircraft"),
        ("turntable-quaternion", None, "turntable"),
    ],
)
def test_the_icon_shows_the_kind_of_vehicle(uncompiled, tmp_path, what, estimator, icon):
    from insenv.files.resources import fmu_folder

    drawn = {path.stem: path.read_bytes() for path in (fmu_folder() / "icons").glob("*.png")}
    assert len(set(drawn.values())) == 6
    assert icons(export_fmu(what, tmp_path / "x.fmu", estimator=estimator)) == [drawn[icon]] * 2
    assert icons(export_fmu(what, tmp_path / "y.fmu", estimator=estimator, fmi=3)) == [drawn[icon]]


def test_a_vehicle_from_outside_has_the_icon_of_a_plant(uncompiled, tmp_path, monkeypatch):
    from insenv.files.resources import fmu_folder
    from insenv.fmu import exporter

    shutil.copytree(fmu_folder(), tmp_path / "fmu", ignore=shutil.ignore_patterns("car.png"))
    monkeypatch.setattr(exporter, "fmu_folder", lambda: tmp_path / "fmu")
    assert icons(export_fmu("car-parked", tmp_path / "x.fmu", fmi=3)) == [
        (tmp_path / "fmu" / "icons" / "plant.png").read_bytes()
    ]


@pytest.mark.parametrize(("fmi", "arrays"), ((2, False), (3, True), (3, False)))
def test_the_schema_of_terminals_and_icons(uncompiled, tmp_path, fmi, arrays):
    import fmpy
    from lxml import etree

    with ZipFile(export_fmu("loosely-coupled", tmp_path / "x.fmu", fmi=fmi, arrays=arrays)) as archive:
        names = set(archive.namelist())
        assert {"documentation/index.html", "documentation/licenses/license.txt", "sources/config.h"} <= names
        assert {"terminalsAndIcons/icon.png", *(["model.png"] if fmi == 2 else [])} <= names
        assert not any(name.startswith("sources/fmi") and name.endswith(".h") for name in names)  # the importer has its own
        manifest = etree.fromstring(archive.read("extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml"))
        assert {related.get("source") for related in manifest} == {"in.csv", "ref.csv", "experiments.xml"}
        folder = next(iter(fmpy.__path__))
        schema = etree.XMLSchema(file=f"{folder}/schema/fmi3/fmi3TerminalsAndIcons.xsd")
        root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        schema.assertValid(root)
        members = {m.get("variableName") for m in root.iter("TerminalMemberVariable")}
        known = {v.get("name") for v in ET.fromstring(archive.read("modelDescription.xml")).find("ModelVariables")}
        assert members <= known and {"gnss_latitude", "q_nb" if arrays else "q_nb[4]"} <= members


def test_the_variables_are_those_of_the_tables(uncompiled, tmp_path):
    model = estimators.get("loosely-coupled").model
    scalars = description(export_fmu(model.id, tmp_path / "2.fmu", fmi=2)).findall("ModelVariables/*")
    arrays = description(export_fmu(model.id, tmp_path / "3.fmu", fmi=3)).findall("ModelVariables/*")
    for causality, table in (("parameter", model.parameters), ("input", model.inputs), ("output", model.outputs)):
        own = causality == "parameter"  # one parameter is not in the tables: step_is_one_increment
        assert sum(v.get("causality") == causality for v in scalars) == table.size + own
        assert sum(v.get("causality") == causality for v in arrays) == len(table.rows) + own
    by_name = {v.get("name"): v for v in scalars}
    assert by_name["velocity_n[2]"].get("description") == "Velocity over the Earth: east"
    assert by_name["delta_angle[1]"].get("variability") == "continuous"
    assert by_name["innovation[1]"][0].get("declaredType") == "Length"
    assert by_name["innovation[6]"][0].get("declaredType") == "Velocity"
    assert by_name["parameters.gyro_bias_sigma"][0].get("declaredType") == "GyroError"
    vectors = {v.get("name"): v for v in arrays}
    assert [d.get("start") for d in vectors["q_nb"].findall("Dimension")] == ["4"]
    assert float(vectors["dt"].get("start")) == 0.005


def test_units_have_their_base_exponents_and_display_units(uncompiled, tmp_path):
    root = description(export_fmu("loosely-coupled", tmp_path / "x.fmu"))
    units = {unit.get("name"): unit for unit in root.findall("UnitDefinitions/Unit")}
    assert units["rad/s"].find("BaseUnit").attrib == {"rad": "1", "s": "-1"}
    assert units["m/s^2"].find("BaseUnit").attrib == {"m": "1", "s": "-2"}
    assert units["rad/s^0.5"].find("BaseUnit") is None
    shown = {d.get("name"): float(d.get("factor")) for unit in units.values() for d in unit.findall("DisplayUnit")}
    assert shown["deg"] == pytest.approx(180 / np.pi, rel=1e-15)
    assert shown["deg/h"] == pytest.approx(180 / np.pi * 3600, rel=1e-15)
    assert shown["ug"] == pytest.approx(1e6 / 9.80665, rel=1e-15)
    assert shown["deg/sqrt(h)"] == pytest.approx(180 / np.pi * 60, rel=1e-15)
    assert shown["ug/sqrt(Hz)"] == pytest.approx(1e6 / 9.80665, rel=1e-15)


@pytest.mark.parametrize("id", ("loosely-coupled", "qakf-improved", "ship-swaying"))
def test_the_dependencies_at_the_start_are_exact(id):
    """Every initial output that a parameter changes is listed, and every listed dependency is in the equations."""
    what = subject(id, {})
    needs = start_dependencies(what.model)
    before = make_runner(what.model, what.parameters, backend="interpreter").output()
    changing = np.zeros_like(needs)
    for place in range(what.parameters.size):
        for change in (1e-3, 0.5):
            moved = what.parameters.copy()
            moved[place] += change
            after = make_runner(what.model, moved, backend="interpreter").output()
            changing[:, place] |= after != before
    assert changing.any() and not (changing & ~needs).any()
    if id == "loosely-coupled":
        heading = what.model.parameters.slice("start_heading").start
        assert needs[what.model.outputs.slice("q_nb"), heading].all()
        assert not needs[what.model.outputs.slice("height"), heading].any()


def test_the_same_call_gives_the_same_token_and_bytes(tmp_path, monkeypatch):
    first = export_fmu("qakf", tmp_path / "a.fmu")
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("INSENV_CACHE_DIR", str(tmp_path / "empty"))  # so that it is compiled again
        second = export_fmu("qakf", tmp_path / "b.fmu")
    assert first.read_bytes() == second.read_bytes()
    tokens = {description(export_fmu("qakf", tmp_path / "c.fmu", settings=s)).get("guid") for s in ({}, {"latitude": 0.5})}
    tokens.add(description(export_fmu("qakf", tmp_path / "d.fmu", fmi=3)).get("instantiationToken"))
    assert len(tokens) == 3 and description(first).get("guid") in tokens
    with ZipFile(first) as archive:
        assert all(entry.date_time == (1980, 1, 1, 0, 0, 0) for entry in archive.infolist())
        assert description(first).get("guid") in archive.read("sources/config.h").decode()


def test_settings_are_start_values(uncompiled, tmp_path):
    settings = {"heading_sigma_deg": 2.0, "antenna_lever_arm": [1.0, 2.0, 3.0], "sample_interval": 0.01}
    path = export_fmu("loosely-coupled", tmp_path / "x.fmu", settings=settings)
    root = description(path)
    start = {
        v.get("name"): float(v[0].get("start")) for v in root.find("ModelVariables") if v[0].tag == "Real" and v[0].get("start")
    }
    assert start["parameters.heading_sigma"] == pytest.approx(np.radians(2.0), rel=1e-15)
    assert [start[f"parameters.antenna_lever_arm[{i}]"] for i in (1, 2, 3)] == [1.0, 2.0, 3.0]
    assert start["dt"] == start["sample_interval"] == 0.01
    assert root.find("DefaultExperiment").get("stepSize") == "0.01"
    plant = description(export_fmu("ship-swaying", tmp_path / "y.fmu", settings={"seed": 7}))
    seed = next(v for v in plant.find("ModelVariables") if v.get("name") == "parameters.seed")
    assert float(seed[0].get("start")) == 7.0


def test_an_estimator_starts_as_in_the_run_of_its_scenario(uncompiled):
    known = scenario.build(scenario.load("ship-swaying"))
    estimator = estimators.get("q-method")
    rows = known.parameters_of(estimator)
    np.testing.assert_array_equal(subject("q-method", {}).parameters, estimator.model.parameters.pack(rows))


@pytest.mark.parametrize(
    ("id", "more", "words"),
    (
        ("qakff", {}, ("no estimator or scenario 'qakff'", "did you mean 'qakf'")),
        ("qakf", {"settings": {"latitud": 1}}, ("no parameter 'latitud'", "did you mean 'latitude'")),
        ("qakf", {"settings": {"latitude": 10}}, ("latitude = 10 rad", "from -1.5708 to 1.5708")),
        ("qakf", {"settings": {"latitude": "north"}}, ("latitude = 'north'",)),
        ("qakf", {"settings": {"start_quaternion": [1, 0]}}, ("start_quaternion", "shape (4,)")),
        ("qakf", {"settings": {"sample_interval": 0}}, ("sample_interval = 0 s", "allowed is a number from")),
        ("qakf", {"settings": {"angle_random_walk": 1e-5, "arw_deg_sqrt_h": 1.0}}, ("angle_random_walk is set twice",)),
        ("ship-swaying", {"settings": {"seed": 1.5}}, ("seed = 1.5", "whole number")),
        ("ship-swaying", {"settings": {"seed": -1}}, ("seed = -1",)),
        ("ship-swaying", {"settings": {"sample_interval": 0.01}}, ("the scenario's rate_hz sets it",)),
        ("ship-swaying", {"settings": {"sed": 1}}, ("no parameter 'sed'", "did you mean 'seed'")),
        ("qakf", {"platforms": ("linux",)}, ("no platform 'linux'", "did you mean 'linux64'")),
        ("qakf", {"platforms": ()}, ("no platform named",)),
        ("qakf", {"fmi": 1}, ("fmi = 1", "allowed is 2 or 3")),
    ),
)
def test_a_wrong_call_is_named(tmp_path, id, more, words):
    with pytest.raises(InputError) as raised:
        export_fmu(id, tmp_path / "x.fmu", **more)
    assert all(word in str(raised.value) for word in words), raised.value
    assert not list(tmp_path.iterdir())


def test_an_output_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    for path in (tmp_path / "none" / "x.fmu", tmp_path / "x.zip", tmp_path):
        with pytest.raises(InputError, match=r"cannot write|allowed is a name that ends in \.fmu"):
            export_fmu("qakf", path)
    monkeypatch.setattr("insenv.fmu.platforms.find_compiler", lambda: None)
    with pytest.raises(InsenvError, match="no C compiler found"):
        export_fmu("qakf", tmp_path / "x.fmu")
    assert not list(tmp_path.iterdir())


def test_named_platforms_need_ziglang(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(InsenvError, match="needs ziglang, which is not installed: pip install"):
        export_fmu("qakf", tmp_path / "x.fmu", platforms=["win64"])


def test_a_universal_library_holds_both():
    thin = [struct.pack("<III", 0xFEEDFACF, cpu, 3) + bytes([cpu & 255]) * 20_000 for cpu in (0x01000007, 0x0100000C)]
    fat = platforms.universal(thin)
    magic, count = struct.unpack(">II", fat[:8])
    assert (magic, count) == (0xCAFEBABE, 2)
    for k, library in enumerate(thin):
        cpu, subtype, offset, size, align = struct.unpack(">IIIII", fat[8 + 20 * k : 28 + 20 * k])
        assert (cpu, subtype, size) == (*struct.unpack("<II", library[4:12]), len(library))
        assert offset % (1 << align) == 0 and fat[offset : offset + size] == library


def test_folders_of_the_platforms():
    macho = {name: struct.pack("<III", 0xFEEDFACF, cpu, 0) for name, cpu in (("x86_64", 0x01000007), ("aarch64", 0x0100000C))}
    made = {name: macho.get(name.split("-")[0], b"") if "darwin" in name else b"" for name in platforms.PLATFORMS}
    two = {path.split("/")[1] for path in platforms._laid_out(made, "m", 2)}
    three = {path.split("/")[1] for path in platforms._laid_out(made, "m", 3)}
    assert two == {"linux64", "aarch64-linux", "win64", "darwin64", "aarch64-darwin"}
    assert three == set(platforms.PLATFORMS)
    assert platforms._laid_out(made, "m", 2)["binaries/darwin64/m.dylib"][:4] == bytes.fromhex("cafebabe")
    assert set(platforms._laid_out({"aarch64-linux": b""}, "m", 2)) == {"binaries/aarch64-linux/m.so", "binaries/linux64/m.so"}


def test_the_rows_in_c_are_in_order():
    for id in ("smoother", "car-city-drive"):
        listed = variables(subject(id, {}))
        assert [v.number for v in listed] == list(range(len(listed)))
        assert [v.place for v in listed] == list(np.cumsum([0, *(v.row.size for v in listed)])[:-1])
        kinds = [v.kind for v in listed if v.kind not in (Kind.NONE, Kind.CONSTANT)]
        assert kinds == sorted(kinds)


def test_the_command(tmp_path):
    path = tmp_path / "q.fmu"
    status, out, err = call("fmu", "export", "qakf", "-o", path, "--fmi", "3", "--set", "start_quaternion=1,0,0,0", "--json")
    told = strict(out)
    assert (status, err) == (0, "") and told["fmi"] == "3.0" and told["bytes"] == path.stat().st_size
    assert told["variables"] == {"parameters": 10, "inputs": 3, "outputs": 4}
    assert description(path).get("instantiationToken") == told["token"]
    status, out, _ = call("fmu", "export", "qakf", "-o", path, "--platform", "host")
    assert status == 0 and "FMI 2.0" in out and max(map(len, out.splitlines())) <= 80 + len(str(path))
    refused(call("fmu", "export", "qakf", "-o", path, "--set", "latitude"), "NAME=VALUE")
    refused(call("fmu", "export", "qakf", "-o", path, "--set", "latitude=x"), "'x' is not a number")
    refused(call("fmu", "export", "qakf", "-o", path, "--set", "latitude=1", "--set", "latitude=1"), "given twice")
    refused(call("fmu", "export", "qakff", "-o", path), "did you mean 'qakf'")
    refused(call("fmu", "export", "qakf", "-o", path, "--platform", "linux64,mac"), "no platform 'mac'")
    status, out, _ = call("fmu", "export", "nonesuch", "-o", path, "--json")
    assert status == 2 and json.loads(out)["error"]["type"] == "InputError"

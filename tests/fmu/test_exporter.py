"""The exported file: the same bytes for the same call, icons, the command."""

import shutil
from zipfile import ZipFile

import pytest
from command_line import call, refused, strict

from insenv.errors import InputError
from insenv.files.resources import fmu_folder
from insenv.fmu import export_fmu, exporter
from insenv.fmu.reading import read_description


def test_the_same_call_gives_the_same_token_and_bytes(bare, tmp_path, monkeypatch):
    first = export_fmu("qakf", tmp_path / "a.fmu")
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("INSENV_CACHE_DIR", str(tmp_path / "empty"))  # so that it is compiled again
        second = export_fmu("qakf", tmp_path / "b.fmu")
    assert first.read_bytes() == second.read_bytes()
    same, setting, three = bare("qakf"), bare("qakf", settings={"latitude": 0.5}), bare("qakf", fmi=3)
    tokens = [read_description(path).guid for path in (first, same, setting, three)]
    assert len(set(tokens)) == 3 and tokens[0] == tokens[1]
    with ZipFile(first) as archive:
        assert all(entry.date_time == (1980, 1, 1, 0, 0, 0) for entry in archive.infolist())
        assert tokens[0] in archive.read("sources/config.h").decode()


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
        ("car-parked", None, "car"),
        ("turntable-quaternion", None, "turntable"),
    ],
)
def test_the_icon_shows_the_kind_of_vehicle(bare, what, estimator, icon):
    drawn = {path.stem: path.read_bytes() for path in (fmu_folder() / "icons").glob("*.png")}
    assert len(set(drawn.values())) == 6
    assert icons(bare(what, estimator=estimator)) == [drawn[icon]] * 2


def test_a_vehicle_from_outside_has_the_icon_of_a_plant(bare, tmp_path, monkeypatch):
    shutil.copytree(fmu_folder(), tmp_path / "fmu", ignore=shutil.ignore_patterns("car.png"))
    monkeypatch.setattr(exporter, "fmu_folder", lambda: tmp_path / "fmu")
    plant = (tmp_path / "fmu" / "icons" / "plant.png").read_bytes()
    assert icons(bare("car-parked", fmi=3, settings={"seed": 2})) == [plant]


def test_wrong_calls_are_named(tmp_path):
    for path in (tmp_path / "none" / "x.fmu", tmp_path / "x.zip", tmp_path):
        with pytest.raises(InputError, match=r"cannot write|allowed is a name that ends in \.fmu"):
            export_fmu("qakf", path)
    for options, said in (({"fmi": 1}, "fmi = 1"), ({"arrays": True}, "arrays with FMI 2"), ({"settings": [1]}, "settings = ")):
        with pytest.raises(InputError, match=said):
            export_fmu("qakf", tmp_path / "x.fmu", **options)
    assert not list(tmp_path.iterdir())


def test_the_command(tmp_path, monkeypatch):
    monkeypatch.setattr(exporter, "build", lambda *arguments: {})
    path = tmp_path / "q.fmu"
    given = ("fmu", "export", "qakf", "-o", path)
    status, out, err = call(*given, "--fmi", "3", "--set", "start_quaternion=1,0,0,0", "--json")
    told = strict(out)
    assert (status, err) == (0, "") and told["fmi"] == "3.0" and told["bytes"] == path.stat().st_size
    assert told["variables"] == {"parameters": 10, "inputs": 3, "outputs": 4}
    assert read_description(path).guid == told["token"]
    status, out, _ = call(*given, "--platform", "host", "--set", "step_is_one_increment=true")
    assert status == 0 and "FMI 2.0" in out and max(map(len, out.splitlines())) <= 80 + len(str(path))
    by_name = {v.name: v.start for v in read_description(path).modelVariables}
    assert by_name["parameters.step_is_one_increment"] == "true"
    refused(call(*given, "--set", "latitude"), "NAME=VALUE")
    refused(call(*given, "--set", "latitude=1", "--set", "latitude=1"), "given twice")
    refused(call(*given, "--platform", "linux64,mac"), "no platform 'mac'")

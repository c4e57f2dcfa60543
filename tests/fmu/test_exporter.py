"""The exported file, and the command."""

from zipfile import ZipFile

import pytest
from command_line import call, strict
from fmu_tools import exported

from insenv.base.errors import InputError
from insenv.fmu import export_fmu, exporter
from insenv.fmu.reading import read_description

ID = "qakf-improved"


def test_the_same_call_gives_the_same_token(bare):
    """The same bytes: test_ssp.py."""
    first = exported(ID)
    same, setting, three = bare(ID), bare(ID, settings={"latitude": 0.5}), bare(ID, fmi=3)
    tokens = [read_description(path).guid for path in (first, same, setting, three)]
    assert len(set(tokens)) == 3 and tokens[0] == tokens[1]
    with ZipFile(first) as archive:
        assert all(entry.date_time == (1980, 1, 1, 0, 0, 0) for entry in archive.infolist())
        assert tokens[0] in archive.read("sources/config.h").decode()


def test_wrong_calls_are_named(tmp_path):
    for options, said in (({"fmi": 1}, "fmi = 1"), ({"settings": [1]}, "settings = ")):
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
    assert read_description(path).guid == told["token"]
    assert call(*given, "--platform", "host", "--set", "step_is_one_increment=true")[0] == 0
    by_name = {v.name: v.start for v in read_description(path).modelVariables}
    assert by_name["parameters.step_is_one_increment"] == "true"

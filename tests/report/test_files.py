"""The files of a report and its JSON document: complete, readable by others, all or none."""

import json
import math
import sys

import numpy as np
import pytest
from made_up_reports import PLACE, report, result

from insenv.base.errors import InputError, InsenvError
from insenv.base.installing import install_extra
from insenv.evaluation.errors import ATTITUDE
from insenv.report import OutputFolder, run_document, to_json, write_files
from insenv.report.files import file_name


def test_no_nan_in_json():
    bad = result(errors={"roll_deg": np.full(200, np.nan)}, limit={"roll_deg": math.inf})
    text = to_json(run_document(report(bad)).as_json())
    parsed = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))
    assert parsed["results"][0]["rms"] == {"roll_deg": None} and parsed["results"][0]["limit"] == {"roll_deg": None}
    assert to_json({"é": np.float64(1.5), "n": np.array([1, 2])}, indent=None) == '{"\\u00e9": 1.5, "n": [1, 2]}'


def test_npz_round_trip(tmp_path):
    made, folder = report(result(), result("q-method", ATTITUDE)), tmp_path / "new" / "out"
    written = write_files(made, OutputFolder(folder), figure=False)
    assert sorted(p.name for p in folder.iterdir()) == ["made-up.json", "made-up.npz"]
    with np.load(written.paths[0], allow_pickle=False) as file:
        meta = json.loads(file["meta"].item())
        arrays = {name: file[name] for name in file.files if name != "meta"}
    assert set(meta["arrays"]) == set(arrays)
    assert meta["format"] == "insenv-results" and meta["run"] == run_document(made).as_json()
    assert np.array_equal(arrays["truth/latitude"], PLACE["latitude"])
    assert np.array_equal(arrays["q-method/errors/heading_deg"], made.results[1].errors["heading_deg"])
    assert np.array_equal(arrays["loosely-coupled/outputs/q_nb"], made.results[0].outputs["q_nb"])
    for name, about in meta["arrays"].items():
        assert about["unit"] and about["meaning"] and about["shape"] == list(arrays[name].shape), name
    assert meta["arrays"]["truth/velocity_n"]["unit"] == "m/s" and meta["arrays"]["truth/velocity_n"]["frame"] == "n"
    assert json.loads(written.paths[1].read_text()) == run_document(made).as_json([str(p) for p in written.paths])
    (tmp_path / "plain").write_text("")
    assert written.paths[0].stat().st_mode == (tmp_path / "plain").stat().st_mode, "others read it as the umask says"


def test_interrupted_writing_leaves_what_was_there(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    write_files(report(), OutputFolder(tmp_path), figure=False)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    monkeypatch.setattr("insenv.report.files.save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_files(report(result("q-method", ATTITUDE), seed=8), OutputFolder(tmp_path))
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_output_folder_is_tried_at_once_and_made_late(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is not a folder"):
        OutputFolder(tmp_path / "file" / "deep" / "out")
    OutputFolder(tmp_path / "new" / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    (tmp_path / "made-up.json").mkdir()
    with pytest.raises(InsenvError, match=r"made-up\.json.*is a folder"):
        write_files(report(), OutputFolder(tmp_path), figure=False)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "made-up.json"]


def test_file_names():
    of = {"ship-swaying": "ship-swaying", "../a b/my log.toml": "my-log", "..": "run", "a/b:c": "a-b-c"}
    assert {scenario: file_name(scenario) for scenario in of} == of


def test_without_matplotlib_the_rest_is_written(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    written = write_files(report(), OutputFolder(tmp_path))
    assert install_extra("plot") in written.note
    assert {p.suffix for p in tmp_path.iterdir()} == {".npz", ".json", ".html"}

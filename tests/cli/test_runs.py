"""`insenv run` and `insenv replay`: their files; wrong calls, scenarios and logs; files that are something else."""

from pathlib import Path

import numpy as np
import pytest
from command_line import ROOT, SHORT, call, log_file, refused, strict

PLAIN = ROOT / "examples" / "logs" / "plain.toml"
SCENARIO = ROOT / "scenarios" / "ship-swaying.toml"
OWN = ROOT / "examples" / "own_scenario.toml"
KINDS = {".npz", ".json", ".html", ".png", ".svg"}


def run(file):
    return call("run", file, "--duration", 5)


def replay(file, estimator="q-method"):
    return call("replay", file, "-e", estimator)


def test_run_writes_files(tmp_path):
    status, out, err = call(*SHORT, "--out", tmp_path / "new" / "out", "--json")
    files = [Path(path) for path in strict(out)["files"]]
    assert (status, err) == (0, "") and {p.name for p in files} == {f"ship-swaying{kind}" for kind in KINDS}
    assert sorted(files) == sorted((tmp_path / "new" / "out").iterdir())
    with np.load(files[0]) as arrays:
        assert arrays["truth/q_nb"].shape == (len(arrays["truth/time"]), 4)
    status, out, _ = call(*SHORT, "--out", tmp_path / "other", "--no-figure")
    assert status == 0 and "ship-swaying.npz" in out and len(list((tmp_path / "other").iterdir())) == 2


def test_unwritable_folder_is_reported_before_the_work(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("insenv.runs.simulated.run", lambda *_, **__: pytest.fail("the work was begun"))
    refused(call(*SHORT, "--out", tmp_path / "file" / "out"), "file/out", "is not a folder")


def standing(fixes):
    """The fixes of a CSV file, all at the place of the first."""
    header, *rows = fixes.splitlines()
    place = rows[0].split(",")[1:]
    return "\n".join([header, *(",".join([row.split(",")[0], *place]) for row in rows)]) + "\n"


def test_replay(tmp_path):
    log = log_file(tmp_path, gnss=standing)
    status, out, err = call("replay", log, "-e", "q-method", "--out", tmp_path / "out", "--json")
    found = strict(out)
    assert (status, err) == (0, "") and {path.suffix for path in (tmp_path / "out").iterdir()} == KINDS
    assert found["seed"] is None and found["results"][0]["rms"] == {} and "heading" in replay(log)[1]
    refused(replay(log_file(tmp_path)), "is for a vehicle that stays in place", "9.86 m/s", "moves")


def test_wrong_scenarios_and_logs_are_named(tmp_path):
    """Each wrong value by itself: tests/scenario, tests/sensors and tests/logs."""
    text = SCENARIO.read_text("utf-8").replace('grade = "marine"', 'grade = "marin"', 1)
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    refused(run(tmp_path / "mine.toml"), "mine.toml", "marin", "did you mean 'marine'")
    refused(replay(log_file(tmp_path, imu=lambda text: text[:-12])), "plain-imu.csv")
    refused(replay(log_file(tmp_path, toml=lambda text: text.replace('"plain-imu.csv"', '"gone.csv"'))), "gone.csv")


def test_a_log_that_is_none_says_what_it_is_in_every_command(tmp_path):
    path = tmp_path / "a.gpx"
    path.write_text('<?xml version="1.0"?>\n<!-- a ride -->\n<gpx version="1.1"><trk/></gpx>\n')
    for answer in (replay(path), call("allan", path), call("tune", path, "-e", "loosely-coupled")):
        refused(answer, "a.gpx", "a GPX file", "recorded")


def test_a_scenario_that_names_no_estimator(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(OWN.read_text("utf-8").replace("estimators = ", "# estimators = "), encoding="utf-8")
    answer = run(path)
    refused(answer, "'mine' names no estimator", "-e ID", "estimators = [", "q-method")
    assert "loosely-coupled" not in answer[2]  # it needs GNSS
    refused(call("stream", path, "--to", "udpout:127.0.0.1:14550"), "names no estimator", "-e ID")

"""The files, tables and data frames of a campaign."""

import csv
import json

import numpy as np
import pyarrow.parquet
import pytest
from campaigns import car, small_plan

import insenv
from insenv.base.errors import InputError
from insenv.evaluation.errors import ATTITUDE
from insenv.studies.campaign import parse_variation, run_campaign


def test_files_and_a_data_frame_hold_every_run_and_the_figure(tmp_path):
    found = run_campaign(small_plan(12, variations=[parse_variation("imu.gyro_bias_deg_h=0:1")]))
    written = found.save(tmp_path)
    assert [p.name for p in written.paths] == ["campaign.npz", "campaign.json", "campaign.html", "campaign.png", "campaign.svg"]
    with np.load(tmp_path / "campaign.npz", allow_pickle=False) as arrays:
        assert arrays["runs/seed"].tolist() == list(range(3, 15))
        assert arrays["runs/heading_deg/final"].shape == arrays["runs/imu.gyro_bias_deg_h"].shape == (12,)
        assert arrays["heading_deg/percentiles"].shape == (5, len(arrays["time"]))
        assert json.loads(arrays["meta"].item())["runs"] == 12
    assert json.loads((tmp_path / "campaign.json").read_text())["errors"].keys() == set(ATTITUDE)
    assert (tmp_path / "campaign.png").stat().st_size > 10_000
    frame, course = found.to_dataframe(), found.courses["heading_deg"]
    assert frame.index.name == "time" and np.array_equal(frame.index, found.time)
    for name, values in (("rms", course.rms), ("p97.5", course.percentiles[-1]), ("limit", course.limit)):
        assert np.array_equal(frame[f"{name}_heading_deg"], values)


def test_tables_hold_every_run_with_all_digits(tmp_path):
    vary = {"imu.grade": "choice(tactical, industrial)", "start.latitude_deg": (0.0, 50.0)}
    found = insenv.campaign(car(), "loosely-coupled", 6, seed=1, duration_s=2.0, vary=vary)
    frame = found.runs_to_dataframe()
    for kind in ("csv", "parquet"):
        found.save(tmp_path / kind, figure=False, table=kind)
    with (tmp_path / "csv" / "runs.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    table = pyarrow.parquet.read_table(tmp_path / "parquet" / "runs.parquet")
    assert [int(row["seed"]) for row in rows] == list(found.seeds) == table["seed"].to_pylist()
    assert {row["imu.grade"] for row in rows} | set(frame["imu.grade"]) <= {"tactical", "industrial"}
    heading = found.final[:, 2].tolist()
    assert [float(row["final_heading_deg"]) for row in rows] == heading == table["final_heading_deg"].to_pylist()
    assert list(frame["final_heading_deg"]) == heading and rows[0]["diverged"] == "false"
    with pytest.raises(InputError, match="allowed is csv or parquet"):
        found.save(tmp_path, figure=False, table="xls")

"""The table of a report: what it says of errors, limits, sigmas and health, in 80 columns."""

import re
from dataclasses import replace

import numpy as np
import pytest
from made_up_reports import report, result
from rich.console import Console

from insenv import attitude, run
from insenv.evaluation.errors import ATTITUDE, CHANNELS
from insenv.report import run_document
from insenv.report.console import rendered
from insenv.report.tables import error_rows


def printed(made):
    with open("/dev/null", "w") as nowhere:
        console = Console(width=80, markup=False, highlight=False, record=True, file=nowhere)
        for part in rendered(run_document(made).blocks()):
            console.print(part)
        return console.export_text().replace(" \n", "\n")


def cells(text, name):
    return next(line for line in text.splitlines() if line.startswith(name)).split()[2:]


@pytest.mark.parametrize("published", [0, 4])
def test_table_fits_80_columns_and_cuts_nothing(published):
    peers = tuple((f"Package number {i}, from the reference state", dict.fromkeys(CHANNELS, 1e9)) for i in range(published))
    limit = {} if published else dict.fromkeys(CHANNELS, 1e9)  # what others published is about logs, which have no limit
    text = printed(report(result(size=-1e9, limit=limit), published=peers))
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    assert all(f"Package number {i}" in text for i in range(published))


def test_table_with_and_without_limits_or_errors():
    rms = result().statistics()["rms"]["roll_deg"]
    *_, stated, limit, ratio = map(float, cells(printed(report(result())), "roll"))
    assert stated == 0.02 and limit == 0.01 and ratio == pytest.approx(rms / limit, rel=1e-2)
    text = printed(report(result(limit={})))
    assert list(map(float, cells(text, "roll")))[-2:] == pytest.approx([0.02, rms / 0.02], rel=5e-3)
    text = printed(report(result(errors={}, sigma={"heading_deg": np.full(200, 0.1), "north_m": np.full(200, 3.0)})))
    assert re.search(r"^latitude \[deg\] +28.6536\d+ +3.00 m$", text, re.MULTILINE)
    assert cells(printed(report(result(settled=False))), "roll")[-2:] == ["0.0100", "-"]  # a run too short for a ratio


def test_an_estimator_that_is_too_sure_is_named(monkeypatch):
    sure = result(sigma={"roll_deg": np.full(200, 1e-3), "heading_deg": np.full(200, 1e3)})
    ratio = sure.statistics()["rms"]["roll_deg"] / 1e-3
    assert sure.too_sure() == (f"the errors are larger than this estimator states, rms over stated sigma: roll {ratio:.3g}",)
    assert replace(sure, settled=False).too_sure() == () == result().too_sure()
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    (found,) = run("large-misalignment-extreme", "aqe-ekf", duration_s=20.0).results
    assert found.notes[-1].startswith("the errors are larger than this estimator states")


def test_roll_and_heading_near_90_deg_of_pitch_are_not_judged():
    """There Euler angles differ by any amount where the attitude hardly does."""
    upright = np.array([attitude.numeric.from_euler(0.3, np.radians(89.99), 1.0)] * 200)
    made = result(channels=ATTITUDE, size=1e-6, outputs={"q_nb": upright})
    turned = replace(made, errors={**made.errors, "roll_deg": np.full(200, 90.0), "heading_deg": np.full(200, 90.0)})
    (note,) = turned.judged().notes
    assert "pitch comes to 90 deg" in note and "not judged" in note
    wrong = replace(made, errors={**made.errors, "pitch_deg": np.full(200, 0.1)}).judged().notes
    assert any("larger than this estimator states" in note and "pitch" in note for note in wrong)
    assert result().judged().notes == ()
    judged = made.judged()
    assert set(judged.limit) == {"pitch_deg"} == set(report(judged).as_json()["results"][0]["limit"])
    for shown in (judged, replace(judged, limit={})):  # with a limit, and with the stated sigmas alone
        ratios = [list(values.values())[-1] for _, values in error_rows(shown)]
        assert ratios[0] is None and ratios[1] > 0.0 and ratios[2] is None

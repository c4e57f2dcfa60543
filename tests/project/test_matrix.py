"""The table of every estimator on every scenario: shares beyond three sigmas, and the part of the page that it writes."""

from dataclasses import replace
from datetime import date

import matrix
import numpy as np
import pytest


def judged(error, sigma=None, estimator="qakf", scenario="car-parked"):
    error = np.array(error)
    sigma = np.ones_like(error) if sigma is None else sigma
    return matrix.Judged(scenario, estimator, np.arange(error.shape[1]) * 1.0, error, sigma, {"roll_deg": 2.0}, ())


def test_the_share_is_that_of_the_worst_component_with_the_scatter_between_runs():
    error = np.zeros((4, 10, 3))
    error[0, :, 1] = 3.1  # one run of four, throughout
    error[1, :2, 0] = -4.0
    share, scatter = judged(error).beyond(0)
    assert share == pytest.approx(0.25) and scatter == pytest.approx(np.std([1, 0, 0, 0], ddof=1) / 2)
    assert judged(error).beyond(3) is None
    assert judged(error, np.full((4, 10, 3), 2.0)).beyond(0) == (0.0, 0.0)
    assert replace(judged(error), unjudged=("roll_deg", "pitch_deg")).beyond(0) == (0.0, 0.0)


def test_rows_replace_those_of_the_same_pair(tmp_path):
    page, error = tmp_path / "page.md", np.zeros((2, 3, 3))
    page.write_text(f"before\n\n{matrix.BEGIN}{matrix.END}\n\nafter\n")
    matrix.write([matrix.row(judged(error)), matrix.row(judged(error, estimator="analytic"))], date(2020, 1, 2), page)
    error[..., 2] = 4.0
    error[..., 0] = 1.0
    matrix.write([matrix.row(judged(error))], date(2020, 1, 3), page)
    lines = page.read_text().splitlines()
    assert lines[:3] == ["before", "", "<!-- begin matrix -->"] and lines[-1] == "after"
    assert "64 seeds from 7000, last written on 2020-01-03." in lines
    rows = [line for line in lines if line.startswith("| car-parked")]
    assert [line.split("|")[2].strip() for line in rows] == ["analytic", "qakf"]
    assert "| 100.0 +- 0.0 |" in rows[1] and "| 0.5, -, - |" in rows[1]


@pytest.mark.slow
def test_a_pair_without_standard_deviations_has_no_row():
    assert matrix.judge("static-ecef", "wander-sins", 2) is None

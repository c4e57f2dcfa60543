"""The rows of `insenv reproduce` are those of the stored table (tools/reproduced.py), to the digits that it has."""

import json

import numpy as np
import pytest
import reproduced
from command_line import call

from insenv.reproduce import PAPERS, Quantity, conditions, ecef, figure, reproduce, table_2
from insenv.reproduce.unit_limits import mean_limit

UNIT = 10.0 ** (1 - reproduced.DIGITS)
"""One unit of the last digit of a number between 1 and 10, the largest share of a number that its rounding can be."""


def test_the_table_has_every_paper_and_names_no_row_twice():
    table = reproduced.stored()
    assert list(table) == list(PAPERS)
    for paper, rows in table.items():
        names = [row["quantity"] for row in rows]
        assert len(set(names)) == len(names) >= 8, paper
        assert all(row["seeds"] >= 1 and (row["ours"], row["printed_form"]) != (None, None) for row in rows)


def test_the_command_prints_conditions_and_notes(monkeypatch):
    row = Quantity("heading", "deg", None, 0.1, note="at rest", paper="ecef")
    monkeypatch.setattr(ecef, "quantities", lambda: [row])
    lines = call("reproduce", "ecef")[1].splitlines()
    assert f"conditions: {conditions('ecef')}" in " ".join(lines)
    assert "[1] at rest" in lines
    assert json.loads(call("reproduce", "ecef", "--json")[1]) == [row.as_json()]


def test_the_mean_of_a_magnitude_is_below_its_root_mean_square():
    """Of constant sigma, errors that do not change with time: sqrt(2 / pi) of it; a large bias is its own mean."""
    assert mean_limit(np.full(5, 0.3), np.zeros(2)) == pytest.approx(0.3 * np.sqrt(2 / np.pi))
    assert mean_limit(np.full(5, 0.3), np.array([9.0, -7.0])) == pytest.approx(8.0)
    falling = mean_limit(np.array([0.4, 0.2]), np.zeros(1))  # variances of the mean: (0.16 + 3 * 0.04) / 4
    assert falling == pytest.approx(np.sqrt(0.07 * 2 / np.pi))


def test_the_responses_of_free_inertial_navigation_are_those_of_theory():
    """After 5 min of straight flight: v t, g e t^3 / 6 with Schuler's factor, b t^2 / 2; fits are never worse than no error."""
    own, each = table_2.responses(table_2.CORRECTED)
    assert np.linalg.norm(own, axis=1).max() < 0.01
    time, g = 300.0, 9.8
    schuler = np.sqrt(g / 6.39e6)
    velocity, gyro, accel = each[0, 4], each[6, 4], each[9, 4]
    assert np.linalg.norm(velocity) == pytest.approx(np.sin(schuler * time) / schuler, rel=0.01)
    drift = np.radians(1 / 3600) * g / schuler**2 * (time - np.sin(schuler * time) / schuler)
    assert np.linalg.norm(gyro) == pytest.approx(drift, rel=0.05)
    assert np.linalg.norm(accel) == pytest.approx(9.80665e-6 * (1 - np.cos(schuler * time)) / schuler**2, rel=0.02)
    nothing = np.sqrt(np.mean(np.sum(table_2.ENU**2, axis=1)))
    assert all(table_2.fit(reading, table_2.CORRECTED).misfit < nothing for reading in table_2.READINGS)
    assert np.allclose(np.linalg.norm(table_2.ENU, axis=1), table_2.DISTANCE, atol=0.06)  # the table agrees with itself


@pytest.mark.slow  # a minute each
@pytest.mark.parametrize("paper", PAPERS)
def test_rows_are_those_of_the_table(paper):
    """Names, order, numbers published, as printed, ours and limits; within the rounding of the stored numbers."""
    expected = reproduced.stored()[paper]
    ((_, found),) = reproduce(paper)
    shown = [reproduced.row(quantity) for quantity in found]
    assert [row["quantity"] for row in shown] == [row["quantity"] for row in expected]
    for row, other in zip(shown, expected, strict=True):
        assert row["published"] == other["published"] and row["seeds"] == other["seeds"], row["quantity"]
        for name in ("printed_form", "ours", "limit"):
            if other["unit"] == "us":  # a time of this machine
                assert row[name] is None or row[name] > 0, row["quantity"]
            elif other[name] is None:
                assert row[name] is None, row["quantity"]
            else:
                assert row[name] == pytest.approx(other[name], rel=UNIT, nan_ok=True), f"{row['quantity']}: {name}"


@pytest.mark.slow
@pytest.mark.parametrize("paper", PAPERS)
def test_the_figure_of_a_paper_is_drawn(paper, tmp_path):
    paths = figure(paper, tmp_path)
    assert [path.name for path in paths[:2]] == [f"reproduce-{paper}.png", f"reproduce-{paper}.svg"]
    assert all(path.name.startswith(f"reproduce-{paper}") and path.suffix in (".png", ".svg") for path in paths)
    assert all(path.stat().st_size > 20_000 for path in paths)

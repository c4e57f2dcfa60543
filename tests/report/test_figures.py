"""The one style of all figures, and what a figure of a run shows beside the errors."""

import re

import numpy as np
import pytest
from places import ROOT

from insenv import run, style
from insenv.evaluation.errors import Result, Track
from insenv.report import tracks
from insenv.report.figures import draw
from insenv.report.outages import outages
from insenv.report.run_data import RunData

DRAWING = [path for folder in ("insenv", "examples", "tools") for path in (ROOT / folder).rglob("*.py")]


@pytest.mark.parametrize("path", DRAWING, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_only_the_style_makes_figures(path):
    if path.name in ("style.py", "icons.py"):  # icons are drawings without axes
        return
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"pyplot|backend_agg|\bFigure\(\w*size|\.legend\(loc=\"(?!center left\", bbox)", text)


def test_outages_are_the_gaps_between_fixes():
    time = np.arange(0.0, 100.0, 0.5)
    fixes = np.where((time > 40) & (time <= 60), 0.0, (time % 1.0 == 0.0).astype(float))
    fixes[time > 90] = 0.0
    assert outages(time, np.cumsum(fixes)) == ((40.0, 61.0), (90.0, 99.5))
    assert outages(time, np.zeros(200)) == ()
    assert outages(time, np.cumsum(time % 1.0 == 0.0)) == ()


def test_a_figure_shades_the_outages_of_its_scenario():
    figure = draw(run("car-city-drive", "loosely-coupled", duration_s=300.0))
    (legend,) = figure.legends
    assert "no GNSS" in [text.get_text() for text in legend.get_texts()]
    shaded = {
        tuple(round(float(x)) for x in (patch.get_x(), patch.get_x() + patch.get_width()))
        for axes in figure.axes
        for patch in axes.patches
        if patch.get_facecolor()[:3] == pytest.approx(tuple(int(style.OUTAGE[k : k + 2], 16) / 255 for k in (1, 3, 5)))
    }
    assert len(shaded) == 1  # the same in every panel
    ((begin, end),) = shaded
    assert abs(begin - 200) <= 1 and abs(end - 230) <= 1
    assert all(axes.get_legend() is None for axes in figure.axes)


def flight(north_m, up_m):
    """A run whose estimate is the truth, along a line."""
    time = np.linspace(0.0, 60.0, 61)
    place = {
        "latitude": 0.8 + north_m * time / 60.0 / 6.37e6,
        "longitude": np.full(61, 0.1),
        "height": 100.0 + up_m * time / 60.0,
    }
    none = np.zeros(61)
    result = Result("own", time, place, {"down_m": none}, {}, {}, 0.0, 0.1)
    return RunData("hover", "", 1, 60.0, 6000, Track(time, **place), (result,))


@pytest.mark.parametrize(
    ("north_m", "up_m", "panels"),
    [
        (1000.0, 10.0, {"Track seen from above"}),
        (100.0, 80.0, {"Track seen from above", "Height above the start [m]"}),
        (0.5, 80.0, {"Height above the start [m]"}),
    ],
)
def test_a_vertical_flight_shows_its_height(north_m, up_m, panels):
    report = flight(north_m, up_m)
    titles = {axes.get_title(loc="left") for axes in draw(report).axes}
    assert titles == {"down error [m]", *panels}
    assert tracks.steepness(report) == pytest.approx(up_m / north_m, rel=1e-2)


def test_angles_are_not_joined_where_they_wrap():
    shown = style.unwrapped(np.array([170.0, 179.0, -179.0, -170.0]))
    assert np.isnan(shown[2]) and np.isfinite(shown[[0, 1, 3]]).all()


def test_a_logarithmic_scale_says_where_it_is_which():
    with style.page(4.0, 3.0) as figure:
        axes = figure.subplots()
        style.symlog(axes, 0.1)
        assert sorted(text.get_text() for text in axes.texts) == ["linear", "log", "log"]

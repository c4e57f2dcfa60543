"""The figure of a run: its panels, what it shades, reports that lack something; the one style of all figures."""

import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from made_up_reports import PLACE, TIME, of_health, report, result, track
from places import ROOT

from insenv import style
from insenv.evaluation.errors import ATTITUDE, Result, Track
from insenv.evaluation.health import course
from insenv.report import OutputFolder, tracks, write_files
from insenv.report.figures import draw
from insenv.report.outages import outages
from insenv.report.run_data import RunData
from insenv.style import save


def test_only_the_style_makes_figures():
    found = []
    for path in (path for folder in ("insenv", "examples", "tools") for path in (ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if re.search(r"pyplot|backend_agg|\bFigure\(\w*size|\.legend\(loc=\"(?!center left\", bbox)", text):
            found.append(path.name)
    assert set(found) == {"style.py", "icons.py"}  # icons are drawings without axes


def test_it_shows_every_channel_limit_and_band_and_leaves_matplotlib_as_it_was():
    before = dict(matplotlib.rcParams)
    figure = draw(report(result(), result("wander-sins", size=50.0, sigma={})))
    assert dict(matplotlib.rcParams) == before
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    assert titles[:3] == ["roll error [deg]", "pitch error [deg]", "heading error [deg]"] and len(titles) == 10
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"loosely-coupled", "wander-sins", "loosely-coupled: stated ±3 sigma", "theoretical limit, ±1 sigma"} <= texts


def test_outages_are_the_gaps_between_fixes():
    time = np.arange(0.0, 100.0, 0.5)
    fixes = np.where((time > 40) & (time <= 60), 0.0, (time % 1.0 == 0.0).astype(float))
    fixes[time > 90] = 0.0
    assert outages(time, np.cumsum(fixes)) == ((40.0, 61.0), (90.0, 99.5))
    assert outages(time, np.zeros(200)) == ()
    assert outages(time, np.cumsum(time % 1.0 == 0.0)) == ()


def test_a_figure_shades_its_outages():
    figure = draw(report(of_health(last_fix_s=60.0)))
    (legend,) = figure.legends
    assert "no GNSS" in [text.get_text() for text in legend.get_texts()]
    colour = pytest.approx(matplotlib.colors.to_rgb(style.OUTAGE))
    patches = [patch for axes in figure.axes for patch in axes.patches if patch.get_facecolor()[:3] == colour]
    # the same in every panel
    assert {(patch.get_x(), patch.get_x() + patch.get_width()) for patch in patches} == {(60.0, 100.0)} and len(patches) > 9
    assert all(axes.get_legend() is None for axes in figure.axes)


HEALTHY = replace(of_health(), sigma={}, limit={}, limit_sigma={})


@pytest.mark.parametrize(
    "made",
    [
        report(of_health(refused_share=0.1), result("wander-sins")),
        report(of_health(ratio=300.0)),
        report(replace(HEALTHY, errors={}), truth=Track(TIME), seed=None),  # no reference
    ],
)
def test_the_figure_has_a_panel_of_test_ratios(made):
    panel = next(axis for axis in draw(made).axes if "Innovations of fixes" in axis.get_title(loc="left"))
    (ratios,) = (line.get_ydata() for line in panel.lines if line.get_marker() == ".")
    expected = course(made.results[0].outputs)[0][1:]
    assert panel.get_yscale() == "log" and np.array_equal(ratios, expected)
    assert panel.get_ylim()[0] < np.quantile(expected, 0.03) and panel.get_ylim()[1] > expected.max()
    crosses = [line for line in panel.lines if line.get_marker() == "x"]
    assert sum(len(line.get_xdata()) for line in crosses) == int(made.results[0].outputs["fix_refused_count"][-1])


def flight(north_m, up_m):
    time, none = np.linspace(0.0, 60.0, 61), np.zeros(61)
    place = {"latitude": 0.8 + north_m * time / 60.0 / 6.37e6, "longitude": none + 0.1, "height": 100.0 + up_m * time / 60.0}
    own = Result("own", time, place, {"down_m": none}, {}, {}, 0.0, 0.1)
    return RunData("hover", "", 1, 60.0, 6000, Track(time, **place), (own,))


def test_a_vertical_flight_shows_its_height():
    above, height = "Track seen from above", "Height above the start [m]"
    for north_m, up_m, panels in ((1000.0, 10.0, {above}), (100.0, 80.0, {above, height}), (0.5, 80.0, {height})):
        made = flight(north_m, up_m)
        assert {axes.get_title(loc="left") for axes in draw(made).axes} == {"down error [m]", *panels}
        assert tracks.steepness(made) == pytest.approx(up_m / north_m, rel=1e-2)


def test_an_alignment_without_reference_shows_its_attitude_with_its_sigma():
    drawn = draw(report(result("q-method", ATTITUDE, errors={}, limit={}), truth=Track(TIME), seed=None))
    assert [axis.get_ylabel() for axis in drawn.axes] == ["roll [deg]", "pitch [deg]", "heading [deg]"]
    assert all(len(axis.lines) == 1 and len(axis.collections) == 1 for axis in drawn.axes)
    assert all(axis.get_ylim()[1] - axis.get_ylim()[0] > 2 * 3 * 0.02 for axis in drawn.axes)  # the sigma is seen


def test_unusual_reports_are_drawn(tmp_path):
    gone = {"truth": Track(TIME), "seed": None}
    unknown = track(latitude=np.r_[[np.nan] * 9, PLACE["latitude"][9:]])
    for made in (
        report(result(errors={}, sigma={}, limit={}), **gone),  # a log without a reference
        report(result(channels=("down_m",))),  # a reference without attitude
        report(result(errors=dict.fromkeys(ATTITUDE, np.zeros(200)), sigma={}, limit={})),
        report(result(errors={"roll_deg": np.full(200, np.nan)}), title="costs $5 and $6", truth=unknown),
    ):
        save(draw(made), {"png": tmp_path / "drawn.png"})
        assert (tmp_path / "drawn.png").read_bytes().startswith(b"\x89PNG")
    nothing = report(result("q-method", ATTITUDE, errors={}, outputs={}), **gone)
    assert "no figure" in write_files(nothing, OutputFolder(tmp_path)).note


def test_figure_files_are_the_same_every_time(tmp_path):
    made, first, second = report(result("q-method", ("heading_deg",), outputs={})), {}, {}
    for files, name in ((first, "a"), (second, "b")):
        files.update({kind: tmp_path / f"{name}.{kind}" for kind in ("svg", "png")})
        save(draw(made), files)
    assert all(first[kind].read_bytes() == second[kind].read_bytes() for kind in first)
    assert b"<dc:date>" not in first["svg"].read_bytes()


def test_angles_are_not_joined_where_they_wrap_and_a_logarithmic_scale_says_where_it_is_which():
    shown = style.unwrapped(np.array([170.0, 179.0, -179.0, -170.0]))
    assert np.isnan(shown[2]) and np.isfinite(shown[[0, 1, 3]]).all()
    with style.page(4.0, 3.0) as figure:
        axes = figure.subplots()
        style.symlog(axes, 0.1)
        assert sorted(text.get_text() for text in axes.texts) == ["linear", "log", "log"]

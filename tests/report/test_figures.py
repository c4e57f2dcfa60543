"""The figure of a run: its panels, what it shades, reports that lack something; the one style of all figures."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from made_up_reports import PLACE, TIME, of_health, report, result, track

from insenv.base import style
from insenv.base.style import save
from insenv.evaluation.errors import ATTITUDE, Track
from insenv.evaluation.health import course
from insenv.report import OutputFolder, Report, write_files
from insenv.report.panels import threshold_of
from insenv.report.run_data import outages

draw = Report.plot


def test_it_shows_every_channel_and_leaves_matplotlib_as_it_was():
    before = dict(matplotlib.rcParams)
    figure = draw(report(result(), result("wander-sins", size=50.0, sigma={})))
    assert dict(matplotlib.rcParams) == before
    assert len(figure.axes) == 10


def test_outages_are_the_gaps_between_fixes():
    time = np.arange(0.0, 100.0, 0.5)
    fixes = np.where((time > 40) & (time <= 60), 0.0, (time % 1.0 == 0.0).astype(float))
    fixes[time > 90] = 0.0
    assert outages(time, np.cumsum(fixes)) == ((40.0, 61.0), (90.0, 99.5))
    assert outages(time, np.zeros(200)) == ()
    assert outages(time, np.cumsum(time % 1.0 == 0.0)) == ()


@pytest.mark.parametrize(("settled", "reach", "threshold"), [
    ((0.3, 40.0), (0.0, 0.0), 0.5), ((40.0, 0.3), (0.0, 0.0), 0.5), ((0.3, 40.0), (0.7, 0.0), 1.0),  # of the best one
    ((7.0, 0.06, 0.015), (0.0, 0.0, 0.0), 0.02), ((0.015,), (0.0,), 0.02), ((90.0, 80.0), (0.0, 0.0), None),
])  # fmt: skip
def test_a_scale_is_linear_within_the_settled_errors_of_the_best_estimator(settled, reach, threshold):
    """Errors of 100 at first, then smaller ones over the last quarter; the next of 1, 2, 5, 10, ... above them."""
    errors = [np.r_[np.full(75, 100.0), np.linspace(-size, size / 2, 25)] for size in settled]
    assert threshold_of(errors, reach) == (None if threshold is None else pytest.approx(threshold))


def test_a_figure_shades_its_outages():
    figure = draw(report(of_health(last_fix_s=60.0)))
    (legend,) = figure.legends
    assert "no GNSS" in [text.get_text() for text in legend.get_texts()]
    colour = pytest.approx(matplotlib.colors.to_rgb(style.OUTAGE))
    patches = [patch for axes in figure.axes for patch in axes.patches if patch.get_facecolor()[:3] == colour]
    # the same in every panel
    assert {(patch.get_x(), patch.get_x() + patch.get_width()) for patch in patches} == {(60.0, 100.0)} and len(patches) > 9


def test_times_that_count_from_a_date_are_drawn_from_the_first_on():
    made = replace(result(), time=TIME + 1.7e9 + 0.25, from_s=1.7e9 + 20.0)
    figure = draw(report(made, seed=None, truth=replace(track(), time=made.time)))
    assert "count from 1700000000 s of the log" in figure.get_suptitle()
    assert {axes.get_xlim()[1] for axes in figure.axes if axes.get_xlabel() == "time [s]"} == {TIME[-1] + 0.25}


HEALTHY = replace(of_health(), sigma={}, limit={}, limit_sigma={})


@pytest.mark.parametrize("made", [
    report(of_health(refused_share=0.1), result("wander-sins")),
    report(of_health(ratio=300.0)),
    report(replace(HEALTHY, errors={}), truth=Track(TIME), seed=None),  # no reference
])  # fmt: skip
def test_the_figure_has_a_panel_of_test_ratios(made):
    panel = next(axis for axis in draw(made).axes if "Innovations over" in axis.get_title(loc="left"))
    expected = course(made.results[0].outputs)[0][1:]
    marked = [line.get_ydata()[1:] for line in panel.lines if line.get_marker() in (".", "x")]
    ratios = np.nanmax([values for values in marked if len(values) == len(expected)], axis=0)
    assert panel.get_yscale() == "log" and np.array_equal(ratios, expected)
    assert panel.get_ylim()[0] < np.quantile(expected, 0.03) and panel.get_ylim()[1] > expected.max()
    crosses = [line for line in panel.lines if line.get_marker() == "x"]
    assert sum(np.isfinite(line.get_ydata()).sum() for line in crosses) == int(made.results[0].outputs["fix_refused_count"][-1])


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


def test_angles_are_not_joined_where_they_wrap():
    shown = style.unwrapped(np.array([170.0, 179.0, -179.0, -170.0]))
    assert np.isnan(shown[2]) and np.isfinite(shown[[0, 1, 3]]).all()


def test_the_band_of_a_long_run_shows_the_largest_stated_sigma():
    """Of 6000 records, of which every hundredth states five times as much: three sigma, as all of them are drawn."""
    time = np.linspace(0.01, 60.0, 6000)
    sigma = np.where(np.arange(6000) % 100 == 0, 0.05, 0.01)
    values = {"time": time, "errors": {"vn_mps": np.zeros(6000)}, "sigma": {"vn_mps": sigma}, "limit": {},
              "outputs": {"velocity_n": np.zeros((6000, 3))}, "from_s": 0.0}  # fmt: skip
    figure = draw(report(result(channels=("vn_mps",), **values), truth=Track(time, velocity_n=np.zeros((6000, 3)))))
    bands = [area.get_paths()[0].vertices for axes in figure.axes for area in axes.collections if "3 sigma" in area.get_label()]
    (edge,) = (vertices[vertices[:, 1] > 0.0] for vertices in bands)
    assert 300 < len(edge) < 1300  # not every record
    for at in time[::100]:
        assert edge[np.abs(edge[:, 0] - at) < 0.2, 1].max() == pytest.approx(0.15)
    assert edge[:, 1].min() == pytest.approx(0.03)

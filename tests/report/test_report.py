"""Tables, figures and result files of reports made up here."""

import json
import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from insenv import attitude, run
from insenv.errors import InputError, InsenvError
from insenv.evaluation.errors import ATTITUDE, CHANNELS, Result, Track
from insenv.evaluation.health import course, health
from insenv.installing import install_extra
from insenv.report import OutputFolder, Report, comparison, document, to_json, write_files
from insenv.report.figures import draw
from insenv.report.files import collect, file_name
from insenv.report.tables import error_rows, number
from insenv.style import save

TIME = np.linspace(0.5, 100.0, 200)
PLACE = {"latitude": 0.5 + 1e-6 * TIME, "longitude": 2.0 + 1e-6 * TIME, "height": 10.0 + 0 * TIME}


def track(**more):
    return Track(TIME, np.tile([1.0, 0.0, 0.0, 0.0], (200, 1)), np.zeros((200, 3)), **{**PLACE, **more})


def result(estimator="loosely-coupled", channels=CHANNELS, size=0.01, **more):
    errors = {name: size * np.sin(TIME + place) * (1 + 100 * np.exp(-TIME / 5)) for place, name in enumerate(channels)}
    outputs = {"q_nb": track().q_nb, **PLACE, "test_ratio": np.zeros((200, 6))}
    if set(channels) <= set(ATTITUDE):
        outputs = {"q_nb": outputs["q_nb"]}
    values = {
        "time": TIME,
        "outputs": outputs,
        "errors": errors,
        "sigma": {name: np.full(200, 2 * size) for name in channels},
        "limit": dict.fromkeys(channels, size),
        "from_s": 75.0,
        "us_per_sample": 0.4321,
    }
    values = {**values, **more}
    limits = {name: np.full(len(values["time"]), size) for name in channels} if values["limit"] else {}
    return Result(estimator, **{"limit_sigma": limits, **values})


def report(*results, **more):
    values = {"scenario": "made-up", "title": "A made-up run, 10 % [x]", "seed": 7, "duration_s": 100.0, "imu_samples": 20000}
    return Report(**{**values, "truth": track(), "results": results or (result(),), **more})


def printed(made):
    console = Console(width=80, markup=False, highlight=False, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    with console.file:
        for part in comparison(made):
            console.print(part)
        return console.export_text()


# --- table -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (1.0, "1.00"), (-0.012345, "-0.0123"), (123456.7, "123457"), (1e-7, "1.0e-07"), (-1e9, "-1.0e+09")],
)
def test_numbers(value, text):
    assert number(value) == text


@pytest.mark.parametrize("value", [None, math.nan, math.inf])
def test_unknown_numbers_are_a_dash(value):
    assert number(value) == "-"


@pytest.mark.parametrize("size", [1e-9, 1e-4, 0.01, 123.456, 1e5, 1e9])
@pytest.mark.parametrize("published", [0, 1, 2, 4])
def test_table_fits_80_columns_and_cuts_nothing(size, published):
    peers = tuple((f"Package number {i}, from the reference state", dict.fromkeys(CHANNELS, size)) for i in range(published))
    limit = {} if published else dict.fromkeys(CHANNELS, size)  # what others published is about logs, which have no limit
    text = printed(report(result(size=-size, limit=limit), published=peers))
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    assert all(f"Package number {i}" in text for i in range(published))


def test_table_says_what_was_run():
    text = printed(report(result(notes=("one remark",)), notes=("another",)))
    for wanted in (
        "made-up",
        "[x]",
        "seed 7",
        "100 s",
        "20000",
        "from 75 s on",
        "0.432 us",
        "one remark",
        "another",
        "heading [deg]",
    ):
        assert wanted in text
    row = next(line for line in text.splitlines() if line.startswith("roll"))
    final, rms, largest, stated, limit, ratio = map(float, row.split()[2:])
    figures = result().statistics()
    assert (final, rms, largest) == pytest.approx([figures[k]["roll_deg"] for k in ("final", "rms", "max")], rel=5e-3)
    assert stated == 0.02 and limit == 0.01 and ratio == pytest.approx(rms / limit, rel=1e-2)


def test_an_estimator_that_is_too_sure_is_named():
    """Each error beside its own sigma: only what is more than three times as large, and nothing while it still settles."""
    sure = result(sigma={"roll_deg": np.full(200, 1e-3), "heading_deg": np.full(200, 1e3)})
    ratio = sure.statistics()["rms"]["roll_deg"] / 1e-3
    assert sure.too_sure() == (f"the errors are larger than this estimator states, rms over stated sigma: roll {ratio:.3g}",)
    assert replace(sure, settled=False).too_sure() == () == result().too_sure()
    (found,) = run("large-misalignment-extreme", "aqe-ekf", duration_s=100.0).results
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


def test_roll_and_heading_near_90_deg_of_pitch_have_no_limit():
    upright = np.array([attitude.numeric.from_euler(0.3, np.radians(89.99), 1.0)] * 200)
    made = result(channels=ATTITUDE, outputs={"q_nb": upright}).judged()
    assert set(made.limit) == {"pitch_deg"} == set(report(made).as_json()["results"][0]["limit"])
    for shown in (made, replace(made, limit={})):  # with a limit, and with the stated sigmas alone
        ratios = [list(values.values())[-1] for _, values in error_rows(shown)]
        assert ratios[0] is None and ratios[1] > 0.0 and ratios[2] is None


def test_table_without_limits_or_errors():
    text = printed(report(result(limit={}, sigma={})))
    assert "limit" not in text and "stated" not in text and "rms" in text
    text = printed(report(result(errors={}, sigma={"heading_deg": np.full(200, 0.1), "north_m": np.full(200, 3.0)})))
    assert re.search(r"^heading \[deg\] +0.0000 +0.100$", text.replace(" \n", "\n"), re.MULTILINE) and "rms" not in text
    assert re.search(r"^latitude \[deg\] +28.6536\d+ +3.00 m$", text.replace(" \n", "\n"), re.MULTILINE)


def test_without_a_limit_the_table_shows_what_the_filter_states():
    text = printed(report(result(limit={})))
    rms = result().statistics()["rms"]["roll_deg"]
    row = next(line for line in text.splitlines() if line.startswith("roll"))
    assert "stated   rms/stated" in text and "limit" not in text
    assert [float(cell) for cell in row.split()[-2:]] == pytest.approx([0.02, rms / 0.02], rel=5e-3)


def test_no_ratio_in_a_run_that_is_too_short():
    text = printed(report(result(settled=False)))
    assert "limit" in text and re.search(r"^roll \[deg\] .* 0.0100 +-$", text.replace(" \n", "\n"), re.MULTILINE)


# --- health ------------------------------------------------------------------------------------------


def sums(ratio=1.0, refused_share=0.0):
    """Outputs of a filter with a fix every record, of which every n-th is refused."""
    count = np.arange(1.0, 201.0)
    refused = np.floor(count * refused_share)
    squares = np.random.default_rng(1).chisquare(3, (200, 2)) * ratio**2
    gone = np.diff(refused, prepend=0.0)[:, None]
    return {
        "fix_count": count,
        "fix_refused_count": refused,
        "nis_used": np.cumsum(squares * (1 - gone), axis=0),
        "nis_used_count": np.cumsum(3.0 * (1 - gone) + [[0.0, 0.0]], axis=0),
        "nis_refused": np.cumsum(squares * 100 * gone, axis=0),
        "nis_refused_count": np.cumsum(3.0 * gone + [[0.0, 0.0]], axis=0),
    }


def of_health(**how):
    rows = sums(**how)
    return result(outputs={**result().outputs, **rows}, health=health(rows), notes=health(rows).notes())


def test_health_is_in_the_table_and_in_the_document():
    made = report(of_health(ratio=3.0, refused_share=0.05))
    text = " ".join(printed(made).split())
    assert "health: overconfident, factor" in text and "5 % of 200 fixes refused" in text and "lever arm" in text
    found = document(made)["results"][0]["health"]
    assert found["verdict"] == "overconfident" and found["fixes"] == 200 and found["refused"] == 10
    assert found["nis"] == pytest.approx(9.0, rel=0.1) and found["nis"] > found["nis_bounds"][1] > 1 > found["nis_bounds"][0]
    assert document(report(result()))["results"][0]["health"] is None
    assert "overconfident" in made._repr_html_()


@pytest.mark.parametrize(
    "made",
    [
        report(of_health(refused_share=0.1), result("wander-sins")),
        report(of_health(ratio=300.0)),
        report(replace(of_health(), errors={}, sigma={}, limit={}, limit_sigma={}), truth=Track(TIME), seed=None),
        report(replace(of_health(), time=TIME[:2], outputs={n: v[:2] for n, v in of_health().outputs.items()},
                       errors={n: v[:2] for n, v in result().errors.items()}, sigma={}, limit_sigma={}), truth=Track(TIME[:2])),
    ],
    ids=["refused", "far", "no reference", "two records"],
)  # fmt: skip
def test_the_figure_has_a_panel_of_test_ratios(made):
    figure = draw(made)
    panel = next(axis for axis in figure.axes if "Innovations of fixes" in axis.get_title(loc="left"))
    (ratios,) = (line.get_ydata() for line in panel.lines if line.get_marker() == ".")
    expected = course(made.results[0].outputs)[0][1:]
    assert panel.get_yscale() == "log"
    assert np.array_equal(ratios, expected)
    assert panel.get_ylim()[0] < np.quantile(expected, 0.03) and panel.get_ylim()[1] > expected.max()
    crosses = [line for line in panel.lines if line.get_marker() == "x"]
    assert sum(len(line.get_xdata()) for line in crosses) == int(made.results[0].outputs["fix_refused_count"][-1])
    assert not any("Innovations" in axis.get_title(loc="left") for axis in draw(report(result())).axes)


# --- JSON --------------------------------------------------------------------------------------------


def test_document_has_the_documented_keys():
    found = document(report(published=(("Other", {"roll_deg": 1.0}),)), ["a.npz"])
    assert {"scenario", "seed", "duration_s", "imu_samples", "results", "published", "files"} <= set(found)
    assert {"estimator", "final", "rms", "max", "limit", "us_per_sample"} <= set(found["results"][0])
    assert all(set(found["results"][0][kind]) == set(CHANNELS) for kind in ("final", "rms", "max", "limit"))
    assert "published" not in document(report())


def test_no_nan_in_json():
    bad = result(errors={"roll_deg": np.full(200, np.nan)}, limit={"roll_deg": math.inf})
    text = to_json(document(report(bad)))
    parsed = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))
    assert parsed["results"][0]["rms"] == {"roll_deg": None} and parsed["results"][0]["limit"] == {"roll_deg": None}
    assert to_json({"é": np.float64(1.5), "n": np.array([1, 2])}, indent=None) == '{"\\u00e9": 1.5, "n": [1, 2]}'


# --- files -------------------------------------------------------------------------------------------


def test_npz_round_trip(tmp_path):
    made = report(result(), result("q-method", ATTITUDE))
    written = write_files(made, OutputFolder(tmp_path / "new" / "out"), figure=False)
    assert sorted(p.name for p in (tmp_path / "new" / "out").iterdir()) == ["made-up.json", "made-up.npz"]
    with np.load(written.paths[0], allow_pickle=False) as file:
        meta = json.loads(file["meta"].item())
        arrays = {name: file[name] for name in file.files if name != "meta"}
    assert set(meta["arrays"]) == set(arrays)
    assert meta["format"] == "insenv-results" and meta["run"] == document(made)
    assert np.array_equal(arrays["truth/latitude"], PLACE["latitude"])
    assert np.array_equal(arrays["q-method/errors/heading_deg"], made.results[1].errors["heading_deg"])
    assert np.array_equal(arrays["loosely-coupled/outputs/q_nb"], made.results[0].outputs["q_nb"])
    for name, about in meta["arrays"].items():
        assert about["unit"] and about["meaning"] and about["shape"] == list(arrays[name].shape), name
    assert meta["arrays"]["truth/velocity_n"]["unit"] == "m/s" and meta["arrays"]["truth/velocity_n"]["frame"] == "n"
    assert meta["arrays"]["loosely-coupled/sigma/vn_mps"]["unit"] == "m/s"
    summary = json.loads(written.paths[1].read_text())
    assert summary == document(made, [str(p) for p in written.paths])


def test_files_are_readable_by_others_as_the_umask_says(tmp_path):
    (tmp_path / "plain").write_text("")
    written = write_files(report(), OutputFolder(tmp_path), figure=False)
    assert written.paths[0].stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("fault", [KeyboardInterrupt, MemoryError])
def test_interrupted_writing_leaves_what_was_there(tmp_path, monkeypatch, fault):
    def interrupted(*_, **__):
        raise fault

    write_files(report(), OutputFolder(tmp_path), figure=False)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    monkeypatch.setattr("insenv.report.files.save", interrupted)
    with pytest.raises(fault):
        write_files(report(seed=8), OutputFolder(tmp_path))
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_folder_in_the_way_is_told_and_nothing_written(tmp_path):
    (tmp_path / "made-up.json").mkdir()
    with pytest.raises(InsenvError, match=r"made-up\.json.*is a folder"):
        write_files(report(), OutputFolder(tmp_path), figure=False)
    assert [p.name for p in tmp_path.iterdir()] == ["made-up.json"]


def test_output_folder_is_tried_at_once_and_made_late(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is not a folder"):
        OutputFolder(tmp_path / "file" / "deep" / "out")
    OutputFolder(tmp_path / "new" / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("scenario", "name"),
    [("ship-swaying", "ship-swaying"), ("../a b/my log.toml", "my-log"), ("..", "run"), ("a/b:c", "a-b-c")],
)
def test_file_names(scenario, name):
    assert file_name(scenario) == name


def test_without_matplotlib_the_rest_is_written(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    written = write_files(report(), OutputFolder(tmp_path))
    assert install_extra("plot") in written.note
    assert {p.suffix for p in tmp_path.iterdir()} == {".npz", ".json", ".html"}


def test_arrays_of_an_unregistered_estimator_are_kept():
    assert "mine/outputs/q_nb" in collect(report(result("mine")))[0]


# --- figures -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def figure():
    return draw(report(result(), result("wander-sins", size=50.0, sigma={})))


def test_figure_shows_every_channel_limit_and_band(figure):
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    assert titles[:3] == ["roll error [deg]", "pitch error [deg]", "heading error [deg]"] and len(titles) == 10
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"loosely-coupled", "wander-sins", "loosely-coupled: stated ±3 sigma", "theoretical limit, ±1 sigma"} <= texts


def test_figure_files_are_the_same_every_time(figure, tmp_path):
    for name in ("a", "b"):
        save(draw(report(result("q-method", ATTITUDE))), {"svg": tmp_path / f"{name}.svg", "png": tmp_path / f"{name}.png"})
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert b"<dc:date>" not in (tmp_path / "a.svg").read_bytes()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_figure_leaves_matplotlib_as_it_was():
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw(report(result("q-method", ATTITUDE)))
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize(
    "made",
    [
        report(result(errors={}, sigma={}, limit={}), truth=Track(TIME), seed=None),  # a log without a reference
        report(result(channels=("north_m", "east_m", "down_m"))),  # a reference without attitude
        report(result(errors=dict.fromkeys(CHANNELS, np.zeros(200)), sigma={}, limit={})),
        report(
            result(errors={"roll_deg": np.full(200, np.nan)}), truth=track(latitude=np.r_[[np.nan] * 9, PLACE["latitude"][9:]])
        ),
        report(title="costs $5 and $6"),
    ],
    ids=["no reference", "position only", "no error at all", "not known", "dollars"],
)
def test_unusual_reports_are_drawn(made, tmp_path):
    assert len(write_files(made, OutputFolder(tmp_path)).paths) == 5


def test_an_alignment_without_reference_shows_its_attitude_with_its_sigma(tmp_path):
    made = report(result("q-method", ATTITUDE, errors={}, limit={}), truth=Track(TIME), seed=None)
    drawn = draw(made)
    assert [axis.get_ylabel() for axis in drawn.axes] == ["roll [deg]", "pitch [deg]", "heading [deg]"]
    assert all(len(axis.lines) == 1 and len(axis.collections) == 1 for axis in drawn.axes)
    assert all(axis.get_ylim()[1] - axis.get_ylim()[0] > 2 * 3 * 0.02 for axis in drawn.axes)  # the sigma is seen
    assert {path.suffix for path in write_files(made, OutputFolder(tmp_path)).paths} == {
        ".npz",
        ".json",
        ".html",
        ".png",
        ".svg",
    }


def test_nothing_to_draw(tmp_path):
    made = report(result("q-method", ATTITUDE, errors={}, outputs={}), truth=Track(TIME), seed=None)
    assert "no figure" in write_files(made, OutputFolder(tmp_path)).note


# --- a report in Python ------------------------------------------------------------------------------


def test_repr_is_short():
    text = repr(report(result(), result("q-method", ATTITUDE)))
    assert text.splitlines()[0] == "Report of made-up, seed 7, 100 s, 20000 inertial samples"
    heading = result().errors["heading_deg"][-1]
    assert re.fullmatch(r"  loosely-coupled: final error heading \S+ deg, position \S+ m", text.splitlines()[1])
    assert f"heading {heading:.3g} deg" in text.splitlines()[2] and len(text.splitlines()) == 3
    assert repr(result(errors={})) == "loosely-coupled: no reference"


def test_html_holds_the_tables_and_the_figure(monkeypatch):
    made = report(result(), result("mine", errors={}), notes=("a < b",))
    text = made._repr_html_()
    assert text.count("<table>") == 2 and "heading [deg]" in text and "a &lt; b" in text and "latitude [deg]" in text
    assert 'src="data:image/png;base64,' in text
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "<img" not in made._repr_html_() and "<table>" in made._repr_html_()
    with pytest.raises(InputError, match=r"matplotlib, which is not installed: pip install"):
        made.plot()


def test_plot_and_save_do_what_out_does(tmp_path):
    made = report()
    assert len(made.plot().axes) == len(draw(made).axes)
    written = made.save(tmp_path / "out", figure=False)
    assert [p.suffix for p in written.paths] == [".npz", ".json"] and all(p.is_file() for p in written.paths)
    with pytest.raises(InsenvError, match="neither a reference"):
        report(result(errors={}, outputs={})).plot()


def test_dataframe(monkeypatch):
    pytest.importorskip("pandas")
    made = report(result(), result("q-method", ATTITUDE))
    frame = made.to_dataframe("loosely-coupled")
    assert frame.index.name == "time" and np.array_equal(frame.index, TIME)
    assert np.array_equal(frame["error_north_m"], made.results[0].errors["north_m"])
    assert np.array_equal(frame["sigma_vn_mps"], made.results[0].sigma["vn_mps"])
    assert np.array_equal(frame[[f"q_nb_{i}" for i in range(4)]], made.results[0].outputs["q_nb"])
    assert np.array_equal(report().to_dataframe()["latitude"], PLACE["latitude"])
    with pytest.raises(InputError, match="must be named, this run has loosely-coupled, q-method"):
        made.to_dataframe()
    with pytest.raises(InputError, match="did you mean 'q-method'"):
        made.to_dataframe("q-methd")
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InsenvError, match="pip install pandas"):
        made.to_dataframe("q-method")

"""The page of a run: its document holds what the report holds, and Chromium shows it."""

import base64

import numpy as np
import pytest
from browser import LAPTOP, PHONE
from changed_scenario import changed
from live_pages import answers, panel_answers
from matplotlib.scale import SymmetricalLogTransform
from scipy.spatial.transform import Rotation
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By

import insenv
from insenv.report.of_run import in_a_turn, run_page
from insenv.report.page import BYTES, Pool, html, page_json, shown_records
from insenv.report.panels import threshold_of
from insenv.report.tables import error_rows, number

DURATION = 60.0


@pytest.fixture(scope="module")
def driven():
    scenario = changed("car-city-drive", gnss={"outages_s": [[20.0, 40.0]]})
    return insenv.run(scenario, ["loosely-coupled", "wander-sins"], duration_s=DURATION)


def test_the_document_holds_errors_sigma_and_limit(driven):
    document = page_json(run_page(driven))
    arrays = [np.frombuffer(base64.b64decode(text), dtype="<f4") for text in document["arrays"]]
    (section,) = (one for one in document["sections"] if one["title"] == "Position error")
    (east,) = (panel for panel in section["panels"] if panel["title"] == "East")
    kinds = [(curve["kind"], curve["group"]) for curve in east["curves"]]
    assert kinds == [("band", 0), ("line", 0), ("line", 1), ("limit", -1)]
    (own,) = (one for one in run_page(driven).sections[1].panels if one.title == "East")  # the scale is that of the figure
    assert east["threshold"] == threshold_of(*own.without_bands().extents()) != threshold_of(*own.extents())
    result = driven.results[0]
    places = np.searchsorted(result.time, arrays[east["x"]].astype(np.float64) - 1e-4)
    band, line, _, limit = (arrays[curve.get("y", curve.get("half"))] for curve in east["curves"])
    assert np.array_equal(line, result.errors["east_m"][places].astype("<f4"))
    assert np.array_equal(band, (3 * result.sigma["east_m"][places]).astype("<f4"))
    assert np.array_equal(limit, result.limit_sigma["east_m"][places].astype("<f4"))
    assert east["shade"] and places[-1] == len(result.time) - 1
    more = {"Track seen from above", "Height above the start", "Gyro bias, down", "Innovations over their stated sigmas, rms"}
    assert more <= {panel["title"] for section in document["sections"] for panel in section["panels"]}


def test_angles_about_180_deg_are_drawn_from_0_to_360():
    near = {-1: np.array([179.0, -179.5, 179.9]), 0: np.array([-178.0, np.nan, 178.0])}
    shown = in_a_turn(near)
    assert np.array_equal(shown[-1], [179.0, 180.5, 179.9]) and np.array_equal(shown[0], [182.0, np.nan, 178.0], equal_nan=True)
    for kept in ({0: np.array([-5.0, 5.0])}, {0: np.array([-179.0, -1.0, 1.0, 179.0])}, {0: np.full(3, np.nan)}, {}):
        assert all(values is kept[group] for group, values in in_a_turn(kept).items())


def test_figures_are_those_of_the_table_with_a_sentence_for_each_aid(driven):
    tables = page_json(run_page(driven))["tables"]
    for table, result in zip(tables, driven.results, strict=True):
        assert [row[1:] for row in table["rows"]] == [[number(v) for v in values.values()] for _, values in error_rows(result)]
        assert table["caption"] == result.estimator and all(note in table["below"] for note in result.notes)
    first, other = driven.results[0].health.lines  # of GNSS, and of standing still
    place = tables[0]["below"].index(f"Health: {first}")
    assert tables[0]["below"][place + 1] == other


def test_kept_records_end_with_the_last_and_fit_and_the_same_array_is_kept_once():
    for records, arrays in ((1, 1), (3000, 40), (30_000, 120), (299, 10_000)):
        keep = shown_records(records, arrays)
        assert keep[-1] == records - 1 and len(set(np.diff(keep))) <= 1
        assert len(keep) * arrays * 16 / 3 <= BYTES or len(keep) <= 200
    assert len(shown_records(0, 5)) == 0
    pool = Pool()
    assert pool.add([1.0, 2.0]) == pool.add(np.array([1.0, 2.0])) == 0 and pool.add([2.0]) == 1


@pytest.fixture(scope="module")
def page(driven, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "drive.html"
    path.write_text(html(run_page(driven)), encoding="utf-8")
    return path


@pytest.mark.parametrize(("size", "dark"), [
    pytest.param(LAPTOP, False, id="light"),
    pytest.param(LAPTOP, True, id="dark", marks=pytest.mark.slow),
    pytest.param(PHONE, False, id="phone", marks=pytest.mark.slow),
])  # fmt: skip
def test_the_page_opens_from_disk(browser, page, driven, size, dark):
    browser.open(page, size, dark)
    browser.until("document.querySelectorAll('.plot canvas').length >= 20")
    assert browser.console() == []
    assert browser.value("document.documentElement.scrollWidth <= innerWidth")
    assert browser.violations() == []
    painted = "getComputedStyle(document.body).backgroundColor"
    assert browser.value(painted) == ("rgb(20, 23, 26)" if dark else "rgb(255, 255, 255)")
    rows = "[...document.querySelectorAll('.summary tbody tr')].map((r) => [...r.cells].slice(1).map((c) => c.textContent))"
    cells = [[cell.replace("\N{MINUS SIGN}", "-") for cell in row] for row in browser.value(rows)]
    assert cells == [[number(v) for v in values.values()] for result in driven.results for _, values in error_rows(result)]
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    browser.resize((703, 900))  # A4 without its margins
    beyond = "[...document.querySelectorAll('canvas, table')].filter((e) => e.getBoundingClientRect().right > innerWidth)"
    pressed = "[...document.querySelectorAll('button:not(.entry), input')].filter((e) => e.offsetWidth)"
    assert browser.value(f"{beyond}.concat({pressed}).length") == 0


def test_a_span_zooms_about_its_middle_and_stays_inside_the_run(tmp_path):
    shown = {("zoom", 0.5): [30, 50], ("zoom", 2): [0, 80], ("zoom", 9): [0, 100], ("move", -0.2): [12, 52],
             ("move", 2): [60, 100], ("set", 90, 99): [90, 99], ("reset",): [0, 100], ("extend", 0, 200): [20, 60]}  # fmt: skip
    code = """given.map(([act, ...values]) => {
      const span = module_span.makeSpan(0, 100);
      span.set(20, 60);
      span[act](...values);
      return span.shown();
    })"""
    assert answers("span.js", code, list(shown), tmp_path) == list(shown.values())


def test_the_vehicle_is_drawn_in_its_attitude_before_the_horizon(tmp_path):
    q, corners = Rotation.random(20, random_state=2), np.random.default_rng(2).normal(size=(20, 3))
    given = [q.as_quat(scalar_first=True).tolist(), corners.tolist()]
    found = answers("hull.js", "given[0].map((q, k) => module_hull.turned(q, given[1][k]))", given, tmp_path)
    np.testing.assert_allclose(found, q.apply(corners), atol=1e-14)
    code = "((to) => given.map((far) => [to.horizon, to.project(far)]))(module_hull.camera(0.7, 0.3, [300, 200]))"
    for horizon, (_, height, distance) in answers("hull.js", code, [[1e9, 1e9, 9], [2e9, 1e8, 9]], tmp_path):
        assert distance > 0 and height == pytest.approx(horizon, abs=1e-3) and 0 < horizon < 100


def test_the_dial_shows_three_stated_sigma_about_each_heading(tmp_path):
    """Sectors as angles on the canvas, which count from east on: none of an estimate that states no sigma."""
    code = """const arcs = [];
    const context = new Proxy({}, { get: (_, name) => (...values) => name === "arc" && arcs.push(values), set: () => true });
    Node.prototype.getContext = () => context;
    globalThis.devicePixelRatio = 1;
    module_dial.headingDial().draw(30, given);
    return arcs.map(([, , , from, to]) => [from, to].map((angle) => (angle * 180) / Math.PI));"""
    needles = [(0, 100.0, 5.0), (1, -20.0, 70.0), (2, 40.0, None)]
    given = [dict(zip(("group", "heading", "sigma"), needle, strict=True)) for needle in needles]
    face, *sectors = panel_answers("dial.js", code, given, tmp_path)
    assert face == [0.0, 360.0]
    np.testing.assert_allclose(sectors, [[100 - 15 - 90, 100 + 15 - 90], [-20 - 180 - 90, -20 + 180 - 90]], atol=1e-9)


def test_the_place_under_the_pointer_is_told_north_up_and_a_drag_takes_it_along(tmp_path):
    """A track of 230 m by 180 m fills a map of 300 by 240 pixels but for margins of 35 and 30: a pixel is a metre."""
    code = """const scene = { lines: [{ group: -1, east: [0, 230, 50], north: [-80, 100, 0] }], refused: [], places: [0, 3] };
    const { element } = module_track.trackPlot("Track", scene, ""), [canvas] = element.all("canvas");
    return given.map(([name, offsetX, offsetY]) => {
      canvas.tell(`pointer${name}`, { pointerId: 1, offsetX, offsetY });
      return element.all("output")[0].textContent;
    });"""
    still = {
        ("move", 35, 30): (0, 100),
        ("move", 265, 210): (230, -80),
        ("move", 150, 120): (115, 10),
        ("move", 50, 90): (15, 40),
    }
    shown = [f"east {number(east)}  north {number(north)}".replace("-", "\N{MINUS SIGN}") for east, north in still.values()]
    dragged = [("down", 50, 90), ("move", 70, 60), ("up", 70, 60), ("move", 70, 60), ("leave", 0, 0)]
    found = panel_answers("track.js", code, [*still, *dragged], tmp_path)
    assert found[:4] == shown and found[-2:] == [shown[-1], ""]


@pytest.mark.slow
def test_all_plots_zoom_together_by_drag_and_keys_and_estimators_hide(browser, page):
    browser.open(page)
    find = browser.driver.find_element
    shown = "[document.getElementById('span-begin').value, document.getElementById('span-end').value].map(Number)"
    assert browser.until(shown) == [0, DURATION]
    over = find(By.CSS_SELECTOR, ".plot .u-over")
    width = over.size["width"]
    drag = ActionChains(browser.driver).move_to_element_with_offset(over, -width // 4, 0).click_and_hold()
    drag.move_by_offset(width // 2, 0).release().perform()
    begin, end = browser.value(shown)
    assert (begin, end) == pytest.approx((DURATION / 4, 3 * DURATION / 4), abs=0.0125 * DURATION)
    plot = find(By.CSS_SELECTOR, ".plot")
    plot.send_keys("+")
    narrower = browser.value(shown)
    assert narrower[1] - narrower[0] == pytest.approx((end - begin) / 2, rel=0.05)
    entries = browser.driver.find_elements(By.CSS_SELECTOR, "button.entry")
    assert [entry.text for entry in entries] == ["loosely-coupled", "wander-sins"]
    entries[1].click()
    assert entries[1].get_attribute("aria-pressed") == "false" and browser.console() == []


def test_the_scale_of_errors_is_that_of_the_figure(tmp_path):
    values = [0.0, 0.0004, -0.001, 0.00100001, 0.03, -20.0]
    code = "((scale) => given.map((v) => [scale.fwd(v), scale.bwd(scale.fwd(v))]))(module_scale.symlog(0.001))"
    expected = SymmetricalLogTransform(10.0, 0.001, 1.3).transform(np.array(values)) / 0.001
    assert np.allclose(answers("scale.js", code, values, tmp_path), np.column_stack([expected, values]), rtol=1e-12)


def test_numbers_in_the_page_are_written_as_in_the_terminal(tmp_path):
    values = [0.0, 1.0, -0.012345, 123456.7, 1e-7, -1e9, 99.96, 0.09996, 999.5, 1e-4, 2.5e5, 10.25, 0.00625, 12.5]
    shown = answers("numbers.js", "given.map(module_numbers.number)", values, tmp_path)
    assert shown == [number(value) for value in values]
    sizes = [mantissa * 10.0**power for power in range(-7, 9) for mantissa in (1.0, -1.25, 4.5678912, 9.9999996)]
    for digits in (3, 6):
        code = f"given.map((value) => module_numbers.significant(value, {digits}))"
        assert answers("numbers.js", code, [0.0, *sizes], tmp_path) == [f"{value:.{digits}g}" for value in (0.0, *sizes)]
    given, told = "1.8e-05 -2.2e-06 1.2e+07 1.0e-11 0.000214", "0.000018 -0.0000022 12000000 1.0e-11 0.000214"
    assert answers("numbers.js", "given.map(module_numbers.plain)", given.split(), tmp_path) == told.split()
    code = "given.map((given) => module_numbers.ticks(...given))"
    marks = answers("numbers.js", code, [[1, 5, 8], [1, 5, 12, True], [1, 25, 5, True], [1.2, 1.8, 8, True]], tmp_path)
    assert marks == [[1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5], [1, 2, 3, 4, 5], [5, 10, 15, 20, 25], []]

"""Live pages in headless Chromium: their numbers are those of `insenv.run`; they are driven, linked to and kept as scenarios.

`make test-web` runs all of them; without INSENV_TEST_WEB the short ones run.
"""

import json
import os
from dataclasses import replace
from urllib.parse import quote

import numpy as np
import pytest
from browser import LAPTOP, PHONE, browser_needed, chromium

import insenv
from insenv.report.page.html import LIMIT
from insenv.report.tables import error_columns, error_rows, number

web = pytest.importorskip("insenv.web.page")
pytest.importorskip("ziglang", reason="ziglang is not installed: there is no compiler to WebAssembly")
pytestmark = browser_needed
long = pytest.mark.skipif("INSENV_TEST_WEB" not in os.environ, reason="a long test of pages: run `make test-web`")
END = "document.querySelector('.end').hidden === false"


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def ship(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "ship.html"
    return web.page("ship-swaying", path, ["q-method"], duration_s=60.0)


@pytest.fixture(scope="module")
def car(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "car.html"
    return web.page("car-city-drive", path, ["loosely-coupled", "wander-sins"], duration_s=120.0)


@pytest.fixture(scope="module")
def hover(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "hover.html"
    return web.page("multirotor-hover", path, ["wander-sins"], duration_s=10.0)


def fast(browser):
    """Run to the end as fast as it goes."""
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script(
        "const speed = document.getElementById('speed'); speed.value = ''; speed.dispatchEvent(new Event('change'));"
        "document.getElementById('run').click();"
    )
    browser.until(END, timeout_s=120.0)


def shown(browser):
    """The figures at the end, by row."""
    rows = "[...document.querySelectorAll('.end tbody tr')].map((row) => [...row.cells].map((cell) => cell.textContent))"
    return [[cell.replace("\N{MINUS SIGN}", "-") for cell in row] for row in browser.value(rows)]


def printed(report, limit=True):
    """What `insenv run` prints: all columns; without those of the limit where the page knows none."""
    results = report.results if limit else [replace(result, limit={}) for result in report.results]
    return [[number(value) for value in values.values()] for result in results for _, values in error_rows(result)]


def test_run_to_the_end_shows_the_numbers_of_insenv_run(browser, ship):
    browser.open(ship)
    fast(browser)
    report = insenv.run("ship-swaying", ["q-method"], duration_s=60.0)
    assert [row[1:] for row in shown(browser)] == printed(report)
    heads = "[...document.querySelectorAll('.end thead th')].map((cell) => cell.textContent)"
    assert browser.value(heads) == list(error_columns(report.results[0]))
    assert browser.console() == []
    assert ship.stat().st_size < LIMIT


@long
def test_health_and_limit_are_those_of_insenv_run_until_something_changes(browser, car):
    """The verdict, the share of fixes refused, the mean NIS with its bounds; the limit, which is that of the scenario alone."""
    browser.open(car)
    fast(browser)
    report = insenv.run("car-city-drive", ["loosely-coupled", "wander-sins"], duration_s=120.0)
    assert [row[1:] for row in shown(browser)] == printed(report)
    below = "[...document.querySelectorAll('.end .below')].map((line) => line.textContent)"
    health = report.results[0].health
    lines = health.summary.splitlines()
    lines[0] = f"Health: {lines[0]}"
    assert len(lines) == 2 and [line for line in browser.value(below) if line in lines] == lines  # of GNSS and of zero velocity
    assert browser.value("document.querySelector('.end .state').textContent") == health.verdict
    now = browser.value("document.querySelector('.readings .below').textContent")
    assert now.startswith(f"loosely-coupled {health.verdict} "), now
    assert "; ".join(lines).endswith(now.partition(f"{health.verdict} ")[2])
    assert browser.value("document.getElementById('changed').textContent") == ""
    browser.driver.execute_script("document.getElementById('reset').click(); document.getElementById('cut-gnss').click()")
    told = browser.until("document.getElementById('changed').textContent")
    assert "no limit is known for them" in told and "some may not hold now" in told
    fast(browser)
    assert browser.value("document.querySelector('.end').textContent.includes('limit')") is False
    assert "no fix came: the estimate is that of the inertial unit and the other aids" in browser.value(below)
    assert browser.console() == []


@long
def test_roll_and_heading_near_90_deg_of_pitch_have_no_limit(browser, tmp_path):
    legs = [{"duration_s": 10.0}, {"duration_s": 20.0, "pitch_deg": 90.0, "rate_deg_s": 20.0}]
    table = {
        "title": "table", "estimators": ["fusion"], "duration_s": 30.0, "imu": {"grade": "tactical"},
        "start": {"latitude_deg": 47.0, "longitude_deg": 15.0}, "vehicle": {"kind": "turntable", "legs": legs},
    }  # fmt: skip
    browser.open(web.page(table, tmp_path / "table.html"))
    fast(browser)
    report = insenv.run(table)
    assert [row[1:] for row in shown(browser)] == printed(report)
    assert [row[5] for row in shown(browser)][:3:2] == ["-", "-"]


@long
def test_what_is_said_below_a_table_is_what_insenv_run_says(browser, tmp_path):
    """Findings, the notes of health, errors larger than stated: of a filter that trusts its odometer far too much."""
    settings = {"fusion": {"odometer_scale_factor_sigma": 1e-6, "odometer_noise_mps": 1e-3}}
    given = {"estimators": ["fusion"], "duration_s": 120.0, "settings": settings}
    browser.open(web.page("car-odometer", tmp_path / "car.html", **given))
    below = "[...document.querySelectorAll('.end .below')].map((line) => line.textContent)"
    for seed in (1, 3):
        browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
        browser.driver.execute_script(
            f"const field = document.getElementById('seed'); field.value = '{seed}'; field.dispatchEvent(new Event('change'));"
        )
        browser.until("document.querySelector('.end').hidden && document.getElementById('clock').textContent === '0:00.0'")
        fast(browser)
        (result,) = insenv.run("car-odometer", seed=seed, **given).results
        for begin in ("the estimate of", "the filter has diverged", "odometer does not fit", "the errors are larger"):
            assert any(note.startswith(begin) for note in result.notes)
        assert browser.value(below) == [*f"Health: {result.health.summary}".split("\n"), *result.notes]
        browser.driver.execute_script("document.getElementById('reset').click();")


def test_a_setting_and_a_seed_give_the_numbers_of_that_scenario_and_the_link_repeats_them(browser, ship):
    from selenium.webdriver import Keys
    from selenium.webdriver.common.by import By

    browser.open(ship)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    field = browser.driver.find_element(By.ID, "seed")
    field.clear()
    field.send_keys("7", Keys.TAB)
    browser.driver.execute_script(
        "const grade = document.getElementById('control-imu.grade'); grade.value = 'navigation';"
        "grade.dispatchEvent(new Event('change'));"
    )
    fast(browser)
    found = shown(browser)
    values = insenv.load("ship-swaying").model_dump(mode="json", exclude_unset=True)
    values["imu"]["grade"] = "navigation"
    report = insenv.run(values, ["q-method"], seed=7, duration_s=60.0)
    assert [row[1:] for row in found] == printed(report, limit=False)
    link = browser.until("location.hash.includes('seed=7') && location.hash")
    assert "imu.grade=navigation" in link
    browser.open(ship, fragment=link)
    fast(browser)
    assert shown(browser) == found
    assert browser.console() == []


def test_another_grade_alone_has_the_notes_of_insenv_run(browser, car):
    notes = "[...document.querySelectorAll('.notes li')].map((one) => one.textContent)"
    told = "document.getElementById('changed').textContent"

    def choose(key, value):
        browser.driver.execute_script(
            "const field = document.getElementById(arguments[0]); field.value = arguments[1];"
            "field.dispatchEvent(new Event('change'));",
            f"control-{key}",
            value,
        )

    def said(**imu):
        values = insenv.load("car-city-drive").model_dump(mode="json", exclude_unset=True)
        values["imu"] |= imu
        found = insenv.run(values, ["loosely-coupled", "wander-sins"], duration_s=120.0).results
        of_errors = ("the filter is", "the errors are larger")  # which stand below the table at the end
        return [f"{one.estimator}: {note}" for one in found for note in one.notes if not note.startswith(of_errors)]

    browser.open(car)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    assert browser.value(notes) == said()
    choose("imu.grade", "consumer")
    assert browser.until(told) == "The settings have changed; no limit is known for them."
    assert browser.value(notes) == said(grade="consumer") != said()
    choose("start.latitude_deg", "10")
    browser.until(f"{told}.includes('some may not hold now')")
    assert browser.value(notes) == said()
    assert browser.console() == []


@pytest.mark.parametrize(
    ("fragment", "message"),
    [
        ("#imu.mass_kg=3", "imu.mass_kg: this page has no control of that name"),
        ("#seed=1.5", "seed = 1.5: allowed is a whole number"),
        ("#seed=2&seed=3", "seed stands in the link more than once: allowed is one value"),
        ("#seed=999999", "seed = 999999: allowed is 0 to 1023"),
        ("#start.latitude_deg=95", "start.latitude_deg = 95 deg: allowed is -80 to 80 deg"),
        ("#imu.grade=golden", 'imu.grade = "golden": allowed is'),
        ("#commands=[[1,{%22sail%22:1}]]", "command"),
        ("#commands=[1", "commands = [1: allowed is a list of values"),
        ("#commands=[[0,[]]]", "commands: allowed are pairs of a sample and the values of commands"),
        ("#commands=[[0,{%22sea%22:null}]]", "command sea = null: allowed is 0 to 3"),
        ("#commands=[[0,{%22sea%22:[2]}]]", "command sea = [2]: allowed is 0 to 3"),
        ("#=3", '"": this page has no control of that name'),
    ],
)
def test_a_broken_link_is_a_sentence_in_the_page(browser, ship, fragment, message):
    browser.open(ship, fragment=fragment)
    told = browser.until("document.getElementById('wrong')?.textContent")
    assert told.startswith("This link cannot be followed: ") and message in told
    assert browser.until("document.getElementById('seed').value === '1' && location.hash === ''")
    assert browser.console() == []


@pytest.mark.parametrize("text", ["5", "{}", "null", "[5]", "[[5,1]]", "[[-5,1]]", "[[null,1]]", '[["1",2]]', "[[1,2,3]]"])
def test_outages_of_a_link_that_are_none_are_a_sentence_in_the_page(browser, car, text):
    browser.open(car, fragment=f"#gnss.outages_s={quote(text)}")
    told = browser.until("document.getElementById('wrong')?.textContent")
    sentence = f"gnss.outages_s = {text} s: allowed are pairs of a begin of 0 s or later and an end after it"
    assert told == f"This link cannot be followed: {sentence}. The scenario is shown as it is."
    assert browser.until("location.hash === ''") and browser.console() == []


def test_a_value_out_of_bounds_is_a_sentence_beside_its_control(browser, ship):
    from selenium.webdriver import Keys
    from selenium.webdriver.common.by import By

    browser.open(ship)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    field = browser.driver.find_element(By.ID, "control-start.latitude_deg")
    field.clear()
    field.send_keys("95", Keys.TAB)
    told = browser.until("[...document.querySelectorAll('.controls [role=alert]')].map((one) => one.textContent).join('')")
    assert told == "start.latitude_deg = 95 deg: allowed is -80 to 80 deg. The run still uses 30 deg."
    seed = browser.driver.find_element(By.ID, "seed")
    for given, sentence in (
        ("", "seed is empty: allowed is 0 to 1023. The run still uses 1."),
        ("2.5", "seed = 2.5: allowed is a whole number, 0 to 1023. The run still uses 1."),
        ("5000", "seed = 5000: allowed is 0 to 1023. The run still uses 1."),
    ):
        seed.clear()
        seed.send_keys(given, Keys.TAB)
        assert browser.value("document.getElementById('seed-wrong').textContent") == sentence


def test_the_space_key_runs_and_pauses_after_clicks_with_the_pointer(browser, ship):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By

    browser.open(ship)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    label = "document.getElementById('run').textContent"
    for button, after in (("step", "Pause"), ("reset", "Pause"), ("run", "Run")):
        browser.driver.find_element(By.ID, button).click()
        ActionChains(browser.driver).send_keys(" ").perform()
        browser.until(f"{label} === {after!r}")
        browser.driver.execute_script("document.getElementById('reset').click()")
        browser.until("document.getElementById('clock').textContent === '0:00.0'")
    # a button that the keyboard has reached keeps its own action
    browser.driver.execute_script("document.getElementById('step').focus()")
    ActionChains(browser.driver).send_keys(" ").perform()
    browser.until("document.querySelector('progress').value > 0")
    assert browser.value(label) == "Run"


def test_focus_that_goes_back_stays_clear_of_the_bar(browser, ship):
    from selenium.webdriver import ActionChains, Keys

    browser.open(ship, (1280, 500))
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script(
        "document.querySelectorAll('details').forEach((one) => (one.open = true)); document.getElementById('restore').focus();"
    )
    for _ in range(12):
        ActionChains(browser.driver).key_down(Keys.SHIFT).send_keys(Keys.TAB).key_up(Keys.SHIFT).perform()
        top = browser.value("document.activeElement.getBoundingClientRect().top")
        assert top >= browser.value("document.querySelector('.transport').getBoundingClientRect().bottom")


def test_labels_of_plots_have_their_size_on_a_screen_with_a_ratio_of_two(browser, ship):
    browser.open(ship, ratio=2)
    browser.driver.execute_script(
        "window.fonts = []; const draw = CanvasRenderingContext2D.prototype.fillText;"
        "CanvasRenderingContext2D.prototype.fillText = function (...given) {"
        "  if (this.canvas.closest('.uplot')) window.fonts.push(parseFloat(this.font)); draw.apply(this, given); };"
        "document.querySelector('.tools button:last-child').click();"
    )
    assert set(browser.until("window.fonts.length && window.fonts")) == {24}


@long
def test_a_page_of_a_track_says_that_its_file_is_needed(tmp_path):
    rows = [f"{t},45.0,{7.0 + 1e-5 * t},300" for t in range(61)]
    (tmp_path / "track.csv").write_text("\n".join(["time,latitude,longitude,height", *rows]), encoding="utf-8")
    text = 'title = "Own"\n[vehicle]\nkind = "recorded"\nfile = "track.csv"\n[imu]\ngrade = "tactical"\n[gnss]\ngrade = "spp"\n'
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    document = web.live_document(web.live(tmp_path / "own.toml", ["loosely-coupled"]))
    assert document["values"]["vehicle"]["file"] == "track.csv"
    assert any("track.csv: keep that file beside it" in note for note in document["notes"])


@pytest.mark.parametrize(("size", "dark"), [(LAPTOP, False), (LAPTOP, True), (PHONE, False)], ids=["light", "dark", "phone"])
def test_the_page_is_accessible_and_fits(browser, ship, size, dark):
    browser.open(ship, size, dark)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    assert browser.violations() == []
    assert browser.value("document.documentElement.scrollWidth <= innerWidth")
    browser.driver.execute_script("document.querySelector('.dial').style.display = 'none'")
    browser.driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(() => arguments[0]()))")
    assert browser.console() == []


def test_nothing_can_be_set_before_the_model_is_there(browser, car):
    """Its worker never answers here; the settings are those of the scenario already."""
    add, remove = (f"Page.{verb}ScriptToEvaluateOnNewDocument" for verb in ("add", "remove"))
    script = browser.driver.execute_cdp_cmd(add, {"source": "window.Worker = class { postMessage() {} };"})
    try:
        browser.open(car)
        browser.until("document.getElementById('run')?.textContent === 'Starting ...'")
    finally:
        browser.driver.execute_cdp_cmd(remove, script)
    assert browser.value("document.querySelector('main').ariaBusy") == "true"
    able = "[...document.querySelectorAll('.transport :is(button, select), .controls, .drive, .cloud')]"
    assert browser.value(f"{able}.filter((one) => !one.disabled && !one.inert).length") == 0
    unit = "document.getElementById('control-imu.grade').selectedOptions[0].textContent"
    assert browser.value(unit) == "tactical"
    assert browser.violations() == []
    browser.open(car)
    browser.until("document.getElementById('run')?.textContent === 'Run'")
    assert browser.value("document.querySelector('main').ariaBusy") == "false"
    assert browser.value(f"{able}.filter((one) => one.disabled || one.inert).length") == 0


@long
def test_plots_out_of_sight_are_drawn_at_the_end_and_for_a_print(browser, car):
    """They show as much as when they are scrolled to."""
    pictures = "[...document.querySelectorAll('.plots .panels .plot canvas')].map((one) => one.toDataURL())"
    frames = (
        "const done = arguments[0]; let left = 40;"
        "const wait = () => (left-- ? requestAnimationFrame(wait) : done()); requestAnimationFrame(wait);"
    )
    browser.open(car)
    fast(browser)
    browser.driver.execute_async_script(frames)
    found = browser.value(pictures)
    for place in range(len(found)):
        browser.driver.execute_script(f"document.querySelectorAll('.plots .panel')[{place}].scrollIntoView()")
        browser.driver.execute_async_script(frames.replace("40", "3"))
    browser.driver.execute_async_script(frames)
    assert len(found) > 12 and browser.value(pictures) == found

    browser.open(car)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script("document.getElementById('run').click()")
    browser.until("document.getElementById('clock').textContent > '0:03.0'")
    drawn = browser.driver.execute_async_script(
        f"const done = arguments[0]; const pictures = () => {pictures}; const before = pictures();"
        "dispatchEvent(new Event('beforeprint'));"
        "queueMicrotask(() => done(pictures().filter((one, place) => one !== before[place]).length));"
    )
    assert drawn > 12
    assert browser.console() == []


@long
def test_plots_out_of_sight_wait_while_it_runs(browser, car):
    browser.open(car)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script("document.getElementById('run').click()")
    browser.until("document.getElementById('clock').textContent > '0:11.0'")  # from 10 s on the axis grows
    last = "[...document.querySelectorAll('.plots .panels .plot canvas')].at(-1)"
    assert browser.value(f"{last}.getBoundingClientRect().top - innerHeight") > 200
    before = browser.value(f"{last}.toDataURL()")
    browser.until("document.getElementById('clock').textContent > '0:13.0'")
    assert browser.value(f"{last}.toDataURL()") == before
    browser.driver.execute_script("document.getElementById('run').click()")
    browser.until(f"{last}.toDataURL() !== arguments[0]".replace("arguments[0]", json.dumps(before)))


def test_numbers_of_two_estimators_fit_on_a_phone(browser, car):
    browser.open(car, PHONE)
    fast(browser)
    width = "document.querySelector('.readings .scroll').{}Width"
    assert browser.value(width.format("scroll")) == browser.value(width.format("client"))


@long
def test_sensors_to_cut_off_fit_on_a_phone(browser, hover):
    browser.open(hover, PHONE)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    assert browser.value("document.querySelectorAll('.cut').length") == 3
    assert browser.value("document.documentElement.scrollWidth") == PHONE[0]


def test_a_multirotor_climbs_and_sinks_by_dragging(browser, hover):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By

    browser.open(hover)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    pad = browser.driver.find_element(By.CSS_SELECTOR, ".pad")
    knob = "document.querySelector('.pad i').style.top"
    assert browser.until(knob) == "50%"
    half = pad.size["height"] / 2
    for share, rate in ((-0.5, 1.5), (0.5, -1.5)):
        ActionChains(browser.driver).move_to_element_with_offset(pad, 0, round(share * half)).click().perform()
        assert browser.value("document.querySelector('.drive output').textContent").startswith("climb rate")
        given = "JSON.parse(new URLSearchParams(location.hash.slice(1)).get('commands') ?? '[]')"
        browser.until(f"Math.abs({given}.at(-1)?.[1].climb_rate - {rate}) < 0.1")


@long
def test_a_car_is_driven_with_keys_and_its_scenario_gives_the_same_numbers(browser, car, tmp_path):
    from selenium.webdriver import ActionChains, Keys
    from selenium.webdriver.common.by import By

    browser.open(car)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    # texts that are offered as files are kept here
    browser.driver.execute_script(
        "window.kept = []; const old = URL.createObjectURL;"
        "URL.createObjectURL = (blob) => { blob.text().then((text) => window.kept.push(text)); return old(blob); };"
    )
    assert browser.violations() == []
    pad = browser.driver.find_element(By.CSS_SELECTOR, ".pad")
    pad.click()
    keys = ActionChains(browser.driver)
    keys.key_down(Keys.ARROW_UP).pause(1.0).key_up(Keys.ARROW_UP).key_down(Keys.ARROW_RIGHT).pause(0.6).key_up(Keys.ARROW_RIGHT)
    keys.perform()
    cut = browser.driver.find_element(By.ID, "cut-gnss")
    cut.click()
    browser.until("document.getElementById('cut-gnss').getAttribute('aria-pressed') === 'true'")
    cut.click()
    browser.until("document.getElementById('cut-gnss').getAttribute('aria-pressed') === 'false'")
    browser.driver.execute_script(
        "const speed = document.getElementById('speed'); speed.value = ''; speed.dispatchEvent(new Event('change'));"
    )
    browser.until(END, timeout_s=120.0)
    found = shown(browser)
    # the address follows a moment later: wait for the one with the outage that has ended
    link = browser.until("/commands=/.test(location.hash) && /outages_s=(?!.*1000000000)/.test(location.hash) && location.hash")
    browser.driver.find_element(By.ID, "toml").click()
    text = browser.until("window.kept[0]")
    (tmp_path / "driven.toml").write_text(text, encoding="utf-8")
    report = insenv.run(tmp_path / "driven.toml")
    assert [row[1:] for row in found] == printed(report)
    east = report.results[0].outputs["longitude"][-1] - report.results[0].outputs["longitude"][0]
    assert abs(east) > 1e-6  # it has been driven
    browser.open(car, fragment=link)
    fast(browser)
    assert shown(browser) == found
    assert browser.console() == []


@long
def test_many_units_stay_about_the_limit(browser, ship):
    browser.open(ship)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script("document.getElementById('cloud').click()")
    browser.until("document.getElementById('cloud-done').textContent === '64 of 64'", timeout_s=300.0)
    rows = "[...document.querySelectorAll('.cloud tbody tr')].map((row) => [...row.cells].map((cell) => cell.textContent))"
    found = {row[0].split()[0]: [float(text) for text in row[1:]] for row in browser.value(rows)}
    runs = [insenv.run("ship-swaying", ["q-method"], seed=seed, duration_s=60.0).results[0] for seed in range(1, 65)]
    for channel, (rms, largest, _, _) in found.items():
        ends = np.array([result.errors[f"{channel}_deg"][-1] for result in runs])
        assert rms == pytest.approx(float(np.sqrt(np.mean(ends**2))), rel=5e-3)
        assert largest == pytest.approx(float(np.abs(ends).max()), rel=5e-3)


@long
def test_frames_keep_coming_while_it_runs(browser, car, record_property):
    browser.open(car)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    times = browser.driver.execute_async_script(
        "const done = arguments[0]; document.getElementById('run').click(); const times = [];"
        "const tick = (now) => { times.push(now); if (times.length < 240) requestAnimationFrame(tick); else done(times); };"
        "requestAnimationFrame(tick);"
    )
    frames = np.diff(times)
    record_property("median_frame_ms", float(np.median(frames)))
    record_property("p95_frame_ms", float(np.quantile(frames, 0.95)))
    print(f"frames: median {np.median(frames):.1f} ms, 95 % {np.quantile(frames, 0.95):.1f} ms, largest {frames.max():.1f} ms")
    assert len(frames) == 239 and browser.value("document.getElementById('clock').textContent") != "0:00.0"


@long
def test_the_page_of_a_run_becomes_live(browser, tmp_path):
    from insenv.report import OutputFolder, write_files
    from insenv.web.live import live, live_document

    report = insenv.run("ship-swaying", ["q-method"], duration_s=60.0)
    more = {"live": live_document(live("ship-swaying", ["q-method"], duration_s=60.0))}
    path = next(path for path in write_files(report, OutputFolder(tmp_path), documents=more).paths if path.suffix == ".html")
    assert path.stat().st_size < LIMIT
    browser.open(path)
    browser.until("document.getElementById('make-live')")
    assert browser.violations() == []
    browser.driver.execute_script("document.getElementById('make-live').click()")
    fast(browser)
    assert [row[1:] for row in shown(browser)] == printed(report)
    assert browser.console() == []


def test_a_finger_on_the_field_commands_and_a_run_after_a_cloud_goes_on(browser, ship):
    from selenium.webdriver.common.by import By

    browser.open(ship, PHONE)
    browser.until("document.getElementById('clock')?.textContent === '0:00.0'")
    browser.driver.execute_script("document.getElementById('cloud').click()")
    browser.until("parseInt(document.getElementById('cloud-done').textContent) >= 1")
    browser.driver.execute_script("document.getElementById('run').click()")
    browser.until("document.getElementById('clock').textContent > '0:01.0'")
    pad = browser.driver.find_element(By.CSS_SELECTOR, ".pad")
    browser.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", pad)
    box = browser.value("arguments[0].getBoundingClientRect().toJSON()", pad)
    place = {"x": box["x"] + 0.75 * box["width"], "y": box["y"] + 0.25 * box["height"]}
    for kind, points in (("touchStart", [place]), ("touchMove", [{**place, "x": place["x"] + 4}]), ("touchEnd", [])):
        browser.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    link = browser.until("decodeURIComponent(location.hash).includes('\"wave\"') && decodeURIComponent(location.hash)")
    waves = [command[1]["wave"] for command in json.loads(link.partition("commands=")[2])]
    assert max(waves) == pytest.approx(0.5, abs=0.05) and waves[-1] == 0
    assert browser.console() == []

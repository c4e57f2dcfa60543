"""Live pages in headless Chromium: their numbers are those of `insenv.run`; they are driven, linked to, kept as scenarios."""

import base64
import json
import zlib
from dataclasses import replace

import numpy as np
import pytest
from browser import LAPTOP, PHONE
from changed_scenario import changed
from live_pages import CAR, SHIP, live_page, page_file
from selenium.webdriver import ActionChains, Keys
from selenium.webdriver.common.by import By

import insenv
from insenv.report import OutputFolder, write_files
from insenv.report.tables import error_rows, number
from insenv.web.live import live_document

END = "document.querySelector('.end').hidden === false"
STARTED = "document.getElementById('clock')?.textContent === '0:00.0'"


def ready(browser, path, size=LAPTOP, **more):
    browser.open(path, size, **more)
    browser.until(STARTED)


def click(browser, id):
    browser.driver.execute_script("document.getElementById(arguments[0]).click()", id)


def choose(browser, id, value):
    script = "const field = document.getElementById(arguments[0]); field.value = arguments[1];"
    browser.driver.execute_script(f"{script} field.dispatchEvent(new Event('change'));", id, value)


def typed(browser, id, text):
    browser.driver.execute_script("document.getElementById('settings').hidden = false")
    field = browser.driver.find_element(By.ID, id)
    field.clear()
    field.send_keys(text, Keys.TAB)


def go_back(browser, seconds):
    script = "arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input'))"
    browser.driver.execute_script(script, browser.driver.find_element(By.ID, "time"), seconds)


def fast(browser):
    browser.until(STARTED)
    choose(browser, "speed", "")
    click(browser, "run")
    browser.until(END, timeout_s=120.0)


def figures(browser):
    """The numbers of the table at the end, with ASCII minus signs."""
    texts = "map((row) => [...row.cells].slice(1).map((cell) => cell.textContent.replaceAll('\u2212', '-')))"
    return browser.value(f"[...document.querySelectorAll('.end tbody tr')].{texts}")


def printed(report, limit=True):
    """What `insenv run` prints; without the limit where the page knows none."""
    results = report.results if limit else [replace(result, limit={}) for result in report.results]
    return [[number(value) for value in values.values()] for result in results for _, values in error_rows(result)]


@pytest.mark.slow
def test_run_to_the_end_shows_the_numbers_of_insenv_run_also_after_changes_and_by_a_link(browser):
    path, (name, estimators, duration) = page_file(*SHIP), SHIP
    ready(browser, path)
    fast(browser)
    report = insenv.run(name, estimators, duration_s=duration)
    assert figures(browser) == printed(report)
    assert path.stat().st_size < 250_000
    ready(browser, path)
    typed(browser, "seed", "7")
    choose(browser, "control-imu.grade", "navigation")
    fast(browser)
    report = insenv.run(changed(name, imu={"grade": "navigation"}), estimators, seed=7, duration_s=duration)
    assert figures(browser) == printed(report, limit=False)
    browser.open(path, fragment=browser.until("location.hash.includes('seed=7') && location.hash"))
    fast(browser)
    assert figures(browser) == printed(report, limit=False) and browser.console() == []


@pytest.mark.slow
def test_another_grade_alone_has_the_notes_of_insenv_run(browser):
    notes = "[...document.querySelectorAll('.notes li')].map((one) => one.textContent)"
    told = "document.getElementById('changed').textContent"
    name, estimators, duration = CAR

    def said(**imu):
        found = insenv.run(changed(name, imu=imu), estimators, duration_s=duration).results
        # below the table at the end
        of_errors = ("the filter is", "the errors are larger", "restarts of position", "the stated sigma")
        return [f"{one.estimator}: {note}" for one in found for note in one.notes if not note.startswith(of_errors)]

    ready(browser, page_file(*CAR))
    assert browser.value(notes) == said()
    choose(browser, "control-imu.grade", "consumer")
    assert browser.until(told) == "The settings have changed; no limit is known for them."
    assert browser.value(notes) == said(grade="consumer") != said()
    choose(browser, "control-start.latitude_deg", "10")
    browser.until(f"{told}.includes('some may not hold now')")
    assert browser.value(notes) == said() and browser.console() == []


@pytest.mark.slow
def test_a_broken_link_and_a_value_out_of_bounds_are_said_in_the_page_and_a_link_may_start_it(browser):
    browser.open(page_file(*SHIP), fragment="#seed=999999")
    told = browser.until("document.getElementById('wrong')?.textContent")
    assert told.startswith("This link cannot be followed: seed = 999999")
    browser.until("document.getElementById('seed').value === '1' && location.hash === ''")
    browser.until(STARTED)
    typed(browser, "seed", "2.5")
    sentence = "seed = 2.5: allowed is a whole number, 0 to 1023. The run still uses 1"
    browser.until(f"document.body.innerText.includes('{sentence}')")
    browser.open(page_file(*SHIP), fragment="#run")
    browser.until("document.getElementById('clock')?.textContent > '0:00.5'")
    assert browser.console() == []


@pytest.mark.slow
@pytest.mark.parametrize(("size", "dark"), [(LAPTOP, False), (LAPTOP, True), (PHONE, False)], ids=["light", "dark", "phone"])
def test_the_page_is_accessible_and_fits(browser, size, dark):
    ready(browser, page_file(*SHIP), size, dark=dark)
    lowest = "Math.max(...[...document.querySelectorAll('canvas.hull, canvas.track, .sensor')].map(bottom), bottom(heading))"
    titled = "[...document.querySelectorAll('.panel')].find((one) => one.textContent.startsWith('Heading error'))"
    of_box = "(one) => one.getBoundingClientRect().bottom"
    assert browser.value(f"((bottom, heading) => {lowest})({of_box}, {titled}) <= innerHeight")  # the first screen
    above = "document.getElementById('follow').getBoundingClientRect().bottom <= "
    assert browser.value(f"{above} document.querySelector('canvas.track').getBoundingClientRect().top")
    dial = "((when) => (dispatchEvent(new Event(when)), document.querySelector('canvas.dial').toDataURL()))"
    assert browser.value(f"{dial}('afterprint') !== {dial}('beforeprint')") == dark  # paper is white
    browser.driver.execute_script("dispatchEvent(new Event('afterprint'))")
    browser.driver.find_element(By.ID, "open-settings").send_keys(" ")
    browser.driver.execute_script("document.querySelectorAll('details').forEach((one) => (one.open = true));")
    assert browser.value("document.getElementById('settings').contains(document.activeElement)")
    assert browser.violations() == []
    browser.driver.find_element(By.ID, "seed").send_keys(Keys.ESCAPE)
    assert browser.value("document.getElementById('settings').hidden && document.activeElement.id") == "open-settings"
    assert browser.value("document.documentElement.scrollWidth <= innerWidth")
    assert browser.console() == []


@pytest.mark.slow
def test_a_car_is_driven_with_keys_and_its_scenario_gives_the_same_numbers(browser, tmp_path):
    path = page_file(*CAR)
    ready(browser, path)
    # texts that are offered as files are kept here
    browser.driver.execute_script(
        "window.kept = []; const old = URL.createObjectURL;"
        "URL.createObjectURL = (blob) => { blob.text().then((text) => window.kept.push(text)); return old(blob); };"
    )
    browser.driver.find_element(By.CSS_SELECTOR, ".pad").click()  # alone commands nothing
    assert browser.value("[document.getElementById('run').textContent, location.hash]") == ["Run", ""]
    keys = ActionChains(browser.driver)
    for key, seconds in ((Keys.ARROW_UP, 1.0), (Keys.ARROW_RIGHT, 0.6)):
        keys.key_down(key).pause(seconds).key_up(key)
    keys.perform()
    for label, state in (("Give GNSS back", "no GNSS since "), ("Cut GNSS", "GNSS on")):
        browser.driver.find_element(By.ID, "cut-gnss").click()
        told = "document.getElementById('cut-gnss').textContent + document.querySelector('.sensor').textContent"
        browser.until(f"({told}).startsWith('{label}{state}')")
    choose(browser, "speed", "")
    browser.until(END, timeout_s=120.0)
    # the address follows a moment later: wait for the one with the outage that has ended
    link = browser.until("/commands=/.test(location.hash) && /outages_s=(?!.*1000000000)/.test(location.hash) && location.hash")
    click(browser, "toml")
    (tmp_path / "driven.toml").write_text(browser.until("window.kept[0]"), encoding="utf-8")
    report = insenv.run(tmp_path / "driven.toml")
    assert figures(browser) == printed(report)
    assert abs(np.diff(report.results[0].outputs["longitude"][[0, -1]])) > 1e-6  # it has been driven
    browser.open(path, fragment=link)
    fast(browser)
    assert figures(browser) == printed(report) and browser.console() == []


@pytest.mark.slow
def test_the_page_of_a_run_becomes_live(browser, tmp_path):
    report = insenv.run(*SHIP[:2], duration_s=SHIP[2])
    written = write_files(report, OutputFolder(tmp_path), documents={"live": live_document(live_page(*SHIP))}).paths
    path = next(path for path in written if path.suffix == ".html")
    browser.open(path)
    browser.until("document.getElementById('make-live')")
    assert browser.violations() == []
    click(browser, "make-live")
    fast(browser)
    assert figures(browser) == printed(report) and browser.console() == []


@pytest.mark.slow
def test_a_finger_on_the_field_commands_and_a_run_after_a_cloud_goes_on(browser):
    ready(browser, page_file(*SHIP), PHONE)
    click(browser, "cloud")
    browser.until("parseInt(document.getElementById('cloud-done').textContent) >= 1")
    click(browser, "run")
    browser.until("document.getElementById('clock').textContent > '0:01.0'")
    pad = browser.driver.find_element(By.CSS_SELECTOR, ".pad")
    browser.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", pad)
    box = browser.value("arguments[0].getBoundingClientRect().toJSON()", pad)
    place = {"x": box["x"] + 0.75 * box["width"], "y": box["y"] + 0.25 * box["height"]}
    for kind, points in (("touchStart", [place]), ("touchMove", [{**place, "x": place["x"] + 4}]), ("touchEnd", [])):
        browser.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    packed = browser.until("/commands=/.test(location.hash) && location.hash").partition("commands=")[2]
    read = json.loads(zlib.decompress(base64.urlsafe_b64decode(packed + "=" * (-len(packed) % 4)), -zlib.MAX_WBITS))
    waves = [values["wave"] for _, values in read if "wave" in values]
    assert max(waves) == pytest.approx(0.5, abs=0.05) and waves[-1] == 0
    assert browser.console() == []


@pytest.mark.slow
def test_the_last_run_stays_beside_one_of_another_grade_until_it_is_forgotten(browser):
    path, (name, estimators, duration) = page_file(*CAR), CAR
    ready(browser, path)
    fast(browser)
    before, drawn = insenv.run(name, estimators, duration_s=duration), "document.querySelector('.panel canvas').toDataURL()"
    choose(browser, "control-imu.grade", "consumer")
    assert browser.until("document.getElementById('last-run').textContent") == "last run: unit tactical"
    fast(browser)
    after = insenv.run(changed(name, imu={"grade": "consumer"}), estimators, duration_s=duration)
    rows = zip(printed(after, limit=False), printed(before), strict=True)
    assert figures(browser) == [[*row[:2], old[1], *row[2:]] for row, old in rows]
    assert browser.violations() == []
    go_back(browser, 30)
    runs = (one.results[0] for one in (after, before))
    now, last = (number(one.errors["roll_deg"][np.argmin(abs(one.time - 30.0))]) for one in runs)
    shown = "document.querySelector('.plots .readout').textContent.replaceAll('\u2212', '-')"
    browser.until(f"{shown}.startsWith('30.0 s{now}({last})')")
    both = browser.value(drawn)
    click(browser, "forget")
    browser.until(f"document.querySelector('.last').hidden && {drawn} !== {both!r}")
    choose(browser, "control-imu.grade", "tactical")
    fast(browser)
    choose(browser, "control-imu.grade", "consumer")
    choose(browser, "control-imu.grade", "tactical")  # equal to the last run: nothing to show
    browser.until("document.querySelector('.last').hidden")
    assert browser.console() == []


@pytest.mark.slow
@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_going_back_shows_the_numbers_of_then_and_the_run_goes_on_from_its_end(browser, size):
    path, (name, estimators, duration) = page_file(*CAR), CAR
    ready(browser, path, size)
    fast(browser)
    go_back(browser, 30)
    browser.until("document.getElementById('clock').textContent === '0:30.0'")
    result = insenv.run(name, estimators, duration_s=duration).results[0]
    place = np.argmin(abs(result.time - 30.0))
    texts = "map((one) => one.rows[0].cells[3].textContent.replace('\u2212', '-'))"
    shown = browser.value(f"[...document.querySelectorAll('.readings tbody')].{texts}")
    assert shown == [number(values[place]) for values in result.errors.values()]
    assert browser.value("[...document.querySelectorAll('.scroll')].every((one) => one.scrollWidth <= one.clientWidth)")
    browser.until("document.querySelector('.plots .readout').textContent.startsWith('30.0 s')")
    click(browser, "follow")
    assert browser.value("document.getElementById('follow').ariaPressed") == "true"
    browser.driver.find_element("css selector", "canvas.track").send_keys("0")
    assert browser.value("document.getElementById('follow').ariaPressed") == "false"
    click(browser, "reset")
    browser.until("document.getElementById('clock').textContent === '0:00.0'")
    assert browser.console() == []

"""The story of a scenario: in its file, and in the strip of a live page."""

import pytest
from browser import LAPTOP, PHONE
from live_pages import CAR, SHIP, answers, page_file

import insenv
from insenv.scenario import parse

STORY = [{"text": "on"}, {"at_s": 5, "text": "later"}, {"after": "cut", "text": "cut"}]
STORY += [{"after": "cut", "at_s": 4, "text": "long cut"}, {"after": "return", "text": "back"}]
STORY += [{"after": "return", "at_s": 11, "text": "well again"}]


def test_the_sentence_that_began_last_is_told_and_each_cut_and_return_tells_its_own(tmp_path):
    times = [0.0, 4.9, 5.0, 10.0, 13.9, 14.0, 20.0, 28.0, 30.0, 32.0, 34.0, 44.0]
    code = "given.times.map((time) => module_story.captionAt(given.story, given.cuts, time))"
    given = {"story": STORY, "times": times, "cuts": [[10.0, 20.0], [30.0, 33.0]]}
    told = ["on", "on", "later", "cut", "cut", "long cut", "back", "back", "cut", "cut", "back", "well again"]
    assert answers("story.js", code, given, tmp_path) == told
    given = {"story": STORY, "times": [2.0, 4.9, 6.0, 7.0, 8.0], "cuts": [[3.0, 7.5]]}  # "later" would begin in the cut
    assert answers("story.js", code, given, tmp_path) == ["on", "cut", "cut", "long cut", "back"]


def test_a_story_about_gnss_may_stay_where_gnss_is_taken_away():
    values = insenv.load("car-city-drive").model_dump(mode="json", exclude_unset=True)
    del values["gnss"]
    assert len(parse({**values, "estimators": ["wander-sins"], "estimator": {}}, "alone").story) > 3


@pytest.mark.slow
@pytest.mark.parametrize(("page", "size"), [(SHIP, LAPTOP), (CAR, PHONE)])
def test_the_strip_follows_the_run_and_is_put_away_with_the_keyboard(browser, page, size):
    path, story = page_file(*page), insenv.load(page[0]).story
    browser.open(path, size)
    caption, strip = "document.getElementById('caption')", "document.querySelector('.story')"
    assert browser.until(f"{caption}.textContent") == story[0].text
    width = "document.querySelector('#story').offsetWidth"
    assert browser.value(f"{width} < {strip}.offsetWidth / 4 && {caption}.getAttribute('aria-live') === 'polite'")
    browser.until("!document.getElementById('run').disabled")
    browser.driver.execute_script("document.getElementById('speed').value = ''; document.getElementById('run').click()")
    browser.until(f"{caption}.textContent === {story[2 if size == LAPTOP else 1].text!r}")
    assert browser.violations() == []
    browser.driver.find_element("id", "story").send_keys(" ")
    assert browser.value(f"{caption}.hidden && !document.getElementById('story').ariaExpanded.includes('true')")
    assert browser.console() == []

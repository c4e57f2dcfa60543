"""The built site, as files and in headless Chromium: `make docs` builds it and names its folder in INSENV_SITE."""

import functools
import http.server
import json
import os
import threading
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import peers
import pytest
from browser import LAPTOP, PHONE, chromium

SITE = Path(os.environ.get("INSENV_SITE", "/nonexistent"))
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pages():
    if not SITE.is_dir():
        peers.lacking("INSENV_SITE names no built site: run `make docs`")
    return sorted(path.relative_to(SITE).as_posix() for path in SITE.rglob("*.html") if "_static" not in path.parts)


class Page(HTMLParser):
    def __init__(self, page):
        super().__init__()
        self.links, self.ids = [], set()
        self.feed((SITE / page).read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.ids |= {given[name] for name in ("id", "name") if given.get(name)}
        wanted = {"a": "href", "img": "src", "link": "href", "script": "src", "source": "src"}.get(tag)
        if wanted and given.get(wanted) and given.get("rel") not in ("search", "prefetch"):
            self.links.append(given[wanted])


def test_links_and_pictures_lead_somewhere(pages):
    assert {"index.html", "search.html", "how-to.html", "reference.html", "concepts/architecture.html"} <= set(pages)
    wrong, parsed = [], functools.cache(Page)
    for page, link in [(each, link) for each in pages for link in parsed(each).links]:
        parts = urlsplit(urljoin(f"http://site/{page}", link))
        path = unquote(parts.path).lstrip("/") or page
        if (parts.netloc, parts.scheme) != ("site", "http"):
            continue
        place = path.endswith(".html") and not path.startswith("live/") and unquote(parts.fragment)
        if not (SITE / path).is_file():
            wrong.append(f"{page}: {link}: no such file")
        elif place and place not in parsed(path).ids:
            wrong.append(f"{page}: {link}: no such place on that page")
    assert not wrong


@pytest.fixture(scope="module")
def address(pages):
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(SITE)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def browser(address):
    with chromium("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", performance="ALL") as found:
        yield found


def opened(browser, address, page):
    """Messages of the console, and requests that leave the site."""
    driver = browser.driver
    browser.resize(LAPTOP)
    driver.get_log("browser"), driver.get_log("performance")
    driver.get(address + page)
    driver.execute_async_script(
        "const done = arguments[0]; const ready = window.MathJax?.startup?.promise ?? Promise.resolve();"
        "ready.then(() => document.fonts.ready).then(() => setTimeout(done, 50));"
    )
    wrong = [entry["message"] for entry in driver.get_log("browser") if entry["level"] in ("WARNING", "SEVERE")]
    for message in (json.loads(entry["message"])["message"] for entry in driver.get_log("performance")):
        url = message.get("params", {}).get("request", {}).get("url", "")
        if message["method"] == "Network.requestWillBeSent" and not url.startswith((address, "data:", "blob:", "about:")):
            wrong.append(f"a request outside the site: {url}")
    return wrong


def test_a_click_on_the_figure_of_the_first_page_runs_a_live_page_there(browser, address):
    assert opened(browser, address, "index.html") == []
    browser.driver.find_element("css selector", ".live-frame a").click()
    browser.driver.switch_to.frame(browser.driver.find_element("css selector", ".live-frame iframe"))
    browser.until("document.getElementById('clock')?.textContent >= '0:01.0'")
    browser.driver.switch_to.default_content()
    assert browser.console() == []


@pytest.mark.parametrize("word, page", [("install", "Installation"), ("Kalman", "Estimators")])
def test_a_search_leads_to_the_page_that_a_reader_looks_for(browser, address, word, page):
    assert opened(browser, address, f"search.html?q={word}") == []
    browser.until("/found [1-9]|[1-9][0-9]* pages/i.test(document.querySelector('.search-summary')?.textContent ?? '')")
    assert page in browser.value("document.querySelector('ul.search li a').textContent")


LAZY = "document.querySelectorAll('img[loading=lazy]').forEach(i => i.loading = 'eager')"
PICTURES = "return [...document.images].filter(i => i.complete && !i.naturalWidth && i.loading != 'lazy').map(i => i.src)"
MATHS = "return ['.math', '.math mjx-container', 'mjx-merror, [data-mjx-error]'].map(s => document.querySelectorAll(s).length)"
SCROLL = "return document.scrollingElement.scrollWidth - window.innerWidth"
HIDDEN = r"""return [...document.querySelectorAll('.bd-article :is(table:not(.dataframe), div.math)')].filter(
  e => e.scrollWidth > e.clientWidth + 1).map(e => e.innerText.slice(0, 80))"""
CUT = r"""const limit = window.innerWidth, may_scroll = 'pre, table, .math, .text_html';
return [...document.querySelectorAll('main article *')].filter(
  e => e.getBoundingClientRect().right > limit + 1 && !e.closest(may_scroll)
).slice(0, 3).map(e => e.outerHTML.slice(0, 120))"""


def test_each_page_in_the_browser(browser, address, pages):
    typeset_on = {}
    for page in pages:
        assert opened(browser, address, page) == [], page
        browser.driver.execute_script(LAZY)
        assert browser.driver.execute_script(PICTURES) == [], page
        equations, typeset_on[page], faulty = browser.driver.execute_script(MATHS)
        assert typeset_on[page] >= equations and faulty == 0, page
        assert browser.driver.execute_script(SCROLL) <= 0, page
        browser.resize((1400, 900))
        assert browser.driver.execute_script(HIDDEN) == [], page
        browser.resize(PHONE)
        assert browser.driver.execute_script(SCROLL) <= 0 and browser.driver.execute_script(CUT) == [], page
    assert typeset_on["concepts/frames.html"] > 8

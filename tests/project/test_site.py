"""The built site, as files and in headless Chromium: `make docs` builds it and names its folder in INSENV_SITE.

Every page is opened once: no message on its console, no request outside the site, all pictures loaded, all equations typeset,
and no sideways scrolling on a phone. Search, and the light and dark themes, are tried on some.
"""

import functools
import http.server
import json
import os
import shutil
import threading
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import pytest

SITE = Path(os.environ.get("INSENV_SITE", "/nonexistent"))
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
PHONE, LAPTOP = (390, 844), (1280, 900)
LOOKED_AT = (
    "index.html",
    "tutorials/align-a-ship.html",
    "estimators/q-method.html",
    "generated/environments/ship-alignment.html",
)

pytestmark = pytest.mark.skipif(not SITE.is_dir(), reason="INSENV_SITE names no built site: run `make docs`")
browser_needed = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="no Chromium with its driver here: install chromium and chromium-driver (chromedriver)"
)
PAGES = sorted(path.relative_to(SITE).as_posix() for path in SITE.rglob("*.html") if "_static" not in path.parts)


class Page(HTMLParser):
    """Links, sources of pictures, and ids of a page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.ids = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.ids |= {given[name] for name in ("id", "name") if given.get(name)}
        wanted = {"a": "href", "img": "src", "link": "href", "script": "src", "source": "src"}.get(tag)
        if wanted and given.get(wanted) and given.get("rel") not in ("search", "prefetch"):
            self.links.append(given[wanted])


@functools.cache
def parsed(page):
    return Page((SITE / page).read_text(encoding="utf-8"))


def test_the_pages_are_there():
    groups = ("environments", "scenarios", "sensors", "grades", "api")
    assert all(any(page.startswith(f"generated/{group}/") for page in PAGES) for group in groups)
    assert {*LOOKED_AT, "search.html", "how-to.html", "reference.html", "concepts/architecture.html"} <= set(PAGES)


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_lead_somewhere(page):
    wrong = []
    for link in parsed(page).links:
        parts = urlsplit(urljoin(f"http://site/{page}", link))
        if parts.netloc != "site" or parts.scheme != "http":
            continue
        path = unquote(parts.path).lstrip("/") or page
        if not (SITE / path).is_file():
            wrong.append(f"{link}: no such file")
        elif parts.fragment and path.endswith(".html") and unquote(parts.fragment) not in parsed(path).ids:
            wrong.append(f"{link}: no such place on that page")
    assert not wrong


@pytest.fixture(scope="module")
def address():
    """Address of the site on a server of this process."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(SITE)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def browser():
    """Headless Chromium that can reach this machine alone."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu",
                     "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"):  # fmt: skip
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    driver.set_script_timeout(30)
    yield driver
    driver.quit()


def sized(browser, size):
    width, height = size
    given = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": size == PHONE}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", given)


def opened(browser, address, page):
    """Open a page, and return what went wrong: messages of the console, and requests that leave the site."""
    browser.get_log("browser"), browser.get_log("performance")
    browser.get(address + page)
    browser.execute_async_script(
        "const done = arguments[0]; const ready = window.MathJax?.startup?.promise ?? Promise.resolve();"
        "ready.then(() => document.fonts.ready).then(() => setTimeout(done, 50));"
    )
    wrong = [entry["message"] for entry in browser.get_log("browser") if entry["level"] in ("WARNING", "SEVERE")]
    for entry in browser.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        url = message.get("params", {}).get("request", {}).get("url", "")
        if message["method"] == "Network.requestWillBeSent" and not url.startswith((address, "data:", "blob:", "about:")):
            wrong.append(f"a request outside the site: {url}")
    return wrong


PICTURES = "return [...document.images].filter(i => i.complete && !i.naturalWidth && i.loading != 'lazy').map(i => i.src)"
LAZY = "document.querySelectorAll('img[loading=lazy]').forEach(i => i.loading = 'eager')"
MATHS = "return [document.querySelectorAll('.math').length, document.querySelectorAll('.math mjx-container').length,"
MATHS += " document.querySelectorAll('mjx-merror, [data-mjx-error]').length]"
SCROLL = "return document.scrollingElement.scrollWidth - window.innerWidth"
CUT = r"""const limit = window.innerWidth, may_scroll = 'pre, table, .math, .text_html';
return [...document.querySelectorAll('main article *')].filter(
  e => e.getBoundingClientRect().right > limit + 1 && !e.closest(may_scroll)
).slice(0, 3).map(e => e.outerHTML.slice(0, 120))"""


@browser_needed
@pytest.mark.parametrize("page", PAGES)
def test_a_page_in_the_browser(browser, address, page):
    sized(browser, LAPTOP)
    assert opened(browser, address, page) == []
    browser.execute_script(LAZY)
    assert browser.execute_script(PICTURES) == []
    equations, typeset, faulty = browser.execute_script(MATHS)
    assert typeset >= equations and faulty == 0
    assert browser.execute_script(SCROLL) <= 0
    sized(browser, PHONE)
    assert browser.execute_script(SCROLL) <= 0
    assert browser.execute_script(CUT) == []


@browser_needed
def test_equations_are_there_to_be_typeset(browser, address):
    sized(browser, LAPTOP)
    opened(browser, address, "concepts/frames.html")
    assert browser.execute_script(MATHS)[1] > 8


@browser_needed
@pytest.mark.parametrize(
    ("words", "wanted"),
    [("gyrocompass", "estimators/gyrocompass.html"), ("ShipAlignment", "generated/environments/ship-alignment.html"),
     ("lever arm", "scenarios.html"), ("InputError", "generated/api/InputError.html")],
)  # fmt: skip
def test_search_finds_a_page(browser, address, words, wanted):
    from selenium.webdriver.support.ui import WebDriverWait

    sized(browser, LAPTOP)
    wrong = opened(browser, address, f"search.html?q={words.replace(' ', '+')}")
    links = "return [...document.querySelectorAll('#search-results a')].map(a => a.href)"
    finished = "return /found|matching/.test(document.querySelector('#search-results .search-summary')?.innerText ?? '')"
    WebDriverWait(browser, 30).until(lambda b: b.execute_script(finished))
    found = browser.execute_script(links)
    assert any(link.startswith(address + wanted) for link in found), found[:10]
    assert wrong == []


COLOURS = """const shown = e => getComputedStyle(e); const body = document.querySelector('.bd-article p');
let e = body, back = 'rgba(0, 0, 0, 0)';
while (e && back == 'rgba(0, 0, 0, 0)') { back = shown(e).backgroundColor; e = e.parentElement; }
return [back, shown(body).color]"""


def luminance(colour):
    """Relative luminance of ``rgb(r, g, b)`` (WCAG 2)."""
    values = [float(part) / 255 for part in colour[colour.index("(") + 1 : -1].split(",")[:3]]
    linear = [value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in values]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@browser_needed
@pytest.mark.parametrize("page", LOOKED_AT)
@pytest.mark.parametrize("mode", ["light", "dark"])
def test_light_and_dark(browser, address, page, mode):
    sized(browser, LAPTOP)
    # The reader's system asks for the theme: a theme stored by this test could be overwritten by the page's own script.
    wished = [{"name": "prefers-color-scheme", "value": mode}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": wished})
    assert opened(browser, address, page) == []
    back, front = (luminance(colour) for colour in browser.execute_script(COLOURS))
    assert (back > 0.8) if mode == "light" else (back < 0.1)
    assert (max(back, front) + 0.05) / (min(back, front) + 0.05) > 7.0  # contrast, WCAG 2 level AAA
    folder = os.environ.get("INSENV_SCREENSHOTS")
    for name, size in (("phone", PHONE), ("laptop", LAPTOP)) if folder else ():
        sized(browser, size)
        Path(folder).mkdir(parents=True, exist_ok=True)
        browser.save_screenshot(f"{folder}/{page.replace('/', '-').removesuffix('.html')}-{mode}-{name}.png")

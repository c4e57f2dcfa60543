"""Headless Chromium for the tests of pages: opens a page from disk, reads its console, checks its accessibility."""

import json
import time
from contextlib import contextmanager
from pathlib import Path

from peers import program
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

AXE = Path(__file__).resolve().parents[1] / "web" / "axe" / "axe.min.js"
PHONE, LAPTOP = (390, 844), (1280, 900)


@contextmanager
def chromium(*switches, **logs):
    options = webdriver.ChromeOptions()
    options.binary_location = program("chromium", "chromium-browser", "google-chrome", how="Debian: chromium")
    service = Service(program("chromedriver", how="Debian: chromium-driver"))
    for switch in ("--headless=new", "--no-sandbox", "--hide-scrollbars", "--disable-dev-shm-usage", *switches):
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", **logs})
    driver = webdriver.Chrome(options=options, service=service)
    try:
        yield Browser(driver)
    finally:
        driver.quit()


class Browser:
    """A browser with short names for what the tests do."""

    def __init__(self, driver):
        self.driver = driver

    def open(self, path, size=LAPTOP, dark=False, fragment="", ratio=1):
        """Open a page from disk in a window of this size; ratio: pixels of the device per pixel of CSS."""
        theme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": theme})
        self.resize(size, ratio)
        self.driver.execute_cdp_cmd("Storage.clearDataForOrigin", {"origin": "file://", "storageTypes": "local_storage"})
        self.driver.get("about:blank")  # a changed fragment alone would not load the page again
        self.driver.get(Path(path).resolve().as_uri() + fragment)
        self.until("!document.getElementById('packed')")

    def resize(self, size, ratio=1):
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": ratio, "mobile": size == PHONE}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def value(self, expression, *given):
        """The value of a JavaScript expression, with `given` as `arguments`."""
        return self.driver.execute_script(f"return {expression}", *given)

    def until(self, expression, timeout_s=30.0):
        """Wait until an expression is true; return its value."""
        end = time.monotonic() + timeout_s
        while not (found := self.value(expression)):
            assert time.monotonic() < end, f"after {timeout_s} s not true: {expression}"
            time.sleep(0.05)
        return found

    def console(self):
        """Messages of the console since the last call, without those of the software renderer."""
        messages = [entry["message"] for entry in self.driver.get_log("browser")]
        return [text for text in messages if "GPU" not in text and "SwiftShader" not in text and "WebGL" not in text]

    def violations(self):
        """What axe-core has to say about accessibility: id, help and element of each violation."""
        self.driver.execute_script(AXE.read_text(encoding="utf-8"))
        found = self.driver.execute_async_script(
            "const done = arguments[arguments.length - 1]; axe.run().then((found) => done(JSON.stringify(found.violations)));"
        )
        return [(one["id"], one["help"], one["nodes"][0]["html"][:160]) for one in json.loads(found)]

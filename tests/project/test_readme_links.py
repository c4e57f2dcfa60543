"""Links of README.md: to files that exist, and absolute on the page of a package index."""

import re

from places import ROOT
from readme_links import ReadmeLinks, absolute

SOURCE = "https://example.org/someone/insenv"
TARGET = re.compile(r"\]\(([^)\s]+)\)")
README = (ROOT / "README.md").read_text("utf-8")


def test_what_the_readme_links_to_exists():
    local = [target.partition("#")[0] for target in TARGET.findall(README) if not target.startswith("http")]
    assert local and [target for target in local if not (ROOT / target).exists()] == []


def test_links_and_images_become_absolute_where_an_address_is_declared():
    text = "![a ship](docs/ship.png) [page](docs/a.md#part) [there](https://x.org) [here](#part)"
    raw, blob = f"{SOURCE}/raw/v1.0", f"{SOURCE}/blob/v1.0"
    expected = f"![a ship]({raw}/docs/ship.png) [page]({blob}/docs/a.md#part) [there](https://x.org) [here](#part)"
    assert absolute(text, SOURCE + "/", "v1.0") == expected
    metadata = {"version": "1.2.3", "urls": {"Source": SOURCE}}
    ReadmeLinks(str(ROOT), {}).update(metadata)
    shown = metadata["readme"]["text"]
    assert all(target.startswith(("https://", "http://", "#")) for target in TARGET.findall(shown))
    assert f"]({SOURCE}/raw/v1.2.3/docs/figures/ship-swaying.png)" in shown

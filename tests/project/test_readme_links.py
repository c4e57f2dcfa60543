"""Links of README.md: to files that exist, and absolute on the page of a package index."""

import re

import pytest
from places import ROOT

pytest.importorskip("hatchling")
from readme_links import ReadmeLinks, absolute

SOURCE = "https://example.org/someone/insenv"
TARGET = re.compile(r"\]\(([^)\s]+)\)")


def test_what_the_readme_links_to_exists():
    for target in TARGET.findall((ROOT / "README.md").read_text("utf-8")):
        if not target.startswith("http"):
            assert (ROOT / target.partition("#")[0]).exists(), target


def test_links_and_images_become_absolute():
    text = "![a ship](docs/ship.png) [page](docs/a.md#part) [there](https://x.org) [here](#part)"
    raw, blob = f"{SOURCE}/raw/v1.0", f"{SOURCE}/blob/v1.0"
    expected = f"![a ship]({raw}/docs/ship.png) [page]({blob}/docs/a.md#part) [there](https://x.org) [here](#part)"
    assert absolute(text, SOURCE + "/", "v1.0") == expected


def test_with_a_declared_address_no_link_of_the_page_is_relative():
    metadata = {"version": "1.2.3", "urls": {"Source": SOURCE}}
    ReadmeLinks(str(ROOT), {}).update(metadata)
    text = metadata["readme"]["text"]
    assert all(target.startswith(("https://", "http://", "#")) for target in TARGET.findall(text))
    assert f"]({SOURCE}/raw/v1.2.3/docs/figures/ship-swaying.png)" in text


def test_without_an_address_the_text_is_the_readme():
    metadata = {"version": "1.2.3"}
    ReadmeLinks(str(ROOT), {}).update(metadata)
    assert metadata["readme"]["text"] == (ROOT / "README.md").read_text("utf-8")

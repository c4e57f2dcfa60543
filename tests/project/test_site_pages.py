"""The generated pages of the site can be made, and say what the tables say; `make docs` builds them."""

import re

import pytest
import site_gallery
import site_pages
import site_sources
import site_tables
import thumbnails
from places import ROOT

import insenv
from insenv import estimators
from insenv.base.shipped import SPECS
from insenv.scenario import summaries
from insenv.sensors import GNSS_GRADES, IMU_GRADES


@pytest.fixture(scope="module")
def pages():
    return site_pages.all_pages()


@pytest.mark.slow
def test_everything_has_a_page(pages):
    wanted = {f"environments/{site_pages.slug(id)}.md" for id in SPECS}
    wanted |= {f"scenarios/{entry['name']}.md" for entry in summaries()}
    wanted |= {f"grades/{name}.md" for name in IMU_GRADES} | {f"grades/gnss-{name}.md" for name in GNSS_GRADES}
    wanted |= {f"api/{name}.rst" for name in insenv.__all__} | {"sensors/imu.md", "sensors/gnss.md", "conventions.rst"}
    assert wanted <= set(pages)
    biases = pages["grades/marine.md"]  # 0.001 deg/h, 10 ug: heading 0.001 / (15.041 cos 45 deg) rad, tilt 1e-5 rad
    assert "| 0.00057 deg | 0.0054 deg |" in biases
    assert "none: its bias hides the rotation of the Earth" in pages["grades/consumer.md"]


@pytest.mark.parametrize("id", estimators.registered())
def test_the_page_of_an_estimator_ends_with_its_tables(pages, id):
    name = f"estimators/{site_tables.estimator_pages()[id].removesuffix('.md')}"
    written = (ROOT / "docs" / f"{name}.md").read_text("utf-8")
    shown = site_sources.extended(name, written)
    assert (f"](../generated/{name}.md)" in shown) == (f"{name}.md" in pages)  # they have a page of their own
    tables = pages.get(f"{name}.md", shown).partition(f"## Interface of `{id}`\n")[2]
    for table in ("inputs", "outputs", *(() if "<!-- begin parameters" in written else ("parameters",))):
        part = re.split(r"\n#+ ", tables.partition(f"### {table.title()} of `{id}`\n")[2])[0]
        assert re.findall(r"^\| `(\w+)` \|", part, re.MULTILINE) == list(getattr(estimators.get(id).model, table).names)


def test_each_scenario_and_estimator_has_its_picture(pages):
    shown = {path: text for path, text in pages.items() if path.startswith("scenarios/")}
    for path in (ROOT / "docs" / "estimators").glob("*.md"):
        name = f"estimators/{path.stem}"
        shown[name] = site_sources.extended(name, path.read_text("utf-8"))
    pictures = {name: re.findall(r"\(\S+/figures/thumbnails/([\w-]+\.svg)\)", text) for name, text in shown.items()}
    assert all(pictures.values()) and len(pictures["estimators/index"]) == len(pictures) - len(summaries()) - 2
    written = {path.name for path in thumbnails.FOLDER.iterdir()}
    assert written == {name for names in pictures.values() for name in names}


def test_a_key_of_a_parameter_is_one_that_is_taken(monkeypatch):
    tables = site_tables.estimator_tables("# `loosely-coupled`\n")
    assert "`arw_deg_sqrt_h`" in tables and "`innovation_gate`" in tables
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    insenv.run("car-city-drive", duration_s=1.0, settings={"loosely-coupled": {"arw_deg_sqrt_h": 0.2, "innovation_gate": 4}})


def test_each_live_page_of_the_gallery_can_run_and_has_a_link():
    text = site_gallery.GALLERY.read_text(encoding="utf-8")
    wanted = site_gallery.commands(text)
    assert {"better-gyro.html", "tunnel.html"} <= set(wanted) and text.count("$ insenv page") == len(wanted) >= 7
    for scenario, ids in wanted.values():
        assert insenv.load(scenario).name == scenario
        assert all(estimators.get(id).kind for id in ids) and ids
    shown = site_gallery.with_links(text)
    assert site_sources.extended("a", "[b.md](b.md#d), [e](e.md)") == "[](b.md#d), [e](e.md)"
    assert all(f'href="live/{name}"' in shown for name in wanted) and "not run" not in shown
    first = site_sources.extended("index", (ROOT / "docs" / "index.md").read_text("utf-8"))
    assert site_gallery.FIRST in wanted and f'href="live/{site_gallery.FIRST}#run"' in first

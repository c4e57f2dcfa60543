"""Live pages, made once for all tests, and the JavaScript of pages in Node."""

import base64
import functools
import gzip
import json
import re
from pathlib import Path

from peers import program, ran
from places import ROOT, scratch

from insenv.base.resources import web_folder
from insenv.report.page import assembled, joined
from insenv.web.live import Live, live, live_document

SHIP = ("ship-swaying", ("q-method",), 60.0)
CAR = ("car-city-drive", ("loosely-coupled", "wander-sins"), 60.0)
ELEMENTS = ROOT / "tests" / "web" / "elements.cjs"


@functools.cache
def live_page(scenario: str, estimators: tuple[str, ...], duration_s: float) -> Live:
    return live(scenario, estimators, duration_s=duration_s)


@functools.cache
def page_file(scenario: str, estimators: tuple[str, ...], duration_s: float) -> Path:
    path, made = scratch() / f"{scenario}.html", live_page(scenario, estimators, duration_s)
    path.write_text(assembled(made.plant.scenario.title, {"live": live_document(made)}), encoding="utf-8", newline="\n")
    return path


def unpacked(page: str) -> dict[str, str]:
    """The documents and scripts that a page holds deflated, by id."""
    packed = base64.b64decode(re.search(r'id="packed">([^<]*)<', page).group(1))
    return {part["id"]: part["text"] for part in json.loads(gzip.decompress(packed))}


def in_node(text: str, given: object, folder: Path) -> str:
    """What JavaScript text prints in Node; it reads `given` from the file given.json."""
    (folder / "given.json").write_text(json.dumps(given))
    (folder / "go.cjs").write_text(text)
    return ran(program("node", how="Debian: nodejs"), "go.cjs", cwd=folder)


def answers(entry: str, code: str, given: object, folder: Path) -> object:
    """What JavaScript `code`, or its promise, makes of `given` with the exports of a module of web/."""
    read = 'const given = JSON.parse(require("fs").readFileSync("given.json"));'
    text = (
        f"{read}\n{joined(web_folder(), entry)}\nPromise.resolve({code}).then((found) => console.log(JSON.stringify(found)));\n"
    )
    return json.loads(in_node(text, given, folder))


def panel_answers(entry: str, code: str, given: object, folder: Path) -> object:
    """The same of a function's `code` that makes elements, of tests/web/elements.cjs."""
    return answers(entry, f"(() => {{\n{ELEMENTS.read_text('utf-8')}\n{code}\n}})()", given, folder)

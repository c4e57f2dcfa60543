"""The live pages of the documentation site: each command `insenv page` of docs/gallery.md writes one, at each build.

They are kept until the code changes, because each is compiled.  One stands on the first page: a click on its figure starts it.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from pages import ROOT

GALLERY = ROOT / "docs" / "gallery.md"
COMMAND = re.compile(r"^```console\n\$ (insenv page .*)\n```$", re.MULTILINE)
FOLDER = "live"
"""Folder of the pages in the site."""
FIRST = "ship-swaying.html"
"""The page that the first page of the site shows."""
FIGURE = re.compile(r"^!\[.*\]\(.*\)$", re.MULTILINE)


def commands(text: str) -> dict[str, tuple[str, list[str]]]:
    """By file name, the scenario and estimators of each command of the gallery."""
    found = {}
    for command in COMMAND.findall(text):
        words = shlex.split(command)[2:]
        scenario, options = words[0], list(zip(words[1::2], words[2::2], strict=True))
        (name,) = (value for option, value in options if option == "-o")
        found[name] = (scenario, [value for option, value in options if option == "-e"])
    return found


def with_links(text: str) -> str:
    """The gallery with a link to its page above each command."""

    def link(match: re.Match[str]) -> str:
        (name,) = commands(match.group())
        opened = f'<p><a class="live-page" href="{FOLDER}/{name}">Open the live page</a></p>'
        return f"```{{raw}} html\n{opened}\n```\n\n{match.group()}"

    return COMMAND.sub(link, re.sub(r"<!-- not run: .*? -->\n(?=```console\n\$ insenv page )", "", text))


def with_frame(text: str) -> str:
    """The first page with a link on its figure, which docs/_static/live-frame.js opens in a frame in the figure's place."""
    link = f'<a class="live-page" href="{FOLDER}/{FIRST}#run">Run it here</a>'
    return FIGURE.sub(lambda match: f":::{{div}} live-frame\n{match[0]}\n\n```{{raw}} html\n{link}\n```\n:::", text, count=1)


def write_pages(folder: Path, code: str) -> None:
    """Write the live pages below `folder`; `code`: digest of what decides them."""
    from insenv.web.live import page

    wanted = commands(GALLERY.read_text(encoding="utf-8"))
    target = folder / FOLDER
    target.mkdir(parents=True, exist_ok=True)
    for name, (scenario, estimators) in wanted.items():
        path, stamp = target / name, folder.parent / "gallery-stamps" / name
        drawn = f"{code} {scenario} {' '.join(estimators)}"
        if path.is_file() and stamp.is_file() and stamp.read_text(encoding="utf-8") == drawn:
            continue
        page(scenario, path, estimators)
        stamp.parent.mkdir(parents=True, exist_ok=True)
        stamp.write_text(drawn, encoding="utf-8")
    for path in target.glob("*.html"):
        if path.name not in wanted:
            path.unlink()

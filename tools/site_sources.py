"""What the site changes in a page of docs/ before it is read: the repository shows the same files without it.

The page of an estimator gets its picture and its tables (or a link to them), the public names of docs/api.md become links,
links whose text is the name of a file get the title of its page, and links to an anchor ``<a id="health"></a>`` become links
to the heading below it, as Sphinx knows headings alone. A page that no table of contents names stands below the reference.
The figure of the first page becomes a live page with one click.
"""

from __future__ import annotations

import posixpath
import re
from functools import lru_cache

import site_gallery
import site_tables
import thumbnails
from pages import ROOT, markdown

import insenv

DOCS = ROOT / "docs"
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ANCHOR = re.compile(r'^<a id="(?P<id>[\w-]+)"></a>\n+#+ (?P<heading>.*)$', re.MULTILINE)
NAMED = re.compile(r"\[[\w./-]+\.md\]\((?=[\w./-]+\.md[)#])")
"""A link whose text is the name of a file: the site shows the title of what it leads to."""
INTERFACE = """## Interface

[](../generated/estimators/{page}.md) lists every input and output.

```{{toctree}}
:hidden:

../generated/estimators/{page}
```
"""
LINK = re.compile(r"\]\((?P<page>[\w./-]*)#(?P<id>[\w-]+)\)")


def extended(name: str, text: str) -> str:
    """The source of page `name` (its path in docs/ without suffix) as the site reads it."""
    if name.startswith("estimators/") and site_tables.estimators_on(text):
        page = posixpath.basename(name)
        tables = INTERFACE.format(page=page) if page in site_tables.OWN_PAGE else site_tables.estimator_tables(text)
        title, _, rest = text.rstrip().partition("\n\n")
        text = f"{title}\n\n{thumbnails.shown(thumbnails.ESTIMATOR + page, '..')}\n\n{rest}\n\n{tables}"
    if name == "estimators/index":
        names = ((one.removeprefix(thumbnails.ESTIMATOR), thumbnails.shown(one, "..")) for one in thumbnails.of_estimators())
        rows = [(f"[]({page}.md)", picture) for page, picture in names]
        text += f"\n## At a glance\n\nEach on the example of its page.\n\n{markdown(('', ''), rows)}\n"
    if name == "index":
        text = site_gallery.with_frame(text)
    if name == "gallery":
        text = site_gallery.with_links(text)
    if name == "api":
        for public in insenv.__all__:
            text = text.replace(f"| `insenv.{public}` |", f"| [`insenv.{public}`](generated/api/{public}.rst) |")
        text += "\n```{toctree}\n:hidden:\n:glob:\n\ngenerated/api/*\n```\n"
    if name == "reference" and (others := unlisted()):
        text += "\n```{toctree}\n:hidden:\n\n" + "\n".join(others) + "\n```\n"
    text = NAMED.sub("[](", text)
    return LINK.sub(lambda match: f"]({match['page']}#{_heading(name, match['page'], match['id'])})", text)


def unlisted() -> list[str]:
    """The pages directly in docs/ that no table of contents names: the site has them below the reference."""
    listed = {"index"}
    for path in (path for path in DOCS.rglob("*.md") if "generated" not in path.parts):
        for block in TOCTREE.findall(path.read_text(encoding="utf-8")):
            folder = path.parent.relative_to(DOCS).as_posix()
            listed |= {posixpath.normpath(posixpath.join(folder, line.strip())) for line in block.splitlines()}
    return sorted(path.stem for path in DOCS.glob("*.md") if path.stem not in listed)


def _heading(name: str, page: str, id: str) -> str:
    """The anchor of the heading that a link of page `name` means: that below the anchor `id`, or `id` itself."""
    target = posixpath.normpath(posixpath.join(posixpath.dirname(name), page)) if page else f"{name}.md"
    return _anchors(target).get(id, id)


@lru_cache
def _anchors(path: str) -> dict[str, str]:
    file = DOCS / path
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    return {match["id"]: _slug(match["heading"]) for match in ANCHOR.finditer(text)}


def _slug(heading: str) -> str:
    """The anchor of a heading, as MyST and the usual hosts of repositories make it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")

"""Configuration of the documentation site, which `make docs` builds into build/docs/html.

The pages are the Markdown files of this folder, as they are read in the repository. The generated ones come from
tools/site_pages.py; tutorials are executed side by side, and kept in a cache under a digest of the code that they run.
"""

from __future__ import annotations

import hashlib
import inspect
import logging
import os
import re
import sys
from pathlib import Path
from typing import Any

from jupyter_cache import get_cache
from jupyter_cache.executors import load_executor

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

import site_docstrings  # noqa: E402
import site_gallery  # noqa: E402
import site_pages  # noqa: E402
import site_sources  # noqa: E402

import insenv  # noqa: E402


def digest(*folders: str) -> str:
    """Digest of the names and contents of all files in some folders of the repository."""
    found = hashlib.sha256()
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            found.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return found.hexdigest()[:16]


CODE = digest("insenv", "scenarios", "fmu", "web", "examples", "recordings")
"""What decides what a tutorial prints, apart from its own text."""
MAKER = digest("tools") + hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
BUILD = ROOT / "build" / "docs"


def settings_of_kernels() -> Path:
    """A folder of IPython settings for the tutorials, in place of the user's: kernels report errors alone."""
    profile = BUILD / "ipython" / "profile_default"
    profile.mkdir(parents=True, exist_ok=True)
    (profile / "ipython_kernel_config.py").write_text("get_config().Application.log_level = 40\n", encoding="utf-8")
    return profile.parent


GALLERY = BUILD / "gallery"
GALLERY.mkdir(parents=True, exist_ok=True)
os.environ["IPYTHONDIR"] = str(settings_of_kernels())

project = "insenv"
author = "The insenv authors"
copyright = "the insenv authors"
version = release = insenv.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # MathJax in the site itself: no request leaves it
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_static"]
nitpicky = True

# --- Markdown and notebooks
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_cache_path = str(BUILD / "notebooks" / CODE)
nb_execution_in_temp = True
nb_execution_timeout = 240
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True

# --- the reference
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88

# --- HTML
html_theme = "pydata_sphinx_theme"
html_title = "insenv"
html_static_path = ["_static"]
html_extra_path = [str(GALLERY)]
html_favicon = "_static/favicon.svg"
html_css_files = ["site.css"]
html_js_files = ["live-frame.js"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"image_light": "_static/favicon.svg", "image_dark": "_static/favicon.svg", "text": "insenv", "alt_text": "insenv"},
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": {"**": ["page-toc"], "index": []},
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
}
html_context = {"default_mode": "auto"}
html_sidebars = {"index": []}
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True


def write_pages(app: Any) -> None:
    """Write the generated pages, and remove those that are no longer made. A page that stays the same is not touched."""
    folder = Path(app.srcdir) / "generated"
    pages = site_pages.all_pages()
    for path, text in pages.items():
        file = folder / path
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
    for file in folder.rglob("*.*"):
        if file.relative_to(folder).as_posix() not in pages:
            file.unlink()


def write_gallery(app: Any) -> None:
    """Write the live pages, which the site has in live/."""
    site_gallery.write_pages(GALLERY, CODE)


def run_tutorials(app: Any) -> None:
    """Run side by side the tutorials, and other pages with programs, whose outputs are not kept for this state of the code.

    Their pages then take the outputs from the cache.  One that fails is run again when its page is read, which says where.
    """
    cache = get_cache(nb_execution_cache_path)
    for path in sorted(Path(app.srcdir).rglob("*.md")):
        if "{code-cell}" in path.read_text(encoding="utf-8"):
            cache.add_nb_to_project(str(path), read_data={"name": "myst_nb_md", "type": "plugin"})
    logger = logging.getLogger("tutorials")
    logger.setLevel(logging.WARNING)
    load_executor("temp-parallel", cache, logger).run_and_cache(timeout=nb_execution_timeout)


def extend_page(app: Any, name: str, text: list[str]) -> None:
    """Turn a page of the repository into one of the site."""
    text[0] = site_sources.extended(name, text[0])


def breakable(app: Any, name: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Let names in tables break after underscores and the like: a browser breaks them after hyphens alone."""

    def cell(match: re.Match[str]) -> str:
        return re.sub(r'(?<=<span class="pre">)[^<]+', lambda found: re.sub(r"([_.,=/])(?=\w)", r"\1<wbr>", found[0]), match[0])

    context["body"] = re.sub(r"<t[dh]\b.*?</t[dh]>", cell, context.get("body", ""), flags=re.DOTALL)


def as_rst(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Turn a docstring into reStructuredText."""
    lines[:] = site_docstrings.as_rst(lines, site_docstrings.parameter_names(thing))


def shorter(app: Any, what: str, name: str, thing: Any, options: Any, signature: str | None, result: str | None) -> Any:
    """Show a default that is an object as ..., an array by its name, keys of a file not at all: they hide the names."""
    if hasattr(thing, "model_fields"):
        return "(**keys)", result
    text = re.sub(r"<factory>|(?<== )\w+\([^()]*\)", "...", signature or "")
    text = re.sub(r"~?numpy\.ndarray\[tuple\[[^]]*\], ~?numpy\.dtype\[[^]]*\]\]", "~numpy.ndarray", text)
    return (text, result) if text else None


def keep_member(app: Any, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what pydantic adds to a class of ours."""
    module = getattr(inspect.unwrap(thing) if callable(thing) else getattr(thing, "fget", None), "__module__", "insenv")
    return True if not str(module).startswith("insenv") or name.startswith("model_") else None


def resolve(app: Any, env: Any, node: Any, text: Any) -> Any:
    """Link the type of a signature to its public name; a type that is not public is shown without a link."""
    target = node.get("reftarget", "")
    if node.get("refdomain") != "py" or node.get("reftype") == "obj":
        return None
    public = target.rpartition(".")[2]
    if public in site_docstrings.LINKED and public != target.rpartition("insenv.")[2]:
        domain = env.get_domain("py")
        return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", f"insenv.{public}", node, text)
    return text


def setup(app: Any) -> dict[str, bool]:
    """Connect the functions above."""
    app.add_config_value("insenv_code", CODE + MAKER, "env")  # another one: all pages are read again
    app.connect("builder-inited", write_pages)
    app.connect("builder-inited", write_gallery)
    app.connect("builder-inited", run_tutorials)
    app.connect("source-read", extend_page)
    app.connect("html-page-context", breakable)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-process-signature", shorter)
    app.connect("autodoc-skip-member", keep_member)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": False}

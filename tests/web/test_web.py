"""The front end: vendored files as they were published, modules joined in order, a policy that forbids requests."""

import base64
import hashlib
import re

import pytest
from live_pages import in_node, unpacked
from peers import program, ran
from places import ROOT

from insenv.base.errors import InsenvError
from insenv.report.page import assembled, joined

VENDORED = {
    "web/vendor/uPlot/uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "web/vendor/uPlot/uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
    "web/vendor/uPlot/LICENSE": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
    "tests/web/axe/axe.min.js": "29348999450cdf2849a8e70b7912fc2da85a849da39c0d0d5394f51d4a9ed95c",
    "tests/web/axe/LICENSE": "af175b9d96ee93c21a036152e1b905b0b95304d4ae8c2c921c7609100ba8df7e",
}


def test_vendored_files_are_as_published():
    assert {path: hashlib.sha256((ROOT / path).read_bytes()).hexdigest() for path in VENDORED} == VENDORED


def test_a_page_makes_no_request_and_runs_its_own_script_alone():
    page = assembled("a & b", {"report": {"text": "</script><b>"}})
    parts = unpacked(page)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    assert policy.startswith("default-src 'none'; script-src 'sha256-") and "unsafe" not in policy
    assert "<title>a &amp; b</title>" in page and "</script><b>" not in page and "</script><b>" in parts["report"]
    (loader,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    allowed = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (loader, parts["script"])]
    assert f"script-src 'sha256-{allowed[0]}' 'sha256-{allowed[1]}';" in policy
    # nothing in the page names something to load; the namespace of SVG and licences are no requests
    loaded = r"""(?:src|href)\s*=\s*["'](?!data:|#)[^"']+|@import|url\((?!["']?data:)"""
    assert not re.findall(loaded, page + parts["script"])


def test_modules_are_joined_after_those_that_they_import(tmp_path):
    main = tmp_path / "main.js"
    main.write_text('import { two } from "./b.js";\nimport { one } from "./a.js";\nprint(one() + two);\n')
    (tmp_path / "a.js").write_text("/** Said. */\nconst hidden = 1;\nexport function one() {\n  return hidden;\n}\n")
    (tmp_path / "b.js").write_text('import { one } from "./a.js";\nconst hidden = 2;\nexport const two = one() + hidden;\n')
    text = joined(tmp_path, "main.js")
    assert "import" not in text and "export" not in text and "Said" not in text
    assert in_node(f"const print = console.log;\n{text}", None, tmp_path) == "4\n"
    main.write_text('import { m } from "./main.js";\n')
    with pytest.raises(InsenvError, match="imports itself"):
        joined(tmp_path, "main.js")


@pytest.mark.slow
def test_types():
    ran(program("tsc", how="npm install -g typescript"), "-p", ROOT / "web")

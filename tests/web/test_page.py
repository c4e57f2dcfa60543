"""The command `insenv page` and `insenv.page`."""

import re
import sys
import webbrowser
from pathlib import Path

import pytest
from command_line import call, refused, strict

import insenv

SHORT = ("ship-swaying", "-e", "q-method", "--duration", "10")


def test_writes_one_file_without_requests(tmp_path):
    path = tmp_path / "ship.html"
    code, out, err = call("page", *SHORT, "-o", path, "--json")
    assert code == 0, err
    assert strict(out) == {"written": str(path), "bytes": path.stat().st_size, "opened": False}
    text = path.read_text("utf-8")
    assert "connect-src" not in text and "default-src 'none'" in text and len(text) < 2_000_000
    assert not re.search(r"""(?:src|href)\s*=\s*["']https?:""", text)


def test_opens_without_a_file(monkeypatch):
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    monkeypatch.setattr("insenv.web.live.Live.controls", ())  # which take the time
    code, out, err = call("page", *SHORT)
    assert code == 0 and "opened in the browser" in out, err
    path = Path(opened[0].removeprefix("file://"))
    assert path.name == "ship-swaying.html" and path.stat().st_size > 100_000
    path.unlink()
    path.parent.rmdir()


def test_the_page_of_a_run_simulates_too(tmp_path):
    code, _, err = call("run", *SHORT, "--out", tmp_path, "--live")
    assert code == 0, err
    text = (tmp_path / "ship-swaying.html").read_text("utf-8")
    assert all(f'<script type="application/json" id="{kind}">' in text for kind in ("report", "live"))
    assert "wasm-unsafe-eval" in text and len(text) < 2_000_000
    smoothed = call("run", "ship-underway", "-e", "smoother", "--duration", "5", "--out", tmp_path / "smoothed", "--live")
    refused(smoothed, "'smoother' smooths a whole run", "here use 'loosely-coupled'")
    refused(call("run", *SHORT, "--live"), "--live is about the page that --out DIR writes")


def test_what_has_no_page(tmp_path, monkeypatch):
    path = tmp_path / "page.html"
    refused(call("page", "car-city-drive", "-e", "smoother", "-o", path), "smooths a whole run from its end")
    refused(call("page", "ship-swaying", "-e", "smoother", "-o", path), "estimator 'smoother' needs GNSS")
    refused(call("page", *SHORT, "-o", tmp_path / "page.txt"), "page.txt': allowed is a name that ends in .html")
    with pytest.raises(insenv.InputError, match="no scenario 'ship-swayin'; did you mean"):
        insenv.page("ship-swayin", path)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    refused(call("page", *SHORT, "-o", path), "a page needs ziglang, which is not installed", "pip install")
    assert not path.exists()

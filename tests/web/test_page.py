"""The command `insenv page` and `insenv.page`."""

from __future__ import annotations

import re
import sys
import webbrowser
from pathlib import Path

import pytest
from command_line import call, refused, strict

import insenv

SHORT = ("ship-swaying", "-e", "q-method", "--duration", "10")


def test_writes_one_file_without_requests(tmp_path: Path) -> None:
    path = tmp_path / "ship.html"
    code, out, err = call("page", *SHORT, "-o", path)
    assert code == 0, err
    text = path.read_text("utf-8")
    assert out.startswith(f"{path}: {path.stat().st_size / 1000:.0f} kB") and len(text) < 2_000_000
    assert "connect-src" not in text and "default-src 'none'" in text
    assert not re.search(r"""(?:src|href)\s*=\s*["']https?:""", text)
    code, out, err = call("page", *SHORT, "-o", path, "--json")
    assert strict(out) == {"written": str(path), "bytes": path.stat().st_size, "opened": False}


@pytest.mark.slow
def test_opens_without_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    code, out, err = call("page", *SHORT)
    assert code == 0 and "opened in the browser" in out, err
    path = Path(opened[0].removeprefix("file://"))
    assert path.name == "ship-swaying.html" and path.stat().st_size > 100_000
    path.unlink()
    path.parent.rmdir()


def test_the_page_of_a_run_simulates_too(tmp_path: Path) -> None:
    code, _, err = call("run", *SHORT, "--out", tmp_path, "--live")
    assert code == 0, err
    text = (tmp_path / "ship-swaying.html").read_text("utf-8")
    assert all(f'<script type="application/json" id="{kind}">' in text for kind in ("report", "live"))
    assert "wasm-unsafe-eval" in text and len(text) < 2_000_000
    smoothed = call("run", "ship-underway", "-e", "smoother", "--duration", "5", "--out", tmp_path / "smoothed", "--live")
    refused(smoothed, "'smoother' smooths a whole run", "allowed in `insenv run` without --live", "here use 'loosely-coupled'")
    refused(call("run", *SHORT, "--live"), "--live is about the page that --out DIR writes")


def test_without_the_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "ziglang", None)
    answer = call("page", *SHORT, "-o", tmp_path / "ship.html")
    refused(answer, "a page needs ziglang, which is not installed", "pip install")
    assert not (tmp_path / "ship.html").exists()


def test_what_has_no_page(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    refused(call("page", "car-city-drive", "-e", "smoother", "-o", path), "smooths a whole run from its end")
    refused(call("page", "ship-swaying", "-e", "loosely-coupled", "-o", path), "needs GNSS")
    refused(call("page", "ship-swaying", "-e", "smoother", "-o", path), "estimator 'smoother' needs GNSS")
    refused(call("page", *SHORT, "-o", tmp_path / "page.txt"), "page.txt': allowed is a name that ends in .html")
    (tmp_path / "folder.html").mkdir()
    refused(call("page", *SHORT, "-o", tmp_path / "folder.html"), "it is a folder")
    with pytest.raises(insenv.InputError, match="no scenario 'ship-swayin'; did you mean"):
        insenv.page("ship-swayin", path)
    assert not path.exists()

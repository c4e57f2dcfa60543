"""The command `insenv page` and `insenv.page`."""

import re

import pytest
from command_line import call, strict
from live_pages import unpacked

SHORT = ("ship-swaying", "-e", "q-method", "--duration", "10")


def test_writes_one_file_without_requests(tmp_path):
    path = tmp_path / "ship.html"
    code, out, err = call("page", *SHORT, "-o", path, "--json")
    assert code == 0, err
    assert strict(out) == {"written": str(path), "bytes": path.stat().st_size, "opened": False}
    text = path.read_text("utf-8")
    assert "connect-src" not in text and "default-src 'none'" in text
    assert not re.search(r"""(?:src|href)\s*=\s*["']https?:""", text)


@pytest.mark.slow
def test_the_page_of_a_run_simulates_too(tmp_path, monkeypatch):
    monkeypatch.setattr("insenv.web.live.wasm", lambda source: b"")
    code, _, err = call("run", *SHORT, "--out", tmp_path, "--live")
    assert code == 0, err
    text = (tmp_path / "ship-swaying.html").read_text("utf-8")
    assert {"report", "live"} <= set(unpacked(text))
    assert "wasm-unsafe-eval" in text

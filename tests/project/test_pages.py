"""The generated parts of the pages, and the schema of scenarios, are those of the current code."""

import pages
import pytest

CURRENT = pages.current()


@pytest.mark.parametrize("path", CURRENT)
def test_generated_files_are_current(path: str) -> None:
    assert (pages.ROOT / path).read_text(encoding="utf-8") == CURRENT[path], "run: python tools/pages.py"

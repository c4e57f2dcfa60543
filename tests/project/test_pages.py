"""The generated parts of the pages, the schema of scenarios and the pictures are those of the current code."""

import pages


def test_generated_files_are_current():
    stale = [path for path, text in pages.current().items() if (pages.ROOT / path).read_text(encoding="utf-8") != text]
    assert stale == [], "run: python tools/pages.py"

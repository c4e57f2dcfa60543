"""README.md as the page of a package index shows it: links and images with the address of the repository.

A package index does not hold the files that README.md names.  While pyproject.toml declares no ``[project.urls] Source``,
the text stays as it is.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(?P<image>!?)\[(?P<text>[^\]]*)\]\((?!https?://|mailto:|#)(?P<path>[^)\s]+)\)")


def absolute(text: str, source: str, tag: str) -> str:
    """The text with every link to a file of the repository at `source` made absolute, at the tag."""

    def of(match: re.Match[str]) -> str:
        kind = "raw" if match["image"] else "blob"
        return f"{match['image']}[{match['text']}]({source.rstrip('/')}/{kind}/{tag}/{match['path']})"

    return _LINK.sub(of, text)


class ReadmeLinks(MetadataHookInterface):
    """Sets the field `readme` when the sdist or the wheel is built."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set it from README.md, the version and the declared address."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        source = metadata.get("urls", {}).get("Source")
        if source:
            text = absolute(text, source, f"v{metadata['version']}")
        metadata["readme"] = {"content-type": "text/markdown", "text": text}

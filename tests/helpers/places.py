"""Where the repository is, and where tests may write."""

import functools
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@functools.cache
def scratch() -> Path:
    """A folder for this process, removed at its end."""
    scratch.kept = tempfile.TemporaryDirectory(prefix="insenv-tests-")
    return Path(scratch.kept.name).resolve()

"""The cache folder of compiled models, and the folder of this process that serves where it cannot be used."""

from __future__ import annotations

import atexit
import functools
import hashlib
import os
import shutil
import stat
import tempfile
import warnings
from collections.abc import Iterable
from pathlib import Path

_PREFIX = "insenv-"


def cache_folder() -> Path:
    """The cache folder: INSENV_CACHE_DIR or the user's cache folder, private to the user.

    If it cannot be made, written or trusted, a warning names the reason, and a temporary folder of this process is used.
    """
    folder, reason = _chosen()
    return process_folder(folder, reason) if reason else folder


def usable_folder() -> Path | None:
    """The cache folder if it can be used; None, without a warning, if not."""
    folder, reason = _chosen()
    return None if reason else folder


def _chosen() -> tuple[Path, str]:
    """The cache folder, made if it is missing, and why it cannot be used ("" if it can)."""
    chosen = os.environ.get("INSENV_CACHE_DIR")
    if chosen:
        folder = Path(chosen)
    else:
        from platformdirs import user_cache_path

        folder = user_cache_path("insenv")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not is_private(folder):
            return folder, "it is a link, or other users can write to it"
        if not os.access(folder, os.W_OK | os.X_OK):
            return folder, "it is not writable"
    except OSError as error:
        return folder, error.strerror or str(error)
    return folder, ""


def is_private(path: Path) -> bool:
    """Whether the path is owned and writable by this user only (always true where files have no owners)."""
    if not hasattr(os, "getuid"):
        return True
    status = path.lstat()
    return (
        status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not stat.S_ISLNK(status.st_mode)
    )


def source_digest(paths: Iterable[Path]) -> str:
    """Hash of Python sources, the key in the cache of what they produce."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(paths) if path.exists())).hexdigest()


@functools.cache
def process_folder(instead_of: Path, reason: str) -> Path:
    """A private folder of this process in place of a cache folder, removed at its end; the warning names both and the reason.

    Raises OSError.
    """
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    warnings.warn(
        f"cache folder {instead_of}: {reason}: models are compiled for this process alone, in {folder}; INSENV_CACHE_DIR "
        "chooses another",
        RuntimeWarning,
        stacklevel=2,
    )
    return folder


def is_lasting(folder: Path) -> bool:
    """Whether a folder of `cache_folder` or `process_folder` outlives this process."""
    return folder.parent != Path(tempfile.gettempdir()) or not folder.name.startswith(_PREFIX)

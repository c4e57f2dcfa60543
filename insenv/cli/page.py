"""The command `insenv page`: a scenario and its estimators as one HTML file that simulates in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.cli.options import Duration, Estimators, Json, Scenario, Seed, Settings, deferred, given_path


@deferred
def page(
    scenario: Scenario,
    estimators: Estimators = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--output", "-o", parser=given_path, metavar="X.html", help="File to write; without it the page opens."),
    ] = None,
    seed: Seed = None,
    duration: Duration = None,
    settings: Settings = None,
    as_json: Json = False,
) -> None:
    """Write a scenario and estimators as one HTML file that simulates in a browser; without -o, open it."""
    from insenv.cli.output import print_json, print_line, working
    from insenv.estimators.settings import parsed_settings
    from insenv.scenario import load
    from insenv.web.live import page as write

    given, loaded = parsed_settings(settings or []), load(scenario)
    path = output or _kept(loaded.name)
    with working(f"page of {loaded.name}") as progress:
        write(loaded, path, estimators or None, seed=seed, duration_s=duration, settings=given, progress=progress)
    opened = output is None and _open(path)
    size = path.stat().st_size
    if as_json:
        print_json({"written": str(path), "bytes": size, "opened": opened})
        return
    print_line(f"{path}: {size / 1000:.0f} kB{'; opened in the browser' if opened else ''}")
    if output is None and not opened:
        print_line("no browser was found here: open this file in one")


def _kept(name: str) -> Path:
    """A file that outlives the command, for the browser."""
    import tempfile

    return Path(tempfile.mkdtemp(prefix="insenv-page-")) / f"{name or 'scenario'}.html"


def _open(path: Path) -> bool:
    import webbrowser

    return webbrowser.open(path.resolve().as_uri())

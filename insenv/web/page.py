"""`page`: a scenario and its estimators as one HTML file that simulates in a browser."""

from __future__ import annotations

from pathlib import Path

from insenv.base.output import as_path, atomic, check_output_file
from insenv.core.progress import Progress, check_progress
from insenv.estimators import EstimatorsLike
from insenv.estimators.settings import Settings
from insenv.report.page import assembled, check_size
from insenv.scenario import ScenarioLike
from insenv.web.live import live, live_document


def page(
    scenario: ScenarioLike,
    output: str | Path,
    estimators: EstimatorsLike | None = None,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write a scenario and estimators as one HTML file that simulates in a browser, with the numbers of `insenv.run`.

    output: the file.  The other arguments are those of `insenv.run`.  The file needs no network and no other file; a browser
    opens it from a disk or from a server.

    Returns the path.  Raises `InputError` for an unknown name, a wrong value, an estimator that cannot run on this scenario
    or goes back over a whole run, and for a file that cannot be written; `InsenvError` if there is no compiler to WebAssembly,
    or if the page is too large.
    """
    check_progress(progress)
    path = as_path("output", output)
    check_output_file(path, ".html")
    made = live(scenario, estimators, seed=seed, duration_s=duration_s, settings=settings)
    text = assembled(made.plant.scenario.title, {"live": live_document(made, progress)})
    check_size(text)
    with atomic(path) as stream:
        stream.write(text.encode("utf-8"))
    return path

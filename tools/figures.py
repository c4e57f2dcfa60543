"""Draw the figures of docs/figures again: those of runs, of the papers, of the example that needs no training, and of pages.

    python tools/figures.py                 all, some minutes
    python tools/figures.py analytic        those whose names begin so

The figures of trained policies (tuner, supervisor, aligner, manoeuvre-curve) come from ``examples/train_*.py --out DIR``.
Those of pages need the extra ``web``, Chromium and its driver.
"""

from __future__ import annotations

import importlib
import runpy
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import insenv
from insenv.base import style
from insenv.reproduce import PAPERS, figure

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "figures"
RUNS = {
    "analytic": ("static-ecef", ["analytic"]),
    "ship-swaying": ("ship-swaying", ["q-method"]),
    "loosely-coupled": ("car-city-drive", ["loosely-coupled"]),
    "wander-sins": ("aircraft-free-inertial", ["wander-sins", "wander-sins-plain"]),
}
"""By name of a figure, its scenario and estimators."""


def of_run(name: str) -> None:
    """The figure of a run."""
    scenario, ids = RUNS[name]
    style.save(insenv.run(scenario, ids).plot(), {"png": FOLDER / f"{name}.png"})


def of_paper(paper: str) -> None:
    """The figure of a paper."""
    with tempfile.TemporaryDirectory() as folder:
        for path in figure(paper, Path(folder)):
            if path.suffix == ".png":
                (FOLDER / path.name).write_bytes(path.read_bytes())


def of_example(name: str) -> None:
    """The figure of an example."""
    sys.argv = [f"{name}.py", "--out", str(FOLDER)]
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")


def of_budget() -> None:
    """The figure of an error budget."""
    style.save(insenv.budget("ship-swaying", "q-method").plot(), {"png": FOLDER / "budget.png"})


def of_tuning() -> None:
    """The figure of tuning."""
    settings = {"loosely-coupled": {"arw_deg_sqrt_h": 15.0}}
    keys = ["arw_deg_sqrt_h", "vrw_ug_sqrt_hz"]
    found = insenv.tune(
        "car-city-drive", "loosely-coupled", runs=4, held_out=8, keys=keys, evaluations=40, duration_s=60.0, settings=settings
    )
    style.save(found.plot(), {"png": FOLDER / "tune.png"})


def of_run_page() -> None:
    """The page of a run."""
    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        insenv.run("car-city-drive", "loosely-coupled").save(folder)
        shown.open(Path(folder) / "car-city-drive.html", (1200, 1000))
        shown.until("document.querySelector('.uplot canvas')")
        shown.driver.save_screenshot(str(FOLDER / "page-run.png"))


def of_live_page() -> None:
    """A live page: the car is in its second outage."""
    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        path = insenv.page("car-city-drive", Path(folder) / "car.html", ["loosely-coupled", "wander-sins"])
        shown.open(path, (1240, 1000))
        shown.until("document.getElementById('clock')?.textContent === '0:00.0'")
        shown.driver.execute_script("document.getElementById('run').click()")
        shown.until("document.getElementById('clock').textContent >= '6:50.0'", timeout_s=120.0)
        shown.driver.execute_script(
            "document.getElementById('run').click();"
            "[...document.querySelectorAll('.legend button')].find((one) => one.textContent.includes('wander-sins')).click();"
        )
        shown.until("document.getElementById('run').textContent === 'Run'")
        shown.driver.save_screenshot(str(FOLDER / "page-live.png"))


def browser() -> Any:
    """Headless Chromium, as the tests of pages have it."""
    sys.path.insert(0, str(ROOT / "tests" / "helpers"))
    return importlib.import_module("browser").chromium()


FIGURES: dict[str, Callable[[], None]] = {
    **{name: partial(of_run, name) for name in RUNS},
    **{f"reproduce-{paper}": partial(of_paper, paper) for paper in PAPERS},
    "budget": of_budget,
    "tune": of_tuning,
    "active-alignment": partial(of_example, "active_alignment"),
    "page-run": of_run_page,
    "page-live": of_live_page,
}


def main(names: list[str]) -> None:
    """Draw the figures whose names begin with one of `names` (all, if none is given)."""
    for name, draw in FIGURES.items():
        if not names or any(name.startswith(begin) for begin in names):
            draw()
            print(name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

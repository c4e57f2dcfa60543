"""Draw the figures of docs/figures again: those of runs, of the papers, of the example that needs no training, and of pages.

    python tools/figures.py                 all, some minutes
    python tools/figures.py analytic        those whose names begin so

The figures of trained policies (tuner, supervisor, aligner, manoeuvre-curve) come from ``examples/train_*.py --out DIR``.
Those of pages need the extra ``web``, Chromium and its driver; one, ``page-drive.webp``, moves: a car through an outage in ten
seconds.
"""

from __future__ import annotations

import importlib
import io
import runpy
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

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


FRAMES, FRAME_MS, SHOWN_S = 100, 100, (192.0, 250.0)
"""Of the moving picture: its frames, the time between two, and the part of the drive that it shows, s."""
SETTLED = """const done = arguments[0]; let left = 6;
const next = () => (left-- ? requestAnimationFrame(next) : done()); next();"""


def of_drive() -> None:
    """A live page while a car drives through an outage, as a picture that moves; step by step, whatever the machine's speed."""
    from PIL import Image

    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        path = insenv.page("car-city-drive", Path(folder) / "car.html", ["loosely-coupled"])
        shown.open(path, (960, 745))
        shown.until("document.getElementById('clock')?.textContent === '0:00.0'")

        record_s = float(shown.value("document.getElementById('time').step"))
        records, pictures = 0, list[Image.Image]()
        for time in np.linspace(*SHOWN_S, FRAMES):
            while records < round(time / record_s):
                shown.driver.execute_script("document.getElementById('step').click()")
                records += 1
            shown.until(f"Math.abs(document.getElementById('time').value - {records * record_s}) < 1e-6")
            if not pictures:
                shown.driver.execute_script("document.getElementById('follow').click()")
            shown.driver.execute_async_script(SETTLED)
            pictures.append(Image.open(io.BytesIO(shown.driver.get_screenshot_as_png())).convert("RGB"))
    first, *others = pictures
    moving: dict[str, Any] = {"save_all": True, "append_images": others, "duration": FRAME_MS, "loop": 0}
    first.save(FOLDER / "page-drive.webp", quality=55, method=6, minimize_size=True, **moving)


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
    "page-drive": of_drive,
}


def main(names: list[str]) -> None:
    """Draw the figures whose names begin with one of `names` (all, if none is given)."""
    for name, draw in FIGURES.items():
        if not names or any(name.startswith(begin) for begin in names):
            draw()
            print(name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

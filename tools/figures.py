"""Draw the figures of docs/figures again: those of runs, of the papers, and of the example that needs no training.

    python tools/figures.py                 all, some minutes
    python tools/figures.py analytic        those whose names begin so

The figures of trained policies (tuner, aligner, manoeuvre-curve) come from ``examples/train_*.py --out DIR``.
"""

from __future__ import annotations

import runpy
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import insenv
from insenv import style
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


FIGURES: dict[str, Callable[[], None]] = {
    **{name: partial(of_run, name) for name in RUNS},
    **{f"reproduce-{paper}": partial(of_paper, paper) for paper in PAPERS},
    "budget": of_budget,
    "tune": of_tuning,
    "active-alignment": partial(of_example, "active_alignment"),
}


def main(names: list[str]) -> None:
    """Draw the figures whose names begin with one of `names` (all, if none is given)."""
    for name, draw in FIGURES.items():
        if not names or any(name.startswith(begin) for begin in names):
            draw()
            print(name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

"""Reports of runs that nobody ran: errors, sigmas and limits of a known size."""

import numpy as np

from insenv.evaluation.errors import ATTITUDE, CHANNELS, Result, Track
from insenv.evaluation.health import health
from insenv.report import Report

TIME = np.linspace(0.5, 100.0, 200)
PLACE = {"latitude": 0.5 + 1e-6 * TIME, "longitude": 2.0 + 1e-6 * TIME, "height": 10.0 + 0 * TIME}


def track(**more):
    return Track(TIME, np.tile([1.0, 0.0, 0.0, 0.0], (200, 1)), np.zeros((200, 3)), **{**PLACE, **more})


def result(estimator="loosely-coupled", channels=CHANNELS, size=0.01, **more):
    errors = {name: size * np.sin(TIME + place) * (1 + 100 * np.exp(-TIME / 5)) for place, name in enumerate(channels)}
    outputs = {"q_nb": track().q_nb, **PLACE, "test_ratio": np.zeros((200, 6))}
    if set(channels) <= set(ATTITUDE):
        outputs = {"q_nb": outputs["q_nb"]}
    values = {
        "time": TIME, "outputs": outputs, "errors": errors, "sigma": {name: np.full(200, 2 * size) for name in channels},
        "limit": dict.fromkeys(channels, size), "from_s": 75.0, "us_per_sample": 0.4321, **more,
    }  # fmt: skip
    limits = {name: np.full(len(values["time"]), size) for name in channels} if values["limit"] else {}
    return Result(estimator, **{"limit_sigma": limits, **values})


def report(*results, **more):
    values = {"scenario": "made-up", "title": "A made-up run, 10 % [x]", "seed": 7, "duration_s": 100.0, "imu_samples": 20000}
    return Report(**{**values, "truth": track(), "results": results or (result(),), **more})


def of_health(ratio=1.0, refused_share=0.0, last_fix_s=np.inf):
    """The result of a filter with a fix every record up to some time, of which every n-th is refused."""
    fixed = (last_fix_s >= TIME).astype(float)
    count = np.cumsum(fixed)
    refused = np.floor(count * refused_share)
    squares = np.random.default_rng(1).chisquare(3, (200, 2)) * ratio**2 * fixed[:, None]
    gone = np.diff(refused, prepend=0.0)[:, None]
    rows = {
        "fix_count": count, "fix_refused_count": refused, "nis_used": np.cumsum(squares * (1 - gone), axis=0),
        "nis_used_count": np.cumsum(3.0 * (1 - gone) * fixed[:, None] + [[0.0, 0.0]], axis=0),
        "nis_refused": np.cumsum(squares * 100 * gone, axis=0),
        "nis_refused_count": np.cumsum(3.0 * gone + [[0.0, 0.0]], axis=0),
    }  # fmt: skip
    return result(outputs={**result().outputs, **rows}, health=health(rows), notes=health(rows).notes())

"""Peers: the same work done by another package, measured in the same run on the same machine.

The peer is pyins (https://github.com/nmayorov/pyins, MIT); its package on PyPI is `python-ins` (extra `bench`).  Each function
returns (what was measured, value in the figure's unit), or None if pyins is not installed.
"""

from __future__ import annotations

import statistics
import time
import warnings
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType
from typing import Any

import numpy as np

from insenv import attitude
from insenv.core.tables import Array
from insenv.geodesy import NOMINAL_GRAVITY

Peer = tuple[str, float]

SAMPLES = 1000  # 5 s at 200 Hz: its cost per sample grows with the length of a run, so a short run favours it
INTERVAL = 0.005
REPETITIONS = 3


def drift(sample_interval: float, q_nb: Array, latitude: Array, longitude: Array, height: Array) -> Peer | None:
    """Position error, largest axis, mm, of poses that pyins converts to increments and integrates again.

    q_nb (n, 4); latitude, longitude (n,) rad; height (n,) m: poses every sample_interval s, including the start.  pyins fits
    splines through the poses; its drift is measured from the same poses: its synthesis against its own mechanization.
    """
    pyins = _pyins()
    if pyins is None:
        return None
    times = sample_interval * np.arange(len(height))
    places = np.stack([np.degrees(latitude), np.degrees(longitude), height], axis=-1)
    angles = np.degrees(np.stack(attitude.numeric.to_euler(q_nb), axis=-1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        trajectory, imu = pyins.sim.generate_imu(times, places, angles, sensor_type="increment")
        increments = pyins.strapdown.compute_increments_from_imu(imu, "increment")
        integrated = pyins.strapdown.Integrator(trajectory.iloc[0]).integrate(increments)
        columns = ["lat", "lon", "alt"]
        error_ned = pyins.transform.compute_lla_difference(integrated[columns].values, trajectory[columns].values)
    return f"pyins {_version()}, its own increments and integration", float(np.abs(error_ned).max() * 1e3)


def feedback_filter(covariance_interval: float, scales: bool = False) -> Peer | None:
    """One inertial sample of pyins' feedback filter of 15 states, or with scale factors 21, at rest without fixes, us.

    pyins has no call for one sample: `run_feedback_filter` takes the whole run and returns trajectory and covariances.
    covariance_interval: its `time_step`, s, as in `loosely-coupled`.
    """
    pyins = _pyins()
    if pyins is None:
        return None
    import pandas as pd

    times = INTERVAL * np.arange(1, SAMPLES + 1)
    rows = np.tile([INTERVAL, 0.0, 0.0, 0.0, 0.0, 0.0, -NOMINAL_GRAVITY * INTERVAL], (SAMPLES, 1))
    increments = pd.DataFrame(rows, times, ["dt", "theta_x", "theta_y", "theta_z", "dv_x", "dv_y", "dv_z"])
    start = pd.Series([30.0, 114.0] + [0.0] * 7, ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"], name=0.0)
    # the filter requires a measurement; a fix before the start is never used
    early = pd.DataFrame([[30.0, 114.0, 0.0]], [-1.0], ["lat", "lon", "alt"])

    scale = np.diag(np.full(3, 3e-4)) if scales else None

    def run(count: int) -> float:
        model = pyins.inertial_sensor.EstimationModel
        begin = time.perf_counter()
        pyins.filters.run_feedback_filter(
            start,
            *(1.0, 0.1, 0.1, 0.5),
            increments.iloc[:count],
            model(bias_sd=1e-6, noise=1e-5, bias_walk=1e-9, scale_misal_sd=scale),
            model(bias_sd=1e-2, noise=1e-3, bias_walk=1e-6, scale_misal_sd=scale),
            [pyins.measurements.Position(early, 1.0)],
            time_step=covariance_interval + INTERVAL / 2,  # between samples, where rounding does not matter
        )
        return time.perf_counter() - begin

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run(40)  # numba compiles
        taken = statistics.median(run(SAMPLES) for _ in range(REPETITIONS))
    return (
        f"pyins {_version()} feedback filter of {21 if scales else 15} states without fixes, a batch run",
        taken / SAMPLES * 1e6,
    )


def _pyins() -> ModuleType | Any:
    """pyins, or None."""
    try:
        version("python-ins")
        import pyins
    except (ImportError, PackageNotFoundError):
        return None
    return pyins


def _version() -> str:
    return version("python-ins")

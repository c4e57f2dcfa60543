"""Exactness: drift of free-inertial navigation in 10 minutes with a perfect inertial unit and a perfect start."""

from __future__ import annotations

from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.bench import peers
from insenv.bench.figure import Figure
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.scenario import Plant, build, load
from insenv.scenario.inputs import input_rows

SCENARIOS = {"ship": "ship-swaying", "car": "car-city-drive", "aircraft": "aircraft-survey"}
DURATION_S = 600.0


def drift(vehicle: str, rate_hz: float = 200.0) -> Figure:
    """Largest position error of `wander-sins` on the true increments of the vehicle's scenario, over axes and time."""
    plant, start, truth = _simulated(vehicle, rate_hz, disturbed=True)
    largest = _drift_ned(plant, start, truth).max()
    spacing = float(np.spacing(np.pi)) * geodesy.A * 1e3
    note = f"{SCENARIOS[vehicle]}, 600 s at {rate_hz:g} Hz; floor: spacing of doubles in longitude"
    poses = {name: np.concatenate([[start[name]], truth[name]]) for name in ("q_nb", "latitude", "longitude", "height")}
    peer = peers.drift(plant.sample_interval, **poses)
    return Figure(float(largest), spacing, int(DURATION_S * rate_hz), note, peer)


def drift_ned(vehicle: str, rate_hz: float, disturbed: bool = True, id: str = "wander-sins") -> np.ndarray:
    """Largest error north, east, down (3,), mm, of the free-inertial estimator `id`.

    disturbed: False leaves out the engine's vibration, which low rates cannot sample, and the gusts, whose driving noise
    differs from rate to rate.
    """
    return _drift_ned(*_simulated(vehicle, rate_hz, disturbed), id)


def _simulated(vehicle: str, rate_hz: float, disturbed: bool) -> tuple[Plant, dict[str, Any], dict[str, Any]]:
    """The vehicle's plant, its state at the start, and its true outputs by name."""
    scenario = load(SCENARIOS[vehicle])
    motion = scenario.vehicle if disturbed else _undisturbed(scenario.vehicle)
    scenario = scenario.model_copy(update={"rate_hz": rate_hz, "gnss": None, "vehicle": motion})
    plant = build(scenario, duration_s=DURATION_S)
    runner = make_runner(plant.model, plant.parameters)
    start = plant.model.state.unpack(runner.x.copy())
    return plant, start, plant.model.outputs.unpack(runner.run(plant.samples))


def _drift_ned(plant: Plant, start: dict[str, Any], truth: dict[str, Any], id: str = "wander-sins") -> np.ndarray:
    """Largest error north, east, down (3,), mm, of a free-inertial estimator on true increments."""
    estimator = get(id).model
    roll, pitch, heading = attitude.numeric.to_euler(start["q_nb"])
    navigator = make_runner(
        estimator,
        {
            "start_latitude": start["latitude"],
            "start_longitude": start["longitude"],
            "start_height": start["height"],
            "start_velocity_n": start["velocity_n"],
            "start_roll": roll,
            "start_pitch": pitch,
            "start_heading": heading,
        },
    )
    columns = {
        "delta_angle": truth["true_delta_angle"],
        "delta_velocity": truth["true_delta_velocity"],
        "dt": np.full(plant.samples, plant.sample_interval),
    }
    estimate = estimator.outputs.unpack(navigator.run(plant.samples, input_rows(estimator, columns, plant.samples)))
    places = [(t["latitude"], t["longitude"], t["height"]) for t in (estimate, truth)]
    return np.abs(geodesy.numeric.ned_offset(*places[0], *places[1])).max(axis=0) * 1e3


def _undisturbed(motion: Any) -> Any:
    """A [vehicle] section with its engine off and no wind."""
    still: dict[str, object] = {
        name: 0.0 for name in type(motion).model_fields if name.startswith(("wind_", "gust_")) and "sigma" in name
    }
    if "gust_velocity_sigma_mps" in still:
        still["gust_velocity_sigma_mps"] = (0.0, 0.0, 0.0)
    return motion.model_copy(update={**still, **({"engine": ()} if "engine" in type(motion).model_fields else {})})

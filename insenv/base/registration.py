"""Registration with Gymnasium by entry points: an environment's module is imported when the environment is made."""

from __future__ import annotations

SPECS: dict[str, tuple[str, dict[str, object]]] = {
    "insenv/ShipAlignment-v0": ("Alignment", {"scenario": "ship-swaying", "vehicle": "ship"}),
    "insenv/VehicleAlignment-v0": ("Alignment", {"scenario": "car-parked", "vehicle": "car"}),
    "insenv/AircraftAlignment-v0": ("Alignment", {"scenario": "aircraft-parked", "vehicle": "aircraft"}),
    "insenv/ShipNavigation-v0": ("Navigation", {"scenario": "ship-underway", "vehicle": "ship"}),
    "insenv/VehicleNavigation-v0": ("Navigation", {"scenario": "car-city-drive", "vehicle": "car"}),
    "insenv/AircraftNavigation-v0": ("Navigation", {"scenario": "aircraft-survey", "vehicle": "aircraft"}),
    "insenv/Tuning-v0": ("Tuning", {"scenario": "car-city-drive"}),
    "insenv/Manoeuvre-v0": ("Manoeuvre", {"scenario": "car-unknown-heading"}),
}
IDS = tuple(SPECS)
"""Ids of all environments."""


def register() -> None:
    """Register the environments that are not yet registered."""
    from gymnasium.envs.registration import register as add
    from gymnasium.envs.registration import registry

    for id, (name, kwargs) in SPECS.items():
        if id not in registry:
            add(
                id,
                entry_point=f"insenv.envs:{name}Env",
                vector_entry_point=f"insenv.envs:{name}VectorEnv",
                disable_env_checker=True,
                kwargs=kwargs,
            )


def titles() -> dict[str, str]:
    """Return a one-line description of each environment, by id."""
    return {id: f"{_TASKS[name]}, by default in {kwargs['scenario']}" for id, (name, kwargs) in SPECS.items()}


_TASKS = {
    "Alignment": "estimate the attitude of a vehicle in place, and declare when aligned",
    "Navigation": "estimate attitude, velocity and position of a vehicle with GNSS",
    "Tuning": "tune the noise parameters of a filter while it runs",
    "Manoeuvre": "move the vehicle such that the filter finds the heading",
}

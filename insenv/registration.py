"""Registration with Gymnasium, by strings: nothing of insenv is imported until an environment is made."""

from __future__ import annotations

SPECS: dict[str, tuple[str, dict[str, object]]] = {
    "insenv/ShipAlignment-v0": ("Alignment", {"scenario": "ship-swaying", "vehicle": "ship"}),
    "insenv/VehicleAlignment-v0": ("Alignment", {"scenario": "car-parked", "vehicle": "car"}),
    "insenv/AircraftAlignment-v0": ("Alignment", {"scenario": "aircraft-parked", "vehicle": "aircraft"}),
    "insenv/ShipNavigation-v0": ("Navigation", {"scenario": "ship-underway", "vehicle": "ship"}),
    "insenv/VehicleNavigation-v0": ("Navigation", {"scenario": "car-city-drive", "vehicle": "car"}),
    "insenv/AircraftNavigation-v0": ("Navigation", {"scenario": "aircraft-survey", "vehicle": "aircraft"}),
}
IDS = tuple(SPECS)
"""The ids of all environments."""


def register() -> None:
    """Register the environments; once registered, they are left alone."""
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

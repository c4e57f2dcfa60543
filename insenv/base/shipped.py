"""What insenv ships: its version; estimators, kinds of vehicle, sensors and environments, in the order of listings.

As the entry points of an outside package, a place is ``"module:attribute"``, imported when the thing is asked for
(`insenv.base.plugins`), so that a command imports only what it uses.
"""

from __future__ import annotations

__version__ = "0.1.0"
"""Here, where every module can import it without the public face of the package."""

ESTIMATORS = {
    "analytic": "insenv.estimators.analytic:ESTIMATOR",
    "ecef-kf": "insenv.estimators.ecef_kf:ESTIMATOR",
    "ecef-kf-printed": "insenv.estimators.ecef_kf_printed:ESTIMATOR",
    "q-method": "insenv.estimators.q_method:ESTIMATOR",
    "velocity-integration": "insenv.estimators.velocity_integration:ESTIMATOR",
    "inertial-fir": "insenv.estimators.inertial_fir:ESTIMATOR",
    "gyrocompass": "insenv.estimators.gyrocompass:ESTIMATOR",
    "qakf": "insenv.estimators.qakf:ESTIMATORS",
    "qakf-improved": "insenv.estimators.qakf:ESTIMATORS",
    "qakf-printed": "insenv.estimators.qakf_printed:ESTIMATORS",
    "qakf-improved-printed": "insenv.estimators.qakf_printed:ESTIMATORS",
    "wander-sins": "insenv.estimators.wander_sins:ESTIMATORS",
    "wander-sins-plain": "insenv.estimators.wander_sins:ESTIMATORS",
    "loosely-coupled": "insenv.estimators.loosely_coupled:ESTIMATORS",
    "aqe-ekf": "insenv.estimators.aqe:ESTIMATORS",
    "aqe-sukf": "insenv.estimators.aqe:ESTIMATORS",
    "aqe-sukf-printed": "insenv.estimators.aqe_printed:ESTIMATOR",
    "lssvm": "insenv.estimators.lssvm:ESTIMATOR",
    "smoother": "insenv.estimators.loosely_coupled:ESTIMATORS",
    "fusion": "insenv.estimators.fusion:ESTIMATORS",
    "fusion-smoother": "insenv.estimators.fusion:ESTIMATORS",
}
"""Estimators by id; an attribute may hold several."""

VEHICLES = {
    "ship": "insenv.vehicles.ship:ShipSection",
    "car": "insenv.vehicles.car:CarSection",
    "aircraft": "insenv.vehicles.aircraft:AircraftSection",
    "multirotor": "insenv.vehicles.multirotor:MultirotorSection",
    "turntable": "insenv.vehicles.turntable:TurntableSection",
    "recorded": "insenv.scenario.tracks.section:RecordedSection",
    "waypoints": "insenv.scenario.tracks.waypoints:WaypointsSection",
    "fmu": "insenv.scenario.tracks.fmu_section:FmuSection",
}
"""Kinds of vehicle; the last three read logs or FMUs."""

# the order of the sensors of a plant: a new one comes last, and changes no random number of those before it
SENSORS = {
    "gnss": "insenv.sensors.gnss:GnssSection",
    "barometer": "insenv.sensors.barometer:BAROMETER",
    "magnetometer": "insenv.sensors.magnetometer:MAGNETOMETER",
    "odometer": "insenv.sensors.odometer:ODOMETER",
    "dvl": "insenv.sensors.dvl:DVL",
    "heading": "insenv.sensors.heading:HEADING",
}
"""Sensors beside the inertial unit by id."""

NAMES_OF_FUSION = "insenv.estimators.fusion.available:own_names"
"""A function: what `fusion` has by names that no sensor of another package may take."""

IMU_GRADES = ("perfect", "consumer", "autopilot", "industrial", "tactical", "navigation", "marine", "leador", "n380")
GNSS_GRADES = ("perfect", "spp", "sbas", "rtk", "centimetre")
"""Names of the grades of `insenv.sensors.catalogue`, but of those that papers simulate: a list of names imports no figures."""


# Environments: Gymnasium imports the module of one when it is made.


SPECS: dict[str, tuple[str, dict[str, object]]] = {
    "insenv/ShipAlignment-v0": ("Alignment", {"scenario": "ship-swaying", "vehicle": "ship"}),
    "insenv/VehicleAlignment-v0": ("Alignment", {"scenario": "car-parked", "vehicle": "car"}),
    "insenv/AircraftAlignment-v0": ("Alignment", {"scenario": "aircraft-parked", "vehicle": "aircraft"}),
    "insenv/ShipNavigation-v0": ("Navigation", {"scenario": "ship-underway", "vehicle": "ship"}),
    "insenv/VehicleNavigation-v0": ("Navigation", {"scenario": "car-city-drive", "vehicle": "car"}),
    "insenv/AircraftNavigation-v0": ("Navigation", {"scenario": "aircraft-survey", "vehicle": "aircraft"}),
    "insenv/Tuning-v0": ("Tuning", {"scenario": "car-city-drive"}),
    "insenv/FaultTuning-v0": ("FaultTuning", {"scenario": "car-city-drive"}),
    "insenv/Correction-v0": ("Correction", {"scenario": "car-city-drive"}),
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
    "FaultTuning": "adapt a filter to instruments that are worse than their data sheets and fail for a while",
    "Correction": "take errors out of the estimate of a filter whose instruments fail",
    "Manoeuvre": "move the vehicle such that the filter finds the heading",
}

"""What insenv ships: its version, and where each estimator, kind of vehicle and sensor is defined, in the order of listings.

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

IMU_GRADES = ("perfect", "consumer", "autopilot", "industrial", "tactical", "navigation", "marine", "leador", "n380")
GNSS_GRADES = ("perfect", "spp", "sbas", "rtk", "centimetre")
"""Names of the grades of `insenv.sensors.catalogue`, but of those that papers simulate: a list of names imports no figures."""

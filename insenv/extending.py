"""Adding estimators, vehicles and sensors to insenv, from a script or from an installed package.

A package that declares entry points is known wherever it is installed, in worker processes and on the command line too:

    [project.entry-points."insenv.estimators"]
    my-estimator = "my_package.estimator:ESTIMATOR"
    [project.entry-points."insenv.vehicles"]
    trolley = "my_package.trolley:TrolleySection"
    [project.entry-points."insenv.sensors"]
    airspeed = "my_package.airspeed:AIRSPEED"
"""

from __future__ import annotations

from typing import TypeVar

from insenv import estimators
from insenv.base.errors import InputError
from insenv.base.toml import shown
from insenv.estimators import Estimator
from insenv.sensors import SensorSection
from insenv.sensors import registry as sensors
from insenv.sensors.instrument import Instrument
from insenv.vehicles import VehicleSection
from insenv.vehicles import registry as vehicles

Thing = TypeVar("Thing", Estimator, type[VehicleSection], type[SensorSection], Instrument)


def register(thing: Thing) -> Thing:
    """Make an estimator, a kind of vehicle or a sensor known by its name in this process; returns it.

    thing: an `Estimator`; a subclass of `VehicleSection`; an `Instrument`; a subclass of `SensorSection`.  `register` may
    decorate the classes.  Raises `InputError` for anything else, for a name that is taken or not allowed, and for a
    class that lacks a method.
    """
    if isinstance(thing, Estimator):
        return estimators.register(thing)
    if isinstance(thing, Instrument):
        return sensors.register(thing)
    if isinstance(thing, type) and issubclass(thing, VehicleSection):
        return vehicles.register(thing)
    if isinstance(thing, type) and issubclass(thing, SensorSection):
        return sensors.register(thing)
    raise InputError(
        f"register({shown(thing)}): allowed is an Estimator, a subclass of VehicleSection, an Instrument or a subclass of "
        "SensorSection"
    )

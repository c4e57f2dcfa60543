"""The kinds of vehicle by name: those that insenv ships, those of installed packages, those registered by a script."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

from insenv.errors import InputError
from insenv.files.toml import shown
from insenv.plugins import Plugins, check_section_name, overrides
from insenv.vehicles.section import VehicleSection


def _shipped() -> Iterator[type[VehicleSection]]:
    from insenv.vehicles.aircraft_section import AircraftSection
    from insenv.vehicles.car_section import CarSection
    from insenv.vehicles.multirotor_section import MultirotorSection
    from insenv.vehicles.ship_section import ShipSection
    from insenv.vehicles.turntable_section import TurntableSection

    yield from (ShipSection, CarSection, AircraftSection, MultirotorSection, TurntableSection)


def kind_of(section: type[VehicleSection]) -> str:
    """The kind that a section is for: the one value of its key `kind`.  Raises `InputError` for what is no such section."""
    if isinstance(section, type) and issubclass(section, VehicleSection):
        names = get_args(section.model_fields["kind"].annotation)
        if len(names) == 1:
            overrides(section, VehicleSection, ("in_place", "vehicle", "rows"))
            return check_section_name(f"{section.__name__}: kind", names[0])
    raise InputError(f'{shown(section)}: a kind of vehicle is a subclass of VehicleSection with kind: Literal["name"]')


_PLUGINS: Plugins[type[VehicleSection]] = Plugins("kind of vehicle", "insenv.vehicles", kind_of, _shipped)


def registered() -> dict[str, type[VehicleSection]]:
    """The sections of all kinds of vehicle by name."""
    return _PLUGINS.all()


def register(section: type[VehicleSection]) -> type[VehicleSection]:
    """Make a kind of vehicle known.  Raises `InputError` if another one has its name."""
    return _PLUGINS.register(section)


def check_loaded(name: str) -> None:
    """Raise `InsenvError` if an installed package declares this kind of vehicle, but cannot be loaded."""
    _PLUGINS.check_loaded(name)

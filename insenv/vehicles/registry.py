"""The kinds of vehicle by name: those that insenv ships, those of installed packages, those registered by a script."""

from __future__ import annotations

from typing import get_args

from insenv.base.errors import InputError
from insenv.base.plugins import Plugins, check_section_name, overrides
from insenv.base.shipped import VEHICLES
from insenv.base.toml import shown
from insenv.vehicles.section import VehicleSection, VehicleTraits


def kind_of(section: type[VehicleSection]) -> str:
    """The kind that a section is for: the one value of its key `kind`.  Raises `InputError` for what is no such section."""
    if isinstance(section, type) and issubclass(section, VehicleSection):
        names = get_args(section.model_fields["kind"].annotation)
        if len(names) == 1:
            overrides(section, VehicleSection, ("in_place", "vehicle", "rows"))
            return check_section_name(f"{section.__name__}: kind", names[0])
    raise InputError(f'{shown(section)}: a kind of vehicle is a subclass of VehicleSection with kind: Literal["name"]')


_PLUGINS: Plugins[type[VehicleSection]] = Plugins("kind of vehicle", "insenv.vehicles", kind_of, VEHICLES)


def names() -> list[str]:
    """The names of all kinds of vehicle; none of insenv's is imported."""
    return _PLUGINS.names()


def get(kind: str) -> type[VehicleSection]:
    """The section of a kind of vehicle.  Raises `InputError` with the nearest name."""
    return _PLUGINS.get(kind)


def traits_of(kind: str) -> VehicleTraits:
    """The traits of a kind of vehicle; those of a generic vehicle if the kind is empty or unknown."""
    return get(kind).traits if kind in names() else VehicleTraits()


def registered() -> dict[str, type[VehicleSection]]:
    """The sections of all kinds of vehicle by name."""
    return _PLUGINS.all()


def register(section: type[VehicleSection]) -> type[VehicleSection]:
    """Make a kind of vehicle known.  Raises `InputError` if another one has its name."""
    return _PLUGINS.register(section)


def check_loaded(name: str) -> None:
    """Raise `InsenvError` if an installed package declares this kind of vehicle, but cannot be loaded."""
    _PLUGINS.check_loaded(name)

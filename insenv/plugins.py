"""Named things that a package outside insenv can add: estimators, vehicles, sensors.

A `Plugins` object holds the things of one kind by name: those that insenv ships, those that installed packages declare by
an entry point, and those that a script registers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from insenv.errors import InputError, InsenvError, nearest

T = TypeVar("T")


class Plugins(Generic[T]):
    """The things of one kind by name, in the order shipped, installed, registered.

    Parameters
    ----------
    what: the kind in messages (``"estimator"``).
    group: entry-point group of installed packages (``"insenv.estimators"``).  An entry point is one thing.
    name_of: the name of a thing; raises `InputError` for an object that is no such thing.
    shipped: the things of insenv, imported when first asked for.
    """

    def __init__(self, what: str, group: str, name_of: Callable[[T], str], shipped: Callable[[], Iterable[T]]) -> None:
        self.what, self.group = what, group
        self._name_of, self._shipped = name_of, shipped
        self._known: dict[str, T] = {}
        self._loaded = False

    def all(self) -> dict[str, T]:
        """All things by name.  Raises `InsenvError` for an installed package whose entry point cannot be loaded."""
        if not self._loaded:
            for thing in self._shipped():
                self._add(thing)
            self._loaded = True  # before the entry points: a package may ask for what insenv ships while it is imported
            for entry in entry_points(group=self.group):
                try:
                    self._add(entry.load())
                except Exception as error:
                    self._loaded = False
                    raise InsenvError(f"entry point {entry.name!r} of {self.group!r} ({entry.value}): {error}") from error
        return self._known

    def get(self, name: str) -> T:
        """The thing of that name.  Raises `InputError` with the nearest name."""
        known = self.all()
        if name not in known:
            raise InputError(f"no {self.what} {name!r}{nearest(str(name), known)}")
        return known[name]

    def register(self, thing: T) -> T:
        """Add a thing and return it.  Raises `InputError` if another one has its name."""
        self.all()
        return self._add(thing)

    def _add(self, thing: T) -> T:
        name = self._name_of(thing)
        if self._known.setdefault(name, thing) is not thing:
            raise InputError(f"{self.what} {name!r} exists already: choose another name")
        return thing

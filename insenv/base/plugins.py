"""Named things that a package outside insenv can add: estimators, vehicles, sensors.

A `Plugins` object holds the things of one kind by name: those that insenv ships, those that installed packages declare by
an entry point, and those that a script registers.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from insenv.base.errors import LISTED, InputError, InsenvError, nearest

T = TypeVar("T")


def check_id(what: str, name: object) -> str:
    """`name` if it may be an id.  Raises `InputError` otherwise."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", name):
        raise InputError(f"{what} id = {name!r}: allowed are letters, digits, '-', '_' and '.', a letter or digit first")
    return name


def check_section_name(what: str, name: object) -> str:
    """`name` if a scenario can name a section or a kind by it.  Raises `InputError` otherwise."""
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError(f"{what} = {name!r}: allowed are lower-case letters, digits and '_', a letter first")
    return name


def overrides(section: type, base: type, names: Iterable[str]) -> None:
    """Raise `InputError` if the class `section` inherits one of the `names` from `base`, where it is only declared."""
    for name in names:
        if getattr(section, name) is getattr(base, name):
            raise InputError(f"{section.__name__}: a subclass of {base.__name__} must define {name!r}")


class Plugins(Generic[T]):
    """The things of one kind by name, in the order shipped, installed, registered.

    Parameters
    ----------
    what: the kind in messages (``"estimator"``).
    group: entry-point group of installed packages (``"insenv.estimators"``).  An entry point is one thing.
    name_of: the name of a thing; raises `InputError` for an object that is no such thing.
    shipped: where each thing of insenv is, by its name, as ``"module:attribute"``, imported when it is asked for: a command
        takes only what it uses.  An attribute may also hold several things.
    taken: what else has names that no added thing may have, in messages, and a function that gives these names.
    check: ``(thing, the other things by name)``: raises `InputError` for an added thing that is wrong.
    """

    def __init__(
        self,
        what: str,
        group: str,
        name_of: Callable[[T], str],
        shipped: Mapping[str, str],
        taken: tuple[str, Callable[[], Container[str]]] = ("", frozenset),
        check: Callable[[T, Mapping[str, T]], None] | None = None,
    ) -> None:
        self.what, self.group = what, group
        self._name_of, self._shipped, self._taken, self._check = name_of, shipped, taken, check
        self._imported: dict[str, T] = {}
        self._added: dict[str, T] = {}
        self._broken: dict[str, str] = {}
        self._entries_loaded = False

    def names(self) -> list[str]:
        """The names of all things; what insenv ships is not imported.  Warns as `all`."""
        return [*self._shipped, *self._others()]

    def all(self) -> dict[str, T]:
        """All things by name.  An entry point that cannot be loaded gives a `RuntimeWarning`."""
        return {name: self._shipped_thing(name) for name in self._shipped} | self._others()

    def _shipped_thing(self, name: str) -> T:
        if name not in self._imported:
            module, _, attribute = self._shipped[name].partition(":")
            held = getattr(import_module(module), attribute)
            things = held if isinstance(held, (tuple, list)) else [held]
            self._imported[name] = next(thing for thing in things if self._name_of(thing) == name)
        return self._imported[name]

    def _others(self) -> dict[str, T]:
        """The things of other packages and of scripts, by name."""
        if not self._entries_loaded:
            self._entries_loaded = True
            for entry in entry_points(group=self.group):
                try:
                    self._load(entry)
                except Exception as error:
                    package = f"package {entry.dist.name!r}" if entry.dist is not None else "an installed package"
                    fault = f"{type(error).__name__}: {error}" if not isinstance(error, InsenvError) else str(error)
                    self._broken[entry.name] = (
                        f"{package}: its entry point {entry.name!r} of {self.group!r} ({entry.value}) cannot be loaded: "
                        f"{fault}; mend or uninstall the package"
                    )
            for message in self._broken.values():
                warnings.warn(message, RuntimeWarning, stacklevel=3)
        return self._added

    def get(self, name: str) -> T:
        """The thing of that name.  Raises `InputError` with the nearest name, and `InsenvError` as `check_loaded`."""
        if name in self._shipped:
            return self._shipped_thing(name)
        if name not in self._others():
            self.check_loaded(name)
            raise InputError(f"no {self.what} {name!r}{nearest(str(name), self.names(), LISTED)}")
        return self._added[name]

    def check_loaded(self, name: str) -> None:
        """Raise `InsenvError` if only an entry point that cannot be loaded has that name."""
        if name not in self._shipped and name not in self._others() and name in self._broken:
            raise InsenvError(f"{self.what} {name!r}: {self._broken[name]}")

    def register(self, thing: T) -> T:
        """Add a thing and return it.  Raises `InputError` if another one has its name."""
        self._others()
        return self._add(thing)

    @contextmanager
    def passed(self, things: Iterable[T]) -> Iterator[None]:
        """Know these things by their names in the block, those whose names are free."""
        new = {self._name_of(thing): thing for thing in things}
        new = {name: thing for name, thing in new.items() if name not in self._shipped and name not in self._others()}
        self._added.update(new)
        try:
            yield
        finally:
            for name in new:
                self._added.pop(name, None)

    def _load(self, entry: EntryPoint) -> None:
        thing = entry.load()
        name = self._name_of(thing)
        if name != entry.name:
            raise InputError(f"it holds the {self.what} {name!r}: give both the same name")
        self._add(thing)

    def _add(self, thing: T) -> T:
        name = self._name_of(thing)
        whose, names = self._taken
        if name in self._shipped:
            if self._shipped_thing(name) is thing:
                return thing
        elif name not in self._added and name in names():
            raise InputError(f"{self.what} {name!r}: {whose} has this name: choose another name")
        elif name not in self._added:
            if self._check is not None:
                self._check(thing, self.all())
            self._added[name] = thing
            return thing
        elif self._added[name] is thing:
            return thing
        raise InputError(f"{self.what} {name!r} exists already: choose another name")

"""All faults of a description at once: steps that do not depend on one another are all tried before an error is raised."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

from insenv.base.errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass
class Faults:
    """Messages of the errors so far, each once, in order."""

    messages: list[str] = field(default_factory=list)

    def attempt(self, step: Callable[[], Result]) -> Result | None:
        """What a step returns; None, with its messages kept, if it raises InputError."""
        try:
            return step()
        except InputError as error:
            self.messages += [line for line in str(error).split("\n") if line not in self.messages]
            return None

    def check(self) -> None:
        """Raise one InputError with all messages, if there are any."""
        if self.messages:
            raise InputError("\n".join(self.messages))


def all_of(step: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The results of a step for all items.  Raises one InputError for all items that have a fault."""
    faults = Faults()
    results = [faults.attempt(lambda item=item: step(item)) for item in items]  # type: ignore[misc]
    faults.check()
    return [result for result in results if result is not None]

"""One published number beside ours and beside the theoretical limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Quantity:
    """A row of a paper's table.

    paper: short name ("ecef", "navigation", "swaying", "quaternion", "large-misalignment").  quantity: what, under which
    conditions. unit; published: the paper's number, None if it gives none; ours: measured here; limit: what theory leaves,
    None if there is none; seeds: over how many (1 where nothing is random).  note: what must be known to read it.
    """

    paper: str
    quantity: str
    unit: str
    published: float | None
    ours: float
    limit: float | None
    seeds: int
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """Ours over the limit (magnitudes)."""
        return abs(self.ours / self.limit) if self.limit else None

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        names = ("paper", "quantity", "unit", "published", "ours", "limit", "seeds")
        return {name: getattr(self, name) for name in names}

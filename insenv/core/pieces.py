"""A long function in pieces: compilers need more than proportional time for a long one, most of it for its registers.

The statements keep their order, so that no result changes.  A value that a later piece uses goes through the array `w`; a
place in it is used again once its value has been used for the last time.  Constants and elements of the arguments are read anew
in each piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from insenv.core.instructions import Instruction

LONGEST = 1500
"""Instructions of a piece."""
LONG = 3000
"""Instructions from which a function is written in pieces."""


@dataclass
class Piece:
    """Statements in order: ("load", value, place in w), ("do", value, 0) or ("keep", value, place in w)."""

    statements: list[tuple[str, int, int]] = field(default_factory=list)


def pieces(steps: Sequence[Instruction], order: Sequence[int], longest: int = LONGEST) -> tuple[list[Piece], int]:
    """The pieces of the instructions `steps`, written in `order`, and the size of w.

    No argument may be changed by the function.
    """
    work = [k for k in order if not steps[k].is_leaf]
    piece_of = {k: place // longest for place, k in enumerate(work)}
    last = dict(piece_of)
    for k in work:
        for source in steps[k].sources:
            if not steps[source].is_leaf:
                last[source] = max(last[source], piece_of[k])
    places: dict[int, int] = {}
    free: list[int] = []
    ending: dict[int, list[int]] = {}
    found, size = [], 0
    for number in range(-(-len(work) // longest)):
        piece, known = Piece(), set[int]()
        for k in work[number * longest : (number + 1) * longest]:
            for source in steps[k].sources:
                if source in known:
                    continue
                known.add(source)
                is_here = steps[source].is_leaf
                piece.statements.append(("do", source, 0) if is_here else ("load", source, places[source]))
            known.add(k)
            piece.statements.append(("do", k, 0))
            if last[k] > number:
                if free:
                    places[k] = free.pop()
                else:
                    places[k], size = size, size + 1
                ending.setdefault(last[k], []).append(k)
                piece.statements.append(("keep", k, places[k]))
        free += [places[k] for k in ending.pop(number, ())]
        found.append(piece)
    return found, size

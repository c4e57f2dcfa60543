"""A CasADi function of scalars as the list of its instructions, for what rewrites them or writes them as C."""

from __future__ import annotations

from typing import Any, NamedTuple


class Instruction(NamedTuple):
    """One operation.

    name: CasADi's, without ``OP_``.  sources: numbers of the instructions whose values it takes.  place: of an INPUT or OUTPUT,
    number of the argument or result and element in it.  value: of a CONST.
    """

    name: str
    sources: tuple[int, ...] = ()
    place: tuple[int, int] = (0, 0)
    value: float = 0.0

    @property
    def is_leaf(self) -> bool:
        """Whether it takes no other's value."""
        return self.name in ("INPUT", "CONST")


def instructions(function: Any) -> list[Instruction]:
    """The instructions of an SX function, in its order."""
    import casadi as ca

    names = {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}
    holder: dict[int, int] = {}
    found = []
    name_of, input_of, output_of = function.instruction_id, function.instruction_input, function.instruction_output
    for k in range(function.n_instructions()):
        name, given = names[name_of(k)], output_of(k)
        if name == "CONST":
            found.append(Instruction(name, value=float(function.instruction_constant(k))))
        elif name == "INPUT":
            argument, element = input_of(k)
            found.append(Instruction(name, place=(argument, element)))
        elif name == "OUTPUT":
            found.append(Instruction(name, (holder[input_of(k)[0]],), (given[0], given[1])))
            continue
        else:
            found.append(Instruction(name, tuple([holder[place] for place in input_of(k)])))
        holder[given[0]] = k
    return found

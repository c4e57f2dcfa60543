"""Divisions by the same number become products with its reciprocal: a division costs a processor ten products.

CasADi writes a product with a reciprocal as a quotient, so a quantity that a model divides by once and then multiplies with is
divided by wherever it is used.  Here that is taken back in the finished function, which the interpreter and the compilers then
share.  A quotient so rounded is within 1.5 units in the last place, not 0.5; quotients by a constant stay.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from insenv.core.instructions import instructions

LEAST_SHARE = 0.008
"""Share of divisions among the instructions from which on there is something to gain."""
_DIVISIONS = ("DIV", "INV")


def share_reciprocals(function: Any) -> Any:
    """An SX function of the same name, arguments and results, with one division for each number divided by more than once."""
    import casadi as ca

    count = function.n_instructions()
    divisions = sum(function.instruction_id(k) in (ca.OP_DIV, ca.OP_INV) for k in range(count))
    if divisions < LEAST_SHARE * count:
        return function
    steps = instructions(function)
    divisors = Counter(step.sources[-1] for step in steps if step.name in _DIVISIONS)
    shared = {k for k, count in divisors.items() if count > 1 and steps[k].name != "CONST"}
    if not shared:
        return function

    arguments = [ca.SX.sym(f"a{i}", function.size1_in(i)) for i in range(function.n_in())]
    results = [ca.SX(function.size1_out(i), 1) for i in range(function.n_out())]
    reciprocal: dict[int, Any] = {}
    value: list[Any] = []
    simplifies = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        for step in steps:
            given = [value[k] for k in step.sources]
            if step.name == "INPUT":
                new = arguments[step.place[0]][step.place[1]]
            elif step.name == "CONST":
                new = ca.SX(step.value)
            elif step.name == "OUTPUT":
                results[step.place[0]][step.place[1]] = new = given[0]
            elif step.name in _DIVISIONS and (divisor := step.sources[-1]) in shared:
                if divisor not in reciprocal:
                    reciprocal[divisor] = ca.SX.unary(ca.OP_INV, given[-1])
                one = step.name == "INV"
                new = reciprocal[divisor] if one else ca.SX.binary(ca.OP_MUL, given[0], reciprocal[divisor])
            else:
                new = (ca.SX.unary, ca.SX.binary)[len(given) - 1](getattr(ca, f"OP_{step.name}"), *given)
            value.append(new)
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(simplifies)
    return ca.Function(function.name(), arguments, results)

"""Finding operations whose result may differ between machines."""

import casadi as ca

_EXACT = (
    "ADD SUB MUL DIV NEG SQ TWICE INV SQRT FLOOR FABS SIGN LT LE EQ NE NOT AND OR IF_ELSE_ZERO "
    "ASSIGN CONST PARAMETER INPUT OUTPUT CALL HORZCAT VERTCAT DIAGCAT HORZSPLIT VERTSPLIT DIAGSPLIT "
    "HORZREPMAT RESHAPE TRANSPOSE PROJECT SPARSITY_CAST SUBREF SUBASSIGN "
    "GETNONZEROS GETNONZEROS_PARAM SETNONZEROS SETNONZEROS_PARAM ADDNONZEROS"
)  # of MX only operations that move numbers: the order of the sums in a matrix product is not defined
_NAME_OF = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}


def inexact_operations(function: ca.Function) -> set[str]:
    """Names of the operations, in a function and those it calls, whose result may differ between machines.

    A called function that is neither SX nor MX nor a map of one (an interpolant, an external) is reported by its class.
    """
    exact, found = {"OP_" + name for name in _EXACT.split()}, set()
    for part in (function, *function.find_functions()):
        if part.is_a("SXFunction") or part.is_a("MXFunction"):
            names = {_NAME_OF[part.instruction_id(i)] for i in range(part.n_instructions())}
            found |= names - exact
        elif not part.is_a("Map"):
            found.add(part.class_name())
    return found

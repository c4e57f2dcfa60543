"""Numbers as constants of CasADi, and expressions of constants as numbers."""

import casadi as ca
import numpy as np


def constants(table, **values):
    """The rows of a table by name, at these values."""
    return table.symbols(ca.SX(ca.DM(table.pack(values))))


def number(expression):
    """The value of an expression without symbols; a column is a vector."""
    return np.squeeze(ca.evalf(ca.densify(ca.SX(expression))).full())

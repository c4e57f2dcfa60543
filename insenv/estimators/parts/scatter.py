"""Scatter of slow vectors about a straight line: what a low-pass has let through of the motion of the base.

Behind the low-pass of an alignment in place a vector should move evenly. What moves to and fro is motion slower than the
stop-band, whose size is not known in advance, so it is measured: recursive least squares of a line through the vectors, older
ones forgotten, with the weighted sum of the squared residuals. The sum grows with every vector by the product of its residuals
before and after the line has taken it in.

Source: Ljung (1999), System Identification, section 11.2.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.elementary import maximum
from insenv.core.tables import Row, Table

MEMORY = 50.0
"""Vectors after which the weight of one has fallen to 1 / e."""
FREE = 1e6
"""Start value of the covariance of the line's value and slope, in variances of a vector: the line is not known."""
FITTED = 2.0
"""Numbers of a line in each component."""
LEAST = 8.0
"""Sum of the weights from which the scatter counts; with fewer vectors a line fits anything."""

_KEEP = 1.0 - 1.0 / MEMORY


def state(name: str, what: str, unit: str, size: int, frame: str = "") -> Table:
    """State rows of the line through vectors (size) of a unit, each named after `name`; what: the vectors, for the meanings."""
    return Table((
        Row(f"{name}_line", f"Line through {what}: value now, and change from one to the next", unit, (2, size), frame),
        Row(f"{name}_line_covariance", "Covariance of value and change, in variances of a vector: 11, 12, 22", "1", (3,),
            start=(FREE, 0.0, FREE)),
        Row(f"{name}_square", f"Weighted sum of squared residuals of {what}", f"({unit})^2", (size, size), frame),
        Row(f"{name}_weight", "Sum of the weights", "1"),
    ))  # fmt: skip


def taken(x: Any, name: str, vector: Any) -> dict[str, Any]:
    """The rows of `state` after another vector (size x 1)."""
    line, c = getattr(x, f"{name}_line"), getattr(x, f"{name}_line_covariance")
    # the line one vector on; older vectors count less
    value, slope = (line[0, :] + line[1, :]).T, line[1, :].T
    a, b, d = (c[0] + 2 * c[1] + c[2]) / _KEEP, (c[1] + c[2]) / _KEEP, c[2] / _KEEP
    before = vector - value
    gain, gain_slope = a / (a + 1), b / (a + 1)
    after = before * (1 - gain)
    return {
        f"{name}_line": ca.vertcat((value + gain * before).T, (slope + gain_slope * before).T),
        f"{name}_line_covariance": ca.vertcat(a * (1 - gain), b * (1 - gain), d - gain_slope * b),
        f"{name}_square": _KEEP * getattr(x, f"{name}_square") + before @ after.T,
        f"{name}_weight": _KEEP * getattr(x, f"{name}_weight") + 1,
    }


def covariance(x: Any, name: str) -> Any:
    """Covariance (size x size) of the vectors about their line; 0 while there are too few."""
    weight = getattr(x, f"{name}_weight")
    return getattr(x, f"{name}_square") * (weight > LEAST) / maximum(weight - FITTED, 1.0)

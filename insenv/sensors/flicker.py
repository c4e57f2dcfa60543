"""Flicker noise of a bias: its Allan deviation has a floor, the "bias instability" of a data sheet.

A spectrum S(f) = h / f (one-sided) has the Allan deviation sqrt(2 ln 2 h) at every averaging time. A sum of first-order
Gauss-Markov processes of equal variance s^2, whose correlation times are spaced by a factor r, has the spectrum
s^2 / (ln r f) between the inverses of its shortest and longest time, and so the floor

    s sqrt(2 ln 2 / ln r)

With one process a decade from 4 to 40000 s the Allan deviation lies within -8 and +1 % of the floor from 10 s to 50000 s.
Below, it falls; the white noise of every real unit covers that part.

Source: Keshner, "1/f noise", Proc. IEEE 70 (1982), 212-218: flicker noise as relaxation processes, one per decade; its
Allan deviation: IEEE Std 952-1997, annex C.
"""

from __future__ import annotations

from math import log, sqrt
from typing import Any

import casadi as ca

from insenv.core.elementary import exp

TIMES = (4.0, 40.0, 400.0, 4000.0, 40000.0)
"""Correlation times of the processes, s."""
PARTS = len(TIMES)
SIGMA = sqrt(log(TIMES[1] / TIMES[0]) / (2.0 * log(2.0)))
"""Standard deviation of each process over the floor of their sum's Allan deviation."""


def advanced(parts: Any, floor: Any, h: Any, normals: Any, first: Any) -> Any:
    """The processes (3 x PARTS) after `h` seconds, stepped exactly; stationary from the first time on.

    parts: before. floor (3): of the Allan deviation, in the unit of the bias. normals: 3 PARTS standard normals. first: 1
    at the first time, else 0.
    """
    columns = []
    for i, time in enumerate(TIMES):
        decay = (1.0 - first) * exp(-h / time)
        drive = SIGMA * floor * ca.sqrt((1.0 - decay) * (1.0 + decay))
        columns.append(decay * parts[:, i] + drive * normals[3 * i : 3 * i + 3])
    return ca.horzcat(*columns)

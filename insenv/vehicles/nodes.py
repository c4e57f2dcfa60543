"""The instants within a sample at which the truth is evaluated: the four Gauss-Lobatto nodes, the first being its
start.

They integrate polynomials of degree 5 exactly, as three Gauss-Legendre nodes do; but because the end of a sample is the
start of the next, three evaluations per sample give both the integrals and the truth at the end.  For a motion of
angular frequency w the relative error over a sample of length h is (w h)^6 / 1512000.  Abramowitz and Stegun 1964, eq.
25.4.32 and table 25.6.
"""

from __future__ import annotations

from math import sqrt

EDGE = 0.5 - sqrt(0.2) / 2.0
"""The second node as a fraction of the sample; also the distance from the third node to the end."""
INNER = sqrt(0.2)
"""Distance from the second node to the third."""
PLACES = (EDGE, 1.0 - EDGE, 1.0)
"""The nodes after the start, as fractions of the sample."""
END_WEIGHT = 1.0 / 12.0
"""Weight of the start and of the end."""
WEIGHTS = (5.0 / 12.0, 5.0 / 12.0, END_WEIGHT)
"""Weights of `PLACES`."""

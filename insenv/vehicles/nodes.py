"""Where within a sample the truth is evaluated: the four Gauss-Lobatto nodes, of which the first is the sample's start.

They integrate polynomials of degree 5 exactly, as three Gauss-Legendre nodes do; but a sample's end is the next one's
start, so that three evaluations serve both the integrals and what is true at the end.  The error over a sample h of a
motion of angular frequency w is (w h)^6 / 1512000 of it.  Abramowitz and Stegun 1964, eq. 25.4.32 and table 25.6.
"""

from __future__ import annotations

from math import sqrt

EDGE = 0.5 - sqrt(0.2) / 2.0
"""Second node, as a fraction of the sample; also the way from the third node to the end."""
INNER = sqrt(0.2)
"""From the second node to the third."""
PLACES = (EDGE, 1.0 - EDGE, 1.0)
"""The nodes after the start, as fractions of the sample."""
END_WEIGHT = 1.0 / 12.0
"""Of the start and of the end."""
WEIGHTS = (5.0 / 12.0, 5.0 / 12.0, END_WEIGHT)
"""Of `PLACES`."""

"""Where within a sample the truth is evaluated: the three Gauss-Legendre nodes, and the sample's end.

Three nodes integrate polynomials of degree 5 exactly; the error over a sample h of a motion of angular
frequency w is (w h)^6 / 2016000 of it. Abramowitz and Stegun 1964, eq. 25.4.30 and table 25.4.
"""

from __future__ import annotations

from math import sqrt

EDGE = 0.5 - sqrt(0.6) / 2.0
"""First node, as a fraction of the sample; also the way from the last node to the end."""
INNER = sqrt(0.6) / 2.0
"""From the first node to the second, and from the second to the third."""
NODES = (EDGE, 0.5, 1.0 - EDGE)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
PLACES = (*NODES, 1.0)
"""Nodes and end."""

"""Cascades of linear-phase FIR low-passes with decimation: coefficients, exact delay and response.

Each sub-filter is of odd length and symmetric, so its delay is exactly half its length at every frequency. The
coefficients of `CASCADE` are those of the shortest sub-filters that keep the specification below, by the exchange of
Parks and McClellan (SciPy 1.17.1), rounded to 1e-12. They are constants, so that results do not depend on the installed
SciPy; the tests design them again and compare.

Source: the swaying-base paper, section 1: two decimations, three sub-filters, pass-band ripple 0.01, disturbances above
1/15 Hz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

BLOCK_S = 0.1
"""Interval of the cascade's input, s: means of specific force over blocks of samples."""
PASS_HZ = 0.002
"""Edge of the pass-band: in the inertial frame gravity turns at 1.16e-5 Hz."""
STOP_HZ = 1.0 / 15.0
"""Edge of the stop-band: disturbances lie above it."""
PASS_RIPPLE = 0.01
STOP_DB = 100.0
"""Attenuation, dB. Of a sway of 0.5 m/s^2 at most 5e-6 m/s^2 remains: below 0.01 deg of heading."""

# First half and centre of each symmetric sub-filter.
# fmt: off
FIRST = (
    0.000119304809, 0.000779186969, 0.00293764973, 0.008150885028, 0.018242956898, 0.034508416729,
    0.056691206986, 0.082274471112, 0.106638565787, 0.124285966081, 0.130742779742,
)
SECOND = (
    0.000152628606, 0.001088344856, 0.004321658822, 0.012303499383, 0.027649709056, 0.051505777724,
    0.081803854968, 0.112695970895, 0.136072961275, 0.14481118883,
)
THIRD = (
    3.5758884e-05, 0.000177501735, 0.000573978431, 0.001467513019, 0.003198907039, 0.006179465245,
    0.010825072271, 0.017456255688, 0.026181783221, 0.036794845097, 0.048715268683, 0.061005716851,
    0.072473578057, 0.081847771199, 0.087996837056, 0.090139495049,
)
# fmt: on


@dataclass(frozen=True)
class Cascade:
    """Sub-filters (coefficients, newest sample first) and the decimations between them.

    Sub-filter i takes every `decimation[0] * .. * decimation[i - 1]`-th block.
    """

    filters: tuple[tuple[float, ...], ...]
    decimation: tuple[int, ...]

    @property
    def strides(self) -> tuple[int, ...]:
        """Blocks between two inputs of each sub-filter."""
        return tuple(math.prod(self.decimation[:i]) for i in range(len(self.filters)))

    @property
    def span(self) -> int:
        """Number of blocks that one output depends on."""
        return 1 + sum((len(h) - 1) * s for h, s in zip(self.filters, self.strides, strict=True))

    @property
    def delay(self) -> float:
        """Delay in blocks, exact, of an output relative to the middle of the last block."""
        return (self.span - 1) / 2


def _whole(half: tuple[float, ...]) -> tuple[float, ...]:
    return half + half[-2::-1]


CASCADE = Cascade((_whole(FIRST), _whole(SECOND), _whole(THIRD)), (5, 4))
"""The cascade in use."""


def filtered(taps: tuple[float, ...], buffer: Any) -> Any:
    """Output (3x1) of a symmetric filter for its last inputs (rows of `buffer`, newest first), one product per pair."""
    last = len(taps) - 1
    total = taps[last // 2] * buffer[last // 2, :]
    for k in range(last // 2):
        total = total + taps[k] * (buffer[k, :] + buffer[last - k, :])
    return total.T

"""`bench`: the project's figures of speed and exactness, each measured on this machine beside its floor.

A floor is the same measurement without any work (an empty model, an empty interpreter, the spacing of doubles): the part of
a figure that no better code could save.  Times are medians over repetitions.  Shared machines are noisy: compare ratios.
"""

from insenv.bench.figure import Figure
from insenv.bench.figures import figures, machine, machine_line

__all__ = ["Figure", "figures", "machine", "machine_line"]

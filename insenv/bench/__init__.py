"""`bench`: the project's figures of speed and exactness, each measured on this machine beside its floor.

A floor is the same measurement without the work itself (an empty model or loop, an empty interpreter, a warm start, the
spacing of doubles): what better code for that work could not save.  Times are medians over repetitions.
Shared machines are noisy: compare ratios.
"""

from insenv.bench.figure import Figure
from insenv.bench.figures import document, figures, machine, machine_line

__all__ = ["Figure", "document", "figures", "machine", "machine_line"]

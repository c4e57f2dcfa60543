"""`bench`: the project's figures of speed and exactness, each measured here and now, beside its floor.

A floor is what the same measurement shows for no work at all (an empty model, an empty interpreter, the spacing of
doubles): the part of a figure that no better code could save.  Times are medians over repetitions; machines are shared and
noisy, so compare ratios.
"""

from insenv.bench.figures import Figure, figures, machine

__all__ = ["Figure", "figures", "machine"]

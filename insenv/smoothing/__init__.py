"""Fixed-interval smoothing: the state at each time from all measurements of a run, those before and those after."""

from insenv.smoothing.follower import SmoothingFollower
from insenv.smoothing.smoothing import Smoother, smooth

__all__ = ["Smoother", "SmoothingFollower", "smooth"]

"""Replay: a recorded log through the same estimators as a simulation."""

from insenv.replay.replay import STARTS, replay

__all__ = ["STARTS", "replay"]

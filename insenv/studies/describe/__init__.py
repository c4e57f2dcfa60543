"""`describe`: the description of a log from its files alone (docs/logs.md)."""

from insenv.studies.describe.describing import Described, describe
from insenv.studies.describe.finding import Finding, UnclearError

__all__ = ["Described", "Finding", "UnclearError", "describe"]

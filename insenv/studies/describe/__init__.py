"""`describe`: the description of a log from its files alone (docs/logs.md)."""

from insenv.studies.describe.describing import describe
from insenv.studies.describe.finding import Described, Finding, UnclearError

__all__ = ["Described", "Finding", "UnclearError", "describe"]

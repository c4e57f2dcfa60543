"""Campaigns: Monte Carlo over seeds and over ranges of a scenario's keys; whole runs stay inside the batch core.

summary = insenv.campaign("ship-swaying", "q-method", runs=100)
"""

from insenv.campaigns.executors import cluster, processes, threads
from insenv.campaigns.plan import Plan, make_plan
from insenv.campaigns.running import campaign, run_campaign
from insenv.campaigns.statistics import PERCENTILES
from insenv.campaigns.store import Folder
from insenv.campaigns.summary import Summary
from insenv.campaigns.variation import Variation, parse_variation

__all__ = [
    "PERCENTILES",
    "Folder",
    "Plan",
    "Summary",
    "Variation",
    "campaign",
    "cluster",
    "make_plan",
    "parse_variation",
    "processes",
    "run_campaign",
    "threads",
]

"""Campaigns: Monte Carlo over seeds and over ranges of a scenario's keys; whole runs stay inside the batch core.

summary = insenv.campaign("ship-swaying", "q-method", runs=100)
"""

from insenv.campaigns.comparison import Comparison, compare
from insenv.campaigns.designs import DESIGNS
from insenv.campaigns.distributions import Distribution
from insenv.campaigns.executors import cluster, processes, threads
from insenv.campaigns.plan import Plan, make_plan
from insenv.campaigns.running import campaign, make_plans, run_campaign, run_campaigns, stores_of
from insenv.campaigns.statistics import PERCENTILES
from insenv.campaigns.store import Folder
from insenv.campaigns.summary import Summary
from insenv.campaigns.variation import Variation, parse_variation

__all__ = [
    "DESIGNS",
    "PERCENTILES",
    "Comparison",
    "Distribution",
    "Folder",
    "Plan",
    "Summary",
    "Variation",
    "campaign",
    "cluster",
    "compare",
    "make_plan",
    "make_plans",
    "parse_variation",
    "processes",
    "run_campaign",
    "run_campaigns",
    "stores_of",
    "threads",
]

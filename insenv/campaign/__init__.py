"""Campaigns: Monte Carlo over seeds, and over ranges of a scenario's keys, with whole runs inside the batch core.

plan = make_plan(load("ship-swaying"), "q-method", 100)
found = run_campaign(plan)
"""

from insenv.campaign.campaign import run_campaign
from insenv.campaign.executors import cluster, processes, threads
from insenv.campaign.plan import Plan, make_plan
from insenv.campaign.store import Folder
from insenv.campaign.summary import PERCENTILES, Summary
from insenv.campaign.variation import Variation, parse_variation

__all__ = [
    "PERCENTILES",
    "Folder",
    "Plan",
    "Summary",
    "Variation",
    "cluster",
    "make_plan",
    "parse_variation",
    "processes",
    "run_campaign",
    "threads",
]

"""Campaigns: Monte Carlo over seeds and over ranges of a scenario's keys; whole runs stay inside the batch core.

summary = insenv.campaign("ship-swaying", "q-method", runs=100)
"""

from insenv.scenario.variation import Distribution, Variation, parse_variation
from insenv.studies.campaign.comparison import Comparison, compare
from insenv.studies.campaign.design import DESIGNS
from insenv.studies.campaign.plan import Plan, make_plan
from insenv.studies.campaign.running import (
    campaign,
    cluster,
    make_plans,
    processes,
    run_campaign,
    run_campaigns,
    stores_of,
    threads,
)
from insenv.studies.campaign.statistics import PERCENTILES
from insenv.studies.campaign.store import Folder
from insenv.studies.campaign.summary import Summary

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

"""Scenarios: the TOML file and its checks, and the plant and the initial knowledge that it describes.

plant = build(load("ship-swaying"), seed=1)
runner = make_runner(plant.model, plant.parameters)
"""

from insenv.scenario.build import KNOWLEDGE_STREAM, build, plant_of, reported_attitude, reseeded, start_errors
from insenv.scenario.description import Scenario
from insenv.scenario.files import USUAL, ScenarioLike, json_schema, load, names, parse, summaries, with_changes, with_settings
from insenv.scenario.limits import limit, limit_along, limit_of, no_limit, prior_of
from insenv.scenario.plant import Plant

__all__ = [
    "KNOWLEDGE_STREAM",
    "USUAL",
    "Plant",
    "Scenario",
    "ScenarioLike",
    "build",
    "json_schema",
    "limit",
    "limit_along",
    "limit_of",
    "load",
    "names",
    "no_limit",
    "parse",
    "plant_of",
    "prior_of",
    "reported_attitude",
    "reseeded",
    "start_errors",
    "summaries",
    "with_changes",
    "with_settings",
]

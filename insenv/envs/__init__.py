"""Gymnasium environments: alignment and navigation as tasks for an agent.

    import gymnasium, insenv
    env = gymnasium.make("insenv/ShipAlignment-v0")

Ids: `IDS`.  The action is the agent's estimate, the observation what a navigator has; the truth is in the info alone.
"""

from insenv.envs.estimation import AlignmentEnv, AlignmentVectorEnv, NavigationEnv, NavigationVectorEnv
from insenv.envs.estimation_task import estimate_action
from insenv.envs.interface import Snapshot
from insenv.envs.knowledge import knowledge_of
from insenv.envs.manoeuvre import ManoeuvreEnv, ManoeuvreVectorEnv
from insenv.envs.single import InertialEnv
from insenv.envs.task import Task
from insenv.envs.tuning import TuningEnv, TuningVectorEnv
from insenv.envs.vector import InertialVectorEnv
from insenv.registration import IDS, register

__all__ = [
    "IDS",
    "AlignmentEnv",
    "AlignmentVectorEnv",
    "InertialEnv",
    "InertialVectorEnv",
    "ManoeuvreEnv",
    "ManoeuvreVectorEnv",
    "NavigationEnv",
    "NavigationVectorEnv",
    "Snapshot",
    "Task",
    "TuningEnv",
    "TuningVectorEnv",
    "estimate_action",
    "knowledge_of",
    "register",
]

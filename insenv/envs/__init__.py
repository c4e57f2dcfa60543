"""Gymnasium environments: alignment, navigation, filter tuning and manoeuvres as tasks for an agent.

    import gymnasium, insenv
    env = gymnasium.make("insenv/ShipAlignment-v0")

The ids are `IDS`.  An observation contains what a navigator knows and measures; only the info contains the truth.
"""

from insenv.base.shipped import IDS, register
from insenv.envs.correction import CorrectionEnv, CorrectionVectorEnv
from insenv.envs.estimation import AlignmentEnv, AlignmentVectorEnv, NavigationEnv, NavigationVectorEnv
from insenv.envs.estimation_task import estimate_action
from insenv.envs.fault_tuning import FaultTuningEnv, FaultTuningVectorEnv
from insenv.envs.knowledge import knowledge_of
from insenv.envs.manoeuvre import ManoeuvreEnv, ManoeuvreVectorEnv
from insenv.envs.single import InertialEnv, Snapshot
from insenv.envs.task import Task
from insenv.envs.tuning import TuningEnv, TuningVectorEnv
from insenv.envs.vector import InertialVectorEnv

__all__ = [
    "IDS",
    "AlignmentEnv",
    "AlignmentVectorEnv",
    "CorrectionEnv",
    "CorrectionVectorEnv",
    "FaultTuningEnv",
    "FaultTuningVectorEnv",
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

register()  # in a process that is the command, `import insenv` does not

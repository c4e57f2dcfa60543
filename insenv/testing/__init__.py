"""The conformance suite: what insenv promises of every estimator, sensor, vehicle and environment, as checks.

    insenv.testing.check_estimator("q-method")
    insenv.testing.check_sensor("compass", noise_deg=0.5)
    insenv.testing.check_vehicle(TrolleySection, kind="trolley", amplitude_m=1.0)
    insenv.testing.check_id("my/Env-v0")
    insenv.testing.score("insenv/ShipNavigation-v0", "fusion")

A check that fails raises `AssertionError`, which names the thing and the promise.  insenv runs them on all that it ships; a
package that adds one of its own runs them on that (docs/write-your-own.md).  `score` makes a row of docs/leaderboard.md.
"""

from insenv.envs.testing import (
    assert_same,
    check,
    check_batch_copies,
    check_contract,
    check_deterministic,
    check_disabled_autoreset,
    check_id,
    check_misuse,
    check_pickling,
    check_rows,
    check_snapshot,
    check_spec,
    episodes,
    row_of,
)
from insenv.testing.estimators import check_estimator
from insenv.testing.models import check_backends, check_inputs, check_snapshots, check_tables
from insenv.testing.scoring import Score, score
from insenv.testing.sections import check_keys, check_sensor, check_vehicle

__all__ = [
    "Score",
    "assert_same",
    "check",
    "check_backends",
    "check_batch_copies",
    "check_contract",
    "check_deterministic",
    "check_disabled_autoreset",
    "check_estimator",
    "check_id",
    "check_inputs",
    "check_keys",
    "check_misuse",
    "check_pickling",
    "check_rows",
    "check_sensor",
    "check_snapshot",
    "check_snapshots",
    "check_spec",
    "check_tables",
    "check_vehicle",
    "episodes",
    "row_of",
    "score",
]

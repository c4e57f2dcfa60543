"""The estimators that a scenario names, and those that can run on it."""

from __future__ import annotations

from insenv.base.errors import InputError
from insenv.estimators import registered
from insenv.scenario.description import Scenario


def accepted(scenario: Scenario) -> list[str]:
    """Ids of the estimators that can run on the scenario."""
    return [id for id, estimator in registered().items() if not estimator.refusal(scenario.drive())]


def named_estimators(scenario: Scenario) -> tuple[str, ...]:
    """Ids of the estimators that the scenario names.  Raises `InputError` if it names none."""
    if scenario.estimators:
        return tuple(scenario.estimators)
    where = f"scenario {scenario.name!r}" if scenario.name else "the scenario"
    allowed = accepted(scenario)
    example = allowed[0] if allowed else "ID"
    raise InputError(
        f"{where} names no estimator: name one with -e ID (in Python: estimators={example!r}), or write estimators = "
        f'["{example}"] into the file; allowed here: {", ".join(allowed) or "none"}'
    )

"""A reference against the velocities of the receiver: what is left, and from when on the log contradicts it."""

import numpy as np
import pytest

from insenv import attitude
from insenv.evaluation.specific_force import SETTLED, VelocityChanges, specific_force

COUNT = 60


def judged(left, of_reference, sigma=None, from_s=0.0):
    """The judgement where the estimate and the reference leave so much, m/s^2, in each half of the run: two numbers each.

    Level, under gravity alone; the receiver's velocity changes by what the estimate leaves, and the reference is rolled by what
    it leaves beyond that: 10 sin(roll).
    """
    time = np.arange(0.5, COUNT)
    each, beyond = (np.repeat(values, COUNT // 2) for values in (left, np.array(of_reference) - left))
    increment = np.tile([0.0, 0.0, -10.0], (COUNT, 1))
    changes = VelocityChanges(time, np.ones(COUNT), increment, increment + each[:, None] * [0.0, 1.0, 0.0],
                              np.ones((COUNT, 3), dtype=bool))  # fmt: skip
    records = np.arange(COUNT + 1.0)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (COUNT + 1, 1))
    # half way between two records, where the intervals have their middle
    roll = np.interp(records, time, -np.arcsin(beyond / 10.0))
    rolled = attitude.numeric.from_euler(roll, 0.0 * roll, 0.0 * roll)
    return specific_force(changes, records, level, sigma, rolled, from_s, float(COUNT))


@pytest.mark.parametrize(("left", "of_reference", "contradicted"), [
    ((0.1, 0.1), (0.6, 0.6), True), ((0.1, 0.1), (0.45, 0.45), False),  # 0.5 m/s^2 beyond the estimate
    ((2.0, 2.0), (2.6, 2.6), True), ((2.0, 2.0), (2.35, 2.35), False),  # and 1.25 times as much
    ((0.1, 0.1), (5.0, 0.3), False), ((0.1, 0.1), (0.3, 5.0), False),  # in both halves
])  # fmt: skip
def test_a_reference_is_contradicted_if_it_leaves_far_more_in_both_halves(left, of_reference, contradicted):
    found = judged(left, of_reference)
    assert found.contradicted == contradicted and found.intervals == COUNT
    assert found.estimate == pytest.approx(np.sqrt(np.mean(np.square(left))))
    if of_reference[0] == of_reference[1]:  # gravity turned leaves a little along itself
        assert found.reference == pytest.approx(of_reference[0], rel=0.01)
    assert bool(found.reference_contradicted()) == contradicted


def test_an_estimate_that_is_none_yet_is_not_judged():
    """Before its stated angles are below 10 deg, and before the statistics begin."""
    sigma = np.full((COUNT + 1, 3), 0.99 * SETTLED)
    sigma[:11, 2] = 1.01 * SETTLED
    assert judged((0.1, 0.1), (0.1, 0.1), sigma).intervals == COUNT - 10
    assert judged((0.1, 0.1), (0.1, 0.1), from_s=30.0).intervals == COUNT // 2
    assert judged((0.1, 0.1), (0.1, 0.1), 2.0 * np.ones_like(sigma)) is None

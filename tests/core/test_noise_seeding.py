"""The first numbers of many generators at once are those of NumPy's generators."""

import numpy as np
import pytest

from insenv.core.noise import FEW_SEEDS, first_uniforms


@pytest.mark.parametrize("number", [0, 1, FEW_SEEDS, FEW_SEEDS + 1, 300])
def test_they_are_the_numbers_of_numpy(number):
    edges = [0, 1, 2**32 - 1, 2**32, 2**53, 2**64 - 1]
    seeds = [*edges, *np.random.default_rng(7).integers(0, 2**53, 294).tolist()][:number]
    found = first_uniforms(seeds, 5)
    assert found.shape == (number, 5)
    for row, seed in zip(found, seeds, strict=True):
        assert row.tolist() == np.random.default_rng(seed).random(5).tolist()

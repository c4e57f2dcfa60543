"""Counter-based noise: the published generator, no number used twice; NumPy's first numbers for many seeds at once."""

import numpy as np
import pytest

from insenv.core.noise import FEW_SEEDS, START_STREAM, first_uniforms, philox, uniforms

ONES = 0xFFFFFFFF


@pytest.mark.parametrize(
    ("key", "counter", "expected"),
    [  # the known answers distributed with Random123
        ((0, 0), (0, 0, 0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((ONES, ONES), (ONES,) * 4, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        ((0xA4093822, 0x299F31D0), (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
         (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)),
    ],
)  # fmt: skip
def test_philox_gives_the_published_answers(key, counter, expected):
    assert tuple(int(word) for word in philox(key, counter)) == expected


def test_uniforms_are_inside_the_open_interval_and_flat():
    numbers = uniforms(12345, np.arange(50_000), 0, 7)
    assert numbers.shape == (50_000, 7)
    assert numbers.min() > 0 and numbers.max() < 1
    # mean of n uniforms: 1/2 +- 5 sigma
    assert abs(numbers.mean() - 0.5) < 5 / np.sqrt(12 * numbers.size)
    counts = np.histogram(numbers, 64, (0, 1))[0]
    chi2 = ((counts - numbers.size / 64) ** 2 / (numbers.size / 64)).sum()
    assert 20 < chi2 < 125  # 63 degrees of freedom: mean 63, 5 sigma 56


def test_numbers_of_one_seed_are_those_of_many():
    seeds, steps = np.array([[3, 2**53 - 1]]), np.array([[0], [2**40]])
    each = [[uniforms(seed, step, START_STREAM, 6) for seed in seeds[0].tolist()] for step in steps[:, 0].tolist()]
    assert np.array_equal(uniforms(seeds, steps, START_STREAM, 6), each)


def test_seed_step_stream_and_place_all_matter_and_order_does_not():
    base = uniforms(1, 10, 2, 4)
    for other in (uniforms(2, 10, 2, 4), uniforms(1, 11, 2, 4), uniforms(1, 10, 3, 4), uniforms(1 + 2**32, 10, 2, 4)):
        assert not np.intersect1d(base, other).size
    assert not np.intersect1d(base, uniforms(1, 10 + 2**32, 2, 4)).size
    assert uniforms(1, 10, START_STREAM, 4).tolist() != base.tolist()
    together = uniforms(9, np.arange(100), 1, 5)
    assert np.array_equal(together[37], uniforms(9, 37, 1, 5))
    assert np.array_equal(together[:, :3], uniforms(9, np.arange(100), 1, 3))


@pytest.mark.parametrize("number", [0, 1, FEW_SEEDS, FEW_SEEDS + 1, 300])
def test_they_are_the_numbers_of_numpy(number):
    edges = [0, 1, 2**32 - 1, 2**32, 2**53, 2**64 - 1]
    seeds = [*edges, *np.random.default_rng(7).integers(0, 2**53, 294).tolist()][:number]
    found = first_uniforms(seeds, 5)
    assert found.shape == (number, 5)
    for row, seed in zip(found, seeds, strict=True):
        assert row.tolist() == np.random.default_rng(seed).random(5).tolist()

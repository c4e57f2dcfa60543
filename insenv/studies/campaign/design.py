"""How varied keys are spread over the runs of a campaign: drawn independently, or by a design that covers the ranges evenly.

random    each value is a function of the seed of its run and the key
latin     Latin hypercube: each of n equal parts of every distribution is hit once (McKay, Beckman, Conover 1979)
sobol     scrambled Sobol sequence (Owen 1998)
saltelli  groups of k + 2 runs for first-order and total Sobol indices (Saltelli et al. 2010): run A, k runs that differ from
          A in one key, run B.  Within a group all but B share the seed; k: number of keys
"""

from __future__ import annotations

from collections.abc import Sequence
from inspect import signature
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import remark
from insenv.core.tables import Array
from insenv.scenario.variation import Variation

DESIGNS = ("random", "latin", "sobol", "saltelli")
LARGEST = 1 << 20
"""Largest number of runs of a design that is made as a whole."""
_EDGE = 2.0**-33
"""Distance of a uniform from 0 and 1: quantiles there are infinite."""


def check_design(design: str, runs: int, keys: int) -> None:
    """Raise `InputError` for a design that is unknown or does not fit the number of runs and keys."""
    if design not in DESIGNS:
        raise InputError(f"design = {design!r}: allowed is one of {', '.join(DESIGNS)}")
    if design == "random":
        return
    if not keys:
        raise InputError(f"design {design!r}: a design spreads varied keys: name one with vary")
    if runs > LARGEST:
        raise InputError(f"runs = {runs}: design {design!r} allows up to {LARGEST}")
    if design == "saltelli" and (runs % (keys + 2) or not _is_power(runs // (keys + 2))):
        some = (keys + 2) * 2 ** max(2, int(np.log2(max(runs // (keys + 2), 1))))
        raise InputError(
            f"runs = {runs}: a saltelli design of {keys} key{'s' if keys > 1 else ''} has groups of {keys + 2} runs, and their "
            f"number is a power of 2: "
            f"allowed is {some} or {2 * some}, for example"
        )


def _is_power(number: int) -> bool:
    return number > 0 and number & (number - 1) == 0


@remark("design-unbalanced", "a Sobol sequence is balanced for a power of 2: {runs} runs cover the ranges less evenly")
def unbalanced(design: str, runs: int) -> dict[str, int] | None:
    """A Sobol sequence with another number of runs."""
    return {"runs": runs} if design == "sobol" and not _is_power(runs) else None


@remark(
    "design-dependent", "the runs of a saltelli design share seeds and values: statistics are not those of independent runs"
)
def dependent(design: str) -> dict[str, Any] | None:
    """The runs of a design are not independent."""
    return {} if design == "saltelli" else None


def seed_of(design: str, first_seed: int, run: int, keys: int) -> int:
    """The seed of a run: they count up, except in a saltelli design, whose groups have one for run B and one for the others."""
    if design != "saltelli":
        return first_seed + run
    group, place = divmod(run, keys + 2)
    return first_seed + 2 * group + (place == keys + 1)


def whole_design(design: str, first_seed: int, runs: int, keys: int) -> Array:
    """Uniforms (runs, keys) of a design that is made as a whole."""
    from scipy.stats import qmc

    def options(kind: Any) -> dict[str, Any]:
        name = "rng" if "rng" in signature(kind.__init__).parameters else "seed"  # before scipy 1.15
        return {name: np.random.default_rng(first_seed)}

    if design == "latin":
        uniforms = qmc.LatinHypercube(keys, **options(qmc.LatinHypercube)).random(runs)
    elif design == "sobol":
        uniforms = qmc.Sobol(keys, **options(qmc.Sobol)).random_base2(max(0, (runs - 1).bit_length()))[:runs]
    else:
        groups = runs // (keys + 2)
        both = qmc.Sobol(2 * keys, **options(qmc.Sobol)).random_base2(groups.bit_length() - 1)
        a, b = both[:, :keys], both[:, keys:]
        crossed = [np.where(np.arange(keys) == k, b, a) for k in range(keys)]
        uniforms = np.stack([a, *crossed, b], axis=1).reshape(runs, keys)
    return np.clip(uniforms, _EDGE, 1.0 - _EDGE)


def numbers_of(variations: Sequence[Variation], uniforms: Array) -> Array:
    """Values (runs, keys) of all variations, those of choices as places."""
    columns = [variation.distribution.numbers(uniforms[:, place]) for place, variation in enumerate(variations)]
    return np.stack(columns, axis=1) if columns else np.zeros((len(uniforms), 0))

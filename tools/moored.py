"""Moored ships in seas of any period: heading by `fusion` and by the papers' alignments, beside the limit.

python tools/moored.py [first seed]           the table of docs/estimators/fusion.md, ten minutes
python tools/moored.py slow [first seed]      the other one: surges that are slower or larger than what fusion assumes
python tools/moored.py q-method [first seed]  that of q-method.md: an alignment in surges of all periods; four others alike
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import insenv
from insenv.evaluation.errors import CHANNELS
from insenv.scenario import load, parse
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import make_plan

RUNS, FIRST_SEED, AT_S = 64, 960000, (300.0, 600.0)
OTHERS = ("q-method", "inertial-fir", "ecef-kf")
HEADER = "\n".join((
    "| sea | limit | `fusion` | beyond 3 sigma | " + " | ".join(f"`{id}`" for id in OTHERS) + " |",
    "|---" * (4 + len(OTHERS)) + "|",
))  # fmt: skip
ALONE_HEADER = "| surge | heading | tilt | heading before | heading, rms (stated), at 45 deg |\n|---|---|---|---|---|"
ALONE_SEED, LATITUDES_DEG = 985000, (0.0, 45.0, 70.0)
FROM_S = {"inertial-fir": 200.0, "q-method": 120.0, "ecef-kf": 120.0, "qakf": 120.0, "qakf-improved": 120.0}
SLOW_HEADER = "| surge | limit | `fusion` | beyond 3 sigma: tilt, heading |\n|---|---|---|---|"


def surging(amplitude_m: float, period_s: float) -> dict[str, Any]:
    """`ship-slow-surge` with another surge."""
    values = values_of("ship-slow-surge")
    values["vehicle"]["sway"]["north"][1] = {"amplitude_m": amplitude_m, "period_s": period_s}
    return values


def values_of(name: str, **changes: Any) -> dict[str, Any]:
    """A shipped scenario for 600 s, with random phases and an unknown heading; changes: of [vehicle.sea]."""
    values = load(name).model_dump(mode="json", warnings=False)
    if values["vehicle"].get("sea"):
        values["vehicle"]["sea"] |= changes
    else:
        values["vehicle"]["random_phases"] = True
    values["knowledge"] = {**(values.get("knowledge") or {}), "heading_sigma_deg": 180.0}
    return {**values, "duration_s": AT_S[-1]}


SEAS = {
    **{f"surge of 0.3 m, {period:g} s": surging(0.3, period) for period in (5.0, 10.0, 25.0, 40.0, 60.0)},
    "`ship-swaying`": values_of("ship-swaying"),
    "`ship-irregular-sea`": values_of("ship-irregular-sea"),
    "the same, peak at 18 s": values_of("ship-irregular-sea", peak_period_s=18.0),
}
SURGES = {f"{a:g} m, {t:g} s": surging(a, t) for t in (12.0, 18.0, 25.0, 40.0, 60.0, 120.0) for a in (0.05, 0.3, 2.0)}
SLOW = {f"{size:g} m, {period:g} s": surging(size, period) for period in (30.0, 60.0, 120.0) for size in (0.05, 0.3, 1.0, 2.0)}


PARTS = CHANNELS.index("heading_deg"), [CHANNELS.index(name) for name in ("roll_deg", "pitch_deg")]


def campaign(values: dict[str, Any], id: str, first_seed: int) -> tuple[Any, ...]:
    """Times (k), errors and stated sigmas (runs, k, channels) of a scenario."""
    plan = make_plan(parse(values, "sea", "sea"), id, RUNS, first_seed=first_seed)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    return plan.times, *(np.concatenate([block[name] for block in blocks]) for name in ("error", "sigma"))


def alone(values: dict[str, Any], id: str, first_seed: int) -> tuple[str, ...]:
    """Largest shares (%) of heading and tilt beyond 3 sigma from `FROM_S` on, and of the heading before, at any latitude.

    And its heading at the end.
    """
    shares, at_end = [], ""
    for latitude_deg in LATITUDES_DEG:
        values["start"]["latitude_deg"] = latitude_deg
        times, error, sigma = campaign(values, id, first_seed)
        late = times >= FROM_S[id]
        beyond = 100 * np.mean(np.abs(error) > 3 * sigma, axis=0)
        shares.append([*(beyond[late][:, part].mean() for part in PARTS), beyond[~late][:, PARTS[0]].mean()])
        if latitude_deg == 45.0:
            rms, stated = (np.sqrt(np.mean(part[:, -1, PARTS[0]] ** 2)) for part in (error, sigma))
            at_end = f"{shown(rms)} ({shown(stated)})"
    return *(f"{shown(share)} %" for share in np.max(shares, axis=0)), at_end


def found(values: dict[str, Any], id: str, first_seed: int) -> tuple[str, str, str]:
    """Limit, rms (stated) of the heading at `AT_S` in deg, and shares (%) of tilt and heading beyond 3 sigma at any time."""
    scenario = parse(values, "sea", "sea")
    times, error, sigma = campaign(values, id, first_seed)
    limit = insenv.limit(scenario).at(np.array(AT_S))["heading_deg"]
    heading, tilts = PARTS
    at = [int(np.argmin(np.abs(times - seconds))) for seconds in AT_S]
    rms, stated = (np.sqrt(np.mean(part[:, at, heading] ** 2, axis=0)) for part in (error, sigma))
    beyond = [100 * np.mean(np.abs(error[:, :, k]) > 3 * sigma[:, :, k]) for k in (tilts, heading)]
    pairs = (f"{shown(one)} ({shown(other)})" for one, other in zip(rms, stated, strict=True))
    return ", ".join(map(shown, limit)), ", ".join(pairs), ", ".join(f"{shown(share)} %" for share in beyond)


def shown(value: float) -> str:
    """Two digits, and no exponent."""
    return f"{float(f'{value:.2g}'):g}" if value >= 1e-3 else "0"


if __name__ == "__main__":
    mode = next((name for name in ("slow", *FROM_S) if name in sys.argv), "")
    seeds = [int(argument) for argument in sys.argv[1:] if argument != mode]
    first = seeds[0] if seeds else ALONE_SEED if mode in FROM_S else FIRST_SEED
    print({"": HEADER, "slow": SLOW_HEADER}.get(mode, ALONE_HEADER))
    for name, values in {"": SEAS, "slow": SLOW}.get(mode, SURGES).items():
        if mode in FROM_S:
            cells: tuple[str, ...] = alone(values, mode, first)
        else:
            limit, by_fusion, beyond = found(values, "fusion", first)
            others = [] if mode == "slow" else [found(values, id, first)[1] for id in OTHERS]
            cells = (limit, by_fusion, beyond, *others)
        print(f"| {' | '.join([name, *cells])} |", flush=True)

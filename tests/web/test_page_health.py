"""The health that a page shows: the rule of `insenv.evaluation`, in JavaScript, gives the same verdicts and sentences."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insenv.estimators.parts.rows import FIX_HEALTH, aid_health
from insenv.evaluation.chi_square import quantile
from insenv.evaluation.health import VERDICTS, health
from insenv.files.resources import web_folder
from insenv.report.page.html import joined
from insenv.web.judging import health_rule

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="Node is not installed")
CASES = 400


def answers(entry: str, code: str, given: Any, folder: Path) -> Any:
    """What JavaScript `code` makes of `given` with the exports of a module of web/."""
    (folder / "given.json").write_text(json.dumps(given))
    text = f'const given = JSON.parse(require("fs").readFileSync("given.json"));\n{joined(web_folder(), entry)}'
    (folder / "go.cjs").write_text(f"{text}\nconsole.log(JSON.stringify({code}));\n")
    done = subprocess.run(["node", "go.cjs"], cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_quantiles_are_those_of_scipy(tmp_path: Path) -> None:
    degrees = np.geomspace(0.05, 1e6, 60).tolist()
    probabilities = list(health_rule()["probabilities"])
    code = "given[1].map((n) => given[0].map((p) => module_chisquare.chiSquareQuantile(p, n)))"
    found = answers("chisquare.js", code, [probabilities, degrees], tmp_path)
    np.testing.assert_allclose(found, [quantile(probabilities, n) for n in degrees], rtol=1e-7)


def measured(random: np.random.Generator, names: tuple[str, ...], groups: int) -> dict[str, np.ndarray]:
    """Records of an instrument: of a scale, slow or white, with refusals, some of them late."""
    records = int(random.integers(1, 120))
    fixes = random.integers(0, random.choice([2, 4]), records)
    ratios = random.normal(0.0, random.choice([0.5, 1.0, 1.05, 1.3, 4.0]), (records, groups)) ** 2
    if random.uniform() < 0.3:
        ratios *= np.linspace(0.2, random.choice([2.0, 60.0]), records)[:, None]
    share = random.choice([0.0, 0.02, 0.3, 0.7]) * (np.arange(records) > random.choice([0.0, 0.7]) * records)
    refused = random.binomial(fixes, share)
    used_number = 3 * np.repeat((fixes - refused)[:, None], groups, 1)
    left_number = np.repeat(refused[:, None], groups, 1)
    steps = (fixes, refused, ratios * used_number, used_number, 30.0 * ratios * left_number, left_number)
    return {name: np.cumsum(step, axis=0).astype(float) for name, step in zip(names, steps, strict=True)}


def test_verdicts_and_sentences_are_those_of_a_run(tmp_path: Path) -> None:
    random, given, expected = np.random.default_rng(17), [], []
    for case in range(CASES):
        fixes = measured(random, FIX_HEALTH.names, 2) if case % 4 else None
        aid = measured(random, aid_health("dvl"), 3) if case % 3 == 0 else None
        found = health({**(fixes or {}), **(aid or {})})
        expected.append(None if found is None else [found.verdict, *found.lines])
        given.append(
            [one and [np.reshape(values, (len(values), -1)).tolist() for values in one.values()] for one in (fixes, aid)]
        )
    code = """given[1].map((case_) => {
      const [fixes, dvl] = case_.map((one) => one && {
        records: one[0].length, count: (r) => one[0][r][0], refused: (r) => one[1][r][0],
        groups: one[2][0].map((_, k) => Object.fromEntries(
          ["used", "usedNumber", "left", "leftNumber"].map((name, at) => [name, (r) => one[at + 2][r][k]]))),
      });
      const found = module_health.healthOf(given[0], fixes, dvl ? { dvl } : {});
      return found && [found.verdict, ...found.lines];
    })"""
    assert answers("health.js", code, [health_rule(), given], tmp_path) == expected
    verdicts = [one and one[0] for one in expected]
    assert all(verdicts.count(verdict) > CASES // 20 for verdict in (*VERDICTS, None) if verdict) and None in verdicts

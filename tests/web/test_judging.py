"""What a page says at the end of a run, in Node: its records, judged by the compiled rules, give the sentences of a run."""

from types import SimpleNamespace

import numpy as np
import pytest
from live_pages import answers

from insenv.attitude import numeric
from insenv.estimators import get
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation.errors import Result, channels_of, stated_of
from insenv.evaluation.health import fixes_count_less, health, models_slow_errors, no_fix
from insenv.scenario import build, load
from insenv.web.judging import findings, health_rows, rules

CASES = 80


def measured(random, names, groups, records):
    fixes = random.integers(0, random.choice([1, 2, 4]), records)
    ratios = random.normal(0.0, random.choice([0.5, 1.0, 1.05, 1.3, 4.0]), (records, groups)) ** 2
    if random.uniform() < 0.3:
        ratios *= np.linspace(0.2, random.choice([2.0, 60.0]), records)[:, None]
    share = random.choice([0.0, 0.02, 0.3, 0.7]) * (np.arange(records) > random.choice([0.0, 0.7]) * records)
    compared = random.uniform() > 0.15
    refused = compared * random.binomial(fixes, share)
    used_number = 3 * compared * np.repeat((fixes - refused)[:, None], groups, 1)
    left_number = np.repeat(refused[:, None], groups, 1)
    steps = (fixes, refused, ratios * used_number, used_number, 30.0 * ratios * left_number, left_number)
    return {name: np.cumsum(step, axis=0).astype(float) for name, step in zip(names, steps, strict=True)}


@pytest.mark.parametrize(("scenario", "id", "scales", "wander", "codes"), [
    ("ship-dvl", "fusion", (1e-12, 0.3, 1e3), {}, "aid-misfit fixes-diverged fixes-overconfident no-fix no-fix-but-aids"),
    ("car-city-drive", "loosely-coupled", (1.0,), {"fix_wander_sigma": 1.0}, "fixes-count-less steep-pitch too-sure"),
    ("car-city-drive", "loosely-coupled", (1.0,), {"fix_wander_sigma": 0.0}, "fixes-slow-errors fixes-overconfident"),
    pytest.param("aircraft-inflight-alignment", "velocity-integration", (0.01, 3.0), {}, "heading-unknown too-sure",
                 marks=pytest.mark.slow),
])  # fmt: skip
def test_the_sentences_are_those_of_a_run(scenario, id, scales, wander, codes, tmp_path):
    plant = build(load(scenario))
    estimator = plant.adapted(get(id), None, offline=False)
    parameters = plant.parameters_of(estimator, offline=False) | wander
    table, random = estimator.model.outputs, np.random.default_rng(3)
    channels, stated = channels_of(table), stated_of(table)
    said, given, expected = set(), [], []
    for case in range(CASES):
        records, scale = int(random.integers(2, 120)), scales[case % len(scales)]
        time = np.arange(1.0, records + 1)
        outputs = {row.name: scale * np.abs(random.normal(size=(records, *row.shape))) ** (1 + 2 * (case % 2)) for row in table}
        outputs["q_nb"] = numeric.from_euler(*random.uniform(-1.4, 1.4, (3, records)))
        for names in (FIX_HEALTH.names if estimator.reports_fixes else (), *map(aid_health, reported_aids(table.names))):
            outputs |= measured(random, names, table[names[2]].size, records) if names else {}
        errors = {name: random.normal(size=records) for name in channels}
        sigma = {name: np.full(records, random.choice([0.2, 1.0])) for name in stated}
        fix_sigma = np.tile(np.exp(random.normal(0.0, 0.2, 3)), (records, 1))
        found = health(outputs) if estimator.reports_health else None
        notes = (
            *(each for each in estimator.shown(parameters, np.zeros(records), outputs) if each.code != "heading-found"),
            *(no_fix(found) if estimator.reports_fixes else ()),
            *(found.notes(models_slow_errors(parameters), estimator.causes) if found else ()),
            *fixes_count_less(parameters, outputs, fix_sigma),
        )
        result = Result(id, time, outputs, errors, sigma, {}, 0.5 * records, 0.0, notes).judged()
        said |= {each.code for each in result.notes}
        expected.append([found and [found.verdict, *found.lines], list(result.notes)])
        pitch = np.degrees(numeric.to_euler(outputs["q_nb"])[1]) - errors["pitch_deg"]
        truth = [
            time,
            np.stack([pitch] * 3, -1),
            fix_sigma,
            np.stack([*errors.values()], -1),
            *([np.stack([*sigma.values()], -1)] if sigma else []),
        ]
        given.append(np.column_stack([*(np.reshape(outputs[row.name], (records, -1)) for row in table), *truth]).tolist())
    places = {row.name: {"at": table.slice(row.name).start, "size": row.size} for row in table}
    end = table.size
    for name, size in (
        ("time", 1),
        ("attitude", 3),
        ("gnss_position_sigma", 3),
        ("error", len(channels)),
        ("sigma", len(stated)),
    ):
        places[name], end = {"at": end, "size": size}, end + size
    told = {
        "prefix": "", "channels": channels, "stated": stated, "settled": True, "health": health_rows(estimator, parameters),
        "findings": findings(estimator, parameters),
    }  # fmt: skip
    code = """(async () => {
      await module_judge.loadRules(given[0]);
      return given[1].map((records) => {
        const value = (place, record) => records[record][place];
        const history = { at: (name) => given[3][name], count: () => records.length, value };
        const one = { ...given[2], from_s: 0.5 * records.length };
        const found = module_judge.healthNow({ rules: given[0] }, one, history);
        return [found && [found.verdict, ...found.lines], module_judge.notesAtEnd({ rules: given[0] }, one, history, true)];
      });
    })()"""
    members = [SimpleNamespace(estimator=estimator)]
    assert answers("judge.js", code, [rules(members), given, told, places], tmp_path) == expected
    assert set(codes.split()) <= said

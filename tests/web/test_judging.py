"""The health that a page shows: the rule of `insenv.evaluation`, compiled, with the sentences of a run."""

import numpy as np
import pytest
from live_pages import answers

from insenv.estimators import get
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health
from insenv.evaluation.health import VERDICTS, fixes_count_less, health
from insenv.evaluation.nis import sums_of
from insenv.scenario import build, load
from insenv.web.judging import findings, rule

CASES = 200
CAUSES = {"dvl": "its scale factor"}


def measured(random, names, groups):
    records = int(random.integers(1, 120))
    fixes = random.integers(0, random.choice([2, 4]), records)
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


def test_verdicts_and_sentences_are_those_of_a_run(tmp_path):
    random, given, expected = np.random.default_rng(17), [], []
    for case in range(CASES):
        fixes = measured(random, FIX_HEALTH.names, 2) if case % 4 else None
        aids = [measured(random, aid_health(id), 2) if case % many == 0 else None for id, many in (("dvl", 3), ("odometer", 5))]
        found = health({name: values for one in (fixes, *aids) for name, values in (one or {}).items()})
        expected.append(None if found is None else [found.verdict, *found.lines, *found.notes(case % 2 == 1, CAUSES)])
        given.append([one and sums_of(one, tuple(one)).tolist() for one in (fixes, *aids)])
    code = """(() => {
      const bytes = Buffer.from(given[0].wasm, "base64");
      module_health.useRule(new WebAssembly.Instance(new WebAssembly.Module(bytes)));
      return given[1].map((case_, at) => {
        const [fixes, dvl, odometer] = case_.map((rows) =>
          rows && { records: rows.length, columns: rows[0].map((_, k) => (record) => rows[record][k]) });
        const found = module_health.healthOf(given[0], fixes, { ...(dvl && { dvl }), ...(odometer && { odometer }) });
        const notes = found && module_health.healthNotes(given[0], found, at % 2 === 1, given[2]);
        return found && [found.verdict, ...found.lines, ...notes];
      });
    })()"""
    assert answers("health.js", code, [rule(2), given, CAUSES], tmp_path) == expected
    verdicts = [one and one[0] for one in expected]
    assert all(verdicts.count(verdict) > CASES // 20 for verdict in (*VERDICTS, None) if verdict) and None in verdicts


@pytest.mark.parametrize(
    ("scenario", "id", "scales"),
    [("aircraft-inflight-alignment", "velocity-integration", (0.01, 3.0)), ("ship-dvl", "fusion", (1e-12, 0.3, 1e3))],
)
def test_findings_are_those_of_a_run(scenario, id, scales, tmp_path):
    plant = build(load(scenario))
    estimator = plant.adapted(get(id), None, offline=False)
    table, random = estimator.model.outputs, np.random.default_rng(3)
    parameters = plant.parameters_of(estimator, offline=False)
    given, expected = [], []
    for case in range(60):
        scale = scales[case % len(scales)]
        outputs = {row.name: scale * random.normal(size=(2, *row.shape)) ** (3 if case % 2 else 1) for row in table}
        if "attitude_sigma" in outputs:
            outputs["attitude_sigma"] = np.abs(outputs["attitude_sigma"])
        given.append([np.concatenate([np.ravel(values[k]) for values in outputs.values()]).tolist() for k in (0, 1)])
        expected.append(
            [note for note in estimator.shown(parameters, np.zeros(2), outputs) if not note.startswith("heading found")]
        )
    places = {row.name: {"at": table.slice(row.name).start} for row in table}
    told = {"prefix": "", "health": None, "channels": [], "settled": False, "findings": findings(estimator, parameters)}
    code = """given[1].map((records) => module_judge.notesAtEnd(
      { rule: given[0] }, given[2], (name) => given[3][name] ?? { at: 0 },
      { count: () => records.length, value: (place, record) => records[record][place] }, true))"""
    assert answers("judge.js", code, [rule(0), given, told, places], tmp_path) == expected
    assert [] in expected and len({sentence for one in expected for sentence in one}) > 1


def test_a_filter_that_is_worse_than_one_fix_is_told_as_in_a_run(tmp_path):
    random, given, expected = np.random.default_rng(5), [], []
    for case in range(20):
        count = np.cumsum(random.integers(0, 2, 12 + case)).astype(float)
        outputs = {"fix_count": count, "position_sigma": np.exp(random.normal(0.0, 0.3, (len(count), 3)))}
        fix_sigma = np.tile(np.exp(random.normal(0.0, 0.2, 3)), (len(count), 1))
        given.append(np.column_stack([count, outputs["position_sigma"], fix_sigma]).tolist())
        expected.append([str(one) for one in fixes_count_less({"fix_wander_sigma": 1.0}, outputs, fix_sigma)])
    places = {"fix_count": {"at": 0}, "position_sigma": {"at": 1}, "gnss_position_sigma": {"at": 4}}
    code = """given[1].map((records) => module_judge.countedLess(given[0], { prefix: "" }, (name) => given[2][name],
      { count: () => records.length, value: (place, record) => records[record][place] }))"""
    assert answers("judge.js", code, [rule(0), given, places], tmp_path) == expected
    assert 3 < expected.count([]) < 17

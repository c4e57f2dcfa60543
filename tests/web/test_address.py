"""Links to a live page: what they cannot mean is one sentence, and what they can is written and read alike."""

from urllib.parse import quote

import numpy as np
import pytest
from live_pages import CAR, SHIP, answers

from insenv.web.live import live, live_document

WINDOWS = ("5", "[[5,1]]", "[[-5,1]]")
BROKEN = {  # by scenario: fragment and what is said
    "ship": {
        "#imu.mass_kg=3": "imu.mass_kg: this page has no control of that name",
        "#seed=1.5": "seed = 1.5: allowed is a whole number",
        "#seed=2&seed=3": "seed stands in the link more than once: allowed is one value",
        "#start.latitude_deg=95": "start.latitude_deg = 95 deg: allowed is -80 to 80 deg",
        '#commands=[[1,{"sail":1}]]': 'unknown command "sail"',
        "#commands=[1": "commands = [1: allowed is a list of values",
        '#commands=[[5,{"sea":1}],[4,{"sea":1}]]': "commands at sample 4: allowed are whole numbers in order",
        '#commands=[[0,{"sea":null}]]': "command sea = null: allowed is 0 to 3",
        "#commands=q1ZK": "commands = q1ZK: allowed is a list of values",
    },
    "car": {f"#gnss.outages_s={quote(text)}": f"gnss.outages_s = {text} s: allowed are pairs of a begin" for text in WINDOWS},
}
SAID = "Promise.all(given[1].map((f) => module_address.stateOf(f, given[0]).then(() => null, (e) => e.message)))"
READ = "module_address.addressOf(given[1], 1).then(async (link) => [link, await module_address.stateOf(link, given[0])])"


@pytest.fixture
def document(monkeypatch):
    """Documents of live pages without their WebAssembly, by the arguments of a page."""
    monkeypatch.setattr("insenv.web.live.wasm", lambda source: b"")
    return lambda scenario, estimators, duration_s: live_document(live(scenario, estimators, duration_s=duration_s))


@pytest.mark.parametrize(("kind", "page"), [("ship", SHIP), pytest.param("car", CAR, marks=pytest.mark.slow)])
def test_a_broken_link_is_one_sentence(document, kind, page, tmp_path):
    found = answers("address.js", SAID, [document(*page), list(BROKEN[kind])], tmp_path)
    told = dict(zip(BROKEN[kind], found, strict=True))
    wrong = {fragment: said for fragment, said in told.items() if BROKEN[kind][fragment] not in (said or "")}
    assert wrong == {}


@pytest.mark.slow
def test_a_state_is_written_and_read_alike(document, tmp_path):
    values = {"imu.grade": "navigation", "gnss.outages_s": [[1.5, 20]], "start.latitude_deg": -3.25}
    moves = (np.random.default_rng(3).integers(0, 101, (200, 2)) * [0.15, 0.002]).round(3).tolist()  # ten seconds of dragging
    driven = [{"sample": 10 * k, "values": {"speed": v, "yaw_rate": w, "slope": 0.1}} for k, (v, w) in enumerate(moves)]
    state = {"seed": 7, "values": values, "commands": driven}
    link, back = answers("address.js", READ, [document(*CAR), state], tmp_path)
    assert back == state and "seed=7" in link and "imu.grade=navigation" in link and len(link) < 2000


def test_a_command_in_a_link_changes_what_it_names_and_keeps_the_rest(tmp_path):
    rows = [{"name": f"command_{name}", "unit": "1", "minimum": 0, "maximum": 9} for name in "ab"]
    live = {"seed": 1, "controls": [], "outages": [], "commands": {}, "tables": {"inputs": rows}}
    given = [(5, {"a": 1, "b": 2}), (9, {"a": 3, "b": 2}), (9, {"a": 3, "b": 4}), (12, {"a": 1, "b": 4})]
    state = {"seed": 1, "values": {}, "commands": [{"sample": sample, "values": values} for sample, values in given]}
    assert answers("address.js", READ, [live, state], tmp_path)[1] == state


def test_what_a_run_had_that_another_has_not_is_named(tmp_path):
    controls = [{"key": f"a.{key}", "label": key, "unit": unit, "value": own} for key, unit, own in
                (("grade", "", "marine"), ("turn", "deg", 3.0), ("wind", "m/s", None), ("sway", "m", 1.0))]  # fmt: skip
    live = {"controls": controls, "outages": [{"key": "gnss.outages_s"}], "commands": None}

    def state(seed=1, **values):
        return {"seed": seed, "values": {f"a.{key}": value for key, value in values.items()}}

    driven = {**state(), "commands": [{"sample": 3, "values": {"speed": 1.0}}]}
    cut = {"seed": 1, "values": {"gnss.outages_s": [[1, 2]]}}
    every = state(2, grade="consumer", turn=4, wind=5, sway=6)
    pairs = [[state(), state()], [state(), every], [state(turn=4.0, wind=2), state()], [state(), driven], [cut, state()]]
    told = ["", "seed 1, grade marine, 3 other settings", "turn 4 deg, wind 2 m/s", "other commands", "other outages"]
    code = "given[1].map(([was, now]) => module_ghost.difference(given[0], was, now))"
    assert answers("ghost.js", code, [live, pairs], tmp_path) == told

"""Remarks: a code and a text each, filled in without losing the code; every note in a document has one."""

import pickle
import re

import pytest
from campaigns import car, slow_ship
from interpreted import interpreted  # noqa: F401
from places import ROOT

import insenv
from insenv.base.remarks import TEXTS, Caveat, clock

LOG = ROOT / "examples" / "logs"
DOCUMENTS = {
    "run": (lambda: insenv.run("car-city-drive", "loosely-coupled", duration_s=2.0), "motion-errors-as-noise"),
    "replay": (lambda: insenv.replay(LOG / "px4-takeoff.ulg.gz", "fusion", start="reference"), "unit-used"),
    "campaign": (lambda: insenv.campaign(slow_ship(), "q-method", 2, duration_s=2.0), "too-short"),
    "comparison": (lambda: insenv.campaign(car(), ["wander-sins", "analytic"], 2, duration_s=2.0), "times-differ"),
    "budget": (lambda: insenv.budget(slow_ship(), "q-method", 2, duration_s=2.0), "too-short"),
    "tune": (lambda: insenv.tune(slow_ship(), "q-method", runs=2, held_out=2, evaluations=4, duration_s=2.0), "too-short"),
    "allan": (lambda: insenv.allan(LOG / "plain.toml", from_s=60.0, to_s=80.0), "moves-in-part"),
}


def noted(values):
    """The parts of a document that have notes, with them."""
    if isinstance(values, dict) and (notes := values.get("notes", values.get("warnings"))) is not None:
        yield values, notes
    for each in values.values() if isinstance(values, dict) else values if isinstance(values, list) else ():
        yield from noted(each)


@pytest.mark.parametrize(
    "command", [pytest.param(name, marks=pytest.mark.slow) if name in ("allan", "tune") else name for name in DOCUMENTS]
)
def test_every_note_of_a_document_has_a_code(command):
    make, code = DOCUMENTS[command]
    parts = list(noted(make().as_json()))
    assert all([each["text"] for each in part["remarks"]] == notes for part, notes in parts)
    assert code in {each["code"] for part, _ in parts for each in part["remarks"]} <= TEXTS.keys()


def test_codes_are_kebab_case_and_stay_with_the_sentence():
    assert all(re.fullmatch(r"[a-z]+(-[a-z]+)*", code) for code in TEXTS)
    said = pickle.loads(pickle.dumps(Caveat("a-code", "{one:.2g} of {other}").filled(one=0.123).of("x")))
    assert said == "x: 0.12 of {other}" and said.code == "a-code" and isinstance(said, Caveat)


def test_times_of_logs_that_count_from_a_date_are_printed_in_full():
    assert [clock(time) for time in (20.0, 12345.678, 1726480000.123456, 1726480001.0)] == [
        "20", "12345.7", "1726480000.123", "1726480001",
    ]  # fmt: skip

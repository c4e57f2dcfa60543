"""Remarks: a code and a text each, filled in without losing the code."""

import pickle
import re

import insenv
from insenv.base.remarks import TEXTS, Caveat


def test_codes_are_kebab_case_and_stay_with_the_sentence():
    report = insenv.run("car-city-drive", "loosely-coupled", duration_s=2.0)
    assert report.results[0].notes and all(re.fullmatch(r"[a-z]+(-[a-z]+)*", code) for code in TEXTS)
    values = report.as_json()["results"][0]
    assert [each["text"] for each in values["remarks"]] == values["notes"] and values["remarks"][0]["code"] in TEXTS
    said = pickle.loads(pickle.dumps(Caveat("a-code", "{one:.2g} of {other}").filled(one=0.123)))
    assert said == "0.12 of {other}" and said.code == "a-code" and isinstance(said, Caveat)
